"""Format the texts of pages: fill templates, read tables of words, and write names and numbers, with no more digits
than the errors justify.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Final

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from anchorpose.joints import JointState

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

_SIDED: Final = re.compile(r"(.*)_(left|right)$")


def spaced(name: str) -> str:
    """Return a name as readable words: ``hip_flexion`` gives hip flexion, ``SpineBase`` gives spine base."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", name).replace("_", " ").lower()


def split_side(name: str) -> tuple[str, str | None]:
    """Split ``knee_flexion_left`` into (``knee_flexion``, ``left``), and ``KneeLeft`` in the same way. A name without a
    side is returned with None.
    """
    match = _SIDED.match(name) or re.match(r"(.*)(Left|Right)$", name)
    return (match.group(1), match.group(2).lower()) if match else (name, None)


def named_part(part: str) -> str:
    """Return the name of a body part as readable words: ``knee_left`` gives left knee."""
    base, side = split_side(part)
    return f"{side} {spaced(base)}" if side else spaced(base)


def decimals_for(uncertainty: float | None, value: float) -> int:
    """Return the number of digits after the decimal point that the uncertainty justifies. Without an uncertainty, the
    number has three significant digits.

    An uncertainty whose first three digits are 100 to 354 is written with two digits, any other uncertainty with one
    (the rule of the Particle Data Group, doi:10.1103/PhysRevD.110.030001, section 5.3 of its introduction).
    """
    size = uncertainty or abs(value)
    if not size or not math.isfinite(size):
        return 0
    power = math.floor(math.log10(size))
    kept = 3 if not uncertainty else 2 if size / 10.0**power < 3.545 else 1
    return min(4, max(0, kept - 1 - power))


def number(value: float, decimals: int) -> str:
    """Format a number with narrow spaces between thousands and U+2212 as the minus sign. A negative zero is written as
    0.
    """
    text = f"{value:,.{decimals}f}".replace(",", "\u202f")
    return text.lstrip("-") if not text.strip("-0.\u202f") else text.replace("-", "\u2212")


def listed(names: Sequence[str]) -> str:
    """Join names as in "one, two and three"."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def counted(count: int, one: str, many: str | None = None) -> str:
    """Format a count with its noun, as in "1 frame" and "2 frames"."""
    return f"{number(count, 0)} {one if count == 1 else many or one + 's'}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The form of a number: the factor to multiply it by, the decimals, and words before and after it.

    share: whether the number is a share of a whole; a share near 0 or 1 is then written as "under 1" or "over 99", not
    as 0 or 100.
    """

    decimals: int = 0
    times: float = 1.0
    before: str = ""
    after: str = ""
    share: bool = False

    def write(self, value: float) -> str:
        """Return the number as text for readers."""
        text = number(self.times * value, self.decimals)
        if self.share and 0 < value < 1 and text in ("0", "100"):
            text = "under 1" if text == "0" else "over 99"
        return f"{self.before}{text}{self.after}"


PERCENT: Final = Form(times=100.0, after=" %", share=True)


def figure(value: float | None, form: Form) -> Markup:
    """Return a number as an HTML element with its exact value; "not known" for None and NaN."""
    if value is None or math.isnan(value):
        return Markup('<span class="unknown">{}</span>').format(MISSING)
    return Markup('<data value="{!r}">{}</data>').format(float(value), form.write(value))


def render_page(package: str, template: str, **values: object) -> str:
    """Fill the template, a file of ``package``. Every value is escaped for HTML unless it is ``Markup``.

    A template can include other templates of the package by name, and ``page_head.html``, which needs the value
    ``title``. In a template, ``inline(name)`` inserts a file unchanged. Raises jinja2.UndefinedError if a value is
    missing.
    """
    return _environment(package).get_template(template).render(values)


@cache
def _environment(package: str) -> Environment:
    loader = ChoiceLoader([PackageLoader(package, ""), PackageLoader("anchorpose.report", "templates")])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals["inline"] = lambda name: Markup(loader.get_source(environment, name)[0])
    return environment


def read_words(package: str, name: str) -> list[dict[str, str]]:
    """Read a CSV file of ``package``: one dict per row, with the names of the columns as keys."""
    return list(csv.DictReader(resources.files(package).joinpath(name).read_text("utf-8").splitlines()))
