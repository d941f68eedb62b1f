"""Limbs laid along the paths of anchors that the pose contradicts: the geodesic from a limb's end is the limb's axis.

The end of a limb shows where the limb is, whatever skin the body covers: an arm laid on the wrong side of a walker
covers its rail, and nothing is uncovered.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from anchorpose.body.limb_proposals import CHAINS, Chain, LimbPath, limb_poses
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.body.tips import anchor_points
from anchorpose.geodesics.anchors import Anchors, SeenGeodesics
from anchorpose.geodesics.center import center_field, limb_path
from anchorpose.joints import ANCHOR_NAMES

CONTRADICTED_M: Final = 0.15  # from an anchor to the tip of its limb: worth a proposal once limbs are looked for
INSIDE_TIP_M: Final = 0.03  # by which an anchor lies nearer to the centre than its limb's tip: half of a cap's depth


def anchor_paths(body: Body, pose: Pose, seen: SeenGeodesics) -> Iterator[tuple[LimbPath, tuple[Chain, ...]]]:
    """The paths of the hands and feet that the pose contradicts, and of free ends; with the limbs that each may be.

    A hand may be the end of either arm, a foot that of either leg: sides are exchanged where the body was thought to
    face the other way. A free end may be that of any limb.
    """
    anchors, elsewhere = seen.anchors, contradicted_by(body, pose, seen.anchors, CONTRADICTED_M)
    ends = [
        (int(anchors.node[number]), INSIDE_TIP_M, tuple(chain for chain in CHAINS if _ends_in(chain, name)))
        for number, name in enumerate(ANCHOR_NAMES)
        if elsewhere[number]
    ]
    ends += [(cap.tip, 0.0, CHAINS) for cap in anchors.free]
    ends = [end for end in ends if end[2]]  # no limb ends in the head
    if not ends:
        return
    field = center_field(seen.whole)
    for node, beyond_m, chains in ends:
        nodes = limb_path(seen.whole, field, node)
        points, normals = (values[nodes].astype(np.float64) for values in (seen.whole.points_m, seen.whole.normals))
        yield LimbPath(points, -normals, beyond_m + field.distance_m[node] - field.distance_m[nodes]), chains


def contradicted_by(body: Body, pose: Pose, anchors: Anchors, beyond_m: float) -> np.ndarray:
    """(5,) bool: anchors that the picture shows farther than ``beyond_m`` from their tips; False for missed ones."""
    tips = pose_points(body, pose).points_m[anchor_points(body.points)]
    away_m = np.linalg.norm(anchors.position_m - tips, axis=1)  # NaN for a missed one
    return np.asarray(away_m > beyond_m)


def anchor_poses(body: Body, pose: Pose, seen: SeenGeodesics) -> Iterator[Pose]:
    """The pose with one limb laid along the path of an anchor."""
    for path, chains in anchor_paths(body, pose, seen):
        yield from limb_poses(body, pose, path, chains)


def _ends_in(chain: Chain, anchor: str) -> bool:
    """Whether a limb ends in an anchor of that name, of whatever side."""
    return anchor.startswith(("Hand", "Foot")) and chain.joints[0][:4] == anchor[:4]
