"""What an angle is: its names, the joints that it is read from, and the formula."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

LEAST_LEVER: Final = 0.2588
"""Sine of 15 degrees. An angle about an axis is read from a vector's part across that axis. Where that part is shorter
than this share of the vector, the axes of the angle nearly fall together (gimbal lock), an error of a joint shows four
times enlarged and more, and no value is given."""

Points = Mapping[str, np.ndarray]
"""Joint centres by name, (3, n) each, metres, world."""

Reading = tuple[np.ndarray, "np.ndarray | float"]
"""An angle (n,) in radians, and the lever (n,) that it is read from: 1 at best; not told below ``LEAST_LEVER``."""


@dataclass(frozen=True, slots=True)
class AngleGroup:
    """Angles that one formula gives from the same joints, in the order of ``names``."""

    names: tuple[str, ...]
    joints: tuple[str, ...]
    formula: Callable[[Points], tuple[Reading, ...]]
