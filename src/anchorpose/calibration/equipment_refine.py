"""The equipment's pose to the millimetre: surfaces by depth, outlines by where the depth jumps, the floor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.equipment_model import Equipment
from anchorpose.calibration.equipment_residuals import (
    OUTLINE_SIGMA_PX,
    ROBUST,
    STEADY_ERROR_M,
    Gate,
    Rows,
    StillView,
    outline_rows,
    predict,
    surface_rows,
)

COARSE, FINE = Gate(0.04, 7), Gate(0.015, 3)
GATES: Final = (COARSE,) * 3 + (Gate(0.03, 6),) * 2 + (Gate(0.02, 5), Gate(0.02, 4)) + (FINE,) * 2  # one per step
LEAST_ROWS: Final = 60
SHIFT_STEPS: Final = 8  # of reweighting: the shift is settled to a tenth of a millimetre
MOST_SHIFT_SIGMA_M: Final = 0.003  # one sigma: less accurate shifts of a part are no evidence
STANDING_SIGMA_M: Final = 0.01  # chi_0's lowest point from the floor: a prior only
STANDING_SIGMA_RAD: Final = 0.0087  # half a degree between chi_0's up and the floor's


@dataclass(frozen=True, slots=True, eq=False)
class FloorPrior:
    """Where Gamma_0 should have the floor: the plane up @ p = height_m, and with which uncertainty."""

    up: np.ndarray  # (3,) unit, in Gamma_0
    height_m: float
    sigma_m: float
    sigma_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """T_camera_model (4, 4); covariance (6, 6) of (turn rad, shift m) about the equipment's centre, camera axes; rms:
    of surface (m) and of outline (px); edge_bias_px: by how much bars look thicker than they are, on each side."""

    T_camera_model: np.ndarray
    covariance: np.ndarray
    surface_rms_m: float
    outline_rms_px: float
    edge_bias_px: float


def standing_prior(floor_m: float) -> FloorPrior:
    """What is assumed without evidence: chi_0 stands upright on the floor."""
    return FloorPrior(np.array([0.0, 1.0, 0.0]), floor_m, STANDING_SIGMA_M, STANDING_SIGMA_RAD)


def refine(view: StillView, equipment: Equipment, start: np.ndarray, prior: FloorPrior) -> Refined | None:
    """Improve T_camera_model from a start within a bar's width; None where too little of the equipment is seen.

    Gauss-Newton with Tukey's weights on all six degrees of freedom, turns about the equipment's centre, and on the
    edge bias: sensors make bars look thicker or thinner, the same on both sides.
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
    return Refined(
        T_camera_model=T,
        covariance=covariance[:6, :6],
        surface_rms_m=_rms(surface.residual) * STEADY_ERROR_M,
        outline_rms_px=_rms(outline.residual) * OUTLINE_SIGMA_PX,
        edge_bias_px=bias,
    )


def part_shifts(view: StillView, equipment: Equipment, fit: Refined) -> np.ndarray:
    """(parts,) by how much each part, shifted alone, would fit better, metres; NaN where that is not accurate.

    Only along the directions known to ``MOST_SHIFT_SIGMA_M``: a bar may slide along itself unseen.
    """
    count = equipment.caster.part_count
    prediction = predict(view.camera, equipment, fit.T_camera_model)
    if prediction is None:
        return np.full(count, np.nan)
    surface = surface_rows(view, prediction, COARSE.tolerance_m)
    rows = [surface, outline_rows(view, prediction, fit.edge_bias_px, COARSE)]
    return np.array([_shift_alone(rows, part) for part in range(count)])


def _shift_alone(groups: list[Rows], part: int) -> float:
    """Length of the shift of one part; weights that fall with the distance keep hands that hold it from counting."""
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
    """The floor that is seen against the prior; centre_model, centre (3,): of the equipment, Gamma_0 and camera."""
    up = T[:3, :3] @ prior.up
    foot = centre - (centre_model @ prior.up - prior.height_m) * up  # below the centre, where Gamma_0 has its floor
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
    turn = cv2.Rodrigues(step[:3])[0]
    moved = np.eye(4)
    moved[:3, :3] = turn @ T[:3, :3]
    moved[:3, 3] = turn @ (T[:3, 3] - centre) + centre + step[3:6]
    return moved


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
