"""Compute the pelvis on legs whose knees bend by given angles: its height, and its tilt where the knees bend
unequally.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.rotations import FORWARD, rotate, turns_about

LEAST_LOAD: Final = 1e-3  # share of a foot in the air, so that shares have a sum
ROUNDS: Final = 8  # iterations for the tilt; each leaves a tenth of its error

LEAST_HEIGHT_M: Final = 0.1
"""From an ankle up to its hip: less is a foot that no leg reaches, and has no height."""


@dataclass(frozen=True, slots=True, eq=False)
class KneeBend:
    """The bend of both knees, radians (t, 2), 0 straight. carry (t,): share by which the legs carry the pelvis; 0: the
    posture determines its place. load (t, 2): share of the load on each foot, above 0.
    """

    flexion: np.ndarray
    carry: np.ndarray
    load: np.ndarray


def knee_bend(flexion: np.ndarray, carry: np.ndarray, lift: np.ndarray) -> KneeBend | None:
    """Return how far the knees bend, (t, 2) as in ``KneeBend``; None where no leg carries. lift: 1 is as high as in a
    step.
    """
    if not carry.any():
        return None
    return KneeBend(flexion, carry.clip(0.0, 1.0).max(axis=1), np.maximum(1.0 - lift, LEAST_LOAD))


@dataclass(frozen=True, slots=True, eq=False)
class Legs:
    """The legs in the rest pose, left and right. hips_m (2, 3): hips relative to the pelvis; lengths_m (2, 2): lengths
    of thigh and shank.
    """

    hips_m: np.ndarray
    lengths_m: np.ndarray


def carried_pelvis(
    bend: KneeBend, legs: Legs, ankles_m: np.ndarray, pelvis_m: np.ndarray, pelvis_turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return place (t, 3) and rotation (t, 3, 3) of the pelvis: the legs determine its height, and its place over the
    floor stays.

    It tilts to one side where the legs are not equally long, and less where a foot is in the air. ankles_m (t, 2, 3);
    pelvis_m, pelvis_turn: pelvis in the posture.
    """
    first, second = legs.lengths_m.T
    reach_m = np.sqrt(first**2 + second**2 + 2.0 * first * second * np.cos(np.maximum(bend.flexion, 0.0)))
    width_m = float(legs.hips_m[1, 2] - legs.hips_m[0, 2])
    both, tilt = bend.carry * bend.load.min(axis=1), np.zeros(len(pelvis_m))
    for _ in range(ROUNDS):
        turn = pelvis_turn @ turns_about(FORWARD, tilt)
        height_m = _pelvis_heights(reach_m, rotate(turn[:, None], legs.hips_m), ankles_m, pelvis_m)
        tilt = both * (tilt + (height_m[:, 0] - height_m[:, 1]) / width_m)
    carried = (bend.load * height_m).sum(axis=1) / bend.load.sum(axis=1)
    place = pelvis_m.copy()
    place[:, 1] += bend.carry * (carried - place[:, 1])
    return place, turn


def _pelvis_heights(reach_m: np.ndarray, hips_m: np.ndarray, ankles_m: np.ndarray, pelvis_m: np.ndarray) -> np.ndarray:
    """Return (t, 2) height of the pelvis by either leg; hips_m (t, 2, 3) from the pelvis."""
    aside_m = (pelvis_m[:, None] + hips_m - ankles_m)[..., [0, 2]]
    rise_m = np.sqrt(np.maximum(reach_m**2 - (aside_m**2).sum(axis=2), LEAST_HEIGHT_M**2))
    return np.asarray(ankles_m[..., 1] + rise_m - hips_m[..., 1])
