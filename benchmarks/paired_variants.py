"""Scores of variants on the same recordings, compared pair by pair."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from intervals import PairedDifference, paired_difference

GEODESIC, ALWAYS, POSITION, NEITHER = "geodesic", "always", "position", "neither"
MISSING_MM: Final = 250.0  # sigma beyond which tracking calls a joint lost (``FollowConfig.lost_sigma_m``)
WRONG_MM: Final = 150.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """One recording by one variant. mean_mm and wrong_share over joints and frames, those without a place included;
    ms: per frame, or per first pose."""

    situation: str
    seed: int
    variant: str
    mean_mm: float
    wrong_share: float
    ms: float


def score(situation: str, seed: int, variant: str, error_mm: np.ndarray, seconds: float) -> Score:
    """error_mm (n, 21), NaN where a joint has no place; seconds: that the n frames took."""
    counted = np.where(np.isfinite(error_mm), error_mm, MISSING_MM)
    return Score(
        situation=situation,
        seed=seed,
        variant=variant,
        mean_mm=float(counted.mean()),
        wrong_share=float((counted > WRONG_MM).mean()),
        ms=1000.0 * seconds / len(error_mm),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A variant against geodesic in one situation: differences of means over recordings, variant minus geodesic."""

    situation: str
    variant: str
    mean_mm: float
    wrong_percent: float
    ms: float
    less_mm: PairedDifference | None = None
    less_wrong_percent: PairedDifference | None = None
    less_ms: PairedDifference | None = None


def compare(scores: Sequence[Score]) -> list[Comparison]:
    """One comparison per situation and variant; geodesic itself has no differences."""
    found = []
    for situation in dict.fromkeys(one.situation for one in scores):
        of_situation = [one for one in scores if one.situation == situation]
        base = {one.seed: one for one in of_situation if one.variant == GEODESIC}
        for variant in dict.fromkeys(one.variant for one in of_situation):
            of_variant = [one for one in of_situation if one.variant == variant]
            found.append(_against(base, of_variant, situation, variant))
    return found


def _against(base: Mapping[int, Score], of_variant: Sequence[Score], situation: str, variant: str) -> Comparison:
    def figures(take: Callable[[Score], float]) -> tuple[float, PairedDifference | None]:
        pairs = [(take(one), take(base[one.seed])) for one in of_variant if one.seed in base]
        away = None if variant == GEODESIC else paired_difference(*zip(*pairs, strict=True))
        return float(np.mean([take(one) for one in of_variant])), away

    mean_mm, less_mm = figures(lambda one: one.mean_mm)
    wrong, less_wrong = figures(lambda one: 100.0 * one.wrong_share)
    ms, less_ms = figures(lambda one: one.ms)
    return Comparison(
        situation=situation,
        variant=variant,
        mean_mm=mean_mm,
        wrong_percent=wrong,
        ms=ms,
        less_mm=less_mm,
        less_wrong_percent=less_wrong,
        less_ms=less_ms,
    )


def table(comparisons: Sequence[Comparison], titles: Mapping[str, str], seeds: int) -> str:
    """Markdown, one row per situation and variant; titles: of the situations."""
    columns = ("variant", "mm", "less geodesic", "over 150 mm, %", "less geodesic", "ms", "less geodesic")
    lines = [f"| {seeds} recordings each | {' | '.join(columns)} |", "|---|---|--:|--:|--:|--:|--:|--:|"]
    for one in comparisons:
        cells = (
            f"{one.mean_mm:.1f}", _interval(one.less_mm), f"{one.wrong_percent:.1f}",
            _interval(one.less_wrong_percent), f"{one.ms:.0f}", _interval(one.less_ms),
        )  # fmt: skip
        lines.append(f"| {titles[one.situation]} | {one.variant} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _interval(away: PairedDifference | None) -> str:
    if away is None:
        return ""
    bounds = "" if away.low is None or away.high is None else f" ({away.low:+.1f} to {away.high:+.1f})"
    return f"{away.mean:+.1f}{bounds}"
