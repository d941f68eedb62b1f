"""A camera's pose from printed markers in its infrared or colour image: an alternative to calibration by depth."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anchorpose.calibration.calibration import PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.markers import MarkerLayout, NoMarkers, SeenMarkers, detect_markers
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording
from anchorpose.recording.regular_file import read_image

MARKER_IMAGES: Final = ("infrared.png", "color.png")  # in a camera's folder, of the depth images' geometry
SAME_M, SAME_RAD = 0.002, 0.002  # the solver's own spread; mirrored poses are degrees apart
CORNER_SIGMA_PX: Final = 0.3  # of a corner after refinement, in an image with noise and a little blur
DEPTH_SIGMA_M: Final = 0.006  # of a depth reading on black and white print: noise, and the effect of ink
WORST_CORNER_PX: Final = 4.0  # a tag with a corner farther off was moved, or misread: it is left out
WORST_RMS_PX: Final = 1.0  # of all corners; more is another lens or another layout
FLIPPED_CHI2: Final = 16.0  # by so much must the mirrored pose of a flat layout be worse: four sigmas
WORST_SIGMA_M: Final = 0.02  # of the camera's position; a small distant tag gives it to 10 cm only
WORST_SIGMA_RAD: Final = 0.01  # half a degree: a centimetre at a metre


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


def place_by_markers(recording: Recording, layout: MarkerLayout) -> tuple[Recording, dict[str, PoseRecord]]:
    """The recording with poses of all cameras that have an image of markers, and a record of each by camera name.

    Cameras without such an image keep the pose they have, or have none. Raises InputError where no camera has one,
    where an image does not fit its camera, or where the markers in it do not give the pose.
    """
    cameras, records = list[Camera](), dict[str, PoseRecord]()
    for camera, background in zip(recording.cameras, recording.backgrounds_m, strict=True):
        path = _marker_image(recording.folder / camera.name)
        if path is None:
            cameras.append(camera)
            continue
        found = pose_from_markers(_read(path, camera), camera, layout, background)
        if isinstance(found, NoMarkers):
            raise InputError(path, found.value, "put up more or larger markers, in different planes, and record again")
        cameras.append(replace(camera, T_world_camera=found.T_world_camera))
        figures = (
            PoseFigure("markers, rms of their corners", found.rms_px, "px"),
            PoseFigure("markers, corners used", float(found.corners), "corners"),
        )
        records[camera.name] = PoseRecord(camera.name, PoseSource.MARKERS, found.sigma_m, found.sigma_rad, figures)
    if not records:
        problem = f"no camera's folder holds {' or '.join(MARKER_IMAGES)}"
        raise InputError(recording.folder, problem, "add an image of the markers from each camera")
    return replace(recording, cameras=tuple(cameras)), records


def _marker_image(folder: Path) -> Path | None:
    return next((folder / name for name in MARKER_IMAGES if (folder / name).is_file()), None)


def _read(path: Path, camera: Camera) -> np.ndarray:
    """(height, width) or (height, width, 3), 8 or 16 bit."""
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
    """The camera's pose in Gamma_0 by the markers in one image, or why not.

    image (height, width) or (height, width, 3), 8 or 16 bit, of the depth images' geometry; depth_m (height,
    width), 0 = no reading: readings on the markers make the distance more accurate and separate the two poses of a
    flat layout.
    Corner residuals are robust; tags that do not fit the others are left out and named.
    Raises ValueError where an image has another size than the camera's.
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
        if 2 * (len(left_out) + 1) >= len(numbers) + len(left_out):  # no majority that agrees
            return NoMarkers.INCONSISTENT
        rest = {number: _candidates(seen.without(number), camera) for number in numbers}
        left_out.append(min(numbers, key=lambda number: rest[number][0][0] if rest[number] else np.inf))
        seen, poses = seen.without(left_out[-1]), rest[left_out[-1]]
    return _judged(poses, seen, camera, tuple(sorted(left_out)))


def _candidates(seen: SeenMarkers, camera: Camera) -> list[tuple[float, np.ndarray]]:
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
            poses.append(_refined(T_camera_world, seen, camera))
    poses.sort(key=lambda pose: pose[0])
    return [pose for index, pose in enumerate(poses) if index == 0 or _differ(poses[0][1], pose[1])]


def _differ(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two solutions are distinct: some starts converge to the same one."""
    step = invert_rigid(one) @ other
    turn = float(Rotation.from_matrix(step[:3, :3]).magnitude())
    return turn > SAME_RAD or float(np.linalg.norm(step[:3, 3])) > SAME_M


def _refined(start: np.ndarray, seen: SeenMarkers, camera: Camera) -> tuple[float, np.ndarray]:
    found = least_squares(lambda x: _rows(_moved(start, x), seen, camera), np.zeros(6), loss="soft_l1", f_scale=2)
    return float(2.0 * found.cost), _moved(start, found.x)


def _moved(T_camera_world: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The pose after a small turn x[:3] and shift x[3:] of the camera frame."""
    step = np.eye(4)
    step[:3, :3], step[:3, 3] = Rotation.from_rotvec(x[:3]).as_matrix(), x[3:]
    return np.asarray(step @ T_camera_world)


def _rows(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> np.ndarray:
    """Residuals in standard deviations: corners in the image, depth readings off the marker's plane."""
    points = transform_points(T_camera_world, seen.world_m)
    off = np.nan_to_num(camera.project(points) - seen.pixel, nan=1e3).ravel() / CORNER_SIGMA_PX
    rows = [off]
    for marker in np.unique(seen.plane):
        normal, place = _plane(points[seen.marker == marker])
        on = seen.plane == marker
        rays = np.concatenate([seen.rays[on], np.ones((int(on.sum()), 1))], axis=1)
        slope = rays @ normal
        predicted = (normal @ place) / np.where(np.abs(slope) > 1e-3, slope, np.inf)
        # errors of readings on one marker are correlated (ink, calibration of the sensor): all of them count as eight
        rows.append((seen.depth_m[on] - predicted) / DEPTH_SIGMA_M * np.sqrt(min(1.0, 8.0 / max(on.sum(), 1))))
    return np.concatenate(rows)


def _plane(points_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    center = points_m.mean(axis=0)
    return np.linalg.svd(points_m - center)[2][2], center


def _worst_corner_px(T_camera_world: np.ndarray, seen: SeenMarkers, camera: Camera) -> float:
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    return float(np.linalg.norm(np.nan_to_num(off, nan=1e3), axis=1).max())


def _judged(
    poses: list[tuple[float, np.ndarray]], seen: SeenMarkers, camera: Camera, left_out: tuple[int, ...]
) -> MarkerPose | NoMarkers:
    chi2, T_camera_world = poses[0]
    rows = _rows(T_camera_world, seen, camera)
    scale = max(1.0, chi2 / max(len(rows) - 6, 1))  # where the corners are worse than assumed, so is all else
    if len(poses) > 1 and (poses[1][0] - chi2) / scale < FLIPPED_CHI2:
        return NoMarkers.AMBIGUOUS
    off = camera.project(transform_points(T_camera_world, seen.world_m)) - seen.pixel
    rms = float(np.sqrt(np.mean((off**2).sum(axis=1))))
    if rms > WORST_RMS_PX:
        return NoMarkers.INCONSISTENT
    jacobian = least_squares(lambda x: _rows(_moved(T_camera_world, x), seen, camera), np.zeros(6), max_nfev=1).jac
    information = jacobian.T @ jacobian
    if np.linalg.cond(information) > 1e14:
        return NoMarkers.TOO_UNCERTAIN
    covariance = scale * np.linalg.inv(information)
    sigma_rad = float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))
    sigma_m = float(np.sqrt(np.trace(covariance[3:, 3:]) / 3.0))  # the camera's shift, whichever way it is turned
    if sigma_m > WORST_SIGMA_M or sigma_rad > WORST_SIGMA_RAD:
        return NoMarkers.TOO_UNCERTAIN
    markers = tuple(sorted(set(seen.marker.tolist())))
    return MarkerPose(invert_rigid(T_camera_world), rms, sigma_m, sigma_rad, len(seen.pixel), markers, left_out)
