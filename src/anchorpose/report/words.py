"""How the report says things: states, body parts, names of angles, and numbers with no more digits than they carry."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Final

from anchorpose.joints import JointState

COVERAGE: Final = 1.96
"""Standard deviations to either side that hold a normally distributed truth 95 times in 100."""

MISSING: Final = "not known"

STATE_WORDS: Final = {
    JointState.OBSERVED: "seen",
    JointState.HIDDEN_BY_SELF: "hidden by the patient's own body",
    JointState.HIDDEN_BY_EQUIPMENT: "hidden by equipment",
    JointState.HIDDEN_BY_PERSON: "hidden by a person",
    JointState.HIDDEN: "hidden, cause unknown",
    JointState.OUT_OF_VIEW: "out of view",
    JointState.LOST: "lost",
}

INFERRED_STATES: Final = tuple(str(s) for s in JointState if s not in (JointState.OBSERVED, JointState.LOST))

_SIDED: Final = re.compile(r"(.*)_(left|right)$")


def spaced(name: str) -> str:
    """``hip_flexion`` and ``SpineBase`` as people write them: hip flexion, spine base."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).replace("_", " ").lower()


def split_side(name: str) -> tuple[str, str | None]:
    """``knee_flexion_left`` is (``knee_flexion``, ``left``); without a side, None. ``KneeLeft`` likewise."""
    match = _SIDED.match(name) or re.match(r"(.*)(Left|Right)$", name)
    return (match.group(1), match.group(2).lower()) if match else (name, None)


def named_part(part: str) -> str:
    """``knee_left`` as left knee."""
    base, side = split_side(part)
    return f"{side} {spaced(base)}" if side else spaced(base)


def decimals_for(uncertainty: float | None, value: float) -> int:
    """Digits after the point: as many as the uncertainty justifies, or three significant ones where there is none.

    An uncertainty that begins with 100 to 354 keeps two digits, a larger one a single digit (the rule of the
    Particle Data Group, doi:10.1103/PhysRevD.110.030001, section 5.3 of its introduction).
    """
    size = uncertainty or abs(value)
    if not size or not math.isfinite(size):
        return 0
    power = math.floor(math.log10(size))
    kept = 3 if not uncertainty else 2 if size / 10.0**power < 3.545 else 1
    return min(4, max(0, kept - 1 - power))


def number(value: float, decimals: int) -> str:
    """With narrow spaces between thousands and a true minus; never a negative zero."""
    text = f"{value:,.{decimals}f}".replace(",", "\u202f")
    return text.lstrip("-") if not text.strip("-0.\u202f") else text.replace("-", "\u2212")


def listed(names: Sequence[str]) -> str:
    """One, two and three."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def counted(count: int, one: str, many: str | None = None) -> str:
    """1 frame, 2 frames."""
    return f"{number(count, 0)} {one if count == 1 else many or one + 's'}"
