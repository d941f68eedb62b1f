"""How the report says things: states, body parts, names of angles, and numbers with no more digits than they carry.

A table that scrolls by itself where a screen is narrow, reached by Tab and named to those who cannot see it.

Angles that pass from 180 to -180 degrees, on the side of the circle where they lie together.

A patient who faces against X has a pelvis that turns by 179 in one frame and by -179 in the next: two degrees, of which
the lowest and the highest number would make a whole turn.
"""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.joints import JointState

COVERAGE: Final = 1.96
"""Standard deviations to either side that hold a normally distributed truth 95 times in 100."""

MISSING: Final = "not known"

STATE_WORDS: Final = {
    JointState.OBSERVED: "seen",
    JointState.HIDDEN_BY_SELF: "hidden by the own body",
    JointState.HIDDEN_BY_EQUIPMENT: "hidden by equipment",
    JointState.HIDDEN_BY_PERSON: "hidden by a person",
    JointState.HIDDEN: "hidden, cause unknown",
    JointState.OUT_OF_VIEW: "out of view",
    JointState.LOST: "lost",
}

INFERRED_STATES: Final = tuple(str(s) for s in JointState if s not in (JointState.OBSERVED, JointState.LOST))

_SIDED = re.compile(r"(.*)_(left|right)$")


def escape(text: object) -> str:
    """As it may stand in HTML, in an attribute too."""
    return html.escape(str(text), quote=True)


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
    """Digits after the point: those that the uncertainty leaves, or three that count of a value that has none.

    Of an uncertainty that begins with 100 to 354 two digits count, of a larger one a single digit (the rule of the
    Particle Data Group, doi:10.1103/PhysRevD.110.030001, section 5.3 of its introduction).
    """
    size = uncertainty or abs(value)
    if not size or not math.isfinite(size):
        return 0
    power = math.floor(math.log10(size))
    kept = 3 if not uncertainty else 2 if size / 10.0**power < 3.545 else 1
    return min(4, max(0, kept - 1 - power))


def number(value: float, decimals: int) -> str:
    """With thin groups of thousands and a true minus; never a negative zero."""
    text = f"{value:,.{decimals}f}".replace(",", "\u202f")
    return text.lstrip("-") if not text.strip("-0.\u202f") else text.replace("-", "\u2212")


def listed(names: Sequence[str]) -> str:
    """One, two and three."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def counted(count: int, one: str, many: str | None = None) -> str:
    """1 frame, 2 frames."""
    return f"{number(count, 0)} {one if count == 1 else many or one + 's'}"


def table(title: str, head: Sequence[str], body: str, kind: str = "") -> str:
    """HTML. title: its caption and name; head: titles of the columns, both plain text. body: its tbody elements."""
    name = escape(title)
    titles = "".join(f"<th scope='col'>{escape(column)}</th>" for column in head)
    return (
        f"<div class='scroll' tabindex='0' role='region' aria-label='{name}'><table class='{kind}'>"
        f"<caption>{name}</caption><thead><tr>{titles}</tr></thead>{body}</table></div>"
    )


def row(name: str, cells: Sequence[str], meaning: str = "") -> str:
    """HTML. name: of the row, plain text; cells: HTML; meaning: told when the name is pointed at."""
    title = f" title='{escape(meaning)}'" if meaning else ""
    return f"<tr><th scope='row'{title}>{escape(name)}</th>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def heading_row(heading: str, columns: int) -> str:
    """HTML: the name of the rows below it."""
    return f"<tr class='group'><th scope='rowgroup' colspan='{columns}'>{escape(heading)}</th></tr>"


TURN_DEG = 360.0


def on_shortest_arc(degrees: np.ndarray) -> np.ndarray:
    """degrees (n,) from -180 to 180, NaN where not known: the same angles on the shortest arc that holds all of them.

    Some are a whole turn further than their number says, or less far, such that the median is from -180 to 180. Angles
    whose numbers lie within half a turn stay as they are.
    """
    known = np.sort(degrees[np.isfinite(degrees)])
    if len(known) < 2:
        return degrees
    gaps = np.diff(known)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= TURN_DEG - (known[-1] - known[0]):
        return degrees
    moved = np.where(degrees <= known[widest], degrees + TURN_DEG, degrees)
    return moved - TURN_DEG if np.nanmedian(moved) > TURN_DEG / 2 else moved
