"""Measurements of the equipment's pose: readings on its surfaces, and places where its outline is seen to end."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from anchorpose.calibration.equipment.render import Outline, Rendering
from anchorpose.calibration.equipment.still import StillView

MOSTLY = 0.4  # of the frames: an edge pixel of a thin bar reads the bar six times in ten


@dataclass(frozen=True, slots=True, kw_only=True)
class RefineConfig:
    """Which pixels count, and how much."""

    tolerances_m: tuple[float, ...] = (
        0.04,
        0.04,
        0.04,
        0.03,
        0.03,
        0.02,
        0.02,
        0.015,
        0.015,
    )  # one a step: on the surface or not
    reaches_px: tuple[int, ...] = (
        7,
        7,
        7,
        6,
        6,
        5,
        4,
        3,
        3,
    )  # likewise: how far on each side of an outline its edge is sought
    noise_gate: float = 3.0  # sigmas of the sensor's noise on top
    steady_error_m: float = 0.0015  # smooth error of a device, the same in all its pictures
    outline_sigma_px: float = 0.6  # of one place of the outline: edge pixels look aside
    surface_rows_per_observation: float = 40.0  # neighbouring pixels share the device's error
    outline_rows_per_observation: float = 6.0  # and edges that of their parts
    robust: float = 2.5  # sigmas beyond which a row loses weight
    least_cosine: float = 0.15  # of incidence: beyond, a small shift is a large change of depth
    standing_sigma_m: float = 0.01  # chi_0's lowest point from the floor: a prior only
    standing_sigma_rad: float = 0.0087  # half a degree between chi_0's up and the floor's

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not min(value if isinstance(value, tuple) else (value,), default=0) > 0:
                raise ValueError(f"{entry.name} must be positive, got {value}")


@dataclass(frozen=True, slots=True, eq=False)
class ObservedEdges:
    """Each (n,): how many pixels beyond an outline pixel's centre the part is seen to end; whether it is seen to end at
    all; whether what is seen goes on at the same depth instead; whether the part is not there at all."""

    beyond_px: np.ndarray
    usable: np.ndarray
    goes_on: np.ndarray
    absent: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """jacobian (n, 7): turn, shift, edge bias; residual (n,) in sigmas; part (n,) it speaks of; together: rows that
    count as one; reach: residuals beyond it have no weight, inf where all count."""

    jacobian: np.ndarray
    residual: np.ndarray
    part: np.ndarray
    together: float
    reach: float


def surface_rows(
    view: StillView, rendering: Rendering, centre: np.ndarray, tolerance_m: float, config: RefineConfig
) -> Rows:
    """Point to plane, where the readings of a pixel inside a part lie on it most of the time."""
    frames, expected = view.frames_m[:, *rendering.window], rendering.depth_m
    row, column = np.nonzero(_inside(expected))
    depth, readings = expected[row, column].astype(np.float64), frames[:, row, column]
    gate = tolerance_m + config.noise_gate * view.noise_per_m * depth**2
    on = np.abs(readings - depth) < gate
    behind = readings > depth + gate
    count = on.sum(axis=0)
    normal = rendering.normal[row, column]
    rays = view.camera.pixel_rays()[row + rendering.top, column + rendering.left].astype(np.float64)
    ahead = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    slant = np.sum(normal * ahead, axis=1)
    cosine = np.abs(slant) / np.linalg.norm(ahead, axis=1)
    used = (count > behind.sum(axis=0)) & (cosine > config.least_cosine)
    mean = np.where(on, readings, 0.0).sum(axis=0)[used] / count[used]
    depth, normal, ahead, slant = depth[used], normal[used], ahead[used], slant[used]
    sigma_z = np.hypot(view.noise_per_m * depth**2 / np.sqrt(count[used]), config.steady_error_m)
    sigma = sigma_z * np.abs(slant)
    point = ahead * depth[:, None]
    jacobian = np.concatenate([np.cross(point - centre, normal), normal, np.zeros((len(point), 1))], axis=1)
    part = rendering.part[row, column][used]
    return Rows(
        jacobian / sigma[:, None],
        (mean - depth) * slant / sigma,
        part,
        config.surface_rows_per_observation,
        2.0 * config.robust,
    )


def outline_rows(
    view: StillView, outline: Outline, rendering: Rendering, centre: np.ndarray, bias_px: float, tolerance_m: float,
    reach_px: int, config: RefineConfig,
) -> Rows:  # fmt: skip
    """Across the outline, in pixels: along a profile the readings on the part are counted, then it ends."""
    edges = observed_edges(view, outline, rendering, tolerance_m, reach_px, config)
    usable, along = edges.usable, np.sum(outline.across * outline.step, axis=1)
    residual = ((edges.beyond_px - outline.beyond_px) * along - bias_px)[usable]
    depth = outline.depth_m[usable].astype(np.float64)
    ray = view.camera.pixel_rays()[outline.row[usable], outline.column[usable]].astype(np.float64)
    point = np.concatenate([ray, np.ones((len(ray), 1))], axis=1) * depth[:, None]
    lens, across = view.camera.intrinsics, outline.across[usable]
    gradient_xy = np.stack([across[:, 1] * lens.fx, across[:, 0] * lens.fy], axis=1) / depth[:, None]
    gradient = np.concatenate([gradient_xy, -np.sum(gradient_xy * ray, axis=1, keepdims=True)], axis=1)
    jacobian = np.concatenate([np.cross(point - centre, gradient), gradient, np.ones((len(point), 1))], axis=1)
    sigma = config.outline_sigma_px
    return Rows(
        jacobian / sigma,
        residual / sigma,
        outline.part[usable],
        config.outline_rows_per_observation,
        max(2.0 * config.robust, reach_px / sigma),
    )


def observed_edges(
    view: StillView, outline: Outline, rendering: Rendering, tolerance_m: float, reach_px: int,
    config: RefineConfig,
) -> ObservedEdges:  # fmt: skip
    """Each place of the outline in the frames.

    A frame in which something nearer stands before a pixel of the profile says nothing of that pixel.
    """
    steps = np.arange(-reach_px + 1, reach_px + 1)
    row = outline.row[:, None] + outline.step[:, :1] * steps
    column = outline.column[:, None] + outline.step[:, 1:] * steps
    inside = (row >= 0) & (row < view.camera.height) & (column >= 0) & (column < view.camera.width)
    row, column = np.clip(row, 0, view.camera.height - 1), np.clip(column, 0, view.camera.width - 1)
    depth = outline.depth_m[:, None].astype(np.float64)
    gate = tolerance_m + config.noise_gate * view.noise_per_m * depth**2
    readings = view.frames_m[:, row, column]
    on = np.abs(readings - depth) < gate
    hidden = (readings > 0) & (readings < depth - gate)
    free = (~hidden).sum(axis=0)
    share = on.sum(axis=0) / np.maximum(free, 1)
    expected = _at(rendering, row, column)
    same = np.abs(expected - depth) < gate
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


def _at(rendering: Rendering, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Depth of the rendering at pixels of the whole picture, inf outside of its window."""
    r, c = row - rendering.top, column - rendering.left
    height, width = rendering.depth_m.shape
    inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
    return np.where(inside, rendering.depth_m[np.clip(r, 0, height - 1), np.clip(c, 0, width - 1)], np.inf)
