"""Decide which sign of the other system's knee angles means flexion. The systems differ in this sign: in OpenSim's
models, for example, a bent knee is negative in gait2392 and positive in the model of Rajagopal.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.agreement.reference import Reference
from anchorpose.results.joint_angles import ANGLE_NAMES
from anchorpose.results.tables import AngleTable

LARGEST_ZERO_DEG: Final = 10.0
"""Maximum difference in degrees between the zeros of knee flexion in two systems. Centres of joints differ by up to 30
mm between definitions; a knee that lies 30 mm farther forward changes the flexion by 9 degrees.
"""


def with_knee_sign(reference: Reference, ours: AngleTable) -> Reference:
    """Return the reference with knee angles whose positive sign means flexion, and with a note on how this sign was
    determined. ours: angles of the results.

    Both knees have the same sign: the one with which the middle of their range is nearer to that in the results. This
    comparison needs no common clock, since knees bend one way. If both signs fit about equally, for example to straight
    knees, the angles become NaN. Knees that have this program's names in the file have this program's sign.
    """
    named = enumerate(zip(reference.angles, reference.labels, strict=True))
    knees = [k for k, (name, label) in named if name.startswith("knee_flexion") and label not in ANGLE_NAMES]
    if not knees:
        return reference
    middle = _middle(ours.degrees[:, [ours.column(reference.angles[k]) for k in knees]])
    in_file = _middle(reference.degrees[:, knees])
    sign, how = _sign(abs(middle - in_file), abs(middle + in_file))
    degrees = reference.degrees.copy()
    degrees[:, knees] *= sign
    note = (
        f"{' and '.join(reference.labels[k] for k in knees)}: {how}; the middle of the range is {_shown(in_file)} in "
        f"the file and {_shown(middle)} in the results. To state the sign yourself, name the angles "
        "knee_flexion_left and knee_flexion_right in the file, with flexion positive."
    )
    return replace(reference, degrees=degrees, notes=(*reference.notes, note))


def _shown(degrees: float) -> str:
    return "unknown" if np.isnan(degrees) else f"{degrees:.0f} degrees"


def _middle(degrees: np.ndarray) -> float:
    """Return the middle between the 5th and the 95th percentile of all known angles; NaN if no angle is known."""
    known = degrees[np.isfinite(degrees)]
    return float(np.percentile(known, [5.0, 95.0]).mean()) if len(known) else float("nan")


def _sign(as_given_deg: float, opposite_deg: float) -> tuple[float, str]:
    """Return the sign, NaN if it is undecided, and a text on it. as_given_deg, opposite_deg: differences from the
    results with either sign.
    """
    if opposite_deg - as_given_deg > LARGEST_ZERO_DEG:
        return 1.0, "taken with the sign as given"
    if as_given_deg - opposite_deg > LARGEST_ZERO_DEG:
        return -1.0, "taken with the opposite sign"
    return float("nan"), "left out, since the results do not show which sign means flexion"
