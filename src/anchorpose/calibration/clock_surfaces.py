"""Measure the lag between the clocks of two cameras with known poses, from the surfaces that both cameras see.

A point that camera A saw at time t is projected into camera B at time t + lag. B's reading at this pixel, interpolated
in time, differs from the point's depth in B. This difference is the error of the assumed lag, multiplied by the rate at
which the depth changes. Tens of thousands of such residuals give the lag, by least squares, to below a millisecond.
Systematic differences of depth (due to wrong poses, errors of the sensors or clothes) do not bias the lag, because the
mean residual of each patch of the depth image is subtracted first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.common_view import NORMAL_PX, SurfaceGates, huber_weights, points_with_normals, smoothed
from anchorpose.calibration.first_frames import MAD_OF_NORMAL
from anchorpose.camera import Camera, invert_rigid, transform_points

UNITS_PER_M: Final = 4000.0  # units per metre in ``Clip.stack``; in quarters of a millimetre, 16 bits reach 16 m
# pixels, side of the window of the morphological opening that removes small groups of flickering pixels, since a limb
# has more pixels
OPENED_PX: Final = 5
# number of frames from which a pixel's noise is computed, by a median; with this number, the computed noise has an
# error of a quarter of its value
NOISE_FRAMES: Final = 16
# number of frames, spread over a clip, by which the range of a pixel's depth over time is measured
SPREAD_FRAMES: Final = 8

# pixels, spacing of the grid of points. Points are not taken from every pixel, since errors of neighbouring pixels are
# correlated; with this spacing, a body has 1700 points
STEP_PX: Final = 3
MOVED_M: Final = 0.01  # m, minimum change of a pixel's depth within a clip; smaller changes do not determine the lag
# minimum change of a pixel's depth within a clip (largest minus smallest), in sigmas of the pixel's noise; on a still
# surface, noise makes eight readings span about 3 sigmas
MOVED_GATE: Final = 6.0
# m, maximum difference of two depths on one surface; a larger difference shows two surfaces, such as a hand and a trunk
SAME_SURFACE_M: Final = 0.05
# m, maximum change of a pixel's depth for the pixel to show one moving surface. The limit applies to four consecutive
# frames (0.1 s at 30 Hz, so the surface moves at 1.5 m/s or less), and in ``_moving`` to a whole clip; if the edge of
# an object passes, the change is larger
ONE_SURFACE_M: Final = 0.15
# minimum cosine of the angle between a surface's normal and the ray, in both cameras; at flatter angles, readings are
# imprecise
LEAST_FACING: Final = 0.3
# pixels, side of the image patches whose mean residual is subtracted; at a distance of 2 m, a patch is 10 cm wide
PATCH_PX: Final = 24
# s, duration of the chunks of time into which residuals are divided for the lag's standard error; errors of residuals
# in one chunk are correlated
CHUNK_S: Final = 0.25
# minimum rate at which a point's depth changes, in sigmas of the rate's noise; points on still surfaces are left out,
# since they add no evidence and cost time
RATE_GATE: Final = 3.0
LEAST_POINTS: Final = 400  # minimum number of residuals for a lag; a hand alone has fewer
ROUNDS: Final = 12  # maximum number of Newton steps; three or four are enough
SETTLED_S: Final = 2e-5


@dataclass(frozen=True, slots=True, eq=False)
class Clip:
    """Consecutive depth frames of one camera with a known pose, and the points on moving surfaces in these frames.

    time_s (n,); stack (n, height * width) uint16: smoothed depth in m, multiplied by ``UNITS_PER_M``, 0 = no reading;
    noise_m (height * width,): standard deviation of still readings over time; points_world_m, normals_world (m, 3)
    float64: points on moving surfaces; frame (m,): index of each point's frame.
    """

    camera: Camera
    time_s: np.ndarray
    stack: np.ndarray
    noise_m: np.ndarray
    points_world_m: np.ndarray
    normals_world: np.ndarray
    frame: np.ndarray


@dataclass(frozen=True, slots=True)
class SurfaceLag:
    """A lag between two clocks, measured from surfaces that both cameras see. lag_s: the second clock minus the first
    at the same moment; sigma_s: its standard error; misfit_m: root mean square of all residuals at this lag, where
    residuals above ``SAME_SURFACE_M`` count as this value.
    """

    lag_s: float
    sigma_s: float
    misfit_m: float


def make_clip(camera: Camera, frames: Sequence[tuple[float, np.ndarray]]) -> Clip:
    """Make a clip from frames (time, depth (height, width) float32, 0 = no reading); the camera has a pose."""
    depths = np.stack([smoothed(depth, SAME_SURFACE_M, depth) for _, depth in frames])
    noise = _noise_over_time(depths)
    low, high = _range_over_time(depths)
    found = [_points(depth, _moving(depth, low, high, noise), camera) for depth in depths]
    T_world_camera = camera.require_pose()
    points = transform_points(T_world_camera, np.concatenate([points for points, _ in found]))
    normals = np.concatenate([normals for _, normals in found]) @ T_world_camera[:3, :3].T
    stack = np.rint(np.minimum(depths, 16.0) * UNITS_PER_M).astype(np.uint16).reshape(len(depths), -1)
    frame = np.repeat(np.arange(len(depths)), [len(points) for points, _ in found])
    return Clip(camera, np.array([time_s for time_s, _ in frames]), stack, noise.ravel(), points, normals, frame)


def surface_lag(first: Clip, second: Clip, around_s: float, reach_s: float) -> SurfaceLag | None:
    """Return the lag between two clips' clocks, searched within ``reach_s`` of ``around_s``; None if both cameras see
    too little movement in common, or if the search does not converge in this range.

    Evenly spaced lags are tried, and the best is refined by Newton steps. The Newton steps minimise the residuals of
    both clips' points by robust least squares; each point is compared with the other clip. The standard error takes
    into account that errors less than about ``CHUNK_S`` seconds apart are correlated.
    """
    there, back = _look_up(first, second), _look_up(second, first)
    step_s = 0.5 * there.period_s
    lags = around_s + step_s * np.arange(-int(np.ceil(reach_s / step_s)), int(np.ceil(reach_s / step_s)) + 1)
    cost = np.array([_truncated_misfit(there, back, lag) for lag in lags])
    if not np.isfinite(cost).any():
        return None
    lag_s = float(lags[np.nanargmin(cost)])
    for _ in range(ROUNDS):
        sides = (_normal_equation(there, lag_s), _normal_equation(back, -lag_s))
        weight, points = sides[0][0] + sides[1][0], sides[0][2] + sides[1][2]
        if points < LEAST_POINTS or weight <= 0:
            return None
        step = (sides[1][1].sum() - sides[0][1].sum()) / weight
        lag_s += float(np.clip(step, -step_s, step_s))
        if abs(step) < SETTLED_S:
            sigma_s = float(np.sqrt(sum((pull**2).sum() for _, pull, _ in sides))) / weight
            misfit_m = float(np.sqrt(_truncated_misfit(there, back, lag_s)))
            return SurfaceLag(lag_s, sigma_s, misfit_m) if abs(lag_s - around_s) <= reach_s + step_s else None
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _LookUp:
    """Points of the source clip, projected into the camera of the target clip. Arrays (n,): the index of a point's
    frame in the source, the point's flat pixel index and depth_m in the target; period_s: time between two frames of
    the target.
    """

    source: Clip
    target: Clip
    frame: np.ndarray
    pixel: np.ndarray
    depth_m: np.ndarray
    period_s: float


def _noise_over_time(depths_m: np.ndarray) -> np.ndarray:
    """Return (height, width) float32: the standard deviation of each pixel's readings, estimated from second
    differences over time.

    Each pixel has its own noise, since a floor at a grazing angle and edges of objects flicker many times more than a
    wall. The second difference of a steady movement is zero, and the median ignores other movement. If a pixel lacks
    readings, the noise of the whole image is used.
    """
    chosen = np.unique(np.linspace(1, len(depths_m) - 2, NOISE_FRAMES).astype(int))
    before, now, after = depths_m[chosen - 1], depths_m[chosen], depths_m[chosen + 1]
    second = np.where((before > 0) & (now > 0) & (after > 0), np.abs(before - 2.0 * now + after), np.inf)
    ordered = np.sort(second.reshape(len(second), -1).T, axis=1)  # gives the median five times as fast as np.median
    middle = (ordered[:, (len(second) - 1) // 2] + ordered[:, len(second) // 2]).reshape(second.shape[1:]) / 2.0
    noise = middle / (MAD_OF_NORMAL * np.sqrt(6.0))
    known = np.isfinite(noise)
    filled = np.where(known, noise, np.median(noise[known]) if known.any() else np.inf).astype(np.float32)
    return np.asarray(cv2.blur(filled, (5, 5)))


def _range_over_time(depths_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest and farthest smoothed depth (height, width) of each pixel over time; 0 where a reading is
    missing.
    """
    chosen = np.unique(np.linspace(0, len(depths_m) - 1, SPREAD_FRAMES).astype(int))
    seen = cv2.erode((depths_m[chosen] > 0).all(axis=0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    smooth = np.stack([cv2.blur(depth, (5, 5)) for depth in depths_m[chosen]])
    return np.where(seen, smooth.min(axis=0), 0.0), np.where(seen, smooth.max(axis=0), 0.0)


def _moving(depth_m: np.ndarray, low_m: np.ndarray, high_m: np.ndarray, noise_m: np.ndarray) -> np.ndarray:
    """Return (height, width) bool: pixels on a moving object, but not on the background that this object uncovers."""
    changed = (high_m - low_m > np.maximum(MOVED_M, MOVED_GATE * noise_m)).astype(np.uint8)
    changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((OPENED_PX, OPENED_PX), np.uint8))
    ahead = (high_m - low_m < ONE_SURFACE_M) | (depth_m < high_m - ONE_SURFACE_M)
    moving: np.ndarray = (changed > 0) & ahead & (depth_m > 0)
    return moving


def _points(depth_m: np.ndarray, moving: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Return points and unit normals (m, 3), camera frame, at the pixels of a grid that ``moving`` (height, width)
    marks; a pixel is used if it lies, with its neighbours, on one surface that faces the camera.
    """
    inner = (slice(NORMAL_PX, size - NORMAL_PX, STEP_PX) for size in (camera.height, camera.width))
    rows, columns = (grid.ravel() for grid in np.mgrid[*inner])
    chosen = moving[rows, columns]
    gates = SurfaceGates(SAME_SURFACE_M, LEAST_FACING)
    points, normals, good = points_with_normals(camera, depth_m, rows[chosen], columns[chosen], gates)
    return points[good], normals[good]


def _look_up(source: Clip, target: Clip) -> _LookUp:
    T_target_world = invert_rigid(target.camera.require_pose())
    points = transform_points(T_target_world, source.points_world_m)
    normals = source.normals_world @ T_target_world[:3, :3].T
    column, row, inside = target.camera.pixel_of(points)
    towards = -np.einsum("ij,ij->i", normals, points)
    kept = inside & (towards > LEAST_FACING * np.linalg.norm(points, axis=1))
    pixel = (row * target.camera.width + column)[kept]
    period_s = float(np.median(np.diff(target.time_s)))
    return _LookUp(source, target, source.frame[kept], pixel, points[kept, 2], period_s)


def _residuals(look: _LookUp, lag_s: float, every: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return, for each point that both cameras see at this lag: its index; the target's depth minus the point's depth
    (m); and the rate of change of the target's depth (m/s), computed in two ways from four consecutive frames: from the
    outer two frames, and from the inner two frames.

    The target's depth is interpolated between the inner two frames. The caller therefore multiplies the difference of
    depths by the rate from the outer two frames. The rate from the inner two frames shares its noise with the
    interpolated depth, so differences multiplied by this rate would pull the lag towards the middle between two frames.
    """
    target_s, pixels = look.target.time_s, look.target.stack
    wanted_s = look.source.time_s + lag_s
    before = np.searchsorted(target_s, wanted_s, side="right") - 1
    within = (before >= 1) & (before < len(target_s) - 2)
    before = np.clip(before, 1, len(target_s) - 3)
    around_s = target_s[before + 2] - target_s[before - 1]
    within &= around_s < 4.5 * look.period_s  # allows one dropped frame
    share = (wanted_s - target_s[before]) / (target_s[before + 1] - target_s[before])
    index = np.flatnonzero(within[look.frame])[::every]
    frame = look.frame[index]
    four = np.stack([pixels[before[frame] + k, look.pixel[index]] for k in (-1, 0, 1, 2)]).astype(np.float32)
    four /= np.float32(UNITS_PER_M)
    rate = (four[3] - four[0]) / around_s[frame]
    still = RATE_GATE * np.sqrt(2.0) * look.target.noise_m[look.pixel[index]] / around_s[frame]
    one = (four.min(axis=0) > 0) & (np.ptp(four, axis=0) < ONE_SURFACE_M) & (np.abs(rate) > still)
    depth = four[1] + (four[2] - four[1]) * share[frame]
    slope = (four[2] - four[1]) / (target_s[before + 1] - target_s[before])[frame]
    return index[one], (depth - look.depth_m[index])[one], rate[one], slope[one]


def _truncated_misfit(there: _LookUp, back: _LookUp, lag_s: float) -> float:
    """Return the mean squared residual of the points of both clips, each compared with the other clip. Residuals above
    ``SAME_SURFACE_M`` count as this value; NaN with too few residuals.
    """
    both = [_residuals(look, lag, every=4)[1] for look, lag in ((there, lag_s), (back, -lag_s))]
    residual = np.concatenate(both)
    if 4 * len(residual) < LEAST_POINTS:
        return float("nan")
    return float(np.minimum(residual**2, SAME_SURFACE_M**2).mean())


def _normal_equation(look: _LookUp, lag_s: float) -> tuple[float, np.ndarray, int]:
    """Return three values that describe the sum, over all points, of weight times rate times residual: the derivative
    of this sum by the lag; the sum's parts, one per chunk of time (``CHUNK_S``); and the number of residuals in the
    sum. At the true lag, the parts are uncorrelated.
    """
    index, residual, rate, slope = _residuals(look, lag_s)
    same = np.abs(residual) < SAME_SURFACE_M
    index = index[same]
    if not len(index):
        return 0.0, np.zeros(1), 0
    width = look.target.camera.width
    patch = look.pixel[index] // width // PATCH_PX * width
    patch += look.pixel[index] % width // PATCH_PX
    residual, rate = (_less_patch_mean(values[same], patch) for values in (residual, rate))
    weight, _ = huber_weights(residual)
    source_s = look.source.time_s
    chunk = ((source_s[look.frame[index]] - source_s[0]) / CHUNK_S).astype(np.int64)
    pull = np.bincount(chunk, weight * rate * residual)
    return float((weight * rate * slope[same]).sum()), pull, len(index)


def _less_patch_mean(values: np.ndarray, patch: np.ndarray) -> np.ndarray:
    _, number = np.unique(patch, return_inverse=True)
    mean = np.bincount(number, values) / np.bincount(number)
    less: np.ndarray = values - mean[number]
    return less
