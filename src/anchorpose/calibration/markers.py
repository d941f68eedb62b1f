"""Find a camera's pose from printed markers in its infrared or colour image, an alternative to calibration by depth.

``marker_layout`` states the poses of the markers in the world (Gamma_0).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anchorpose.calibration.calibration import PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.marker_layout import Board, MarkerLayout
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import read_image
from anchorpose.rotations import rigid

# pixels, minimum side length of a tag; in smaller tags, the squares of the code are only two pixels wide, and corners
# are less accurate than assumed
LEAST_SIDE_PX: Final = 14.0
LEAST_BOARD_CORNERS: Final = 6
DEPTH_READINGS: Final = 40  # maximum number of depth readings used per marker


class NoMarkers(StrEnum):
    """The reason why the image gives no pose."""

    NONE_SEEN = "none of the markers of the layout is seen whole"
    TOO_SMALL = "the markers seen are too small in the image"
    AMBIGUOUS = "the flat markers allow two poses that explain the image equally well"
    INCONSISTENT = "the markers seen do not fit the layout: one was moved, or the layout or a printed size is wrong"
    TOO_UNCERTAIN = "the markers seen do not give the pose accurately enough"


@dataclass(frozen=True, slots=True, eq=False)
class SeenMarkers:
    """The markers that were seen. For each corner: pixel (n, 2), world_m (n, 3), marker (n,): id of its marker. For
    each depth reading on a marker: rays (k, 2), depth_m (k,), plane (k,): id of its marker.
    """

    pixel: np.ndarray
    world_m: np.ndarray
    marker: np.ndarray
    rays: np.ndarray
    depth_m: np.ndarray
    plane: np.ndarray

    def without(self, marker: int) -> SeenMarkers:
        keep, on = self.marker != marker, self.plane != marker
        return SeenMarkers(
            self.pixel[keep], self.world_m[keep], self.marker[keep], self.rays[on], self.depth_m[on], self.plane[on]
        )


def detect_markers(
    image: np.ndarray, camera: Camera, layout: MarkerLayout, depth_m: np.ndarray | None
) -> SeenMarkers | NoMarkers:
    """Detect the layout's markers in an image, or return why no marker is usable.

    image (height, width) or (height, width, 3), 8 or 16 bit, with the same intrinsics as the depth images; depth_m
    (height, width), 0 = no reading; None without a depth image.
    """
    grey = _grey(image)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, layout.dictionary))
    parameters = cv2.aruco.DetectorParameters()
    if layout.board is not None:
        found = _board_corners(grey, layout.board, dictionary, parameters)
    else:
        # corners found by fitting a tag's four edges have half the error of corners that are refined separately
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        found = _tag_corners(grey, layout, cv2.aruco.ArucoDetector(dictionary, parameters))
    if not found:
        return NoMarkers.NONE_SEEN
    found = {number: pair for number, pair in found.items() if _side_px(pair[0]) >= LEAST_SIDE_PX}
    if not found:
        return NoMarkers.TOO_SMALL
    pixel = np.concatenate([pair[0] for pair in found.values()])
    world = np.concatenate([pair[1] for pair in found.values()])
    marker = np.repeat(list(found), [len(pair[0]) for pair in found.values()])
    rows = [_depth_inside(corners, number, camera, depth_m) for number, (corners, _) in found.items()]
    rays, depth, plane = (np.concatenate(part) for part in zip(*rows, strict=True))
    return SeenMarkers(pixel, world, marker, rays, depth, plane)


def _grey(image: np.ndarray) -> np.ndarray:
    """Return an 8-bit grey image. In 16-bit infrared, values are scaled so that the brightest specks saturate, and the
    square root of the values makes near and far markers similarly bright.
    """
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if grey.dtype == np.uint8:
        return grey
    top = max(float(np.percentile(grey, 99.0)), 1.0)
    return np.asarray(255.0 * np.sqrt(np.clip(grey / top, 0.0, 1.0)), dtype=np.uint8)


def _tag_corners(
    grey: np.ndarray, layout: MarkerLayout, detector: cv2.aruco.ArucoDetector
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return pixel and world corners of each tag of the layout that is seen exactly once; if two equal tags are seen,
    both are left out, since one is a copy.
    """
    corners, numbers, _ = detector.detectMarkers(grey)
    listed = [] if numbers is None else [int(number) for number in np.ravel(numbers)]
    places = {tag.number: tag.corners_m() for tag in layout.tags or ()}
    return {
        number: (corner.reshape(4, 2).astype(np.float64), places[number])
        for number, corner in zip(listed, corners, strict=True)
        if number in places and listed.count(number) == 1
    }


def _board_corners(
    grey: np.ndarray, board: Board, dictionary: cv2.aruco.Dictionary, parameters: cv2.aruco.DetectorParameters
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return pixel and world positions of all chessboard corners of the board, under the id 0; empty if fewer than
    ``LEAST_BOARD_CORNERS`` are seen.
    """
    size = (board.squares_x, board.squares_y)
    known = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary)
    detector = cv2.aruco.CharucoDetector(known, cv2.aruco.CharucoParameters(), parameters)
    corners, numbers, _, _ = detector.detectBoard(grey)
    if numbers is None or len(numbers) < LEAST_BOARD_CORNERS:
        return {}
    places = np.asarray(known.getChessboardCorners(), dtype=np.float64)[np.asarray(numbers).ravel()]
    return {0: (corners.reshape(-1, 2).astype(np.float64), transform_points(board.T_world_board, places))}


def _side_px(corners: np.ndarray) -> float:
    """Return a detected marker's size in pixels, which must be at least ``LEAST_SIDE_PX``: a tag's shortest side, or
    half of a board's narrower extent.
    """
    if len(corners) == 4:
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min())
    return float(np.ptp(corners, axis=0).min()) / 2.0


def _depth_inside(
    corners: np.ndarray, number: int, camera: Camera, depth_m: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rays and depths of the readings inside a marker, and the marker's number for each reading. The marker's
    rim is left out, since depth there mixes with the background.
    """
    if depth_m is None:
        return np.empty((0, 2)), np.empty(0), np.empty(0, dtype=np.int64)
    mask = np.zeros(depth_m.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(cv2.convexHull(corners.astype(np.float32))).astype(np.int32), 1)
    inside = (cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0) & (depth_m > 0)
    place = np.argwhere(inside)
    place = place[:: max(1, len(place) // DEPTH_READINGS)]
    row, column = place.T
    rays = camera.pixel_rays()[row, column].astype(np.float64)
    return rays, depth_m[row, column].astype(np.float64), np.full(len(place), number)


# names of the images of markers in a camera's folder; these images must have the intrinsics of the camera's depth
# images
MARKER_IMAGES: Final = ("infrared.png", "color.png")
# m and rad; solver solutions that differ by less count as one solution, while mirrored poses differ by several degrees
SAME_M, SAME_RAD = 0.002, 0.002
CORNER_SIGMA_PX: Final = 0.3  # px, error of a corner after refinement, in an image with noise and slight blur
DEPTH_SIGMA_M: Final = 0.006  # m, error of a depth reading on black and white print, due to noise and the ink
WORST_CORNER_PX: Final = 4.0  # px; a tag with a corner farther from the prediction is left out as moved or misread
# px, maximum root mean square residual of all corners; with more, the lens or the layout is wrong
WORST_RMS_PX: Final = 1.0
# squared sigmas (four sigmas): minimum by which the chi2 of the mirrored pose of a flat layout must exceed the best
# pose's chi2, and maximum chi2 of the difference between a marker's depth readings and its distance according to the
# corners
CONTRADICTION_CHI2: Final = 16.0
WORST_SIGMA_M: Final = 0.02  # m, maximum sigma of the camera's position; with a small distant tag it is 0.1 m
# rad (half a degree), maximum sigma of the camera's direction; at one metre, it displaces a point by one centimetre
WORST_SIGMA_RAD: Final = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class MarkerPose:
    """The camera's pose, found from markers: T_world_camera (4, 4); rms_px: root mean square residual of the corners;
    sigma_m: sigma of the position, per axis; sigma_rad: sigma of the direction.

    corners: number of corners used; markers: ids of the tags to which they belong, 0 for a board; left_out: ids of tags
    that do not fit the other tags.
    """

    T_world_camera: np.ndarray
    rms_px: float
    sigma_m: float
    sigma_rad: float
    corners: int
    markers: tuple[int, ...]
    left_out: tuple[int, ...]


def place_by_markers(recording: Recording, layout: MarkerLayout) -> tuple[Recording, dict[str, PoseRecord]]:
    """Return the recording with poses of all cameras that have an image of markers, and their records by camera name.

    Cameras without an image of markers keep their given pose, if any. Raises InputError if no camera has such an image,
    if an image does not fit its camera, or if its markers do not give the pose.
    """
    cameras, records = list[Camera](), dict[str, PoseRecord]()
    for camera, background in zip(recording.cameras, recording.backgrounds_m, strict=True):
        beside = (recording.folder / camera.name / name for name in MARKER_IMAGES)
        path = next((image for image in beside if image.is_file()), None)
        if path is None:
            cameras.append(camera)
            continue
        found = pose_from_markers(_read(path, camera), camera, layout, background)
        if isinstance(found, NoMarkers):
            raise InputError(path, found.value, "put up more or larger markers, in different planes, and record again")
        cameras.append(replace(camera, T_world_camera=found.T_world_camera))
        figures = [
            PoseFigure("markers, rms of their corners", found.rms_px, "px"),
            PoseFigure("markers, corners used", float(found.corners), "corners"),
        ]
        if found.left_out:
            numbers = ", ".join(map(str, found.left_out))
            what = f"markers, tags left out since they contradict the others ({numbers})"
            figures.append(PoseFigure(what, float(len(found.left_out)), "tags"))
        pose = PoseRecord(camera.name, PoseSource.MARKERS, found.sigma_m, found.sigma_rad, tuple(figures))
        records[camera.name] = pose
    if not records:
        problem = f"no camera's folder holds {' or '.join(MARKER_IMAGES)}"
        raise InputError(recording.folder, problem, "add an image of the markers from each camera")
    return replace(recording, cameras=tuple(cameras)), records


def _read(path: Path, camera: Camera) -> np.ndarray:
    """Read an image (height, width) or (height, width, 3), 8 or 16 bit."""
    image = read_image(path)
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise InputError(path, "is not a readable image of 8 or 16 bit", "export it again as PNG")
    if image.shape[:2] != (camera.height, camera.width):
        size = f"{image.shape[1]} x {image.shape[0]}"
        problem = f"is {size} pixels, the depth images are {camera.width} x {camera.height}"
        raise InputError(path, problem, "export it registered to the depth images")
    return np.asarray(image[..., :3] if image.ndim == 3 else image)


def pose_from_markers(
    image: np.ndarray, camera: Camera, layout: MarkerLayout, depth_m: np.ndarray | None = None
) -> MarkerPose | NoMarkers:
    """Find the camera's pose in the world (Gamma_0) by the markers in one image, or return why it is not found.

    image (height, width) or (height, width, 3), 8 or 16 bit, with the same intrinsics as the depth images; depth_m
    (height, width), 0 = no reading. Readings on the markers make the distance more accurate. If all markers lie in one
    plane, two mirrored poses fit the corners about equally well; the readings then show which pose is right. Outliers
    among the corners have little weight; tags that contradict the other tags are left out, and the result names them.
    Raises ValueError if the size of an image differs from the camera's.
    """
    for given in (image, depth_m):
        if given is not None and given.shape[:2] != (camera.height, camera.width):
            raise ValueError(f"camera {camera.name} is {camera.width} x {camera.height}, an image is {given.shape[:2]}")
    seen = detect_markers(image, camera, layout, depth_m)
    if isinstance(seen, NoMarkers):
        return seen
    left_out: list[int] = []
    poses = _candidates(seen, camera)
    while not poses or _worst_corner_px(poses[0][1], seen, camera) > WORST_CORNER_PX:
        numbers = np.unique(seen.marker).tolist()
        if 2 * (len(left_out) + 1) >= len(numbers) + len(left_out):  # the remaining tags would not be a majority
            return NoMarkers.INCONSISTENT
        rest = {number: _candidates(seen.without(number), camera) for number in numbers}
        left_out.append(min(numbers, key=lambda number: rest[number][0][0] if rest[number] else np.inf))
        seen, poses = seen.without(left_out[-1]), rest[left_out[-1]]
    return _judged(poses, seen, camera, tuple(sorted(left_out)))


def _candidates(seen: SeenMarkers, camera: Camera) -> list[tuple[float, np.ndarray]]:
    """Return (chi2, T_camera_world) of the refined poses, best first: up to two poses if all corners lie in one plane.
    chi2: sum of squared residuals in sigmas, in which outliers count less.
    """
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
        T_camera_world = rigid(Rotation.from_rotvec(turn.ravel()).as_matrix(), shift.ravel())
        if transform_points(T_camera_world, seen.world_m)[:, 2].min() > 0:
            poses.append(_refined(T_camera_world, seen, camera))
    poses.sort(key=lambda pose: pose[0])
    return [pose for index, pose in enumerate(poses) if index == 0 or _differ(poses[0][1], pose[1])]


def _differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Return whether two solutions are distinct: some starts of the solver converge to the same solution."""
    step = invert_rigid(one) @ other
    turn = float(Rotation.from_matrix(step[:3, :3]).magnitude())
    return turn > SAME_RAD or float(np.linalg.norm(step[:3, 3])) > SAME_M


def _refined(start: np.ndarray, seen: SeenMarkers, camera: Camera) -> tuple[float, np.ndarray]:
    found = least_squares(lambda x: _rows(_moved(start, x), seen, camera), np.zeros(6), loss="soft_l1", f_scale=2)
    return float(2.0 * found.cost), _moved(start, found.x)


def _moved(T_camera_world: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the pose after a small rotation x[:3] and shift x[3:] of the camera frame."""
    return np.asarray(rigid(Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]) @ T_camera_world)


def _rows(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> np.ndarray:
    """Return all residuals in sigmas: differences between projected and detected corners in the image, and between the
    depth readings and the plane of their marker.
    """
    points = transform_points(T_camera_world, seen.world_m)
    off = np.nan_to_num(camera.project(points) - seen.pixel, nan=1e3).ravel() / CORNER_SIGMA_PX
    rows = [off]
    for off_m in _depth_off_m(points, seen).values():
        # errors of readings on one marker are correlated (ink, calibration of the sensor), so all of these readings
        # together count as at most eight readings
        rows.append(off_m / DEPTH_SIGMA_M * np.sqrt(min(1.0, 8.0 / max(len(off_m), 1))))
    return np.concatenate(rows)


def _depth_off_m(points_m: np.ndarray, seen: SeenMarkers) -> dict[int, np.ndarray]:
    """Return, for each marker with depth readings, how much farther its readings lie than its plane, in m. points_m
    (n, 3): the markers' corners in the camera frame.
    """
    found = {}
    for marker in np.unique(seen.plane).tolist():
        corners = points_m[seen.marker == marker]
        place = corners.mean(axis=0)
        normal = np.linalg.svd(corners - place)[2][2]
        on = seen.plane == marker
        slope = np.concatenate([seen.rays[on], np.ones((int(on.sum()), 1))], axis=1) @ normal
        found[marker] = seen.depth_m[on] - (normal @ place) / np.where(np.abs(slope) > 1e-3, slope, np.inf)
    return found


def _depth_contradicts(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> bool:
    """Return whether, near a pose, the depth readings on a marker contradict the marker's distance that the corners
    alone give. A print at another scale causes such a contradiction: its corners fit a nearer or farther camera just as
    well.
    """
    corners = replace(seen, rays=seen.rays[:0], depth_m=seen.depth_m[:0], plane=seen.plane[:0])
    _, alone = _refined(T_camera_world, corners, camera)
    covariance = np.linalg.pinv(_information(alone, corners, camera))
    points = transform_points(alone, seen.world_m)
    for marker, off_m in _depth_off_m(points, seen).items():
        x, y, _ = points[seen.marker == marker].mean(axis=0)
        by_pose = np.array([y, -x, 0.0, 0.0, 0.0, 1.0])  # derivative of the marker's depth by a step of ``_moved``
        # the readings' variance is not divided by their number, since readings on one marker share an error
        variance = DEPTH_SIGMA_M**2 + by_pose @ covariance @ by_pose
        if np.median(off_m) ** 2 > CONTRADICTION_CHI2 * variance:
            return True
    return False


def _information(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> np.ndarray:
    """Return the information matrix (6, 6), the inverse of the covariance, of a small step of the pose (``_moved``)."""
    jacobian = least_squares(lambda x: _rows(_moved(T_camera_world, x), seen, camera), np.zeros(6), max_nfev=1).jac
    return np.asarray(jacobian.T @ jacobian)


def _worst_corner_px(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> float:
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    return float(np.linalg.norm(np.nan_to_num(off, nan=1e3), axis=1).max())


def _judged(
    poses: list[tuple[float, np.ndarray]], seen: SeenMarkers, camera: Camera, left_out: tuple[int, ...]
) -> MarkerPose | NoMarkers:
    chi2, T_camera_world = poses[0]
    rows = _rows(T_camera_world, seen, camera)
    scale = max(1.0, chi2 / max(len(rows) - 6, 1))  # factor on the assumed variances of corners and depths
    if len(poses) > 1 and (poses[1][0] - chi2) / scale < CONTRADICTION_CHI2:
        return NoMarkers.AMBIGUOUS
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    rms = float(np.sqrt(np.mean((off**2).sum(axis=1))))
    if not rms <= WORST_RMS_PX:  # rms is NaN if a corner lies beyond the lens's valid radius
        return NoMarkers.INCONSISTENT
    information = _information(T_camera_world, seen, camera)
    if np.linalg.cond(information) > 1e14:
        return NoMarkers.TOO_UNCERTAIN
    if _depth_contradicts(T_camera_world, seen, camera):
        return NoMarkers.INCONSISTENT
    covariance = scale * np.linalg.inv(information)
    sigma_rad = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    sigma_m = float(np.sqrt(np.trace(covariance[3:, 3:]) / 3.0))  # root mean square of the three axes' sigmas
    if sigma_m > WORST_SIGMA_M or sigma_rad > WORST_SIGMA_RAD:
        return NoMarkers.TOO_UNCERTAIN
    markers = tuple(sorted(set(seen.marker.tolist())))
    return MarkerPose(invert_rigid(T_camera_world), rms, sigma_m, sigma_rad, len(seen.pixel), markers, left_out)
