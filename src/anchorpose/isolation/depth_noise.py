"""Describe one camera's depth images by their noise, the depth step from one stored grey value to the next, the width
of edges, and false ramps between surfaces.

Spatial filters (such as librealsense's) connect a person with the wall behind by a false ramp, a decimetre wide.

Noise is measured on pixels that show the empty room in two sampled frames, since two readings of a still surface differ
only by noise. Second differences along an image row, which ``calibration.first_frames`` uses, would miss the error that
neighbouring pixels share. The error of a stereo camera is the same within a patch as wide as its matching window. So
the mean over all readings of a limb has hardly less of this error than a single reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.first_frames import step_per_m
from anchorpose.camera import Camera
from anchorpose.descriptor.people import people_mask
from anchorpose.isolation.components import JumpLimit, jump_limit

LIMB_M: Final = 0.08  # m, thickness of a forearm, the thinnest limb (25 cm in circumference)
# pixels, width of a depth edge that no filter has blurred: at most one pixel with a mixed depth lies between the pixels
# that show its two sides
SHARP_EDGE_PX: Final = 2.0


@dataclass(frozen=True, slots=True)
class DepthDetail:
    """The width of depth edges, and the depth step from one grey value to the next, in one camera's images."""

    edge_px: float  # width of the camera's depth edges in pixels
    focal_px: float  # focal length in pixels
    step_per_m: float = 0.0  # 1/m; the depth step from one grey value to the next is ``step_per_m z^2``; 0 = unknown

    @property
    def filtered(self) -> bool:
        """Return whether filters have blurred the depth edges."""
        return self.edge_px > SHARP_EDGE_PX

    def edge_m(self, distance_m: float) -> float:
        """Return the width of a depth edge at a distance, metres."""
        return self.edge_px * distance_m / self.focal_px

    def step_m(self, distance_m: float) -> float:
        """Return the depth step from one grey value to the next at a distance, metres."""
        return self.step_per_m * distance_m**2

    @property
    def limbs_until_m(self) -> float:
        """Return the distance from the camera, in metres, beyond which depth edges (ramps from an object's depth to the
        depth behind it) are wider than a forearm, so that no pixel shows the forearm's own depth.
        """
        return LIMB_M * self.focal_px / self.edge_px


WIDEST_PX: Final = 16  # pixels, maximum width of an edge; a wider ramp is a slanting surface
# m, minimum depth difference across a measured edge; edges of clothes, arms and seats are left out, since they are
# nearer than this to the surface behind them
JUMP_M: Final = 0.40
FLAT: Final = 0.1  # maximum depth change along one side of an edge, as a share of the depth difference across it
MIDDLE: Final = (0.2, 0.8)  # an edge's width is measured from 20 % to 80 % of the depth difference across it
# minimum number of measured edges in all frames; one image of a real, filtered recording has 900 on a person's outline
LEAST_EDGES: Final = 200
# pixels, maximum width of a sharp edge, measured from 20 % to 80 % of the depth difference (``MIDDLE``); edges that no
# filter has blurred have a width of at most one pixel
SHARP_PX: Final = 2.0
FRAMES: Final = 8  # number of frames in which edges are measured
# a pixel that differs from both sides of an edge by more than this share of the edge's depth jump is on a false ramp
ON_RAMP: Final = 0.15


def smear_px(frames_m: Sequence[np.ndarray], people: Sequence[np.ndarray] | None = None) -> int | None:
    """Return the width in pixels of this camera's depth edges; 0 if they are sharp, None if too few edges are seen.

    frames_m: (height, width) float32 metres, 0 = no reading. people: for each frame (height, width) bool, the pixels
    that show people; only the outlines of people are measured. None: all edges are measured.
    """
    masks = [None] * (2 * len(frames_m)) if people is None else [mask for own in people for mask in (own, own.T)]
    turned = [depth for frame in frames_m for depth in (frame, frame.T)]
    middles = np.concatenate([_middles(depth, mask) for depth, mask in zip(turned, masks, strict=True)])
    if len(middles) < LEAST_EDGES:
        return None
    middle = float(np.median(middles))
    return 0 if middle <= SHARP_PX else int(np.ceil(middle / (MIDDLE[1] - MIDDLE[0])))


def _middles(depth_m: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """Return the widths (e,), pixels, of depth edges with a flat surface on both sides, found along the rows. A width
    is the number of pixels whose depth lies from 20 % to 80 % (``MIDDLE``) of the way from the nearer to the farther
    side.

    near (height, width) bool: only edges are measured whose nearer side lies in this mask and whose farther side does
    not.
    """
    beside, width = 4, depth_m.shape[1]
    span = width - WIDEST_PX - 2 * beside
    if span <= 0:
        return np.zeros(0, np.int64)
    places = [depth_m[:, k : k + span] for k in (0, beside, beside + WIDEST_PX, WIDEST_PX + 2 * beside)]
    jump = np.abs(places[2] - places[1])
    even = (np.abs(places[1] - places[0]) < FLAT * jump) & (np.abs(places[3] - places[2]) < FLAT * jump)
    measured = (jump > JUMP_M) & even
    if near is not None:
        left, right = near[:, beside : beside + span], near[:, beside + WIDEST_PX : beside + WIDEST_PX + span]
        measured &= np.where(places[1] < places[2], left & ~right, right & ~left)
    row, column = np.nonzero(measured)
    ramp = depth_m[row[:, None], column[:, None] + np.arange(WIDEST_PX + 2 * beside + 1)]
    ramp = ramp[(ramp > 0).all(axis=1), beside : beside + WIDEST_PX + 1]
    ends = np.sort(ramp[:, [0, -1]], axis=1)
    share = (ramp - ends[:, :1]) / np.maximum(np.diff(ends, axis=1), 1e-6)
    return np.asarray(((share > MIDDLE[0]) & (share < MIDDLE[1])).sum(axis=1))


def smeared(depth_m: np.ndarray, width_px: int) -> np.ndarray:
    """Return (height, width) bool: pixels on a false ramp between two surfaces. width_px: from ``smear_px``."""
    square = np.ones((2 * width_px + 1, 2 * width_px + 1), np.uint8)
    seen = depth_m > 0
    near = cv2.erode(np.where(seen, depth_m, np.float32(1e3)), square)
    far = cv2.dilate(depth_m, square)
    jump = far - near
    return np.asarray(seen & (jump > JUMP_M) & (depth_m > near + ON_RAMP * jump) & (depth_m < far - ON_RAMP * jump))


CHANGES: Final = 6  # number of pairs of frames that are compared; together, they have half a million pixels or more
# sigmas; a reading closer than this to the background shows the background; people stand farther in front of the
# background
STILL_GATE: Final = 6.0
# sigmas; a reading with a larger error is an outlier and is left out; normally distributed noise exceeds this once in
# 16,000 readings
OUTLIER_GATE: Final = 4.0
ROUNDS: Final = 3  # number of times that outliers are removed and sigma is computed again
# pixels, maximum distance from a depth edge of readings that count as beside the edge; they may lie between two
# surfaces, so they are counted separately
EDGE_PX: Final = 2
# m, minimum difference between the nearest and the farthest depth in 5x5 pixels at an edge; on a slanted surface, it is
# less
EDGE_M: Final = 0.10
BIN_M: Final = 0.5  # m, width of the depth bins; noise is measured per bin
# degrees between ray and surface normal; surfaces up to the first angle are called "facing", up to the second
# "slanted", beyond it "steep"
SLANTS_DEG: Final = (35.0, 60.0)
# minimum number of readings per depth bin and slant; sigma is then known to 10 % even if 40 readings share one error
LEAST_READINGS: Final = 2000
LONGEST_PX: Final = 24  # pixels, maximum distance between two pixels whose errors are compared
UNRELATED: Final = 0.05  # correlation below which pixels count as independent, since a smaller value may be chance
SMOOTH_PX: Final = 9  # pixels, side of the window over which a surface normal is computed


@dataclass(frozen=True, slots=True)
class DepthNoise:
    """The random error of one camera's readings along its optical axis."""

    at_m: tuple[float, ...]  # m, depths in increasing order
    sigma_at_m: tuple[float, ...]  # m, sigma of a reading at these depths, on a surface that faces the camera
    # factors on sigma, first for slanted surfaces (35 to 60 degrees between ray and normal), then for steeper ones;
    # None if not measured
    slants: tuple[float | None, float | None] = (None, None)
    shared_px: float = 1.0  # mean number of pixels that share one error; 1 = pixels are independent
    # share of the readings beside depth edges that have the depth of neither side of the edge; None if not measured
    flying: float | None = None
    holes: float | None = None  # share of pixels on the room's surfaces without a reading; None if not measured
    # False if no still background was seen; sigma is then a lower bound, measured between neighbouring readings
    measured: bool = True

    def sigma_m(self, depth_m: np.ndarray, slant_deg: np.ndarray | None = None) -> np.ndarray:
        """Return sigma, metres, at each depth of an array; slant_deg: array of the same shape, None = facing the
        camera.

        The ratio sigma / z^2, where z is the depth, is interpolated linearly between the depths at which it was
        measured, and is constant beyond them.
        """
        depth = np.asarray(depth_m, np.float64)
        per_square = np.interp(depth, self.at_m, np.divide(self.sigma_at_m, np.square(self.at_m)))
        return np.asarray(per_square * depth**2 * (1.0 if slant_deg is None else self._times(slant_deg)))

    def _times(self, slant_deg: np.ndarray) -> np.ndarray:
        """Return, for each slant of a surface, the factor by which sigma on a surface that faces the camera is
        multiplied. If a class of slants has no measured factor, it gets the factor of the class with the next smaller
        slant.
        """
        times = [1.0]
        for slant in self.slants:
            times.append(times[-1] if slant is None else slant)
        return np.array(times)[np.digitize(slant_deg, SLANTS_DEG)]


def neighbour_noise(neighbours_per_m: float) -> DepthNoise:
    """Return the noise for a camera that sees no still background: sigma is ``neighbours_per_m z^2`` at depth z, where
    the factor comes from ``calibration.first_frames.noise_per_m``, and the errors of pixels count as independent.
    """
    return DepthNoise((1.0,), (neighbours_per_m,), measured=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor(DepthDetail):
    """The measured properties of one camera's depth images."""

    # 1/m; sigma of a reading at depth z is ``noise_per_m z^2``, as measured between neighbouring readings of one
    # surface
    noise_per_m: float
    noise: DepthNoise  # noise of a single reading

    @property
    def jump_limit(self) -> JumpLimit:
        """Return the largest depth difference between neighbouring pixels of one surface in this camera's frames."""
        return jump_limit(self.noise_per_m, self.focal_px)

    def without_ramps(self, depth_m: np.ndarray) -> np.ndarray:
        """Return depth (height, width) float32, 0 = no reading, without the false ramps that filters draw."""
        return np.where(smeared(depth_m, int(self.edge_px)), np.float32(0.0), depth_m) if self.filtered else depth_m


def measure_detail(frames_m: Sequence[np.ndarray], camera: Camera) -> DepthDetail:
    """Measure edge width and depth steps on one camera's frames (height, width) float32 metres, 0 = no reading.

    A slanted surface between two flat surfaces looks like a wide edge. In an image without readings behind the people,
    such surfaces may outnumber the edges. So if edges seem wide, the outlines of people alone are measured. If too few
    outlines have readings behind them, edges count as sharp, since a filter draws no ramp to a surface without
    readings.
    """
    chosen = frames_m[:: max(1, len(frames_m) // FRAMES)]
    edge_px = smear_px(chosen) or 0
    if edge_px:
        edge_px = smear_px(chosen, [people_mask(depth, camera) for depth in chosen]) or 0
    return DepthDetail(max(edge_px, SHARP_EDGE_PX), camera.intrinsics.fx, step_per_m(frames_m))


def measure_noise(
    room_m: np.ndarray, sigma_m: np.ndarray, frames_m: Sequence[np.ndarray], camera: Camera, neighbours_per_m: float
) -> DepthNoise:
    """Measure a camera's noise on frames (height, width) of one recording, 0 = no reading.

    room_m, sigma_m (height, width): the empty room, 0 = unknown, and the standard deviation of its readings
    (``BackgroundModel``). neighbours_per_m: factor of ``neighbour_noise``, used if too little of the room is seen in
    two frames.
    """
    chosen = np.unique(np.linspace(0, len(frames_m) - 1, CHANGES + 1).astype(int))
    frames = [frames_m[k] for k in chosen]
    near, far = _around(room_m)
    surface, edge = (room_m > 0) & (far - near < EDGE_M), (near > 0) & (far - near > EDGE_M)
    still = [surface & (frame > 0) & (np.abs(frame - room_m) < STILL_GATE * sigma_m) for frame in frames]
    pairs = pairwise(zip(frames, still, strict=True))
    change = [np.where(a & b, (after - before) / np.sqrt(2.0), np.nan) for (before, a), (after, b) in pairs]
    slant_deg = _slant_deg(room_m, camera)
    law = _law(np.stack(change), room_m, np.digitize(slant_deg, SLANTS_DEG)) if change else None
    if law is None:
        return neighbour_noise(neighbours_per_m)
    in_sigmas = np.stack(change) / np.where(surface, law.sigma_m(room_m, slant_deg), 1.0)
    return DepthNoise(
        law.at_m,
        law.sigma_at_m,
        law.slants,
        _shared(in_sigmas),
        _flying(frames, near, far, STILL_GATE * sigma_m, edge),
        _holes(frames, still, surface),
    )


def _around(room_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest and the farthest depth (height, width) of the room in each pixel's neighbourhood, which
    extends ``EDGE_PX`` to each side. Return 0 and inf if the room's depth is unknown at any pixel of the neighbourhood.
    """
    square = np.ones((2 * EDGE_PX + 1, 2 * EDGE_PX + 1), np.uint8)
    near, far = cv2.erode(room_m, square), cv2.dilate(room_m, square)
    return near, np.where(near > 0, far, np.float32(np.inf))


def _slant_deg(room_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Return the angle (height, width), degrees, from each ray to the normal of the smoothed surface; 0 if unknown."""
    size = (SMOOTH_PX, SMOOTH_PX)
    share = cv2.blur((room_m > 0).astype(np.float32), size)
    smooth_m = np.where(room_m > 0, cv2.blur(room_m, size) / np.maximum(share, 1e-6), np.float32(0.0))
    points = np.nan_to_num(camera.back_project(smooth_m).astype(np.float64))
    normal = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    length = np.linalg.norm(normal, axis=-1) * np.linalg.norm(points, axis=-1)
    cosine = np.abs((normal * points).sum(axis=-1)) / np.where(length > 0, length, np.inf)
    return np.where(length > 0, np.degrees(np.arccos(np.minimum(cosine, 1.0))), 0.0)


def _law(change_m: np.ndarray, room_m: np.ndarray, slant: np.ndarray) -> DepthNoise | None:
    """Fit the noise law: sigma is a function of depth, multiplied by a factor for the slant. The fit is least squares
    on the logarithm of sigma in each cell (a depth bin and a class of slant). Return None if no cell is measured.

    change_m (n, height, width): noise of each reading, NaN where unknown; slant (height, width): 0 = facing, 1 =
    slanted, 2 = steep.
    """
    cells = _cells(change_m, room_m, slant)
    if not cells:
        return None
    levels, slants = sorted({level for level, _ in cells}), sorted({slant for _, slant in cells})
    matrix = np.zeros((len(cells), len(levels) + len(slants)))
    for row, (level, kind) in zip(matrix, cells, strict=True):
        row[levels.index(level)] = row[len(levels) + slants.index(kind)] = 1.0
    logs, depth_m = np.log(np.array(list(cells.values()))).T
    found = np.linalg.lstsq(matrix, logs, rcond=None)[0]
    by_level, by_slant = found[: len(levels)], dict(zip(slants, found[len(levels) :], strict=True))
    # the returned sigma holds for surfaces that face the camera; if none is seen, it holds for the least slanted
    # surfaces that are seen, where sigma is larger
    reference = by_slant[slants[0]]
    at_m = [float(np.exp(np.mean([d for d, (at, _) in zip(depth_m, cells, strict=True) if at == k]))) for k in levels]
    times = [float(np.exp(by_slant[k] - reference)) if k in by_slant else None for k in (1, 2)]
    return DepthNoise(tuple(at_m), tuple(np.exp(by_level + reference).tolist()), (times[0], times[1]))


def _cells(change_m: np.ndarray, room_m: np.ndarray, slant: np.ndarray) -> dict[tuple[int, int], tuple[float, float]]:
    """Return (sigma, median depth), metres, of each cell, that is, of each pair of a depth bin and a class of slant;
    keys are (number of the depth bin, slant). Cells with too few readings, or without noise, are left out.
    """
    _, row, column = np.nonzero(np.isfinite(change_m))
    value, depth_m = change_m[np.isfinite(change_m)], room_m[row, column]
    level, kind = (depth_m / BIN_M).astype(np.int64), slant[row, column]
    found = {}
    for key in np.unique(3 * level + kind).tolist():
        here = 3 * level + kind == key
        sigma = _deviation(value[here])
        if np.count_nonzero(here) >= LEAST_READINGS and sigma > 0:
            found[divmod(key, 3)] = (sigma, float(np.median(depth_m[here])))
    return found


def _deviation(values: np.ndarray) -> float:
    """Return the root mean square of the values without outliers. A median is not used: with coarse grey values most
    readings do not change between frames, and the median would be 0.
    """
    sigma = float(np.sqrt(np.mean(values**2)))
    for _ in range(ROUNDS):
        sigma = float(np.sqrt(np.mean(values[np.abs(values) <= OUTLIER_GATE * sigma] ** 2)))
    return sigma


def _shared(in_sigmas: np.ndarray) -> float:
    """Return how many pixels share one error: the sum of a pixel's correlations with itself and all pixels around it.

    in_sigmas (n, height, width): noise divided by its sigma, NaN where unknown. Correlations are summed by rings of
    equal distance, up to the first ring with a mean correlation below ``UNRELATED``. The correlation is computed for
    all lags (offsets from pixel to pixel) up to ``LONGEST_PX``, by Fourier transforms. A few lags would not suffice: as
    a function of the lag, the correlation may be a narrow peak on top of a broad peak.
    """
    seen = np.abs(in_sigmas) < OUTLIER_GATE
    value = np.where(seen, in_sigmas, 0.0).astype(np.float32)
    related = _at_lags(value) / np.maximum(np.rint(_at_lags(seen.astype(np.float32))), 1.0)
    rows, columns = np.ogrid[: related.shape[0], -LONGEST_PX : LONGEST_PX + 1]
    ring = np.rint(np.hypot(rows, columns)).astype(np.int64)
    # opposite lags have the same correlation, so only one lag of each pair is summed and counts twice; lag 0 counts
    # once
    twice = np.where((rows > 0) | (columns > 0), 1.0, 0.5) * ((rows > 0) | (columns >= 0))
    weight = np.bincount(ring.ravel(), twice.ravel())[: LONGEST_PX + 1]
    total = np.bincount(ring.ravel(), (twice * related).ravel())[: LONGEST_PX + 1] / related[0, LONGEST_PX]
    unrelated = np.flatnonzero(total < UNRELATED * weight)
    return float(2.0 * total[: unrelated[0] if len(unrelated) else None].sum())


def _at_lags(images: np.ndarray) -> np.ndarray:
    """Return, for each lag in rows and (signed) columns, the sum of the products of all pairs of pixels at this lag,
    (LONGEST_PX + 1, 2 LONGEST_PX + 1).
    """
    size = tuple(cv2.getOptimalDFTSize(side + LONGEST_PX) for side in images.shape[1:])
    power = sum(np.abs(np.fft.rfft2(image, size)) ** 2 for image in images)
    lags = np.fft.irfft2(power, size)
    return np.roll(lags, LONGEST_PX, axis=1)[: LONGEST_PX + 1, : 2 * LONGEST_PX + 1]


def _flying(
    frames_m: Sequence[np.ndarray], near_m: np.ndarray, far_m: np.ndarray, gate_m: np.ndarray, edge: np.ndarray
) -> float | None:
    """Return the share of the readings beside the room's depth edges that show neither side of the edge."""
    beside = edge & np.isfinite(far_m) & (far_m - near_m > 2.0 * gate_m + EDGE_M)
    read = [beside & (frame > near_m - gate_m) & (frame < far_m + gate_m) for frame in frames_m]
    between = [(frame > near_m + gate_m) & (frame < far_m - gate_m) for frame in frames_m]
    count = sum(int(np.count_nonzero(one)) for one in read)
    flying = sum(int(np.count_nonzero(one & other)) for one, other in zip(read, between, strict=True))
    return flying / count if count >= LEAST_READINGS else None


def _holes(frames_m: Sequence[np.ndarray], still: Sequence[np.ndarray], surface: np.ndarray) -> float | None:
    """Return the share of pixels on the room's surfaces that have no reading; pixels on people do not count."""
    lost = sum(int(np.count_nonzero(surface & (frame <= 0))) for frame in frames_m)
    count = lost + sum(int(np.count_nonzero(one)) for one in still)
    return lost / count if count >= LEAST_READINGS else None
