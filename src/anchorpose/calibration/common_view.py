"""Compare the people that two cameras see at the same moments, to find the pose of one camera relative to the other.

The pose is refined by point-to-plane least squares (Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C). Points
are paired by projective association in both directions: a point of one camera is paired with the point that the other
camera sees at the pixel to which the first point projects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np

from anchorpose.calibration.first_frames import MAD_OF_NORMAL, FloorPlane
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.rotations import rigid

NEARER_M: Final = 0.12  # m; a reading nearer than the room by more than this is a reading of a person
SURFACE_STEP_M: Final = 0.07  # m, maximum depth difference between neighbouring pixels of one surface
NORMAL_PX: Final = 2  # pixels, distance of the neighbours from which a normal is computed
# pixels, side of the window that adds a rim of 3 pixels to people; at a distance of 2 m, this rim is 2 cm wide, as far
# as a limb moves between two frames
RIM_PX: Final = 7
# m, maximum distance of paired points in each iteration; the initial poses are off by at most 0.3 m
GATES_M: Final = (0.4, 0.4, 0.4, 0.3, 0.3, 0.3, 0.2, 0.2, 0.2, 0.15, 0.1, 0.06, 0.04, 0.03, 0.03)
WORST_CONDITION: Final = 1e9  # maximum condition number of the fit; beyond it, a rotation or a shift is undetermined
SAME_WAY: Final = 0.8  # minimum cosine between the normals of one surface in two cameras
HUBER: Final = 1.5  # limit in robust standard deviations; residuals above it lose weight
LEAST_PAIRS: Final = 200  # minimum number of pairs of points; a hand has fewer


class SurfaceGates(NamedTuple):
    """Limits for pixels whose normal is used: maximum depth step to neighbours, minimum cosine of the angle between
    normal and ray.
    """

    step_m: float
    least_facing: float


# limits for pixels whose normal is used; on surfaces seen at a flatter angle, normals are too noisy
GATES: Final = SurfaceGates(2.0 * SURFACE_STEP_M, 0.25)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """Surface points of one depth frame: points, normals (n, 3) float64, camera frame; person (n,) bool: points on
    people, not on the room.
    """

    points_m: np.ndarray
    normals: np.ndarray
    person: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class LevelView:
    """The view of one camera, with a level coordinate frame that has its origin on the floor.

    T_level_camera (4, 4): Y up, origin on the floor below the camera, X level along its optical axis; depths_m: its
    depth frames (height, width) at the moments that all cameras share; smooth_m: the same after ``smoothed``; people
    (height, width) bool, one per frame: pixels of people, with a rim; seen: surface points, one entry per frame.
    """

    camera: Camera
    T_level_camera: np.ndarray
    depths_m: tuple[np.ndarray, ...]
    smooth_m: tuple[np.ndarray, ...]
    people: tuple[np.ndarray, ...]
    seen: tuple[Seen, ...]


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceFit:
    """The fitted pose T_first_second (4, 4) between camera frames. residual_m: robust standard deviation of the
    distances from point to plane; impossible: share of one camera's points on people that lie where the other camera
    sees no people; common: share of these points inside the other camera's depth image; both shares are computed from
    the first to the second camera and vice versa, and the worse value is stored; sigma_m, sigma_rad: standard errors of
    position and rotation, if the errors of different moments are independent.
    """

    T_first_second: np.ndarray
    residual_m: float
    impossible: float
    common: float
    sigma_m: float
    sigma_rad: float

    @property
    def sentence(self) -> str:
        """Return a sentence for users that states the residuals."""
        return (
            f"surfaces agree to {1000.0 * self.residual_m:.1f} mm, {100.0 * self.impossible:.0f} % of the people one "
            f"sees fall beside those of the other, ± {1000.0 * self.sigma_m:.1f} mm, "
            f"± {np.degrees(self.sigma_rad):.2f} degrees"
        )


def level_view(
    camera: Camera, floor: FloorPlane, background_m: np.ndarray | None, depths_m: Sequence[np.ndarray], step_px: int
) -> LevelView:
    """Prepare the view of one camera; depths_m: one or more frames (height, width) float32, 0 = no reading."""
    stack = np.stack(depths_m)
    room = background_m if background_m is not None else np.quantile(stack, 0.9, axis=0).astype(np.float32)
    smooth = tuple(smoothed(depth, SURFACE_STEP_M, np.float32(0.0)) for depth in depths_m)
    seen = tuple(_surface_points(camera, depth, room, step_px) for depth in smooth)
    people = tuple(_people(depth, room) for depth in depths_m)
    return LevelView(camera, level_frame(floor), tuple(depths_m), smooth, people, seen)


def level_frame(floor: FloorPlane) -> np.ndarray:
    """Return T_level_camera (4, 4): Y along the floor's normal, origin below the camera, X level along the optical
    axis.
    """
    ahead = np.array([0.0, 0.0, 1.0])
    forward = ahead - (floor.up @ ahead) * floor.up
    forward /= np.linalg.norm(forward)
    return rigid(np.stack([forward, floor.up, np.cross(forward, floor.up)]), np.array([0.0, floor.height_m, 0.0]))


def smoothed(depth_m: np.ndarray, step_m: float, otherwise: np.ndarray | np.float32) -> np.ndarray:
    """Return the mean depth (height, width) of each pixel's 3x3 neighbourhood, if all nine readings lie on one surface,
    with depth differences below ``step_m``; else the value of ``otherwise``.
    """
    window = np.ones((3, 3), np.uint8)
    nearest = cv2.erode(depth_m, window)
    one = (nearest > 0) & (cv2.dilate(depth_m, window) - nearest < step_m)
    return np.where(one, cv2.blur(depth_m, (3, 3)), otherwise)


def _people(depth_m: np.ndarray, room_m: np.ndarray) -> np.ndarray:
    """Return (height, width) bool: pixels nearer than the room, and their neighbours."""
    nearer = (depth_m > 0) & ((room_m <= 0) | (depth_m < room_m - NEARER_M))
    return np.asarray(cv2.dilate(nearer.astype(np.uint8), np.ones((RIM_PX, RIM_PX), np.uint8)) > 0)


def _surface_points(camera: Camera, smooth_m: np.ndarray, room_m: np.ndarray, step_px: int) -> Seen:
    """Return points with normals at every ``step_px``-th pixel at which the surface is smooth and faces the camera."""
    height, width = (
        slice(NORMAL_PX, camera.height - NORMAL_PX, step_px),
        slice(NORMAL_PX, camera.width - NORMAL_PX, step_px),
    )
    rows, columns = (grid.ravel() for grid in np.mgrid[height, width])
    points, normals, good = points_with_normals(camera, smooth_m, rows, columns, GATES)
    room = room_m[rows, columns]
    # at pixels where the room is out of range, all readings are on people
    person = (room <= 0) | (smooth_m[rows, columns] < room - NEARER_M)
    return Seen(points[good], normals[good], person[good])


def points_with_normals(
    camera: Camera, smooth_m: np.ndarray, rows: np.ndarray, columns: np.ndarray, gates: SurfaceGates
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points and unit normals (n, 3) at pixels that are at least ``NORMAL_PX`` from the border, and (n,) bool:
    whether they are usable.

    Usable points lie, with their four neighbours, on one surface that faces the camera.
    """
    rays = camera.pixel_rays()
    aside = ((0, 0), (0, -NORMAL_PX), (0, NORMAL_PX), (-NORMAL_PX, 0), (NORMAL_PX, 0))
    places = [(rows + r, columns + c) for r, c in aside]
    point, left, right, above, below = (
        np.column_stack([rays[at] * smooth_m[at][:, None], smooth_m[at]]).astype(np.float64) for at in places
    )
    normal = np.cross(right - left, below - above)
    length = np.linalg.norm(normal, axis=1)
    seen = np.logical_and.reduce([smooth_m[at] > 0 for at in places])
    flat = np.maximum(np.abs(right - left)[:, 2], np.abs(below - above)[:, 2]) < gates.step_m
    normal /= np.maximum(length, 1e-12)[:, None]
    towards = -np.einsum("ij,ij->i", normal, point)
    normal *= np.sign(towards)[:, None]
    facing = np.abs(towards) > gates.least_facing * np.linalg.norm(point, axis=1)
    return point, normal, seen & flat & facing & (length > 0)


def huber_weights(residual: np.ndarray) -> tuple[np.ndarray, float]:
    """Return Huber's weights (n,) of residuals, and their scale: the robust standard deviation of the residuals."""
    spread = float(np.median(np.abs(residual))) / MAD_OF_NORMAL + 1e-6
    return 1.0 / np.maximum(1.0, np.abs(residual) / (HUBER * spread)), spread


def fit_people(first: LevelView, second: LevelView, T_first_second: np.ndarray) -> SurfaceFit | None:
    """Fit the second camera's rotation about the vertical and its shift over the floor, relative to the first camera,
    starting from a pose T_first_second (4, 4) whose tilt and height are correct.

    Frames at the same index in both views show the same moment. Return None if both cameras see too little in common.
    Walls are left out: their depth stays the same if a camera is shifted along them, and they would keep the fit at the
    starting pose.
    """
    up, ahead, aside = first.T_level_camera[[1, 0, 2], :3]
    zero = np.zeros(3)
    freedom = np.stack([np.append(up, zero), np.append(zero, ahead), np.append(zero, aside)], axis=1)
    T = T_first_second
    for gate in GATES_M:
        jacobian, residual, moment = paired_rows(first, second, T, gate)
        jacobian = jacobian @ freedom
        if len(residual) < LEAST_PAIRS:
            return None
        weight, spread = huber_weights(residual)
        information = (jacobian * weight[:, None]).T @ jacobian
        if np.linalg.cond(information) > WORST_CONDITION:
            return None
        covariance = np.linalg.inv(information)
        T = moved_by(T, -freedom @ (covariance @ (jacobian.T @ (weight * residual))))
    scores = np.zeros((int(moment.max()) + 1, jacobian.shape[1]))
    np.add.at(scores, moment, jacobian * (weight * residual)[:, None])
    spread_of_pose = freedom @ covariance @ (scores.T @ scores) @ covariance @ freedom.T
    there, back = outside_silhouette(first, second, T), outside_silhouette(second, first, invert_rigid(T))
    sigma_rad, sigma_m = (float(np.sqrt(np.trace(spread_of_pose[k : k + 3, k : k + 3]))) for k in (0, 3))
    return SurfaceFit(T, spread, max(there[0], back[0]), min(there[1], back[1]), sigma_m, sigma_rad)


def outside_silhouette(target: LevelView, source: LevelView, T_target_source: np.ndarray) -> tuple[float, float]:
    """Return two shares of the source's points on people: the share at which the target sees no people, among points at
    which the target has a reading; and the share that lies inside the target's depth image.
    """
    outside = readings = inside = total = 0
    for depth, people, seen in zip(target.depths_m, target.people, source.seen, strict=True):
        column, row, within = target.camera.pixel_of(transform_points(T_target_source, seen.points_m[seen.person]))
        row, column = row[within], column[within]
        read = depth[row, column] > 0
        outside += int((read & ~people[row, column]).sum())
        readings += int(read.sum())
        inside += len(row)
        total += len(within)
    return (outside / readings if readings else 1.0), (inside / total if total else 0.0)


def _pairs(
    target: LevelView, source: LevelView, T_target_source: np.ndarray, gate_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the paired points of source and target and the target's normals, (n, 3) each in the target frame, and (n,)
    the index of the frame from which each pair is.
    """
    found = []
    for moment in range(len(source.seen)):
        both = shown_by_both(target, source, T_target_source, moment)
        good = both.is_one_surface(gate_m)
        found.append((both.points_m[good], both.there_m[good], both.plane[good], np.full(int(good.sum()), moment)))
    points, there, normals, moments = (np.concatenate(part) for part in zip(*found, strict=True))
    return points, there, normals, moments


@dataclass(frozen=True, slots=True, eq=False)
class ShownByBoth:
    """Points of the source camera at whose pixels the target camera also shows a surface, in the target frame.
    points_m, normals: the source's points and normals (n, 3); there_m, plane: the target's points at the same pixels
    and their normals (n, 3).
    """

    points_m: np.ndarray
    normals: np.ndarray
    there_m: np.ndarray
    plane: np.ndarray

    def away_m(self) -> np.ndarray:
        """Return the distance (n,) of each point from the plane through the target's point at the same pixel."""
        return np.asarray(np.abs(np.einsum("ij,ij->i", self.plane, self.points_m - self.there_m)))

    def is_one_surface(self, gate_m: float) -> np.ndarray:
        """Return (n,) bool: whether both points lie on one surface, at most ``gate_m`` apart."""
        same_way = np.einsum("ij,ij->i", self.plane, self.normals) > SAME_WAY
        near = np.linalg.norm(self.points_m - self.there_m, axis=1) < 2.0 * gate_m
        return np.asarray(same_way & near & (self.away_m() < gate_m))

    def is_comparable(self, gate_m: float) -> np.ndarray:
        """Return (n,) bool: whether the target should show the point: it faces the target, and nothing hides it."""
        facing = np.einsum("ij,ij->i", self.normals, -self.points_m)
        faces = facing > GATES.least_facing * np.linalg.norm(self.points_m, axis=1)
        return np.asarray(faces & (self.there_m[:, 2] > self.points_m[:, 2] - gate_m))


def shown_by_both(target: LevelView, source: LevelView, T_target_source: np.ndarray, moment: int) -> ShownByBoth:
    """Return the source's points in the frame with index ``moment`` at whose pixels the target also shows a surface.
    Only points marked as ``person`` are used.
    """
    seen = source.seen[moment]
    points = transform_points(T_target_source, seen.points_m[seen.person])
    normals = seen.normals[seen.person] @ T_target_source[:3, :3].T
    column, row, inside = target.camera.pixel_of(points)
    inside &= (column > 2) & (row > 2) & (column < target.camera.width - 3) & (row < target.camera.height - 3)
    there, plane, good = points_with_normals(target.camera, target.smooth_m[moment], row[inside], column[inside], GATES)
    return ShownByBoth(points[inside][good], normals[inside][good], there[good], plane[good])


def paired_rows(
    first: LevelView, second: LevelView, T_first_second: np.ndarray, gate_m: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rows of the least-squares system, one row per pair of points within ``gate_m``. The second camera's
    points are paired with surfaces of the first camera, and vice versa.

    jacobian (n, 6): derivative by a small rotation and shift in the first camera's frame; residual (n,) in metres;
    moment (n,): index of the frame from which each pair is.
    """
    points, there, normal, moment = _pairs(first, second, T_first_second, gate_m)
    back, seen, back_normal, back_moment = _pairs(second, first, invert_rigid(T_first_second), gate_m)
    # The pairs with the second camera as the target are moved into the first camera's frame. In pairs with the second
    # camera as the target, the pose moves the target's point and not the source's point, so the sign of the derivative
    # is reversed.
    here, seen = transform_points(T_first_second, back), transform_points(T_first_second, seen)
    turned = back_normal @ T_first_second[:3, :3].T
    rows = np.hstack([np.cross(points, normal), normal]), -np.hstack([np.cross(seen, turned), turned])
    residuals = np.einsum("ij,ij->i", normal, points - there), np.einsum("ij,ij->i", turned, here - seen)
    return np.concatenate(rows), np.concatenate(residuals), np.concatenate([moment, back_moment])


def moved_by(T: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return T followed by the rotation step[:3] about the origin and the shift step[3:]."""
    return np.asarray(rigid(cv2.Rodrigues(step[:3])[0], step[3:]) @ T)
