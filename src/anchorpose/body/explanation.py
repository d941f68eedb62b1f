"""Measure how well a pose explains a frame, from the frame's depth images alone, without predictions from other frames.

Two quantities show that a limb is misplaced. The first is the area of the patient's seen skin that no part of the posed
body covers. The second is the share of each limb's skin that a camera sees past, that is, where the camera sees
something farther away than the posed skin.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
from numba import njit

from anchorpose.body.constraints import thin
from anchorpose.body.evidence import Evidence
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.pose import LIMB_OF_BONES, PARTS, SEGMENT_OF_BONES
from anchorpose.body.skin_points import PosedPoints, SkinPoints
from anchorpose.body.visibility import SkinReason, skin_reasons
from anchorpose.camera import Camera
from anchorpose.isolation.view import View

# m; a skin point covers a node if the node is nearer than this; the distance allows for the thickness of clothes, the
# spacing of skin points and half the thickness of a forearm
COVERED_M: Final = 0.06
NODES: Final = 2500  # maximum number of nodes that are examined; registration uses the same number of nodes
# minimum number of a limb's camera-facing skin points; with fewer points, the share of the limb that the camera sees
# past (where it sees something farther away) is unreliable
LEAST_FACING: Final = 8


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """The measures of how well a pose explains a frame: the nodes (seen points of the patient's skin) that the posed
    skin covers, and the share of the posed skin that cameras see past (where they see something farther away).
    """

    covered: np.ndarray  # (c,) int, index of each examined node that posed skin covers
    node: np.ndarray  # (u,) int, index of each examined node that no posed skin covers
    thinned: float  # ratio of the number of surface nodes to the number of examined nodes
    # m2, area of the patient's seen skin that the uncovered nodes of one camera represent; the largest value of all
    # cameras
    uncovered_m2: float
    # (PARTS,) share of each limb's camera-facing skin that a camera sees past (where it sees something farther away);
    # the largest value of all cameras; NaN if too little of the limb is in view
    seen_past: np.ndarray
    # (p,) bool, whether the skin point covers a node, that is, is the point nearest to one of the nodes ``covered``
    covering: np.ndarray


@lru_cache(maxsize=2)  # cached, since registration and the frame's estimate both need the result
def explain(points: SkinPoints, posed: PosedPoints, evidence: Evidence) -> Explanation:
    """Measure how well a posed body explains one frame."""
    chosen = thin(len(evidence.surface), NODES)
    nearest = nearest_point(posed.points_m, evidence.surface.points_m[chosen].astype(np.float64), COVERED_M)
    bare = chosen[nearest < 0]
    covering = np.zeros(len(posed.points_m), dtype=bool)
    covering[nearest[nearest >= 0]] = True
    thinned = len(evidence.surface) / max(1, len(chosen))
    area = node_area_m2(evidence) * thinned
    uncovered = np.bincount(evidence.surface.camera[bare], minlength=len(area)) * area
    past = seen_past(points, posed, evidence.views, evidence.cameras)
    return Explanation(chosen[nearest >= 0], bare, thinned, float(uncovered.max(initial=0.0)), past, covering)


def node_area_m2(evidence: Evidence) -> np.ndarray:
    """Return (c,) m2: for each camera, the area of skin that a single node of this camera represents, measured
    perpendicular to the rays; 0 for a camera without nodes.
    """
    area = np.zeros(len(evidence.cameras))
    count = np.bincount(evidence.surface.camera, minlength=len(area))
    for number, (view, camera) in enumerate(zip(evidence.views, evidence.cameras, strict=True)):
        if view is not None and count[number]:
            depth = view.depth_m[view.patient]
            squares = float(depth.astype(np.float64) @ depth) / (camera.intrinsics.fx * camera.intrinsics.fy)
            area[number] = squares / count[number]
    return area


def seen_past(
    points: SkinPoints, posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera]
) -> np.ndarray:
    """Return ``Explanation.seen_past`` (PARTS,): the share of each limb's camera-facing skin that a camera sees past
    (where it sees something farther away); the largest value of all cameras. A camera sees past a skin point if the
    reading at the point's pixel lies more than ``COVERED_M`` behind the point, or if the pixel shows the background
    without a reading. Hidden skin counts as not seen past.
    """
    most = np.full(PARTS, np.nan)
    for past, counted in _seen_past_counts(points, posed, views, cameras):
        most = np.fmax(most, np.where(counted >= LEAST_FACING, past / np.maximum(counted, 1), np.nan))
    return most


def seen_past_by_all(
    points: SkinPoints, posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera]
) -> np.ndarray:
    """Return (PARTS,) the share of each limb's camera-facing skin that cameras see past (where they see something
    farther away), counted over all cameras together. If it is uncertain which way the body faces, this share is more
    reliable than the largest share of a single camera (``seen_past``): a camera that sees the body from the side sees
    past more of the body than other cameras do, so the largest share would depend on this camera alone.
    """
    counts = [np.zeros((2, PARTS)), *(np.stack(one) for one in _seen_past_counts(points, posed, views, cameras))]
    past, counted = np.sum(counts, axis=0)
    return np.where(counted >= LEAST_FACING, past / np.maximum(counted, 1), np.nan)


def _seen_past_counts(
    points: SkinPoints, posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield, for each camera with an image, two numbers of skin points per limb (PARTS,): points that the camera sees
    past (it sees something farther away there), and points that the camera could see past, as in ``_count_past``.
    """
    limb = limb_of_points(points)
    for view, camera in zip(views, cameras, strict=True):
        if view is None:
            continue
        reason, facing = skin_reasons(posed, view, camera, COVERED_M)
        yield _count_past(limb, reason, facing)


@njit(cache=True, nogil=True)
def _count_past(limb: np.ndarray, reason: np.ndarray, facing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return, per limb (PARTS,), how many skin points the camera sees past (it sees something farther away there), and
    how many skin points face the camera. Points outside the image and points at holes (``SkinReason.HOLE``) are not
    counted.
    """
    past, counted = np.zeros(PARTS, np.int64), np.zeros(PARTS, np.int64)
    for p in range(len(limb)):
        if facing[p] and reason[p] != SkinReason.OUTSIDE and reason[p] != SkinReason.HOLE:
            past[limb[p]] += reason[p] == SkinReason.PAST
            counted[limb[p]] += 1
    return past, counted


@cache
def limb_of_points(points: SkinPoints) -> np.ndarray:
    """Return the limb (p,) of each skin point: 1 left arm, 2 left leg, 3 right arm, 4 right leg, 0 trunk and head."""
    return np.asarray(LIMB_OF_BONES[_bone_of_points(points)])


@cache
def segment_of_points(points: SkinPoints) -> np.ndarray:
    """Return the body segment (p,) of each skin point: half of a limb or of the trunk, as in ``SEGMENT_OF_BONES``."""
    return np.asarray(SEGMENT_OF_BONES[_bone_of_points(points)])


def _bone_of_points(points: SkinPoints) -> np.ndarray:
    """Return (p,) the index in ``MOVING_BONES`` of the bone that moves each skin point most. If ``MOVING_BONES`` does
    not contain this bone, return the index of the bone's nearest ancestor in ``MOVING_BONES``.
    """
    found, parents = np.zeros(len(points.part), np.int64), points.asset.bone_parents
    row = {int(bone): number for number, bone in enumerate(points.moving)}
    for bone in np.unique(points.part):
        moving = int(bone)
        while moving not in row and moving >= 0:
            moving = int(parents[moving])
        found[points.part == bone] = row.get(moving, 0)
    return found
