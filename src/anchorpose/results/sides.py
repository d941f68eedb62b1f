"""Whether joints of another system, or true ones, have their axes or their labels the wrong way round."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES

WRONG_M: Final = 0.15
"""Farther off than this, half a forearm, a joint says nothing about the patient, and its limb is wrong."""

CLEARLY_BETTER: Final = 0.7
"""Ratio of two misfits from which on the smaller is the right one. In six simulated laboratories it was at most 0.1."""

LARGEST_DEFINITION_M: Final = 0.03
"""A misfit up to here needs no other explanation: joint centres of two systems differ by as much by definition."""


class Sides(NamedTuple):
    """What is the wrong way round."""

    exchanged: bool
    mirrored: bool


AS_IS: Final = Sides(False, False)

WRONG: Final = {
    Sides(True, False): (
        "left and right are exchanged: with them the other way round it fits",
        "correct the labels in the other system, or give --exchange-sides (leave it out where it was given)",
    ),
    Sides(False, True): (
        "is mirrored: with one axis reversed it fits",
        "export it with right-handed axes, or change the sign of one of its axes, such as z",
    ),
    Sides(True, True): (
        "is mirrored, and left and right are exchanged: with both the other way round it fits",
        "export it with right-handed axes, or change the sign of one of its axes, and correct the labels, or give "
        "--exchange-sides (leave it out where it was given)",
    ),
}


def require_as_is(path: Path, misfit: Mapping[Sides, float], is_length: bool) -> None:
    """Raises InputError where the file fits much better with axes or labels the other way round.

    misfit: by what is reversed, in metres where it is a length; without an entry where nothing can be compared.
    """
    best = min(misfit, key=lambda sides: misfit[sides], default=AS_IS)
    if best == AS_IS:
        return
    problem, remedy = WRONG[best]
    if AS_IS in misfit:
        if misfit[best] > CLEARLY_BETTER * misfit[AS_IS] or (is_length and misfit[AS_IS] < LARGEST_DEFINITION_M):
            return
        if is_length:
            problem += f" within {1000 * misfit[best]:.0f} mm instead of {1000 * misfit[AS_IS]:.0f} mm"
    raise InputError(path, problem, remedy)


_EXCHANGED: Final = [
    JOINT_INDEX[name.replace("Left", "-").replace("Right", "Left").replace("-", "Right")] for name in JOINT_NAMES
]


def require_not_mirrored(path: Path, ours_m: np.ndarray, truth_m: np.ndarray) -> None:
    """Raises InputError where the truth (n, 21, 3), in the world of ours (n, 21, 3), fits with an axis reversed.

    Labels may be the other way round in ours, where a patient was tracked back to front: that is an error to be
    reported, as is any other misfit over ``WRONG_M``.
    """
    kept, reversed_m = AS_IS, Sides(exchanged=False, mirrored=True)
    misfit = {kept: np.inf, reversed_m: np.inf}
    for axes, labels in product((*np.diag([-2.0] * 3) + 1.0, np.ones(3)), (slice(None), _EXCHANGED)):
        distance_m = np.linalg.norm(ours_m - (truth_m * axes)[:, labels], axis=2)
        sides = kept if axes.min() > 0 else reversed_m
        if np.isfinite(distance_m).any():
            misfit[sides] = min(misfit[sides], float(np.nanmedian(distance_m)))
    if misfit[reversed_m] < WRONG_M:
        require_as_is(path, misfit, is_length=True)
