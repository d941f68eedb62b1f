"""Turns after which the equipment looks the same: no picture of it can tell them apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.calibration.equipment.samples import EquipmentSamples
from anchorpose.camera import transform_points
from anchorpose.recording.equipment import EquipmentModel

STEP_DEG: Final = 5
SAME_M: Final = 0.012  # as far as a part may be from its place in equipment.json
ALIKE_M: Final = 0.10  # near enough to be mistaken in a search
TRIED_POINTS: Final = 400
ROUND_SHARE: Final = 0.9  # of all turns


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """Turns about a vertical axis, each T_model_model (4, 4), the identity left out.

    same: chi_0 falls onto itself within ``SAME_M``; alike: nearly; round: so many turns that its direction means
    nothing.
    """

    same: tuple[np.ndarray, ...]
    alike: tuple[np.ndarray, ...]
    round: bool


def find_symmetry(model: EquipmentModel, samples: EquipmentSamples) -> Symmetry:
    """Try every turn in steps of ``STEP_DEG`` about two middles, of the outline and of the surface.

    Any symmetry leaves both in place, but a model that mixes round and square tubes shifts the second.
    """
    points = samples.surface_m[:: max(1, len(samples.surface_m) // TRIED_POINTS)]
    same, alike, apart = list[np.ndarray](), list[np.ndarray](), list[float]()
    turns = []
    for degrees in range(STEP_DEG, 360, STEP_DEG):
        tried = [
            turn_about(middle, np.radians(degrees)) for middle in (samples.centre_m, samples.surface_m.mean(axis=0))
        ]
        off = [float(np.quantile(np.abs(model.distance_m(transform_points(T, points))), 0.95)) for T in tried]
        turns.append(tried[int(np.argmin(off))])
        apart.append(min(off))
    around = np.array([np.inf, *apart, np.inf])
    for index in range(1, len(turns) - 1):  # next to no turn at all nothing is a place of its own
        if around[index + 1] > min(around[index], around[index + 2]):
            continue
        if apart[index] < SAME_M:
            same.append(turns[index])
        elif apart[index] < ALIKE_M:
            alike.append(turns[index])
    is_round = np.mean(np.array(apart) < SAME_M) > ROUND_SHARE
    return Symmetry(tuple(same), tuple(alike), bool(is_round))


def turn_about(middle_m: np.ndarray, angle_rad: float) -> np.ndarray:
    """(4, 4) turn about the vertical (Y) through a point."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    T = np.eye(4)
    T[:3, :3] = [[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]
    T[:3, 3] = middle_m - T[:3, :3] @ middle_m
    return T
