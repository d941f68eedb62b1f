"""Segments on which what is seen stands off the learnt body by more than clothes do: an orthosis, a cast, a bandage.

There the body model does not fit, however well it was learnt: bones and joints of such a segment are less certain.
"""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.asset import BodyAsset
from anchorpose.body.segments import SIDES, TRUNK
from anchorpose.body.skin_points import CLOTHES, FittedShape, SkinPoints
from anchorpose.joints import JOINT_INDEX
from anchorpose.recording.subject import CoveredPart

LEAST_M: Final = 0.015  # at 95 of 100 skin points: 0.010 at most on ten people without braces, 0.021 to 0.040 with one
JOINT_SHARE: Final = 1.0 / 3.0  # of it, by which the joints at both ends may be off along an axis
BONE_SHARE: Final = 0.5  # of it, by which the length between them may be

_LIMBS: Final = {
    "upper_arm": ("Arm", ("Shoulder", "Elbow")), "forearm": ("ForeArm", ("Elbow", "Wrist")),
    "thigh": ("UpLeg", ("Hip", "Knee")), "shank": ("Leg", ("Knee", "Ankle")),
}  # fmt: skip
"""The bone of each segment, and the joints at its ends."""


def standing_off(points: SkinPoints, shape: FittedShape) -> dict[CoveredPart, float]:
    """Segments, named as in ``subject.covered``, and how far what is seen stands off there, metres."""
    off_m = np.abs(points.covered[:, len(CLOTHES) :] @ shape.offset_m[len(CLOTHES) :])
    found = {name: float(np.percentile(off_m[mine], 95)) for name, mine in _points_of(points).items()}
    return {name: away_m for name, away_m in found.items() if away_m > LEAST_M}


def standing_off_sigma_m(points: SkinPoints, shape: FittedShape) -> np.ndarray:
    """(21,) by how much a joint may be off along an axis, 0 where clothes are all that the person wears."""
    sigma = np.zeros(len(JOINT_INDEX))
    for name, away_m in standing_off(points, shape).items():
        for joint in _joints_of(name):
            sigma[joint] = max(sigma[joint], JOINT_SHARE * away_m)
    return sigma


def _joints_of(name: CoveredPart) -> tuple[int, ...]:
    if name == "trunk":
        return tuple(JOINT_INDEX[joint] for joint in ("SpineBase", "SpineMid", "SpineShoulder"))
    segment, side = name.rsplit("_", 1)
    return tuple(JOINT_INDEX[f"{joint}{side.capitalize()}"] for joint in _LIMBS[segment][1])


@cache
def _points_of(points: SkinPoints) -> dict[CoveredPart, np.ndarray]:
    """(p,) bool by segment: the skin points that move with it."""
    bones: dict[CoveredPart, tuple[str, ...]] = {"trunk": TRUNK}
    for segment, (bone, _) in _LIMBS.items():
        bones |= {f"{segment}_{side}": (f"{side.capitalize()}{bone}",) for side in SIDES}  # type: ignore[misc]
    return {name: np.isin(points.part, _rows(points.asset, chosen)) for name, chosen in bones.items()}


def _rows(asset: BodyAsset, names: tuple[str, ...]) -> list[int]:
    return [asset.bone(name) for name in names]
