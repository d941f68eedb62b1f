"""Refine the equipment's pose to the millimetre, by the depth of its surfaces, its outlines, and the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import cv2
import numpy as np

from anchorpose.calibration.equipment_model import Equipment, Outline, Rendering
from anchorpose.calibration.first_frames import NOISE_GATE, FloorPlane, what_stays
from anchorpose.camera import Camera, transform_points
from anchorpose.rotations import rigid

# minimum share of the frames in which a pixel on the equipment must read the equipment; an edge pixel of a thin bar
# reads the bar in six of ten frames
MOSTLY: Final = 0.4
STEADY_ERROR_M: Final = 0.0015  # m, systematic error of a depth camera, the same in all its frames
# px, standard deviation of the position of one outline point, due to edge pixels that read the background
OUTLINE_SIGMA_PX: Final = 0.6
# number of least-squares rows of surface readings that together count as one observation, since neighbouring readings
# share the camera's error
SURFACE_ROWS_PER_OBSERVATION: Final = 40.0
# number of least-squares rows of outline points that together count as one observation, since neighbouring points share
# the error of their part
OUTLINE_ROWS_PER_OBSERVATION: Final = 6.0
ROBUST: Final = 2.5  # sigmas, scale of the robust weights, which decrease with the size of a residual
# minimum cosine of the angle of incidence; at flatter angles, a small shift changes the depth much
LEAST_COSINE: Final = 0.15


class Gate(NamedTuple):
    """Limits within which equipment counts as seen: readings within tolerance_m of the equipment's surface, and edges
    within reach_px of its outline.
    """

    tolerance_m: float
    reach_px: int


@dataclass(frozen=True, eq=False)
class StillView:
    """The evidence about the equipment's pose from one camera, while the equipment stands still.

    frames_m (n, height, width) float32, 0 = no reading: the depth frames; if a frame of the empty room is given, only
    this frame.
    """

    camera: Camera
    frames_m: np.ndarray
    noise_per_m: float
    floor: FloorPlane

    @cached_property
    def still_m(self) -> np.ndarray:
        """Return the depth (height, width) float32 of the surface that each pixel shows in enough of the frames to
        count as still (see ``what_stays``), 0 = unknown.
        """
        return what_stays(self.frames_m, self.noise_per_m)

    @property
    def range_m(self) -> float:
        """Return the largest depth read, in metres. Missing readings beyond this depth do not show that equipment is
        absent.
        """
        return float(self.frames_m.max())


def see_still(
    camera: Camera, frames_m: Sequence[np.ndarray], background_m: np.ndarray | None, noise: float, floor: FloorPlane
) -> StillView:
    """Return the evidence from the image of the empty room if given, else from the frames."""
    stack = np.stack(frames_m if background_m is None else [background_m]).astype(np.float32)
    return StillView(camera, stack, noise, floor)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The predicted view of the equipment at a pose; centre_m (3,): the equipment's centre, camera frame."""

    rendering: Rendering
    outline: Outline
    centre_m: np.ndarray


def predict(camera: Camera, equipment: Equipment, T_camera_model: np.ndarray) -> Prediction | None:
    """Predict the view at a pose; None if the equipment is outside the depth image."""
    rendering = equipment.caster.render(camera, T_camera_model)
    if rendering is None:
        return None
    outline = equipment.caster.outline(camera, T_camera_model, rendering)
    return Prediction(rendering, outline, transform_points(T_camera_model, equipment.samples.centre_m))


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Rows of the least-squares system, one row per residual. jacobian (n, 7): derivative by turn, shift and edge bias
    (by how many pixels bars look too thick on each side); residual (n,) in sigmas; part (n,): index of the equipment's
    part, -1 for none; together: number of rows that count as one observation; reach: limit (in sigmas) beyond which
    residuals have no weight, inf for no limit.
    """

    jacobian: np.ndarray
    residual: np.ndarray
    part: np.ndarray
    together: float
    reach: float


@dataclass(frozen=True, slots=True, eq=False)
class ObservedEdges:
    """The observed edges; arrays (n,) with one value per outline pixel, in this order: distance in pixels, from the
    pixel's centre outward, at which the part ends; whether this end is seen; whether the surface continues at the same
    depth instead; whether the part is absent.
    """

    beyond_px: np.ndarray
    usable: np.ndarray
    goes_on: np.ndarray
    absent: np.ndarray


def surface_rows(view: StillView, prediction: Prediction, tolerance_m: float) -> Rows:
    """Return point-to-plane rows of the least-squares system, one row per used pixel inside a part. A pixel is used if
    it reads the part in more frames than a surface behind the part, and if the angle of incidence is not too flat
    (``LEAST_COSINE``).
    """
    rendering = prediction.rendering
    frames, expected = view.frames_m[:, *rendering.window], rendering.depth_m
    row, column = np.nonzero(_inside(expected))
    depth, readings = expected[row, column].astype(np.float64), frames[:, row, column]
    gate = tolerance_m + NOISE_GATE * view.noise_per_m * depth**2
    on = np.abs(readings - depth) < gate
    behind = readings > depth + gate
    count = on.sum(axis=0)
    normal = rendering.normal[row, column]
    ahead, slant, cosine = incidence(view.camera, rendering, row, column)
    used = (count > behind.sum(axis=0)) & (cosine > LEAST_COSINE)
    mean = np.where(on, readings, 0.0).sum(axis=0)[used] / count[used]
    depth, normal, ahead, slant = depth[used], normal[used], ahead[used], slant[used]
    sigma_z = np.hypot(view.noise_per_m * depth**2 / np.sqrt(count[used]), STEADY_ERROR_M)
    sigma = sigma_z * np.abs(slant)
    point = ahead * depth[:, None]
    turn = np.cross(point - prediction.centre_m, normal)
    jacobian = np.concatenate([turn, normal, np.zeros((len(point), 1))], axis=1) / sigma[:, None]
    residual, part = (mean - depth) * slant / sigma, rendering.part[row, column][used]
    return Rows(jacobian, residual, part, SURFACE_ROWS_PER_OBSERVATION, 2.0 * ROBUST)


def incidence(
    camera: Camera, rendering: Rendering, row: np.ndarray, column: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, for pixels (n,) of a rendering: the vector (n, 3) along the ray with a depth of one metre, its product
    (n,) with the surface's normal, and the cosine (n,) of the angle of incidence.
    """
    rays = camera.pixel_rays()[row + rendering.top, column + rendering.left].astype(np.float64)
    ahead = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    slant = np.sum(rendering.normal[row, column] * ahead, axis=1)
    return ahead, slant, np.abs(slant) / np.linalg.norm(ahead, axis=1)


def outline_rows(view: StillView, prediction: Prediction, bias_px: float, gate: Gate) -> Rows:
    """Return least-squares rows across the outline. Each row belongs to one pixel of the expected outline. It compares
    the place where the part's edge is expected with the place where the edge is observed, along the outline's normal.
    The observed edge is found by counting readings on the part along a line of pixels across the outline.
    """
    outline, edges = prediction.outline, observed_edges(view, prediction, gate)
    usable, along = edges.usable, np.sum(outline.across * outline.step, axis=1)
    residual = ((edges.beyond_px - outline.beyond_px) * along - bias_px)[usable]
    depth = outline.depth_m[usable].astype(np.float64)
    ray = view.camera.pixel_rays()[outline.row[usable], outline.column[usable]].astype(np.float64)
    point = np.concatenate([ray, np.ones((len(ray), 1))], axis=1) * depth[:, None]
    lens, across = view.camera.intrinsics, outline.across[usable]
    gradient_xy = np.stack([across[:, 1] * lens.fx, across[:, 0] * lens.fy], axis=1) / depth[:, None]
    gradient = np.concatenate([gradient_xy, -np.sum(gradient_xy * ray, axis=1, keepdims=True)], axis=1)
    turn = np.cross(point - prediction.centre_m, gradient)
    jacobian = np.concatenate([turn, gradient, np.ones((len(point), 1))], axis=1) / OUTLINE_SIGMA_PX
    reach = max(2.0 * ROBUST, gate.reach_px / OUTLINE_SIGMA_PX)
    part = outline.part[usable]
    return Rows(jacobian, residual / OUTLINE_SIGMA_PX, part, OUTLINE_ROWS_PER_OBSERVATION, reach)


def observed_edges(view: StillView, prediction: Prediction, gate: Gate) -> ObservedEdges:
    """Find in the frames where the part ends at each outline pixel.

    At each pixel of the outline, the pixels on a line across the outline are examined. A frame in which a nearer object
    hides a pixel on this line is not evidence for the hidden pixel. Pixels of the outline beyond the camera's range are
    not usable.
    """
    outline, reach_px = prediction.outline, gate.reach_px
    steps = np.arange(-reach_px + 1, reach_px + 1)
    row = outline.row[:, None] + outline.step[:, :1] * steps
    column = outline.column[:, None] + outline.step[:, 1:] * steps
    inside = (row >= 0) & (row < view.camera.height) & (column >= 0) & (column < view.camera.width)
    row, column = np.clip(row, 0, view.camera.height - 1), np.clip(column, 0, view.camera.width - 1)
    depth = outline.depth_m[:, None].astype(np.float64)
    margin = gate.tolerance_m + NOISE_GATE * view.noise_per_m * depth**2
    readings = view.frames_m[:, row, column]
    on = np.abs(readings - depth) < margin
    hidden = (readings > 0) & (readings < depth - margin)
    free = (~hidden).sum(axis=0)
    share = on.sum(axis=0) / np.maximum(free, 1)
    same = np.abs(_depth_at(prediction.rendering, row, column) - depth) < margin
    # pixels from the outline inward, on the line across the outline, before the first pixel at which the equipment's
    # predicted depth differs from its depth at the outline
    first = np.cumprod(same[:, :reach_px][:, ::-1], axis=1)[:, ::-1].astype(bool)
    counted = np.concatenate([first, np.ones((len(row), reach_px), bool)], axis=1)
    inner = first.sum(axis=1)
    seen = -(inner - 1) - 0.5 + np.where(counted, share, 0.0).sum(axis=1)
    deepest = share[np.arange(len(row)), reach_px - np.maximum(inner, 1)]
    usable = (inner > 0) & inside.all(axis=1) & (outline.depth_m <= view.range_m)
    usable &= ((free > 0) | ~counted).all(axis=1) & ~same[:, reach_px:].any(axis=1)
    there, goes_on = deepest > MOSTLY, share[:, -1] > MOSTLY
    return ObservedEdges(seen, usable & there & ~goes_on, usable & there & goes_on, usable & ~there)


def _inside(depth_m: np.ndarray) -> np.ndarray:
    """Return (h, w) bool: pixels whose four neighbours show the equipment at about the same depth."""
    inside = np.isfinite(depth_m)
    inside[0], inside[-1], inside[:, 0], inside[:, -1] = False, False, False, False
    filled = np.where(np.isfinite(depth_m), depth_m, 1e3)
    for axis in (0, 1):
        for side in (-1, 1):
            inside &= np.abs(np.roll(filled, side, axis) - filled) < 0.05
    return inside


def _depth_at(rendering: Rendering, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Return the depth of the rendering at pixels of the whole image, inf outside of its window."""
    r, c = row - rendering.top, column - rendering.left
    height, width = rendering.depth_m.shape
    inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
    return np.where(inside, rendering.depth_m[np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)], np.inf)


COARSE, FINE = Gate(0.04, 7), Gate(0.015, 3)
GATES: Final = (COARSE,) * 3 + (Gate(0.03, 6),) * 2 + (Gate(0.02, 5), Gate(0.02, 4)) + (FINE,) * 2  # one Gate per step
LEAST_ROWS: Final = 60
SHIFT_STEPS: Final = 8  # number of reweighting steps; a part's shift has then converged to a tenth of a millimetre
MOST_SHIFT_SIGMA_M: Final = 0.003  # m, maximum sigma of a part's shift; a less accurate shift is not used as evidence
STANDING_SIGMA_M: Final = 0.01  # m, prior sigma of the equipment's height above the floor
# rad (half a degree), prior sigma of the angle between the equipment's vertical and the floor's normal
STANDING_SIGMA_RAD: Final = 0.0087


@dataclass(frozen=True, slots=True, eq=False)
class FloorPrior:
    """The expected floor in the equipment's frame Gamma_0: the plane up @ p = height_m, with its uncertainty."""

    up: np.ndarray  # (3,) unit vector, in Gamma_0
    height_m: float
    sigma_m: float
    sigma_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """The refined pose T_camera_model (4, 4); covariance (6, 6) of (turn rad, shift m) about the equipment's centre, in
    the camera's axes; rms: root mean square of surface (m) and outline (px) residuals; edge_bias_px: distance, in
    pixels, by which bars look too thick on each side.
    """

    T_camera_model: np.ndarray
    covariance: np.ndarray
    surface_rms_m: float
    outline_rms_px: float
    edge_bias_px: float


def standing_prior(floor_m: float) -> FloorPrior:
    """Return the floor prior that needs no depth frames: the equipment stands upright on a floor at height ``floor_m``
    of its own frame.
    """
    return FloorPrior(np.array([0.0, 1.0, 0.0]), floor_m, STANDING_SIGMA_M, STANDING_SIGMA_RAD)


def refine(view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior) -> Refined | None:
    """Improve T_camera_model from a start correct within a bar's width; None if too little of the equipment is seen.

    The method is Gauss-Newton with Tukey's weights. All six degrees of freedom are fitted, with rotations about the
    equipment's centre, and the edge bias: sensors make bars look thicker or thinner, equally on both sides. If the
    residuals are larger than the assumed errors, the covariance is scaled up to agree with them.
    """
    T, bias = start, 0.0
    for gate in GATES:
        prediction = predict(view.camera, equipment, T)
        if prediction is None:
            return None
        surface = surface_rows(view, prediction, gate.tolerance_m)
        outline = outline_rows(view, prediction, bias, gate)
        if len(surface.residual) + len(outline.residual) < LEAST_ROWS:
            return None
        centre = prediction.centre_m
        step, covariance = _solve([surface, outline, _floor_rows(view, T, equipment.samples.centre_m, centre, prior)])
        bias += float(step[6])
        T = _moved(T, centre, step)
    surface_rms, outline_rms = _rms(surface.residual), _rms(outline.residual)
    return Refined(
        T_camera_model=T,
        covariance=covariance[:6, :6] * max(1.0, surface_rms, outline_rms) ** 2,
        surface_rms_m=surface_rms * STEADY_ERROR_M,
        outline_rms_px=outline_rms * OUTLINE_SIGMA_PX,
        edge_bias_px=bias,
    )


def part_shifts(view: StillView, prediction: Prediction, bias_px: float, count: int) -> np.ndarray:
    """Return the length (parts,), in metres, of the shift after which each part alone would fit best; NaN if
    inaccurate. Only directions in which sigma is at most ``MOST_SHIFT_SIGMA_M`` count, since a shift of a bar along
    itself is invisible.

    bias_px: distance, in pixels, by which bars look too thick on each side; count: number of parts.
    """
    surface = surface_rows(view, prediction, COARSE.tolerance_m)
    rows = [surface, outline_rows(view, prediction, bias_px, COARSE)]
    return np.array([_shift_alone(rows, part) for part in range(count)])


def _shift_alone(groups: list[Rows], part: int) -> float:
    """Return the length, in metres, of the shift after which one part alone would fit best; NaN if inaccurate. Weights
    decrease with a reading's distance from the part, so that hands on the part have little effect.
    """
    shift = np.zeros(3)
    rows = [(group.jacobian[group.part == part, 3:6], group.residual[group.part == part], group) for group in groups]
    for _ in range(SHIFT_STEPS):
        information, pull = np.zeros((3, 3)), np.zeros(3)
        for jacobian, residual, group in rows:
            weight = 1.0 / (1.0 + np.abs(residual - jacobian @ shift) / ROBUST) / group.together
            information += (jacobian * weight[:, None]).T @ jacobian
            pull += (jacobian * weight[:, None]).T @ residual
        known, axes = np.linalg.eigh(information)
        accurate = known > MOST_SHIFT_SIGMA_M**-2
        if not accurate.any():
            return float("nan")
        shift = axes[:, accurate] @ ((axes[:, accurate].T @ pull) / known[accurate])
    return float(np.linalg.norm(shift))


def _floor_rows(
    view: StillView, T: np.ndarray, centre_model: np.ndarray, centre: np.ndarray, prior: FloorPrior
) -> Rows:
    """Return least-squares rows that compare the seen floor with the prior; centre_model, centre (3,): the equipment's
    centre in its own frame and in the camera frame.
    """
    up = T[:3, :3] @ prior.up
    foot = centre - (centre_model @ prior.up - prior.height_m) * up  # the point of the prior's floor below the centre
    level = np.linalg.svd(up[None])[2][1:]  # two horizontal directions
    turn = np.concatenate([np.cross(up, level), np.zeros((2, 4))], axis=1) / prior.sigma_rad
    shift = np.concatenate([np.cross(foot - centre, view.floor.up), view.floor.up, [0.0]])[None] / prior.sigma_m
    residual = np.append(
        level @ (view.floor.up - up) / prior.sigma_rad, -(view.floor.up @ foot + view.floor.height_m) / prior.sigma_m
    )
    return Rows(np.concatenate([turn, shift]), residual, np.full(3, -1), 1.0, np.inf)


def _solve(rows: list[Rows]) -> tuple[np.ndarray, np.ndarray]:
    """Return the step (7,) of weighted least squares, and its covariance (7, 7). The step has a turn, a shift and a
    change of the edge bias (by how many pixels bars look too thick on each side).
    """
    information, pull = np.diag([1e-6] * 6 + [1.0]), np.zeros(7)  # prior of the edge bias: 0 with a sigma of one pixel
    for group in rows:
        ratio = np.minimum(np.abs(group.residual) / group.reach, 1.0)
        weight = (1.0 - ratio**2) ** 2 / group.together
        weighted = group.jacobian * weight[:, None]
        information += weighted.T @ group.jacobian
        pull += weighted.T @ group.residual
    return np.linalg.solve(information, pull), np.linalg.inv(information)


def _moved(T: np.ndarray, centre: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return T followed by the rotation step[:3] about ``centre`` and the shift step[3:6]."""
    turn = cv2.Rodrigues(step[:3])[0]
    return rigid(turn @ T[:3, :3], turn @ (T[:3, 3] - centre) + centre + step[3:6])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
