"""A camera's pose from printed markers in its infrared or colour picture: another way to calibrate than by depth."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anchorpose.calibration.marker.layout import Board, MarkerLayout
from anchorpose.camera import Camera, invert_rigid, transform_points

SAME_M, SAME_RAD = 0.002, 0.002  # the solver's own spread; mirrored poses are degrees apart


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerConfig:
    """When a pose from markers is to be trusted."""

    corner_sigma_px: float = 0.3  # of a corner after refinement, in a picture with noise and a little blur
    depth_sigma_m: float = 0.006  # of a depth reading on black and white print: noise and what ink does to it
    least_side_px: float = 14.0  # a smaller tag's bits are two pixels wide, its corners worse than stated
    worst_corner_px: float = 4.0  # a tag with a corner farther off was moved, or misread: it is left out
    worst_rms_px: float = 1.0  # of all corners; more is another lens or another layout
    flipped_chi2: float = 16.0  # by so much must the mirrored pose of a flat layout be worse: four sigmas
    worst_sigma_m: float = 0.02  # of the camera's position; a small far tag tells it to a decimetre
    worst_sigma_rad: float = 0.01  # half a degree: a centimetre at a metre

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not getattr(self, entry.name) > 0:
                raise ValueError(f"{entry.name} must be positive, got {getattr(self, entry.name)}")


@dataclass(frozen=True, slots=True, eq=False)
class MarkerPose:
    """T_world_camera (4, 4); rms_px of the corners; sigma_m: of the position, one axis; sigma_rad: of the direction.

    corners: how many were used; markers: ids of the tags, or of the board's markers, they belong to; left_out: ids of
    tags that do not fit the others.
    """

    T_world_camera: np.ndarray
    rms_px: float
    sigma_m: float
    sigma_rad: float
    corners: int
    markers: tuple[int, ...]
    left_out: tuple[int, ...]


class NoMarkers(StrEnum):
    """Why the picture gives no pose."""

    NONE_SEEN = "none of the markers of the layout is seen whole"
    TOO_SMALL = "the markers seen are too small in the picture"
    AMBIGUOUS = "the flat markers allow two poses that explain the picture equally well"
    INCONSISTENT = "the markers seen do not fit the layout: one was moved, or the layout is wrong"
    TOO_UNCERTAIN = "the markers seen do not tell the pose well enough"


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """Corners: pixel (n, 2), world_m (n, 3), marker (n,) id of each; depth rows: rays (k, 2), depth_m (k,), plane (k,)
    index of the marker that each reading lies on."""

    pixel: np.ndarray
    world_m: np.ndarray
    marker: np.ndarray
    rays: np.ndarray
    depth_m: np.ndarray
    plane: np.ndarray

    def without(self, marker: int) -> _Seen:
        keep, on = self.marker != marker, self.plane != marker
        return _Seen(
            self.pixel[keep], self.world_m[keep], self.marker[keep], self.rays[on], self.depth_m[on], self.plane[on]
        )


def pose_from_markers(
    picture: np.ndarray, camera: Camera, layout: MarkerLayout, depth_m: np.ndarray | None = None,
    config: MarkerConfig | None = None,
) -> MarkerPose | NoMarkers:  # fmt: skip
    """The camera's pose in Gamma_0 by the markers in one picture, or why not.

    picture (height, width) or (height, width, 3), 8 or 16 bit, of the depth pictures' geometry; depth_m (height,
    width), 0 = no reading: readings on the markers sharpen the distance and tell the two poses of a flat layout apart.
    Corner residuals are robust; tags that do not fit the others are left out and named.
    Raises ValueError where a picture has another size than the camera's.
    """
    config = config or MarkerConfig()
    for image in (picture, depth_m):
        if image is not None and image.shape[:2] != (camera.height, camera.width):
            raise ValueError(
                f"camera {camera.name} is {camera.width} x {camera.height}, a picture is {image.shape[:2]}"
            )
    seen = _detect(_grey(picture), camera, layout, depth_m, config)
    if isinstance(seen, NoMarkers):
        return seen
    left_out: list[int] = []
    poses = _candidates(seen, camera, config)
    while not poses or _worst_corner_px(poses[0][1], seen, camera) > config.worst_corner_px:
        numbers = np.unique(seen.marker).tolist()
        if 2 * (len(left_out) + 1) >= len(numbers) + len(left_out):  # no majority that agrees
            return NoMarkers.INCONSISTENT
        rest = {number: _candidates(seen.without(number), camera, config) for number in numbers}
        left_out.append(min(numbers, key=lambda number: rest[number][0][0] if rest[number] else np.inf))
        seen, poses = seen.without(left_out[-1]), rest[left_out[-1]]
    return _judged(poses, seen, camera, config, tuple(sorted(left_out)))


def _grey(picture: np.ndarray) -> np.ndarray:
    """8-bit grey; 16-bit infrared is stretched, its brightest specks aside, by the root that evens near and far."""
    grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    if grey.dtype == np.uint8:
        return grey
    top = max(float(np.percentile(grey, 99.0)), 1.0)
    return np.asarray(255.0 * np.sqrt(np.clip(grey / top, 0.0, 1.0)), dtype=np.uint8)


def _detect(
    grey: np.ndarray, camera: Camera, layout: MarkerLayout, depth_m: np.ndarray | None, config: MarkerConfig
) -> _Seen | NoMarkers:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, layout.dictionary))
    parameters = cv2.aruco.DetectorParameters()
    if layout.board is not None:
        found = _board_corners(grey, layout.board, dictionary, parameters)
    else:
        # quads by fitted edges: half the error of corners refined one by one
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        found = _tag_corners(grey, layout, cv2.aruco.ArucoDetector(dictionary, parameters))
    if not found:
        return NoMarkers.NONE_SEEN
    found = {number: pair for number, pair in found.items() if _side_px(pair[0]) >= config.least_side_px}
    if not found:
        return NoMarkers.TOO_SMALL
    pixel = np.concatenate([pair[0] for pair in found.values()])
    world = np.concatenate([pair[1] for pair in found.values()])
    marker = np.repeat(list(found), [len(pair[0]) for pair in found.values()])
    rows = [_depth_inside(corners, number, camera, depth_m) for number, (corners, _) in found.items()]
    rays, depth, plane = (np.concatenate(part) for part in zip(*rows, strict=True))
    return _Seen(pixel, world, marker, rays, depth, plane)


def _tag_corners(
    grey: np.ndarray, layout: MarkerLayout, detector: cv2.aruco.ArucoDetector
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Pixel and world corners of each tag of the layout that is seen exactly once: of two alike, one is a copy."""
    corners, numbers, _ = detector.detectMarkers(grey)
    listed = [] if numbers is None else [int(number) for number in np.ravel(numbers)]
    places = {tag.number: tag.corners_m() for tag in layout.tags}
    return {
        number: (corner.reshape(4, 2).astype(np.float64), places[number])
        for number, corner in zip(listed, corners, strict=True)
        if number in places and listed.count(number) == 1
    }


def _board_corners(
    grey: np.ndarray, board: Board, dictionary: cv2.aruco.Dictionary, parameters: cv2.aruco.DetectorParameters
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """All chessboard corners of the board under the id 0; nothing where fewer than six are seen."""
    size = (board.squares_x, board.squares_y)
    known = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary)
    detector = cv2.aruco.CharucoDetector(known, cv2.aruco.CharucoParameters(), parameters)
    corners, numbers, _, _ = detector.detectBoard(grey)
    if numbers is None or len(numbers) < 6:
        return {}
    places = np.asarray(known.getChessboardCorners(), dtype=np.float64)[np.asarray(numbers).ravel()]
    return {0: (corners.reshape(-1, 2).astype(np.float64), transform_points(board.T_world_board, places))}


def _side_px(corners: np.ndarray) -> float:
    """Of a tag its shortest side; of a board's corners, half the breadth of what they span."""
    if len(corners) == 4:
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min())
    return float(np.ptp(corners, axis=0).min()) / 2.0


def _depth_inside(
    corners: np.ndarray, number: int, camera: Camera, depth_m: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays and depths of up to 40 readings on a marker, its rim left out: there depth mixes with what is behind."""
    if depth_m is None:
        return np.empty((0, 2)), np.empty(0), np.empty(0, dtype=np.int64)
    mask = np.zeros(depth_m.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(cv2.convexHull(corners.astype(np.float32))).astype(np.int32), 1)
    inside = (cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0) & (depth_m > 0)
    place = np.argwhere(inside)
    place = place[:: max(1, len(place) // 40)]
    row, column = place.T
    rays = camera.pixel_rays()[row, column].astype(np.float64)
    return rays, depth_m[row, column].astype(np.float64), np.full(len(place), number)


def _candidates(seen: _Seen, camera: Camera, config: MarkerConfig) -> list[tuple[float, np.ndarray]]:
    """(chi2, T_camera_world) of the refined solutions, best first: two where all corners lie in one plane."""
    matrix, distortion = camera.intrinsics.matrix, np.array(camera.intrinsics.distortion)
    spread = np.linalg.svd(seen.world_m - seen.world_m.mean(axis=0), compute_uv=False)
    flat = spread[2] < 1e-3 * spread[0]
    method = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
    try:
        count, turns, shifts, _ = cv2.solvePnPGeneric(seen.world_m, seen.pixel, matrix, distortion, flags=method)
    except cv2.error:
        return []
    poses = []
    for turn, shift in zip(turns[:count], shifts[:count], strict=True):
        T_camera_world = np.eye(4)
        T_camera_world[:3, :3], T_camera_world[:3, 3] = Rotation.from_rotvec(turn.ravel()).as_matrix(), shift.ravel()
        if transform_points(T_camera_world, seen.world_m)[:, 2].min() > 0:
            poses.append(_refined(T_camera_world, seen, camera, config))
    poses.sort(key=lambda pose: pose[0])
    return [pose for index, pose in enumerate(poses) if index == 0 or _differ(poses[0][1], pose[1])]


def _differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two solutions are two: some starts end in the same one."""
    step = invert_rigid(one) @ other
    turn = float(Rotation.from_matrix(step[:3, :3]).magnitude())
    return turn > SAME_RAD or float(np.linalg.norm(step[:3, 3])) > SAME_M


def _refined(start: np.ndarray, seen: _Seen, camera: Camera, config: MarkerConfig) -> tuple[float, np.ndarray]:
    found = least_squares(
        lambda x: _rows(_moved(start, x), seen, camera, config), np.zeros(6), loss="soft_l1", f_scale=2
    )
    return float(2.0 * found.cost), _moved(start, found.x)


def _moved(T_camera_world: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The pose after a small turn x[:3] and shift x[3:] of the camera frame."""
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]
    return np.asarray(step @ T_camera_world)


def _rows(T_camera_world: np.ndarray, seen: _Seen, camera: Camera, config: MarkerConfig) -> np.ndarray:
    """Residuals in standard deviations: corners in the picture, depth readings off the marker's plane."""
    points = transform_points(T_camera_world, seen.world_m)
    off = np.nan_to_num(camera.project(points) - seen.pixel, nan=1e3).ravel() / config.corner_sigma_px
    rows = [off]
    for marker in np.unique(seen.plane):
        normal, place = _plane(points[seen.marker == marker])
        on = seen.plane == marker
        rays = np.concatenate([seen.rays[on], np.ones((int(on.sum()), 1))], axis=1)
        slope = rays @ normal
        predicted = (normal @ place) / np.where(np.abs(slope) > 1e-3, slope, np.inf)
        # readings of one marker err together (ink, calibration of the sensor): all of them count as eight
        rows.append((seen.depth_m[on] - predicted) / config.depth_sigma_m * np.sqrt(min(1.0, 8.0 / max(on.sum(), 1))))
    return np.concatenate(rows)


def _plane(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    center = points_m.mean(axis=0)
    return np.linalg.svd(points_m - center)[2][2], center


def _worst_corner_px(T_camera_world: np.ndarray, seen: _Seen, camera: Camera) -> float:
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    return float(np.linalg.norm(np.nan_to_num(off, nan=1e3), axis=1).max())


def _judged(
    poses: list[tuple[float, np.ndarray]], seen: _Seen, camera: Camera, config: MarkerConfig, left_out: tuple[int, ...]
) -> MarkerPose | NoMarkers:
    chi2, T_camera_world = poses[0]
    rows = _rows(T_camera_world, seen, camera, config)
    scale = max(1.0, chi2 / max(len(rows) - 6, 1))  # where the corners are worse than assumed, all is less sure
    if len(poses) > 1 and (poses[1][0] - chi2) / scale < config.flipped_chi2:
        return NoMarkers.AMBIGUOUS
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    rms = float(np.sqrt(np.mean((off**2).sum(axis=1))))
    if rms > config.worst_rms_px:
        return NoMarkers.INCONSISTENT
    jacobian = least_squares(
        lambda x: _rows(_moved(T_camera_world, x), seen, camera, config), np.zeros(6), max_nfev=1
    ).jac
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > 1e14:
        return NoMarkers.TOO_UNCERTAIN
    covariance = scale * np.linalg.inv(information)
    sigma_rad = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    sigma_m = float(np.sqrt(np.trace(covariance[3:, 3:]) / 3.0))  # the camera's own shift, whichever way it is turned
    if sigma_m > config.worst_sigma_m or sigma_rad > config.worst_sigma_rad:
        return NoMarkers.TOO_UNCERTAIN
    markers = tuple(sorted(set(seen.marker.tolist())))
    return MarkerPose(invert_rigid(T_camera_world), rms, sigma_m, sigma_rad, len(seen.pixel), markers, left_out)
