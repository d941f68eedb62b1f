"""The equipment's pose to the millimetre: surfaces by depth, outlines by where the depth jumps, the floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.calibration.equipment.render import EquipmentCaster
from anchorpose.calibration.equipment.rows import RefineConfig, Rows, outline_rows, surface_rows
from anchorpose.calibration.equipment.still import StillView
from anchorpose.camera import transform_points

LEAST_ROWS = 60
SHIFT_STEPS = 8  # of reweighting: the shift is settled to a tenth of a millimetre


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


def _shift_alone(groups: list[Rows], part: int, surest_m: float, robust: float) -> float:
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


def _floor_rows(view: StillView, T: np.ndarray, centre: np.ndarray, centre_m: np.ndarray, prior: FloorPrior) -> Rows:
    up = T[:3, :3] @ prior.up
    foot = centre - (centre_m @ prior.up - prior.height_m) * up  # below the centre, where Gamma_0 has its floor
    level = np.linalg.svd(up[None])[2][1:]  # two directions across
    turn = np.concatenate([np.cross(up, level), np.zeros((2, 4))], axis=1) / prior.sigma_rad
    shift = np.concatenate([np.cross(foot - centre, view.floor.up), view.floor.up, [0.0]])[None] / prior.sigma_m
    residual = np.append(
        level @ (view.floor.up - up) / prior.sigma_rad, -(view.floor.up @ foot + view.floor.height_m) / prior.sigma_m
    )
    return Rows(np.concatenate([turn, shift]), residual, np.full(3, -1), 1.0, np.inf)


def _solve(rows: list[Rows]) -> tuple[np.ndarray, np.ndarray]:
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


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
