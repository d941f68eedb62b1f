"""Residuals of the equipment's pose: readings on its surfaces, and places where its outline is seen to end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from anchorpose.calibration.equipment_model import Equipment
from anchorpose.calibration.equipment_render import Outline, Rendering
from anchorpose.calibration.floor import FloorPlane
from anchorpose.calibration.noise import what_stays
from anchorpose.camera import Camera, transform_points

MOSTLY: Final = 0.4  # of the frames: an edge pixel of a thin bar reads the bar six times in ten
NOISE_GATE: Final = 3.0  # sigmas of the sensor's noise, added to each tolerance
STEADY_ERROR_M: Final = 0.0015  # smooth error of a device, the same in all its frames
OUTLINE_SIGMA_PX: Final = 0.6  # of one place of the outline: edge pixels often read what is behind
SURFACE_ROWS_PER_OBSERVATION: Final = 40.0  # neighbouring pixels share the device's error
OUTLINE_ROWS_PER_OBSERVATION: Final = 6.0  # and edges that of their parts
ROBUST: Final = 2.5  # sigmas beyond which a row loses weight
LEAST_COSINE: Final = 0.15  # of incidence: beyond, a small shift is a large change of depth


class Gate(NamedTuple):
    """What counts as seen: depth within tolerance_m of the equipment; an edge within reach_px of its outline."""

    tolerance_m: float
    reach_px: int


@dataclass(frozen=True, slots=True, eq=False)
class StillView:
    """The evidence from one camera.

    still_m (height, width) float32: what stays, 0 = unknown; frames_m (n, height, width) float32, 0 = no reading: the
    depth frames it was made from (the empty room's alone, where there is one).
    """

    camera: Camera
    still_m: np.ndarray
    frames_m: np.ndarray
    noise_per_m: float
    floor: FloorPlane


def see_still(
    camera: Camera, frames_m: Sequence[np.ndarray], background_m: np.ndarray | None, noise: float, floor: FloorPlane
) -> StillView:
    """The empty room where there is a frame of it, else what stays in frames spread over the recording."""
    stack = np.stack(frames_m if background_m is None else [background_m]).astype(np.float32)
    return StillView(camera, what_stays(stack, noise), stack, noise, floor)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The equipment as one camera would see it at a pose; centre_m (3,): of the equipment, camera frame."""

    rendering: Rendering
    outline: Outline
    centre_m: np.ndarray


def predict(camera: Camera, equipment: Equipment, T_camera_model: np.ndarray) -> Prediction | None:
    """What is expected at a pose; None where the equipment is outside the depth image."""
    rendering = equipment.caster.render(camera, T_camera_model)
    if rendering is None:
        return None
    outline = equipment.caster.outline(camera, T_camera_model, rendering)
    return Prediction(rendering, outline, transform_points(T_camera_model, equipment.samples.centre_m))


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """jacobian (n, 7): turn, shift, edge bias; residual (n,) in sigmas; part (n,) of the equipment; together: rows
    that count as one; reach: residuals beyond it have no weight, inf where all count."""

    jacobian: np.ndarray
    residual: np.ndarray
    part: np.ndarray
    together: float
    reach: float


@dataclass(frozen=True, slots=True, eq=False)
class ObservedEdges:
    """Each (n,): how many pixels beyond an outline pixel's centre the part is seen to end; whether it is seen to end at
    all; whether the surface continues at the same depth instead; whether the part is absent."""

    beyond_px: np.ndarray
    usable: np.ndarray
    goes_on: np.ndarray
    absent: np.ndarray


def surface_rows(view: StillView, prediction: Prediction, tolerance_m: float) -> Rows:
    """Point to plane, where the readings of a pixel inside a part lie on it most of the time."""
    rendering = prediction.rendering
    frames, expected = view.frames_m[:, *rendering.window], rendering.depth_m
    row, column = np.nonzero(_inside(expected))
    depth, readings = expected[row, column].astype(np.float64), frames[:, row, column]
    gate = tolerance_m + NOISE_GATE * view.noise_per_m * depth**2
    on = np.abs(readings - depth) < gate
    behind = readings > depth + gate
    count = on.sum(axis=0)
    normal = rendering.normal[row, column]
    rays = view.camera.pixel_rays()[row + rendering.top, column + rendering.left].astype(np.float64)
    ahead = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    slant = np.sum(normal * ahead, axis=1)
    cosine = np.abs(slant) / np.linalg.norm(ahead, axis=1)
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


def outline_rows(view: StillView, prediction: Prediction, bias_px: float, gate: Gate) -> Rows:
    """Across the outline, in pixels: along a profile the readings on the part are counted, then it ends."""
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
    """Each place of the outline in the frames.

    A frame in which something nearer stands in front of a pixel of the profile is no evidence for that pixel.
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
    first = np.cumprod(same[:, :reach_px][:, ::-1], axis=1)[:, ::-1].astype(bool)  # from the outline inward
    counted = np.concatenate([first, np.ones((len(row), reach_px), bool)], axis=1)
    inner = first.sum(axis=1)
    seen = -(inner - 1) - 0.5 + np.where(counted, share, 0.0).sum(axis=1)
    deepest = share[np.arange(len(row)), reach_px - np.maximum(inner, 1)]
    usable = (inner > 0) & inside.all(axis=1)
    usable &= ((free > 0) | ~counted).all(axis=1) & ~same[:, reach_px:].any(axis=1)
    there, goes_on = deepest > MOSTLY, share[:, -1] > MOSTLY
    return ObservedEdges(seen, usable & there & ~goes_on, usable & there & goes_on, usable & ~there)


def _inside(depth_m: np.ndarray) -> np.ndarray:
    """(h, w) bool: pixels whose four neighbours show the equipment at about the same depth."""
    inside = np.isfinite(depth_m)
    inside[0], inside[-1], inside[:, 0], inside[:, -1] = False, False, False, False
    filled = np.where(np.isfinite(depth_m), depth_m, 1e3)
    for axis in (0, 1):
        for side in (-1, 1):
            inside &= np.abs(np.roll(filled, side, axis) - filled) < 0.05
    return inside


def _depth_at(rendering: Rendering, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Depth of the rendering at pixels of the whole image, inf outside of its window."""
    r, c = row - rendering.top, column - rendering.left
    height, width = rendering.depth_m.shape
    inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
    return np.where(inside, rendering.depth_m[np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)], np.inf)
