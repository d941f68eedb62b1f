"""Gather the constraints on a pose in one frame: surface, outlines, floor, and body parts that must not intersect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numba import njit

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints, join, surface_constraints
from anchorpose.body.kinematics import missing_points
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, PosedPoints, SkinPoints, pose_points
from anchorpose.body.visibility import Projection, pixels_of, projection_of
from anchorpose.camera import Camera
from anchorpose.isolation.depth_noise import DepthNoise
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.surface import Nodes, Surface
from anchorpose.threads import each

# m, sigma of the place of the patient's outline, which flickers by one to two pixels at a distance of 2.5 m
OUTLINE_SIGMA_M: Final = 0.020
# pixels, minimum width of an object that may hide a limb; the rim of missing readings around a silhouette is thinner
THICK_PX: Final = 5

_TRUNK: Final = ("Hips", "LowerBack", "Spine", "Spine1", "LHipJoint", "RHipJoint")
_LIMBS: Final = ("ForeArm", "Hand", "FingerBase", "HandFinger1", "Thumb")
_FOOT: Final = ("Foot", "ToeBase")
_SHANK: Final = ("Leg", *_FOOT)
# m; a place this deep below the skin of one shank must not lie inside the other shank: shanks may touch, but not
# coincide. The value is half of a shank's thickness
_FLESH_M: Final = 0.03
# m, half a trunk's thickness. A point deeper than this inside a body part is not pushed out of it, since the skin
# nearest to the point may be on the wrong side
_DEEPEST_M: Final = 0.15
_ALLOWED_M: Final = 0.01  # m, allowed depth of one body part inside another, since soft tissue gives way
# m, allowed depth of skin below the floor, since the floor's height and the soles of approximate bodies have errors
_ALLOWED_FLOOR_M: Final = 0.03
_SIGMA_M: Final = 0.01  # m, sigma of the rows that push skin out of other body parts and out of the floor
# m, sigma of a foot's height above the floor. With this sigma, a foot at the height ``_IN_THE_AIR_M`` makes a pose less
# probable by 3 nats, and a far higher foot by 6 nats; in rehabilitation, 95 of 100 feet stand on the floor, and
# ln(95/5) is 3
_STANDING_M: Final = 0.14
# m above the floor, scale of the robust kernel for a foot's height: at this height the cost is half of its limit
_IN_THE_AIR_M: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The data of one frame to which a person's body is registered."""

    surface: Nodes | Surface  # nodes of the person's seen surface; edges are not needed
    views: tuple[View | None, ...]  # each camera's depth image with labels; None without a depth image
    outlines: tuple[np.ndarray | None, ...]  # from ``find_outline``; None without a depth image that shows the person
    cameras: tuple[Camera, ...]
    floor_m: float | None = None  # m, height of the floor in the world; None if unknown
    label: int = PixelLabel.PATIENT  # the person's pixel label
    noises: tuple[DepthNoise | None, ...] = ()  # each camera's noise; None without a depth image; empty if unknown


def gather_evidence(
    surface: Nodes,
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    floor_m: float | None = None,
    noises: Sequence[DepthNoise | None] = (),
) -> Evidence:
    """Return the evidence of one frame for the patient. The outlines of the patient are computed here, once for all
    registrations to this frame.
    """
    outlines = tuple(each(lambda view: None if view is None else find_outline(view), views))
    return Evidence(surface, tuple(views), outlines, tuple(cameras), floor_m, noises=tuple(noises))


def node_noise(evidence: Evidence, thinned: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Return the sigma (n,), metres, of each node's place along its normal, due to the noise of the node's camera. Also
    return the number (n,) of the patch of pixels to which each node belongs. All nodes of a patch share one error.

    thinned: share of the nodes that are used. If few nodes are used, a node may represent more pixels than a patch has.
    In this case, the denoising of the depth image averages the errors of several patches at the node. The node then has
    less noise and shares its error with no other node, so its patch contains this node alone. Sigma is 0 if the noise
    of the node's camera is unknown.
    """
    surface, noise_m = evidence.surface, np.zeros(len(evidence.surface))
    patch = np.arange(len(surface))
    for number, noise in enumerate(evidence.noises):
        view, camera = evidence.views[number], evidence.cameras[number]
        mine = np.flatnonzero(surface.camera == number)
        if view is None or noise is None or not len(mine):
            continue
        ray = surface.points_m[mine] - camera.position_m
        depth_m = ray @ camera.require_pose()[:3, 2]
        cosine = np.abs((ray * surface.normals[mine]).sum(axis=1)) / np.linalg.norm(ray, axis=1)
        cosine = np.minimum(cosine, 1.0)
        sharing = noise.shared_px * thinned * len(mine) / max(int(view.patient.sum()), 1)
        along_m = cosine * noise.sigma_m(depth_m, np.degrees(np.arccos(cosine)))
        noise_m[mine] = along_m * min(1.0, np.sqrt(sharing))
        if sharing > 1.0:
            row, column = (surface.pixel[mine] / np.sqrt(noise.shared_px)).astype(np.int64).T
            patch[mine] = len(surface) + (row * camera.width + column) * len(evidence.noises) + number
    return noise_m, patch


def rows_alike(evidence: Evidence, config: RegistrationConfig) -> float:
    """Return the number of constraint rows that count as one observation in this frame. The noisier the cameras, the
    larger the number.

    If only clothes and folds cause errors, the number of rows that count as one observation is the setting
    ``rows_per_observation``. A sensor that smooths its images gives a whole patch of nodes the same error
    (``node_noise``). For such noise, a second term is added to ``rows_per_observation``. For each node, the variance of
    its noise is multiplied by the number of used nodes in its patch. The second term is the mean of these products over
    all nodes, divided by the variance of the surface error (``surface_sigma_m``).
    """
    used = min(config.node_count, len(evidence.surface)) / len(evidence.surface)
    noise_m, patch = node_noise(evidence, used)
    together = np.maximum(used * np.bincount(patch)[patch], 1.0)
    return config.rows_per_observation + float(np.mean(noise_m**2 * together)) / config.surface_sigma_m**2


def evidence_rows(
    body: Body, pose: Pose, evidence: Evidence, reach_m: float, config: RegistrationConfig
) -> Constraints:
    """Return all constraint rows for a pose. Each node of the seen surface pulls the skin point nearest to the node, if
    this point is within reach_m. Skin points that a camera should see, but does not, are pulled to the patient's
    outline. Forearms and hands are pushed out of the trunk, and the left shank out of the right shank. Skin more than
    ``_ALLOWED_FLOOR_M`` below the floor is pulled up to this depth, and feet are pulled to the floor.
    """
    posed = pose_points(body, pose)
    rows = [surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config)]
    rows.append(separation_rows(body, posed))
    if evidence.floor_m is not None:
        rows.append(floor_rows(posed, evidence.floor_m))
        rows.append(standing_rows(body, posed, evidence.floor_m, config.rows_per_observation))
    for view, outline, camera in zip(evidence.views, evidence.outlines, evidence.cameras, strict=True):
        if view is not None and outline is not None:
            rows.append(outline_constraints(posed, view, outline, camera, reach_m))
    return join(rows)


def find_outline(view: View) -> np.ndarray | None:
    """Return (height, width) bool: pixels where the patient is seen or may be hidden; None if the patient is not in the
    view.

    The patient may be hidden behind equipment, behind another person, and at pixels without a reading. The patient
    cannot be at a pixel that shows the background, or another person farther from the camera than the patient. The thin
    rim of lost and wrong readings along every silhouette counts as background.
    """
    import cv2

    patient = view.patient
    if not patient.any():
        return None
    other = view.labels >= PixelLabel.OTHER_PERSON
    unseen = (view.labels != PixelLabel.BACKGROUND) & ~patient
    if other.any():
        unseen &= ~(other & (view.depth_m > np.median(view.depth_m[patient])))
    thick = cv2.morphologyEx(unseen.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK_PX, THICK_PX), np.uint8))
    return np.asarray(patient | (thick > 0))


def outline_constraints(
    posed: PosedPoints, view: View, outline: np.ndarray, camera: Camera, reach_m: float
) -> Constraints:
    """Return rows that pull skin points that should be seen, but are not, to the patient's outline.

    If a pixel shows the background or another person, the patient's skin cannot be in front of what the pixel shows,
    since the camera would see this skin instead. A skin point at such a place is pulled sideways, at its own depth, to
    the nearest pixel of ``outline``, where the patient is seen or may be hidden. Skin points at pixels with any other
    label, such as equipment or no reading, get no row.
    """
    point, target, direction = _stray_rows(
        posed.points_m, projection_of(camera), view.labels, view.depth_m, outline, camera.pixel_rays(), reach_m
    )
    return Constraints.alike(point, target, direction, OUTLINE_SIGMA_M, reach_m)


@njit(cache=True, nogil=True)
def _stray_rows(
    points: np.ndarray,
    projection: Projection,
    labels: np.ndarray,
    depth: np.ndarray,
    possible: np.ndarray,
    rays: np.ndarray,
    reach: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows of ``outline_constraints``: the index (n,) of each row's skin point, the target (n, 3) and the
    unit direction (n, 3) of the pull. A skin point gets no row if it would have to move farther than three times
    ``reach`` to a pixel that is True in ``possible``, the patient's outline.
    """
    column, row, distance = pixels_of(points, projection, labels.shape[0], labels.shape[1])
    T_world_camera, focal_px = projection.T_world_camera, max(projection.lens[0], projection.lens[1])
    kept, count = np.empty(len(points), np.int64), 0
    target, direction = np.empty((len(points), 3)), np.empty((len(points), 3))
    for p in range(len(points)):
        if column[p] < 0 or not _stray(labels[row[p], column[p]], depth[row[p], column[p]], distance[p] + reach):
            continue
        reach_px = 3.0 * reach / distance[p] * focal_px
        goal_row, goal_column = nearest_possible(possible, row[p], column[p], int(reach_px) + 2)
        if goal_row < 0:
            continue
        x, y = rays[goal_row, goal_column, 0] * distance[p], rays[goal_row, goal_column, 1] * distance[p]
        squared = 0.0
        for i in range(3):
            target[count, i] = T_world_camera[i, 3] + T_world_camera[i, 0] * x + T_world_camera[i, 1] * y
            target[count, i] += T_world_camera[i, 2] * distance[p]
            direction[count, i] = points[p, i] - target[count, i]
            squared += direction[count, i] ** 2
        length = np.sqrt(squared)
        if not 1e-4 < length < 3.0 * reach:
            continue
        for i in range(3):
            direction[count, i] /= length
        kept[count] = p
        count += 1
    return kept[:count].copy(), target[:count].copy(), direction[:count].copy()


@njit(cache=True, nogil=True)
def _stray(label: int, depth: float, farthest: float) -> bool:
    """Return whether a pixel shows the background or another person farther away than ``farthest``. A pixel that has
    one of these labels but no reading counts as farther away, too. farthest: the maximum depth of a reading that may
    still show the tested skin point.
    """
    if label != PixelLabel.BACKGROUND and label < PixelLabel.OTHER_PERSON:
        return False
    return depth <= 0.0 or depth > farthest


@njit(cache=True, nogil=True)
def nearest_possible(possible: np.ndarray, row: int, column: int, reach_px: int) -> tuple[int, int]:
    """Return row and column of the True pixel nearest to the pixel (row, column), at most reach_px rows and columns
    away; -1, -1 without such a pixel.
    """
    height, width = possible.shape
    best, best_row, best_column = np.inf, -1, -1
    for ring in range(reach_px + 1):
        if ring * ring >= best:
            break
        for r in range(max(0, row - ring), min(height - 1, row + ring) + 1):
            # pixels are searched in growing square rings; between its top and bottom row, a ring has only two pixels in
            # each row
            step = 1 if abs(r - row) == ring else max(1, 2 * ring)
            for c in range(column - ring, column + ring + 1, step):
                if c < 0 or c >= width or not possible[r, c]:
                    continue
                away = (r - row) ** 2 + (c - column) ** 2
                if away < best:
                    best, best_row, best_column = away, r, c
    return best_row, best_column


@cache
def trunk_and_arms(points: SkinPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the skin points on the trunk, and of the skin points on forearms and hands."""
    names = np.array(points.asset.bone_names)[points.part]
    trunk = np.flatnonzero(np.isin(names, _TRUNK))
    arms = np.flatnonzero([str(name).endswith(_LIMBS) for name in names])
    return trunk, arms


@cache
def shanks(points: SkinPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the skin points on the left shank and foot, and on the right shank and foot."""
    names = np.array(points.asset.bone_names)[points.part]
    left, right = (np.flatnonzero(np.isin(names, [f"{side}{part}" for part in _SHANK])) for side in ("Left", "Right"))
    return left, right


def separation_rows(body: Body, posed: PosedPoints) -> Constraints:
    """Return rows that push body parts out of each other, towards the nearest skin of the other part.

    Each skin point of a forearm or hand inside the trunk gets a row. Shanks may touch, so a skin point of the left
    shank or foot gets a row only if the place at the depth ``_FLESH_M`` below this point is inside the right shank or
    foot. Without these rows, both shanks could be fitted to the seen surface of one shank.
    """
    (trunk, arms), (left, right) = trunk_and_arms(body.points), shanks(body.points)
    return join([_pushed_out(body, posed, arms, trunk, 0.0), _pushed_out(body, posed, left, right, _FLESH_M)])


def _pushed_out(body: Body, posed: PosedPoints, limb: np.ndarray, part: np.ndarray, below_m: float) -> Constraints:
    """Return rows that push the skin points ``limb`` out of the body part with the skin points ``part``. A point gets a
    row if the place ``below_m`` metres below the point, inside the limb, is also inside the part by more than
    ``_ALLOWED_M``.
    """
    if body.shape.missing:
        limb = limb[~missing_points(body.points.asset, body.points.part[limb], body.shape.missing)]
    shift_m = below_m * posed.normals
    near, nearest = _nearest(posed.points_m - shift_m, posed.points_m, limb, part)
    limb, skin = limb[near], part[nearest]
    target_m = posed.points_m[skin] + shift_m[limb]
    inside = ((target_m - posed.points_m[limb]) * posed.normals[skin]).sum(axis=1) > _ALLOWED_M
    limb, skin = limb[inside], skin[inside]
    return Constraints.alike(limb, target_m[inside], posed.normals[skin], _SIGMA_M, 2.0 * _DEEPEST_M)


def floor_rows(posed: PosedPoints, floor_m: float) -> Constraints:
    """Return a row that pulls upwards for each skin point more than ``_ALLOWED_FLOOR_M`` below the floor."""
    below = np.flatnonzero(posed.points_m[:, 1] < floor_m - _ALLOWED_FLOOR_M)
    target = posed.points_m[below].copy()
    target[:, 1] = floor_m - _ALLOWED_FLOOR_M
    up = np.tile((0.0, 1.0, 0.0), (len(below), 1))
    return Constraints.alike(below, target, up, _SIGMA_M, 2.0 * _DEEPEST_M)


def standing_rows(body: Body, posed: PosedPoints, floor_m: float, rows_per_observation: float) -> Constraints:
    """Return a row for each foot that pulls its lowest skin point to the floor. The row counts as one observation, or
    as less if the foot is far above the floor. If no camera sees a leg, this row keeps the foot of the leg on the
    floor.
    """
    feet = [foot[posed.points_m[foot, 1].argmin()] for foot in _feet(body.points, body.shape.missing) if len(foot)]
    target = posed.points_m[feet].copy()
    target[:, 1] = floor_m
    up = np.tile((0.0, 1.0, 0.0), (len(feet), 1))
    return Constraints.alike(
        np.array(feet, np.int64), target, up, _STANDING_M / rows_per_observation**0.5, _IN_THE_AIR_M
    )


@cache
def _feet(points: SkinPoints, missing: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return the indices of the skin points on the left and on the right foot; empty for a foot that the body lacks."""
    names = np.array(points.asset.bone_names)[points.part]
    there = ~missing_points(points.asset, points.part, missing)
    left, right = (
        np.flatnonzero(np.isin(names, [f"{side}{part}" for part in _FOOT]) & there) for side in ("Left", "Right")
    )
    return left, right


@njit(cache=True, nogil=True)
def _nearest(
    asked: np.ndarray, points: np.ndarray, arms: np.ndarray, trunk: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find, for each of the places ``asked[arms]``, the nearest of the skin points ``points[trunk]``, if it is nearer
    than ``_DEEPEST_M``. Return two index arrays, with an entry per place that has such a skin point: the position of
    the place in ``arms``, and the position of its nearest skin point in ``trunk``. Instead of arms and trunk, the
    caller may pass the skin points of two shanks.
    """
    near, nearest, count = np.empty(len(arms), np.int64), np.empty(len(arms), np.int64), 0
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for t in range(len(trunk)):
        for i in range(3):
            low[i] = min(low[i], points[trunk[t], i] - _DEEPEST_M)
            high[i] = max(high[i], points[trunk[t], i] + _DEEPEST_M)
    for a in range(len(arms)):
        x, y, z = asked[arms[a], 0], asked[arms[a], 1], asked[arms[a], 2]
        if not (low[0] < x < high[0] and low[1] < y < high[1] and low[2] < z < high[2]):
            continue
        best, found = _DEEPEST_M * _DEEPEST_M, -1
        for t in range(len(trunk)):
            up = points[trunk[t], 1] - y
            if up * up >= best:
                continue
            away = up * up + (points[trunk[t], 0] - x) ** 2 + (points[trunk[t], 2] - z) ** 2
            if away < best:
                best, found = away, t
        if found >= 0:
            near[count], nearest[count] = a, found
            count += 1
    return near[:count], nearest[:count]
