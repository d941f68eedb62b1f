"""The tips of the body's own skin, where the anchors of a frame lie, and the constraints that anchors put on them."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.constraints import Constraints, place_constraints
from anchorpose.body.skin_points import SkinPoints
from anchorpose.geodesics.anchors import Anchors

_ANCHOR_SIGMA_M: Final = 0.05  # the paper's bound on the localisation of anchors (Section V)


@cache
def anchor_points(points: SkinPoints) -> np.ndarray:
    """(5,) skin points at the tips that the anchors lie on, in the order of ``ANCHOR_NAMES``."""
    place = points.asset.vertices[points.vertex]
    names = np.array(points.asset.bone_names)[points.part]
    tips = []
    for words, axis in (
        (("Head",), (0, 1, 0)),
        (("LeftHand", "LeftFingerBase", "LeftHandFinger1"), None),
        (("RightHand", "RightFingerBase", "RightHandFinger1"), None),
        (("LeftFoot", "LeftToeBase"), (1, 0, 0)),
        (("RightFoot", "RightToeBase"), (1, 0, 0)),
    ):
        own = np.flatnonzero(np.isin(names, words))
        sideways = np.abs(place[own] @ np.array([0.4, -0.4, 0.0])) + np.abs(place[own, 2])
        reach = place[own] @ np.array(axis) if axis else sideways
        tips.append(own[reach.argmax()])
    return np.array(tips)


def anchor_constraints(points: SkinPoints, anchors: Anchors, sigma_m: float = _ANCHOR_SIGMA_M) -> Constraints:
    """The anchors that were found hold the tips."""
    found = anchors.found
    return place_constraints(anchor_points(points)[found], anchors.position_m[found], sigma_m, 5.0 * sigma_m)
