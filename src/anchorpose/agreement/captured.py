"""What a file of another motion capture system holds: points and angles over time, by the names that it gives them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError

METRES: Final[Mapping[str, float]] = {
    "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "cm": 0.01, "mm": 0.001, "millimeters": 0.001,
    "millimetres": 0.001, "centimeters": 0.01, "centimetres": 0.01,
}  # fmt: skip
"""Metres per unit, by the names that files use."""

LEAST_FRAMES: Final = 2
LONGEST_S: Final = 86_400.0  # a day; a movement of more is in milliseconds or less
FARTHEST_M, LARGEST_DEG = 1e4, 1e5  # a body of metres that is read as millimetres is found by its size


@dataclass(frozen=True, slots=True, eq=False)
class Captured:
    """time_s (t,) float64, the file's own clock, increasing.

    point_m (t, p, 3) metres in the file's own frame, NaN where missing, of the labels ``points``; degrees (t, a), NaN
    where missing, of ``angles``.
    """

    path: Path
    time_s: np.ndarray
    points: tuple[str, ...]
    point_m: np.ndarray
    angles: tuple[str, ...]
    degrees: np.ndarray

    def point(self, label: str) -> np.ndarray:
        """(t, 3) metres of one label."""
        return self.point_m[:, self.points.index(label)]


def metres_per_unit(path: Path, unit: str | None, stated: str | None) -> float:
    """unit: as the file has it, None where it has none; stated: by the user, which wins.

    Raises InputError where neither is known, or the unit is unknown.
    """
    name = stated if stated is not None else unit
    if not name:
        raise InputError(path, "does not state its unit of length", "give it with --unit mm, --unit cm or --unit m")
    scale = METRES.get(name.strip().lower())
    if scale is None:
        raise InputError(path, f"has lengths in '{name}'", "give the unit with --unit mm, --unit cm or --unit m")
    return scale


def checked(captured: Captured) -> Captured:
    """Raises InputError for a file without points and angles, of a single frame, whose times do not increase, or with
    values that nothing can have."""
    path, known = captured.path, np.isfinite(captured.point_m).all(axis=2).any(axis=0)
    if not known.any() and not np.isfinite(captured.degrees).any():
        what = "holds no markers, joint centres or angles" if not captured.points else "has only markers without values"
        raise InputError(path, what, "export the labelled trajectories of the other system and give that file")
    if len(captured.time_s) < LEAST_FRAMES:
        raise InputError(path, "has a single frame", "give the file of a movement")
    if not (np.isfinite(captured.time_s).all() and (np.diff(captured.time_s) > 0).all()):
        raise InputError(path, "has times that do not increase", "export it again with a time for each frame")
    lasts_s = captured.time_s[-1] - captured.time_s[0]
    if lasts_s > LONGEST_S:
        raise InputError(path, f"lasts {lasts_s:.3g} s by its times", "give its times in seconds")
    with np.errstate(invalid="ignore"):
        far = (np.abs(captured.point_m) > FARTHEST_M).any() or (np.abs(captured.degrees) > LARGEST_DEG).any()
    if far:
        problem = f"has points over {FARTHEST_M:g} m away, or angles over {LARGEST_DEG:g} degrees"
        raise InputError(path, problem, "check its unit of length, or give it with --unit mm, --unit cm or --unit m")
    return captured


def repeated_label(path: Path, labels: tuple[str, ...]) -> None:
    """Raises InputError where a label stands for two columns."""
    for label in labels:
        if labels.count(label) > 1:
            raise InputError(path, f"has the label '{label}' twice", "rename one of them in the other system")
