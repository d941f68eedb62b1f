"""Compute the height of the pelvis for given bends of the knees, and its tilt to one side if the knees bend
unequally.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.rotations import FORWARD, rotate, turns_about

LEAST_LOAD: Final = 1e-3  # share of the load of a foot in the air; not 0, so that the sum of the shares is never 0
ROUNDS: Final = 8  # number of iterations that compute the tilt; each reduces the error of the tilt to a tenth

LEAST_HEIGHT_M: Final = 0.1
"""Minimum height (m) of a hip above its ankle. It is used if a leg, bent as given, is too short to reach from the hip
to the ankle.
"""


@dataclass(frozen=True, slots=True, eq=False)
class KneeBend:
    """The bend of both knees, and how the legs carry the pelvis."""

    flexion: np.ndarray  # (t, 2) rad, 0 = straight
    carry: np.ndarray  # (t,) 1 = the legs determine the height of the pelvis; 0 = the posture determines it
    load: np.ndarray  # (t, 2) share of the load on each foot, above 0


def knee_bend(flexion: np.ndarray, carry: np.ndarray, lift: np.ndarray) -> KneeBend | None:
    """Return the bend of the knees; None if the legs never carry the pelvis, that is, never determine its height. carry
    (t, 2): 1 where the leg determines the height of the pelvis, 0 where the posture determines it; lift (t, 2): height
    of each foot above the floor, as a share of the height of a step.
    """
    if not carry.any():
        return None
    return KneeBend(flexion, carry.clip(0.0, 1.0).max(axis=1), np.maximum(1.0 - lift, LEAST_LOAD))


@dataclass(frozen=True, slots=True, eq=False)
class Legs:
    """The dimensions of the left and the right leg, from the rest pose."""

    hips_m: np.ndarray  # (2, 3) positions of the hips relative to the pelvis
    lengths_m: np.ndarray  # (2, 2) lengths of thigh and shank


def carried_pelvis(
    bend: KneeBend, legs: Legs, ankles_m: np.ndarray, pelvis_m: np.ndarray, pelvis_turn: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position (t, 3) and rotation (t, 3, 3) of the pelvis. The legs determine the pelvis's height; the posture
    determines its x and z.

    The pelvis tilts to one side if one leg carries its hip higher than the other leg does; it tilts less if a foot is
    in the air. ankles_m (t, 2, 3): ankles. pelvis_m, pelvis_turn: position and rotation of the pelvis in the posture.
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
    """Return the heights (t, 2) at which the left and the right leg would carry the pelvis. reach_m (t, 2): distance
    from hip to ankle; hips_m (t, 2, 3): places of the hips relative to the pelvis.
    """
    aside_m = (pelvis_m[:, None] + hips_m - ankles_m)[..., [0, 2]]
    rise_m = np.sqrt(np.maximum(reach_m**2 - (aside_m**2).sum(axis=2), LEAST_HEIGHT_M**2))
    return np.asarray(ankles_m[..., 1] + rise_m - hips_m[..., 1])
