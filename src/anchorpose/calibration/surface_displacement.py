"""How far two cameras have from each other what both see: by the motion that best lays one's surfaces onto the other's.

Room and people together: floor and walls give tilt and height, people what slides along them. Each has half of the
weight, so that a wide room does not decide alone; a wrong focal length moves its far ends, and not the people.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.calibration.common_view import LevelView, level_view, moved_by, paired_rows
from anchorpose.calibration.floor import FloorPlane, up_of
from anchorpose.calibration.noise import MAD_OF_NORMAL
from anchorpose.camera import Camera, invert_rigid, transform_points

GATES_M: Final = (
    0.4,
    0.4,
    0.4,
    0.4,
    0.3,
    0.3,
    0.3,
    0.2,
    0.2,
    0.2,
    0.15,
    0.15,
    0.1,
    0.1,
    0.1,
)  # a wrong lens leaves 5 cm
ROOM_PX, PEOPLE_PX = 6, 3  # every sixth and every third pixel of every such row
HUBER: Final = 1.5  # robust deviations beyond which a residual loses weight
LEAST_PAIRS: Final = 500
LEAST_SUPPORT: Final = 0.02  # right poses: with less up to 32 mm and 26 mm, else up to 9; without people often 0.001
STEP_M, STEP_RAD = 0.1, 0.2  # standard deviations that damp each step where nothing determines it
TIGHT_M: Final = 0.010  # right poses leave up to 6 mm; a lens 2 % wrong 15 to 25, and the turn then means nothing


@dataclass(frozen=True, slots=True)
class Displacement:
    """off_m: of the people, or of the room without them; turn_rad: None where the surfaces do not fit closely enough to
    tell."""

    off_m: float
    turn_rad: float | None


def common_surfaces(
    camera: Camera, room_m: np.ndarray, background_m: np.ndarray | None, depths_m: Sequence[np.ndarray]
) -> LevelView:
    """Return what one camera with a pose sees: the room as the first moment, then the people of each frame.

    room_m, depths_m: (height, width) float32, 0 = no reading; background_m: of the empty room, None without.
    """
    level = FloorPlane(up_of(camera), float(camera.position_m[1]), 0.0, 0.0)  # a frame that stands on Y = 0
    room = level_view(camera, level, np.full_like(room_m, np.inf), [room_m], ROOM_PX)
    people = level_view(camera, level, room_m if background_m is None else background_m, depths_m, PEOPLE_PX)
    return replace(
        room,
        depths_m=(*room.depths_m, *people.depths_m),
        smooth_m=(*room.smooth_m, *people.smooth_m),
        people=(*room.people, *people.people),
        seen=(*room.seen, *people.seen),
    )


def find_displacement(first: LevelView, second: LevelView) -> Displacement | None:
    """Return how far two cameras' poses have common surfaces apart; None where these do not determine it.

    first, second: ``common_surfaces`` of the same moments. Point-to-plane least squares (``common_view``), all six
    degrees of freedom, weights of Huber.
    """
    given = T = invert_rigid(first.camera.require_pose()) @ second.camera.require_pose()
    for gate in GATES_M:
        jacobian, residual, moment = paired_rows(first, second, T, gate)
        if len(residual) < LEAST_PAIRS:
            return None
        spread = float(np.median(np.abs(residual))) / MAD_OF_NORMAL + 1e-6
        weight = _halved(1.0 / np.maximum(1.0, np.abs(residual) / (HUBER * spread)), moment > 0)
        information = (jacobian * weight[:, None]).T @ jacobian
        damping = np.repeat([(10.0 * spread / STEP_RAD) ** 2, (10.0 * spread / STEP_M) ** 2], 3)
        T = moved_by(T, -np.linalg.solve(information + np.diag(damping), jacobian.T @ (weight * residual)))
    seen = [each.points_m[each.person] for each in second.seen]
    people = np.concatenate(seen[1:]) if any(len(each) for each in seen[1:]) else seen[0]
    place = people.mean(axis=0, keepdims=True)
    there = transform_points(T, place)
    if _support(jacobian, weight, there[0]) < LEAST_SUPPORT:
        return None
    off_m = float(np.linalg.norm(there - transform_points(given, place)))
    turn = float(np.arccos(np.clip((np.trace((T @ invert_rigid(given))[:3, :3]) - 1.0) / 2.0, -1.0, 1.0)))
    return Displacement(off_m, turn if spread <= TIGHT_M else None)


def _halved(weight: np.ndarray, of_people: np.ndarray) -> np.ndarray:
    """Weights (n,) with the same sum for the room and for the people, where both have some."""
    shares = [weight[which].sum() for which in (of_people, ~of_people)]
    if min(shares) <= 0.0:
        return weight
    return np.asarray(weight * np.where(of_people, 1.0 / shares[0], 1.0 / shares[1]) * len(weight) / 2.0)


def _support(jacobian: np.ndarray, weight: np.ndarray, place_m: np.ndarray) -> float:
    """Share of the weight that determines a shift in the direction that is determined least, whatever the turn."""
    about_place = jacobian.copy()
    about_place[:, :3] -= np.cross(place_m, jacobian[:, 3:])
    mean = (about_place * weight[:, None]).T @ about_place / weight.sum()
    turn, both = mean[:3, :3] + 1e-9 * np.eye(3), mean[:3, 3:]
    return float(np.linalg.eigvalsh(mean[3:, 3:] - both.T @ np.linalg.solve(turn, both))[0])
