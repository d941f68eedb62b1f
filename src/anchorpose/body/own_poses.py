"""Poses of the whole body by which skin lies where it is seen, whatever was predicted (``own_surface``)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.constraints import place_constraints
from anchorpose.body.fit import damped_step
from anchorpose.body.own_surface import LEAST_NODES, match_skin
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.geodesics.anchors import SeenGeodesics

MATCH_SIGMA_M: Final = 0.05  # of a match, as of an anchor (``initial.anchor_constraints``)
MATCH_SCALES_M: Final = (0.5, 0.5, 0.5, 0.5, 0.15, 0.15, 0.15, 0.15)  # of each step: limbs come from far at first
MATCHES_PER_OBSERVATION: Final = 8.0  # neighbours are wrong together, as in ``RegistrationConfig``


def poses_of_own_surface(body: Body, seen: SeenGeodesics) -> Iterator[Pose]:
    """Poses of the whole body by which the matched skin lies where it is seen, from a neutral posture.

    One with the anchors' names as found, and one with left and right exchanged, since they are exchanged where the body
    was thought to face the other way. None where fewer than three anchors reach enough nodes.
    """
    for mirrored in (False, True):
        matches = match_skin(body, seen, mirrored)
        if len(matches.node) >= LEAST_NODES:
            places = seen.whole.points_m[matches.node].astype(np.float64)
            yield settle_on(body, neutral(body, matches.point, places), matches.point, places)


def neutral(body: Body, point: np.ndarray, places_m: np.ndarray) -> Pose:
    """The rest pose, turned and moved as a whole so that skin points (m,) lie as near as possible to places (m, 3)."""
    asset = body.points.asset
    rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
    own = pose_points(body, Pose(rotations, np.zeros(3))).points_m[point]
    turn, _ = Rotation.align_vectors(places_m - places_m.mean(axis=0), own - own.mean(axis=0))
    rotations[asset.bone("Hips")] = turn.as_matrix()
    moved = pose_points(body, Pose(rotations, np.zeros(3))).points_m[point]
    return Pose(rotations, (places_m - moved).mean(axis=0))


def settle_on(body: Body, pose: Pose, point: np.ndarray, places_m: np.ndarray) -> Pose:
    """A few damped steps that bring skin points (m,) to places (m, 3)."""
    for scale_m in MATCH_SCALES_M:
        rows = place_constraints(point, places_m, MATCH_SIGMA_M, scale_m)
        pose = damped_step(body, pose, rows, None, MATCHES_PER_OBSERVATION)
    return pose
