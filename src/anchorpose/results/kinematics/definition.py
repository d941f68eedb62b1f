"""What an angle is: its names, the joints that it is read from, and the formula."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.results.kinematics.vectors import between

LEAST_LEVER: Final = 0.2588
"""Sine of 15 degrees. An angle about an axis is read from a vector's part across that axis. Where that part is shorter
than this share of the vector, the axes of the angle nearly fall together (gimbal lock), an error of a joint shows four
times enlarged and more, and no value is given."""

PLANE_UNKNOWN_RAD: Final = np.radians(15.0)
PLANE_KNOWN_RAD: Final = np.radians(30.0)
"""How far a limb is bent when its plane is still, and no longer, mostly that of noise and of bowed limbs."""

Points = Mapping[str, np.ndarray]
"""Joint centres by name, (3, n) each, metres, world."""

Reading = tuple[np.ndarray, "np.ndarray | float"]
"""An angle (n,) in radians, and the lever (n,) that it is read from: 1 at best; not told below ``LEAST_LEVER``."""


@dataclass(frozen=True, slots=True)
class AngleGroup:
    """Angles that one formula gives from the same joints, in the order of ``names``.

    own_sigma: (n,) radians, one standard deviation of what the formula itself may be off, were the joints exact.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    formula: Callable[[Points], tuple[Reading, ...]]
    own_sigma: Callable[[Points], np.ndarray] | None = None


def hinge_sigma(points: Points, limb: tuple[str, str, str], aside_rad: float) -> np.ndarray:
    """(n,) radians: how far the plane of a bent limb may be turned against that of its hinge.

    limb: the joints at its root, hinge and end. aside_rad: by how much limbs differ in how far they are bowed to a
    side; the less the limb is bent, the more of its plane that makes.
    """
    root, hinge, end = (points[name] for name in limb)
    bent = np.sin(between(hinge - root, end - hinge))
    sigma: np.ndarray = np.arctan2(np.tan(aside_rad), bent)
    return sigma
