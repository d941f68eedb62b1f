"""Decide, from the skin around a joint, whether cameras see the joint or what hides it; find depth images of poor
quality.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import cache
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.config import VisibilityConfig
from anchorpose.body.kinematics import shape_body
from anchorpose.body.skin_points import PosedPoints, SkinPoints
from anchorpose.camera import Camera, invert_rigid
from anchorpose.isolation.depth_noise import LIMB_M, DepthDetail
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_COUNT, JointState
from anchorpose.lens import lens_array, pixel_of_ray

# m, radius around a joint within which skin decides whether the joint counts as seen
JOINT_RADIUS_M: Final = 0.13
# m, radius as ``JOINT_RADIUS_M``, but for joints of the spine, which lie this far from the skin of the belly
TRUNK_RADIUS_M: Final = 0.22
# a camera sees a joint if it sees at least this share of the camera-facing skin around the joint
LEAST_SEEN: Final = 0.2
# if more than this share of the camera-facing skin around a joint lies outside the image, the camera does not see the
# joint
MOST_OUTSIDE: Final = 0.5
# minimum cosine between the skin's normal and the direction to the camera for skin to count as facing the camera; below
# this cosine, almost no readings exist
GRAZING: Final = 0.25

_TRUNK = ("Hips", "Spine")
_REASONS = (
    JointState.OBSERVED,
    JointState.HIDDEN_BY_SELF,
    JointState.HIDDEN_BY_EQUIPMENT,
    JointState.HIDDEN_BY_PERSON,
    JointState.HIDDEN,
    JointState.OUT_OF_VIEW,
)


class SkinReason(IntEnum):
    """The kind of reading that a camera has at a skin point's pixel: it shows the point, or gives the reason why the
    camera does not see the point. The value of each kind except the last is the index of the corresponding joint state
    in ``_REASONS``.
    """

    SEEN = 0  # the pixel shows the patient, at the depth of the point
    SELF = 1  # the pixel shows the patient, in front of the point
    EQUIPMENT = 2  # the pixel shows equipment, at the depth of the point or in front of it
    PERSON = 3  # the pixel shows another person, at the depth of the point or in front of it
    # the pixel has no usable reading, or shows an object of the room at the depth of the point or in front of it
    HOLE = 4
    OUTSIDE = 5  # the point lies outside the image
    # the camera sees past the point: it reads something farther away, or the pixel shows the background without a
    # reading
    PAST = 6


class Projection(NamedTuple):
    """A camera's pose and lens as arrays, for compiled code."""

    T_world_camera: np.ndarray  # (4, 4)
    T_camera_world: np.ndarray  # (4, 4)
    lens: np.ndarray  # as in ``lens_array``


def projection_of(camera: Camera) -> Projection:
    """Return a camera's ``Projection``; raises the errors of ``Camera.require_pose``."""
    T_world_camera = np.array(camera.require_pose(), np.float64, order="C")
    return Projection(T_world_camera, np.array(invert_rigid(T_world_camera), order="C"), lens_array(camera.intrinsics))


@cache
def skin_around_joints(points: SkinPoints) -> tuple[np.ndarray, ...]:
    """Return, for each joint, the skin points that decide its visibility. In the rest pose, these points lie around the
    joint, on the body parts that meet at the joint.
    """
    asset: BodyAsset = points.asset
    body = shape_body(asset, np.zeros(1))
    place = body.vertices[points.vertex]
    around = []
    for joint, bone in zip(body.rest_joints(), joint_bones(asset), strict=True):
        distance = np.linalg.norm(place - joint, axis=1)
        radius = TRUNK_RADIUS_M if asset.bone_names[bone] in _TRUNK else JOINT_RADIUS_M
        near = distance < max(radius, np.partition(distance, 24)[24])
        related = np.isin(points.part, [bone, asset.bone_parents[bone], *np.flatnonzero(asset.bone_parents == bone)])
        around.append(np.flatnonzero(near & related))
    return tuple(around)


def joint_states(
    points: SkinPoints,
    posed: PosedPoints,
    covering: np.ndarray,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    config: VisibilityConfig,
) -> tuple[JointState, ...]:
    """Return each joint's state: observed if any camera sees the joint, else the most frequent reason why the skin
    around the joint is hidden.

    covering (p,) bool: skin points that are nearest to a node of the surface (``Explanation.covering``). Skin that lies
    at the patient's pixels but covers no node, such as an arm inside the trunk, counts as behind the seen surface. A
    joint is lost if no camera sees the patient at the joint, and some camera reads something farther away at more of
    the skin points around the joint than are hidden from this camera or outside its image.
    """
    votes = np.zeros((JOINT_COUNT, SkinReason.PAST + 1))
    observed, possible, refuted = (np.zeros(JOINT_COUNT, dtype=bool) for _ in range(3))
    around = skin_around_joints(points)
    for view, camera in zip(views, cameras, strict=True):
        if view is None:
            continue
        reason, facing = skin_reasons(posed, view, camera, config.reach_m)
        behind = (reason == SkinReason.SEEN) & ~covering
        reason = np.where(behind, SkinReason.SELF, reason)
        for joint, skin in enumerate(around):
            towards = skin[facing[skin]]
            if not len(towards):
                votes[joint, SkinReason.SELF] += 1.0
                continue
            counts = np.bincount(reason[towards], minlength=SkinReason.PAST + 1)
            inside = counts[SkinReason.OUTSIDE] <= MOST_OUTSIDE * len(towards)
            observed[joint] |= inside and counts[SkinReason.SEEN] >= LEAST_SEEN * len(towards)
            possible[joint] |= counts[SkinReason.SEEN] + behind[towards].sum() >= LEAST_SEEN * len(towards)
            # a single camera is enough: other cameras, whose view of the joint may be blocked, do not count against it
            refuted[joint] |= counts[SkinReason.PAST] > counts[SkinReason.SELF : SkinReason.PAST].sum()
            votes[joint] += counts / len(towards)
    votes[:, SkinReason.SEEN] = 0.0
    # if no camera has an image, a hole counts as the reason
    votes[:, SkinReason.HOLE] += (votes.sum(axis=1) == 0.0) & ~observed
    misfit = ~possible & refuted
    reasons = [_REASONS[vote[: SkinReason.PAST].argmax()] for vote in votes]
    states = [JointState.OBSERVED if seen else why for seen, why in zip(observed, reasons, strict=True)]
    return tuple(JointState.LOST if odd else state for odd, state in zip(misfit, states, strict=True))


def seen_skin(
    posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera], config: VisibilityConfig
) -> np.ndarray:
    """Return (p,) bool: whether each skin point faces a camera that sees the point as part of the patient."""
    seen = np.zeros(len(posed.points_m), dtype=bool)
    for view, camera in zip(views, cameras, strict=True):
        if view is not None:
            reason, facing = skin_reasons(posed, view, camera, config.reach_m)
            seen |= facing & (reason == SkinReason.SEEN)
    return seen


def facing_skin(posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera]) -> np.ndarray:
    """Return (p,) bool: whether each skin point faces a camera that has a depth image of the frame."""
    facing = np.zeros(len(posed.points_m), dtype=bool)
    for view, camera in zip(views, cameras, strict=True):
        if view is not None:
            facing |= _turned_to(posed.points_m, posed.normals, camera.position_m, GRAZING)
    return facing


def skin_reasons(posed: PosedPoints, view: View, camera: Camera, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the ``SkinReason`` (p,) of each skin point, and (p,) bool: whether the point faces the camera.

    reach_m: maximum depth difference between a skin point and a reading that still counts as a reading of this point.
    """
    column, row, far = pixels_of(posed.points_m, projection_of(camera), *view.labels.shape)
    reason = _read(column, row, far, view.labels, view.depth_m, reach_m)
    return reason, _turned_to(posed.points_m, posed.normals, camera.position_m, GRAZING)


@njit(cache=True, nogil=True)
def pixels_of(
    points: np.ndarray, projection: Projection, height: int, width: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the column and row (n,) of each point's pixel, -1 outside the image, and the point's depth z (n,) in
    metres.

    ``Camera.pixel_of`` is the reference implementation.
    """
    T_camera_world, lens = projection.T_camera_world, projection.lens
    column, row = np.full(len(points), -1, np.int64), np.full(len(points), -1, np.int64)
    depth, place = np.empty(len(points)), np.empty(3)
    for p in range(len(points)):
        for i in range(3):
            place[i] = T_camera_world[i, 3]
            for j in range(3):
                place[i] += T_camera_world[i, j] * points[p, j]
        depth[p] = place[2]
        if place[2] <= 1e-6:
            continue
        u, v = pixel_of_ray(place[0] / place[2], place[1] / place[2], lens)
        if -0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5:
            c, r = int(np.rint(u)), int(np.rint(v))
            if 0 <= c < width and 0 <= r < height:
                column[p], row[p] = c, r
    return column, row, depth


@njit(cache=True, nogil=True)
def _read(
    column: np.ndarray, row: np.ndarray, far: np.ndarray, labels: np.ndarray, depth: np.ndarray, reach: float
) -> np.ndarray:
    """Return the ``SkinReason`` (p,) int64 from label and depth of each point's pixel; column -1 stands for a point
    outside the image.
    """
    reason = np.full(len(column), np.int64(SkinReason.PAST))
    for p in range(len(column)):
        if column[p] < 0:
            reason[p] = SkinReason.OUTSIDE
            continue
        label, z = labels[row[p], column[p]], np.float64(depth[row[p], column[p]])
        before, near = z < far[p] - reach, abs(z - far[p]) <= reach
        if label == PixelLabel.NO_READING:
            reason[p] = SkinReason.HOLE
        elif label == PixelLabel.PATIENT:
            reason[p] = SkinReason.SEEN if near else (SkinReason.SELF if before else SkinReason.PAST)
        elif label == PixelLabel.EQUIPMENT and (before or near):
            reason[p] = SkinReason.EQUIPMENT
        elif label >= PixelLabel.OTHER_PERSON and (before or near):
            reason[p] = SkinReason.PERSON
        elif (label == PixelLabel.BACKGROUND or label == PixelLabel.CLUTTER) and z > 0.0 and (before or near):
            reason[p] = SkinReason.HOLE
    return reason


@njit(cache=True, nogil=True)
def _turned_to(points: np.ndarray, normals: np.ndarray, eye: np.ndarray, grazing: float) -> np.ndarray:
    """Return (p,) bool: whether the cosine between the normal of each skin point and the direction to the camera is
    above ``grazing``.
    """
    facing = np.empty(len(points), np.bool_)
    for p in range(len(points)):
        towards, squared = 0.0, 0.0
        for axis in range(3):
            ray = eye[axis] - points[p, axis]
            towards += ray * normals[p, axis]
            squared += ray * ray
        facing[p] = towards > grazing * np.sqrt(squared)
    return facing


# a depth image is poor if more than this share of the camera-facing skin has no usable reading
MOST_MISSING: Final = 0.5


class PoorKind(StrEnum):
    """The kind of defect that makes a camera's depth images poor."""

    EDGES = "edges"  # edges blurred by filters, or by pixels as wide as a limb
    STEPS = "steps"  # coarse steps from one possible depth value to the next
    HOLES = "holes"  # readings missing on most of the patient's skin


@dataclass(frozen=True, slots=True)
class PoorDepth:
    """The reason why one camera's depth image of a frame is too poor to find joints."""

    camera: str
    kind: PoorKind
    # m, width of an edge or height of a step at the patient's distance; for holes, the share, 0 to 1, of the patient's
    # camera-facing skin without a usable reading
    amount: float

    @property
    def resolves_limbs(self) -> bool:
        """Return whether the existing readings resolve limbs. The readings do so if holes are the only defect; then
        only joints at holes become hidden.
        """
        return self.kind is PoorKind.HOLES


def too_coarse(camera: str, detail: DepthDetail, distance_m: float) -> PoorDepth | None:
    """Return the defect that makes depth too coarse at this distance: edges or steps wider than a limb; None without a
    defect.
    """
    edge_m, step_m = detail.edge_m(distance_m), detail.step_m(distance_m)
    if max(edge_m, step_m) <= LIMB_M:
        return None
    kind = PoorKind.EDGES if edge_m >= step_m else PoorKind.STEPS
    return PoorDepth(camera, kind, max(edge_m, step_m))


def poor_depth(
    posed: PosedPoints,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    details: Sequence[DepthDetail | None],
    reach_m: float,
) -> tuple[PoorDepth | None, ...]:
    """Return, for each camera, why its depth image of the patient is too poor for joints; None if the image is good
    enough or does not show the patient.

    posed: the body in its registered pose. details: one per camera, None without a depth image of the frame.
    """
    return tuple(
        None if view is None or detail is None else _of_camera(posed, view, camera, detail, reach_m)
        for view, camera, detail in zip(views, cameras, details, strict=True)
    )


def _of_camera(posed: PosedPoints, view: View, camera: Camera, detail: DepthDetail, reach_m: float) -> PoorDepth | None:
    distance_m = distance_of(view)
    if distance_m is None:
        return None
    coarse = too_coarse(camera.name, detail, distance_m)
    missing = missing_share(posed, view, camera, reach_m)
    if coarse is None and missing > MOST_MISSING:
        return PoorDepth(camera.name, PoorKind.HOLES, missing)
    return coarse


def distance_of(view: View) -> float | None:
    """Return the median depth (m) of the patient in a view; None if the view does not show the patient."""
    depth = view.depth_m[view.patient]
    return float(np.median(depth)) if depth.size else None


def missing_share(posed: PosedPoints, view: View, camera: Camera, reach_m: float) -> float:
    """Return the share, 0 to 1, of the camera-facing skin inside the image that has no usable reading.

    Skin hidden by a person or equipment has a reading, so this skin does not count as missing. Skin behind another
    object of the room counts as missing (``SkinReason.HOLE``).
    """
    reason, facing = skin_reasons(posed, view, camera, reach_m)
    inside = reason[facing & (reason != SkinReason.OUTSIDE)]
    return float(np.count_nonzero(inside == SkinReason.HOLE) / max(1, len(inside)))
