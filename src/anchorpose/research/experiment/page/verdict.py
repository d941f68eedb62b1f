"""Judge claims by comparing values. Each comparison has the answer yes, no or open; the answers give the verdict."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from anchorpose.research.experiment.page.tables import Estimate, Unit, format_estimate


class Answer(StrEnum):
    """The answer of a comparison: open if the interval of the compared value contains the threshold or is unknown."""

    YES = "yes"
    NO = "no"
    OPEN = "open"


class Verdict(StrEnum):
    """The verdict on a claim from all its comparisons."""

    HOLDS = "holds"
    IN_PART = "holds in part"
    NOT = "does not hold"
    UNKNOWN = "undecided"


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison: what is compared, the value, its unit, and the answer."""

    what: str
    value: Estimate
    unit: Unit
    answer: Answer

    def text(self) -> str:
        """Return the comparison as text for readers."""
        unit = {Unit.MM: " mm", Unit.SECONDS: " s"}.get(self.unit, "")
        return f"{self.what}: {format_estimate(self.value, self.unit)}{unit if np.isfinite(self.value.mean) else ''}"


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim and its comparisons."""

    key: str  # key of the claim in claims.json
    place: str  # place of the claim in the paper, or a note that the claim is this project's
    text: str  # the claim in our words
    rule: str  # condition under which the answer of a comparison is yes
    checks: tuple[Check, ...]  # every comparison
    context: tuple[str, ...] = ()  # further values for the reader, which do not affect the verdict

    @property
    def verdict(self) -> Verdict:
        """Return the verdict from the answers of all comparisons, by the rule of ``judge``."""
        return judge([check.answer for check in self.checks])


def judge(answers: Sequence[Answer]) -> Verdict:
    """Judge a claim: it holds if all comparisons answer yes.

    The claim holds in part if at least half of the comparisons answer yes, or if more comparisons answer yes than no
    and at least one comparison answers no. Otherwise, the claim does not hold if any comparison answers no, and it is
    undecided if no comparison answers no.
    """
    yes, no = answers.count(Answer.YES), answers.count(Answer.NO)
    if not yes + no:
        return Verdict.UNKNOWN
    if yes == len(answers):
        return Verdict.HOLDS
    if 2 * yes >= len(answers) or yes > no > 0:
        return Verdict.IN_PART
    return Verdict.NOT if no else Verdict.UNKNOWN


def at_most(value: Estimate, bound: float) -> Answer:
    """Return yes if the whole interval is at or below the bound, no if the whole interval is above it, else open."""
    if np.isnan(value.low) or np.isnan(value.high):
        return Answer.OPEN
    if value.high <= bound:
        return Answer.YES
    return Answer.NO if value.low > bound else Answer.OPEN


def at_least(value: Estimate, bound: float) -> Answer:
    """Return yes if the whole interval is at or above the bound, no if the whole interval is below it, else open."""
    return at_most(Estimate(-value.mean, -value.high, -value.low, value.count), -bound)


def between(value: Estimate, low: float, high: float) -> Answer:
    """Return yes if the whole interval lies within the limits, no if the whole interval lies outside, else open."""
    parts = (at_least(value, low), at_most(value, high))
    if Answer.NO in parts:
        return Answer.NO
    return Answer.YES if parts == (Answer.YES, Answer.YES) else Answer.OPEN


def measured(value: float, bound: float) -> Answer:
    """Return yes if a measurement without an interval, such as a time, is at most the bound, no if not, open if NaN."""
    if np.isnan(value):
        return Answer.OPEN
    return Answer.YES if value <= bound else Answer.NO


def claims_json(claims: Sequence[Claim]) -> str:
    """Return all claims with every comparison as JSON; unknown numbers are null."""
    return json.dumps([_claim(claim) for claim in claims], indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _claim(claim: Claim) -> dict[str, Any]:
    return {
        "key": claim.key,
        "place": claim.place,
        "claim": claim.text,
        "rule": claim.rule,
        "verdict": str(claim.verdict),
        "checks": [_check(check) for check in claim.checks],
        "context": list(claim.context),
    }


def _check(check: Check) -> dict[str, Any]:
    value = check.value
    numbers = {"mean": value.mean, "low": value.low, "high": value.high}
    return {
        "what": check.what,
        "answer": str(check.answer),
        "unit": str(check.unit),
        **{name: None if math.isnan(number) else round(number, 6) for name, number in numbers.items()},
        "recordings": value.count,
    }
