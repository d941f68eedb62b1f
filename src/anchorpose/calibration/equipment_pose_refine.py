"""The equipment's pose to the millimetre: surfaces by depth, outlines by where the depth jumps, the floor."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from anchorpose.calibration.equipment_pose_render import EquipmentCaster, Outline, Rendering
from anchorpose.calibration.equipment_pose_still import StillView
from anchorpose.camera import transform_points

LEAST_ROWS = 60
SHIFT_STEPS = 8  # of reweighting: the shift is settled to a tenth of a millimetre
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
class FloorPrior:
    """Where Gamma_0 should have the floor: the plane up @ p = height_m, and how sure that is."""

    up: np.ndarray  # (3,) unit, in Gamma_0
    height_m: float
    sigma_m: float
    sigma_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """T_camera_model (4, 4); covariance (6, 6) of (turn rad, shift m) about the equipment's centre, camera axes; rows:
    how many measurements of surface and of outline; rms: of surface (m) and of outline (px); edge_bias_px: by how much
    bars look thicker than they are, on each side."""

    T_camera_model: np.ndarray
    covariance: np.ndarray
    surface_rows: int
    outline_rows: int
    surface_rms_m: float
    outline_rms_px: float
    edge_bias_px: float


@dataclass(frozen=True, slots=True, eq=False)
class ObservedEdges:
    """Each (n,): how many pixels beyond an outline pixel's centre the part is seen to end; whether it is seen to end at
    all; whether what is seen goes on at the same depth instead; whether the part is not there at all."""

    beyond_px: np.ndarray
    usable: np.ndarray
    goes_on: np.ndarray
    absent: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """jacobian (n, 7): turn, shift, edge bias; residual (n,) in sigmas; part (n,) it speaks of; together: rows that
    count as one; reach: residuals beyond it have no weight, inf where all count."""

    jacobian: np.ndarray
    residual: np.ndarray
    part: np.ndarray
    together: float
    reach: float


def refine(
    view: StillView, caster: EquipmentCaster, start: np.ndarray, centre_m: np.ndarray, prior: FloorPrior,
    config: RefineConfig,
) -> Refined | None:  # fmt: skip
    """Improve T_camera_model from a start within a bar's width; None where too little of the equipment is seen.

    centre_m (3,) in Gamma_0: turns are about it. Gauss-Newton with Tukey's weights on all six freedoms and on the edge
    bias: sensors make bars look thicker or thinner, the same on both sides.
    """
    T, bias = start, 0.0
    for tolerance, reach in zip(config.tolerances_m, config.reaches_px, strict=True):
        rendering = caster.render(view.camera, T)
        if rendering is None:
            return None
        centre = transform_points(T, centre_m)
        surface = surface_rows(view, rendering, centre, tolerance, config)
        outline = outline_rows(
            view, caster.outline(view.camera, T, rendering), rendering, centre, bias, tolerance, reach, config
        )
        if len(surface.residual) + len(outline.residual) < LEAST_ROWS:
            return None
        floor = _floor_rows(view, T, centre, centre_m, prior)
        step, covariance = _solve([surface, outline, floor])
        bias += float(step[6])
        T = _moved(T, centre, step)
    return Refined(
        T, covariance[:6, :6], len(surface.residual), len(outline.residual),
        _rms(surface.residual) * config.steady_error_m, _rms(outline.residual) * config.outline_sigma_px, bias,
    )  # fmt: skip


def surface_rows(
    view: StillView, rendering: Rendering, centre: np.ndarray, tolerance_m: float, config: RefineConfig
) -> _Rows:
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
    return _Rows(
        jacobian / sigma[:, None],
        (mean - depth) * slant / sigma,
        part,
        config.surface_rows_per_observation,
        2.0 * config.robust,
    )


def outline_rows(
    view: StillView, outline: Outline, rendering: Rendering, centre: np.ndarray, bias_px: float, tolerance_m: float,
    reach_px: int, config: RefineConfig,
) -> _Rows:  # fmt: skip
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
    return _Rows(
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


def part_shifts(
    view: StillView, caster: EquipmentCaster, T: np.ndarray, bias_px: float, surest_m: float, config: RefineConfig
) -> np.ndarray:
    """(parts,) by how much each part, shifted alone, would fit better, metres; NaN where that is not sure.

    Only along the directions known to ``surest_m``: a bar may slide along itself unseen.
    """
    rendering, shifts = caster.render(view.camera, T), np.full(caster.part_count, np.nan)
    if rendering is None:
        return shifts
    tolerance, centre = config.tolerances_m[0], np.zeros(3)
    surface = surface_rows(view, rendering, centre, tolerance, config)
    outline = outline_rows(
        view,
        caster.outline(view.camera, T, rendering),
        rendering,
        centre,
        bias_px,
        tolerance,
        config.reaches_px[0],
        config,
    )
    for part in range(caster.part_count):
        shifts[part] = _shift_alone([surface, outline], part, surest_m, config.robust)
    return shifts


def _shift_alone(groups: list[_Rows], part: int, surest_m: float, robust: float) -> float:
    """Length of the shift of one part; hands that hold it are outvoted (weights that fall with the distance)."""
    shift = np.zeros(3)
    rows = [(group.jacobian[group.part == part, 3:6], group.residual[group.part == part], group) for group in groups]
    for _ in range(SHIFT_STEPS):
        information, pull = np.zeros((3, 3)), np.zeros(3)
        for jacobian, residual, group in rows:
            weight = 1.0 / (1.0 + np.abs(residual - jacobian @ shift) / robust) / group.together
            information += (jacobian * weight[:, None]).T @ jacobian
            pull += (jacobian * weight[:, None]).T @ residual
        known, axes = np.linalg.eigh(information)
        sure = known > surest_m**-2
        if not sure.any():
            return float("nan")
        shift = axes[:, sure] @ ((axes[:, sure].T @ pull) / known[sure])
    return float(np.linalg.norm(shift))


def _floor_rows(view: StillView, T: np.ndarray, centre: np.ndarray, centre_m: np.ndarray, prior: FloorPrior) -> _Rows:
    up = T[:3, :3] @ prior.up
    foot = centre - (centre_m @ prior.up - prior.height_m) * up  # below the centre, where Gamma_0 has its floor
    level = np.linalg.svd(up[None])[2][1:]  # two directions across
    turn = np.concatenate([np.cross(up, level), np.zeros((2, 4))], axis=1) / prior.sigma_rad
    shift = np.concatenate([np.cross(foot - centre, view.floor.up), view.floor.up, [0.0]])[None] / prior.sigma_m
    residual = np.append(
        level @ (view.floor.up - up) / prior.sigma_rad, -(view.floor.up @ foot + view.floor.height_m) / prior.sigma_m
    )
    return _Rows(np.concatenate([turn, shift]), residual, np.full(3, -1), 1.0, np.inf)


def _solve(rows: list[_Rows]) -> tuple[np.ndarray, np.ndarray]:
    """Step (7,) and covariance (7, 7)."""
    information, pull = np.diag([1e-6] * 6 + [1.0]), np.zeros(7)  # the edge bias is a pixel at most
    for group in rows:
        ratio = np.minimum(np.abs(group.residual) / group.reach, 1.0)
        weight = (1.0 - ratio**2) ** 2 / group.together
        weighted = group.jacobian * weight[:, None]
        information += weighted.T @ group.jacobian
        pull += weighted.T @ group.residual
    return np.linalg.solve(information, pull), np.linalg.inv(information)


def _moved(T: np.ndarray, centre: np.ndarray, step: np.ndarray) -> np.ndarray:
    """T after the turn step[:3] about ``centre`` and the shift step[3:6]."""
    import cv2

    turn = cv2.Rodrigues(step[:3])[0]
    moved = np.eye(4)
    moved[:3, :3] = turn @ T[:3, :3]
    moved[:3, 3] = turn @ (T[:3, 3] - centre) + centre + step[3:6]
    return moved


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


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
