"""Each claim of the paper, and what the experiment says of it."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from anchorpose.research.experiment.outcome import Outcome
from anchorpose.research.experiment.page.matching_claims import MatchingClaims
from anchorpose.research.experiment.page.matching_tables import PAPER_FEATURE_S, PAPER_MESH_S, PAPER_NODES
from anchorpose.research.experiment.page.tables import Estimate, Unit
from anchorpose.research.experiment.page.tracking_claims import TrackingClaims
from anchorpose.research.experiment.page.verdict import Answer, Check, Claim, measured

COMPARABLE: Final = 0.8  # of the paper's nodes: a smaller mesh proves nothing about time


def judge_claims(outcome: Outcome) -> list[Claim]:
    """All claims, those of the figures first."""
    return [*TrackingClaims(outcome).all(), *MatchingClaims(outcome).all(), paper_times(outcome)]


def paper_times(outcome: Outcome) -> Claim:
    """Section V-B."""
    checks, times = [], outcome.times
    if times is not None:
        enough = times.nodes >= COMPARABLE * PAPER_NODES
        for what, seconds, bound in (
            ("mesh", times.mesh_s, PAPER_MESH_S),
            ("feature by Dijkstra", times.dijkstra_s, PAPER_FEATURE_S),
            ("feature by fast marching", times.feature_s, PAPER_FEATURE_S),
        ):
            value = Estimate(seconds, np.nan, np.nan, 1)
            answer = measured(seconds, bound) if enough else Answer.OPEN
            checks.append(Check(f"{what}, {times.nodes} nodes (paper: {bound} s)", value, Unit.SECONDS, answer))
    return Claim(
        "times", "Section V-B",
        "One core makes a mesh of 15,549 nodes in 0.72 s, and the feature of five anchors in 0.23 s.",
        f"No longer than the paper’s, on a mesh of at least {COMPARABLE:g} times as many nodes; another processor.",
        tuple(checks),
    )  # fmt: skip


def claims_json(claims: Sequence[Claim]) -> str:
    """With every comparison; null where a number is not known."""
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
