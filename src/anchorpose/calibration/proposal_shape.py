"""Fit the faces of a part by robust least squares: readings should lie on its surface, and rays that end beyond it
should miss it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from anchorpose.calibration.first_frames import MAD_OF_NORMAL
from anchorpose.calibration.proposal_readings import Readings
from anchorpose.recording.equipment import Box, Cylinder

LEAST_SIGMA_M: Final = 0.003  # m, minimum sigma of a reading; neither tubes nor camera poses are more accurate
REACH_M: Final = 0.03  # m from a part's surface; readings within this distance belong to the part
BEYOND_M: Final = 0.05  # m; if a ray ends this far behind a part, it has passed the part
STEP_M: Final = 0.015  # m, step along a ray, half the thickness of a thin plate
ROWS: Final = 300  # maximum number of readings, and of rays, for one part; faces are then precise to half a millimetre
TRIALS: Final = 25  # maximum number of iterations of the solver; most fits converge after ten
# m, sigma of the difference between the two breadths of a bar that is assumed to be square; readings of a visible side
# outweigh this assumption
SQUARE_SIGMA_M: Final = 0.02
PLATE_M, PLATE_SIGMA_M = 0.03, 0.02  # m, assumed thickness of a seat whose edge is not seen, and its sigma
# sine of 24 degrees; a part's extent along an axis counts as unseen if the angle from axis to line of sight is smaller.
# At an angle of 24 degrees, the visible side of a 5 cm bar is three pixels wide
ASLANT: Final = 0.4
# factor by which the residual of the assumption that a bar is square, or a plate thin, is multiplied if no camera sees
# the part's extent along one of its axes
ASSUMED: Final = 20.0
THINNEST_M, BROADEST_M = 0.01, 0.13  # m, minimum and maximum breadth of a bar; broader parts, such as pads, are plates
END_SIGMA_M: Final = 0.05  # m, sigma of the distance from a bar's last reading to its end, if no camera sees the end
# maximum cost of the fitted tube, divided by the cost of the fitted box, for the tube to be used. The ratio is above 1,
# since a box has one more free length than a tube, so that it fits a little better even if the part is a tube
ROUNDER: Final = 1.12
# minimum number of readings on a face, or of rays that pass by it; with fewer, the face's place is a guess
LEAST_SUPPORT: Final = 12


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A box along the axes ``rotation``, or a tube along the last axis.

    rotation (3, 3): from the part's axes to the world; low, high (3,): position of the faces along the axes, relative
    to the world's origin. A round part (tube) has the same breadth along the first two axes. cost: cost of the fit per
    reading; residual_m: robust spread of the readings about the surface; support (3, 2): for the lower and upper face
    along each axis, the number of readings and of places on passing rays that lie close to the face; readings: number
    of readings on the part; blind (3,) bool: axes along which no camera sees the part's extent.
    """

    rotation: np.ndarray
    low: np.ndarray
    high: np.ndarray
    plate: bool
    round: bool
    cost: float
    residual_m: float
    support: np.ndarray
    readings: int
    blind: np.ndarray

    @property
    def size_m(self) -> np.ndarray:
        """Return the edge lengths (3,) along the axes."""
        return self.high - self.low

    @property
    def center_m(self) -> np.ndarray:
        """Return the centre (3,), world."""
        middle: np.ndarray = self.rotation @ ((self.low + self.high) / 2.0)
        return middle

    @property
    def axis(self) -> np.ndarray:
        """Return a bar's direction or a plate's normal, (3,), world."""
        return self.rotation[:, 2]

    def part(self, name: str) -> Box | Cylinder:
        """Return the part in the form of equipment.json."""
        if self.round:
            return Cylinder(name, self.center_m, self.axis, float(self.size_m[0] / 2.0), float(self.size_m[2]))
        return Box(name, self.center_m, self.size_m, self.rotation)

    def distance_m(self, points_m: np.ndarray) -> np.ndarray:
        """Return the signed distance (n,) to the surface."""
        return self.part("").distance_m(points_m)


def first_fit(rotation: np.ndarray, low: np.ndarray, high: np.ndarray, plate: bool, seen_from: np.ndarray) -> Fit:
    """Make a part from its visible points. Its unseen thickness is assumed: a bar's breadth, or ``PLATE_M`` for a
    plate. seen_from (3,): camera position along the part's axes.
    """
    low, high = low.copy(), high.copy()
    size = high - low
    for axis, other in ((0, 1), (1, 0)) if not plate else ((2, 2),):
        wanted = PLATE_M if plate else size[other]
        if size[axis] < wanted:
            if seen_from[axis] > 0:
                low[axis] = high[axis] - wanted
            else:
                high[axis] = low[axis] + wanted
    return Fit(rotation, low, high, plate, False, np.inf, np.inf, np.zeros((3, 2)), 0, np.zeros(3, dtype=bool))


def refine(fit: Fit, readings: Readings, own: np.ndarray, turn: bool = False, tubes: bool = False) -> Fit:
    """Fit a box to the readings. If ``tubes`` is True and a tube fits the readings about as well, return the tube.

    own (n,) bool: readings on this part. turn: whether the fit may also turn the axes.
    """
    evidence = _evidence(fit, readings, own)
    fit = replace(fit, blind=_blind(fit, readings.origin_m[own]))
    best = _solve(replace(fit, round=False), evidence, turn)
    if tubes and not fit.plate:
        tube = _solve(_as_tube(best), evidence, turn)
        best = tube if tube.cost < ROUNDER * best.cost else best
    return replace(best, readings=int(own.sum()))


@dataclass(frozen=True, slots=True, eq=False)
class _Evidence:
    """The evidence for one part. points_m (n, 3): its readings, with sigma_m (n,); hitting_m (n, k, 3): places on the
    rays of these readings, which hit the part; passing_m (m, k, 3): places on rays that miss the part. hitting_sigma_m
    (n,), passing_sigma_m (m,): half the breadth of a pixel.
    """

    points_m: np.ndarray
    sigma_m: np.ndarray
    hitting_m: np.ndarray
    hitting_sigma_m: np.ndarray
    passing_m: np.ndarray
    passing_sigma_m: np.ndarray


def _evidence(fit: Fit, readings: Readings, own: np.ndarray) -> _Evidence:
    rows = np.flatnonzero(own)
    rows = rows[:: max(1, len(rows) // ROWS)]
    near, distance = _closest_approach(fit, readings)
    thick = float(np.linalg.norm(np.delete(fit.size_m, np.argmax(fit.size_m)))) / 2.0
    passed = (readings.depth_m > near + thick + BEYOND_M) & (distance < thick + 0.02) & (near > 0)
    passing = np.flatnonzero(passed)
    places = _along_rays(readings, passing, near, thick)
    close = np.flatnonzero(_nearest_distance(places, fit) < 0.015)
    close = close[:: max(1, len(close) // ROWS)]
    half_pixel = 0.5 * readings.pixel_m * near / readings.depth_m
    return _Evidence(
        points_m=readings.points_m[rows],
        sigma_m=np.hypot(LEAST_SIGMA_M, readings.sigma_m[rows]),
        hitting_m=_along_rays(readings, rows, near, thick),
        hitting_sigma_m=np.maximum(half_pixel[rows], 1e-3),
        passing_m=places[close],
        passing_sigma_m=np.maximum(half_pixel[passing[close]], 1e-3),
    )


def _blind(fit: Fit, origins_m: np.ndarray) -> np.ndarray:
    """Return (3,) bool: axes that lie nearly along the lines of sight of all cameras that see the part. The part's
    extent along these axes is not seen, since its outline shows only the extent along the other axes.
    """
    view = (np.unique(origins_m, axis=0) - fit.center_m) @ fit.rotation
    blind = np.zeros(3, dtype=bool)
    if fit.plate:
        view /= np.linalg.norm(view, axis=1, keepdims=True)
        blind[2] = np.all(np.linalg.norm(view[:, :2], axis=1) < ASLANT)
    else:
        view[:, :2] /= np.maximum(np.linalg.norm(view[:, :2], axis=1, keepdims=True), 1e-9)
        blind[:2] = (np.abs(view[:, 1::-1]) < ASLANT).all(axis=0)
    return blind


def _along_rays(readings: Readings, rows: np.ndarray, near: np.ndarray, thick_m: float) -> np.ndarray:
    """Return places (n, k, 3) on each ray, about ``STEP_M`` apart or less, around the point nearest to the part."""
    length = np.linalg.norm(readings.ray[rows], axis=1)
    count = max(5, int(np.ceil(2.0 * thick_m / STEP_M)))
    along = near[rows, None] + np.linspace(-1.0, 1.0, count) * thick_m / length[:, None]
    places: np.ndarray = readings.origin_m[rows, None] + along[..., None] * readings.ray[rows, None]
    return places


def _nearest_distance(places_m: np.ndarray, fit: Fit) -> np.ndarray:
    """Return, for each ray, the least signed distance (n,) of its places (n, k, 3) from the part's surface."""
    distance = _local_distance(places_m.reshape(-1, 3), fit).reshape(places_m.shape[:2])
    return np.asarray(distance.min(axis=1, initial=1.0))


def _closest_approach(fit: Fit, readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """Return the depth at which each ray is nearest to a part's middle line, and the distance between ray and line
    there.
    """
    long = int(np.argmax(fit.size_m))
    center_m, axis, half_m = fit.center_m, fit.rotation[:, long], fit.size_m[long] / 2.0
    offset = readings.origin_m - center_m
    d, o = readings.ray @ axis, offset @ axis
    across, start = readings.ray - d[:, None] * axis, offset - o[:, None] * axis
    t = -(across * start).sum(axis=1) / np.maximum((across**2).sum(axis=1), 1e-12)
    on_axis = np.clip(o + t * d, -half_m, half_m)
    point = center_m + on_axis[:, None] * axis
    t = ((point - readings.origin_m) * readings.ray).sum(axis=1) / (readings.ray**2).sum(axis=1)
    return t, np.linalg.norm(readings.origin_m + t[:, None] * readings.ray - point, axis=1)


def _as_tube(box: Fit) -> Fit:
    low, high = box.low.copy(), box.high.copy()
    middle, radius = (low[:2] + high[:2]) / 2.0, float(box.size_m[:2].min()) / 2.0
    low[:2], high[:2] = middle - radius, middle + radius
    return replace(box, low=low, high=high, round=True)


def _solve(fit: Fit, evidence: _Evidence, turn: bool) -> Fit:
    def at(x: np.ndarray) -> Fit:
        rotation = fit.rotation @ Rotation.from_rotvec(x[6:9]).as_matrix() if turn else fit.rotation
        low, high = x[:3] - np.maximum(x[3:6], THINNEST_M) / 2.0, x[:3] + np.maximum(x[3:6], THINNEST_M) / 2.0
        if fit.round:
            middle, half = x[:2], np.maximum(x[3], THINNEST_M) / 2.0
            low[:2], high[:2] = middle - half, middle + half
        # low and high are positions along the turned axes, measured from the world's origin, so a change of the
        # rotation alone also moves the part around this origin
        return replace(fit, rotation=rotation, low=low, high=high)

    def rows(x: np.ndarray) -> np.ndarray:
        shape = at(x)
        on = _local_distance(evidence.points_m, shape) / evidence.sigma_m
        passing = np.minimum(_nearest_distance(evidence.passing_m, shape), 0.0) / evidence.passing_sigma_m
        hitting = np.maximum(_nearest_distance(evidence.hitting_m, shape), 0.0) / evidence.hitting_sigma_m
        ends = np.array([shape.low[2] - fit.low[2], shape.high[2] - fit.high[2]]) / END_SIGMA_M
        return np.concatenate([on, passing, hitting, _assumptions(x, fit), ends, 20.0 * x[6:9], _too_broad(x, fit)])

    x = np.concatenate([(fit.low + fit.high) / 2.0, fit.size_m, np.zeros(3 if turn else 0)])
    scale = np.concatenate([np.full(6, 0.01), np.full(len(x) - 6, 0.02)])
    seen = len(evidence.points_m) + len(evidence.passing_m) + len(evidence.hitting_m)
    # the first fit, with the soft L1 loss, moves the part away from rays that end beyond it; the second fit begins
    # there, and its Cauchy loss rejects outliers
    for kernel in (_soft_l1, _cauchy):
        loss = partial(_robust_loss, kernel, seen)
        found = least_squares(rows, x, loss=loss, f_scale=2.0, max_nfev=TRIALS, x_scale=scale)
        x = found.x
    return _measured(at(x), evidence, float(2.0 * found.cost / max(len(evidence.points_m), 1)))


def _robust_loss(kernel: Callable[[np.ndarray], np.ndarray], seen: int, z: np.ndarray) -> np.ndarray:
    """Compute the robust loss of residuals. Only the first ``seen`` residuals, which are measurements, may be outliers:
    the other residuals are assumptions and keep their full weight.
    """
    rho = np.stack([z, np.ones_like(z), np.zeros_like(z)])
    rho[:, :seen] = kernel(z[:seen])
    return rho


def _soft_l1(z: np.ndarray) -> np.ndarray:
    root = np.sqrt(1.0 + z)
    return np.stack([2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3])


def _cauchy(z: np.ndarray) -> np.ndarray:
    return np.stack([np.log1p(z), 1.0 / (1.0 + z), -1.0 / (1.0 + z) ** 2])


def _too_broad(x: np.ndarray, fit: Fit) -> np.ndarray:
    """Return residuals that keep a bar from becoming broader, or a plate thicker, than ``BROADEST_M``."""
    across = x[5:6] if fit.plate else x[3:5]
    rows: np.ndarray = np.maximum(across - BROADEST_M, 0.0) / 1e-3
    return rows


def _assumptions(x: np.ndarray, fit: Fit) -> np.ndarray:
    """Return the residuals of the assumptions for unseen sides: bars are square, plates are thin."""
    weight = ASSUMED if fit.blind.any() else 1.0
    if fit.plate:
        return np.array([weight * (x[5] - PLATE_M) / PLATE_SIGMA_M])
    return np.array([weight * (x[3] - x[4]) / SQUARE_SIGMA_M])


def _local_distance(points_m: np.ndarray, fit: Fit) -> np.ndarray:
    local = points_m @ fit.rotation
    if fit.round:
        middle = (fit.low + fit.high) / 2.0
        across = np.linalg.norm(local[:, :2] - middle[:2], axis=1) - (fit.high[0] - fit.low[0]) / 2.0
        along = np.abs(local[:, 2] - middle[2]) - (fit.high[2] - fit.low[2]) / 2.0
        beyond = np.stack([across, along], axis=1)
    else:
        beyond = np.maximum(fit.low - local, local - fit.high)
    outside = np.sqrt((np.maximum(beyond, 0.0) ** 2).sum(axis=1))
    return np.asarray(outside + np.minimum(beyond.max(axis=1), 0.0))


def _measured(fit: Fit, evidence: _Evidence, cost: float) -> Fit:
    distance = _local_distance(evidence.points_m, fit)
    support = np.zeros((3, 2))
    for places in (evidence.points_m, evidence.passing_m.reshape(-1, 3)):
        local = places @ fit.rotation
        near = np.abs(_local_distance(places, fit)) < 2.0 * LEAST_SIGMA_M + 0.004
        for axis in range(3):
            for side, face in enumerate((fit.low[axis], fit.high[axis])):
                support[axis, side] += np.count_nonzero(near & (np.abs(local[:, axis] - face) < 0.008))
    residual = float(np.median(np.abs(distance)) / MAD_OF_NORMAL) if len(distance) else np.inf
    return replace(fit, cost=cost, residual_m=residual, support=support)
