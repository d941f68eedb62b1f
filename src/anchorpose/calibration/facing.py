"""Which way the patient faces, from his feet: toes reach farther from the shank than heels do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import cv2
import numpy as np

from anchorpose.recording.equipment import EquipmentModel


@dataclass(frozen=True, slots=True, kw_only=True)
class FacingConfig:
    """What passes for a leg and its foot, and when the feet have said enough. Heights are above the floor."""

    foot_m: tuple[float, float] = (0.03, 0.11)  # above the floor's noise, below the ankle
    shank_m: tuple[float, float] = (0.18, 0.42)
    from_equipment_m: float = 0.05  # nearer points are the equipment's own
    cell_m: float = 0.03  # of the map in which legs are told apart
    widest_leg_m: float = 0.24
    least_leg_points: int = 40
    least_foot_points: int = 15
    reach_m: float = 0.28  # from the shank to the toes of a large foot
    least_lead_m: float = 0.03  # toes over heels; feet without shoes lead by 10 cm
    least_agreement: float = 0.75  # of the feet seen
    least_feet: int = 6

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not min(value if isinstance(value, tuple) else (value,), default=0) > 0:
                raise ValueError(f"{entry.name} must be positive, got {value}")


def patient_faces(
    clouds_m: Sequence[np.ndarray],
    headings: Sequence[np.ndarray],
    equipment: EquipmentModel,
    floor_height_m: float,
    config: FacingConfig,
) -> int | None:
    """Which of the level unit vectors ``headings`` (3,) the person within the equipment faces; None where unsure.

    clouds_m: one (n, 3) cloud a moment, of all cameras together, in a Gamma_0 that is right up to chi_0's symmetry.
    Only feet within the equipment's outline count: therapists stand beside it.
    """
    outline = cv2.convexHull(equipment.triangles()[0][:, [0, 2]].astype(np.float32))
    leads = []
    for cloud in clouds_m:
        height = cloud[:, 1] - floor_height_m
        low = cloud[(height > config.foot_m[0]) & (height < config.shank_m[1])]
        low = low[[cv2.pointPolygonTest(outline, (float(x), float(z)), False) >= 0 for x, z in low[:, [0, 2]]]]
        low = low[np.abs(equipment.distance_m(low)) > config.from_equipment_m] if len(low) else low
        leads += _leads_of_feet(low, floor_height_m, headings, config)
    if len(leads) < config.least_feet:
        return None
    lead = np.array(leads)  # (feet, headings)
    best = int(np.argmax(np.median(lead, axis=0)))
    agreeing = np.mean(lead.argmax(axis=1) == best)
    sure = np.median(lead[:, best]) > config.least_lead_m and agreeing >= config.least_agreement
    return best if sure else None


def _leads_of_feet(
    points_m: np.ndarray, floor_m: float, headings: Sequence[np.ndarray], config: FacingConfig
) -> list[list[float]]:
    """For each foot, by how much it reaches farther forward than backward from its shank, along each heading."""
    height = points_m[:, 1] - floor_m
    shanks = points_m[(height > config.shank_m[0])][:, [0, 2]]
    feet = points_m[height < config.foot_m[1]][:, [0, 2]]
    legs = _legs(shanks, config)
    if not len(legs) or not len(feet):
        return []
    distance = np.linalg.norm(feet[:, None] - legs[None], axis=2)
    owner = np.where(distance.min(axis=1) < config.reach_m, distance.argmin(axis=1), -1)
    leads = []
    for number, leg in enumerate(legs):
        foot = feet[owner == number] - leg
        if len(foot) >= config.least_foot_points:
            along = [foot @ heading[[0, 2]] for heading in headings]
            leads.append([float(np.quantile(a, 0.95) + np.quantile(a, 0.05)) for a in along])
    return leads


def _legs(shanks_m: np.ndarray, config: FacingConfig) -> np.ndarray:
    """(n, 2) middles of separate columns over the ground that are as wide as one leg."""
    if len(shanks_m) < config.least_leg_points:
        return np.zeros((0, 2))
    cell = np.floor((shanks_m - shanks_m.min(axis=0)) / config.cell_m).astype(np.int64)
    filled = np.zeros(cell.max(axis=0) + 1, np.uint8)
    filled[cell[:, 0], cell[:, 1]] = 1
    label = cv2.connectedComponents(filled, connectivity=8)[1][cell[:, 0], cell[:, 1]]
    legs = []
    for number in range(1, label.max(initial=0) + 1):
        column = shanks_m[label == number]
        low, high = np.percentile(column, [2, 98], axis=0)
        if len(column) >= config.least_leg_points and np.max(high - low) < config.widest_leg_m:
            legs.append((low + high) / 2.0)
    return np.array(legs).reshape(-1, 2)
