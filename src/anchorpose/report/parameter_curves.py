"""Draw measures and their uncertainty over a parameter: a number set in each trial, such as an amplitude."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.special import stdtrit

from anchorpose.recording.events import TrialColumn, Trials
from anchorpose.report.measure_section import unit_of, words_of
from anchorpose.report.still_chart import Drawn, StillChart, across, still_row
from anchorpose.report.words import decimals_for, number
from anchorpose.results.records import Measure, MeasureKey
from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95, systematic_share

LEAST_LEVELS: Final = 2
MOST_TICKS: Final = 9


class Level(NamedTuple):
    """The trials with the same value of a parameter. at: this value; trials: their number; mean: the measure's mean
    over these trials; half: half the width of the mean's 95 % interval, NaN if unknown, as for a single trial.
    """

    at: float
    trials: int
    mean: float
    half: float


def levels_of(at: np.ndarray, value: np.ndarray, sigma: np.ndarray, share: float) -> list[Level]:
    """Return, for each distinct value of the parameter in ascending order, the mean of the trials with this value.

    at, value, sigma (n,): the parameter, the measure's value and its sigma in each trial, NaN where unknown. share: the
    share of the variance (sigma squared) that is due to systematic errors. The mean's interval covers the scatter of
    the trials or, if this is larger, their random errors. The systematic error is left out, since it shifts all levels
    alike.
    """
    return [
        _level(float(place), value[at == place], np.sqrt(1.0 - share) * sigma[at == place]) for place in np.unique(at)
    ]


def _level(at: float, value: np.ndarray, random_sigma: np.ndarray) -> Level:
    count = len(value)
    random = float(np.sum(random_sigma**2)) / count**2
    variance = float(np.fmax(value.var(ddof=1) / count, random)) if count > 1 else 0.0
    if variance == 0.0:  # the scatter of the trials is unknown
        return Level(at, count, float(value.mean()), float("nan"))
    return Level(at, count, float(value.mean()), float(stdtrit(count - 1, 0.5 + CONFIDENCE / 2.0) * np.sqrt(variance)))


def parameter_charts(trials: Trials, found: Mapping[MeasureKey, Sequence[Measure]]) -> list[StillChart]:
    """Return a chart for each measure and each numeric column of events.tsv with at least two different numbers; left
    and right share a chart.
    """
    names = dict.fromkeys(key[0] for key in found)
    numeric = [column for column in trials.columns if column.unit is not None]
    charts = (
        _chart(column, trials, [rows for key, rows in found.items() if key[0] == name])
        for name in names
        for column in numeric
    )
    return [chart for chart in charts if chart is not None]


def _chart(column: TrialColumn, trials: Trials, sides: Sequence[Sequence[Measure]]) -> StillChart | None:
    """Return the chart of a measure against the trial parameter in ``column``. Return None if neither the left nor the
    right side has values at two different numbers of this parameter.
    """
    cells = dict(zip([trial.number for trial in trials.rows], trials.column(column.name), strict=True))
    drawn, table = list[Drawn](), list[tuple[str, Sequence[str]]]()
    times, unit = unit_of(sides[0][0].unit)
    for rows in sides:
        known = [row for row in rows if row.value is not None and isinstance(cells.get(row.trial or 0), float)]
        at = np.array([cells[row.trial or 0] for row in known], dtype=np.float64)
        value = times * np.array([row.value for row in known], dtype=np.float64)
        sigma = times * np.array([np.nan if row.sigma is None else row.sigma for row in known])
        levels, side = levels_of(at, value, sigma, systematic_share(rows[0].unit)), rows[0].side or ""
        if len(levels) < LEAST_LEVELS:
            continue
        x, mean, half = (np.array([getattr(level, name) for level in levels]) for name in ("at", "mean", "half"))
        points = {"x": at, "y": value, "reach": NORMAL_95 * sigma}
        drawn.append(Drawn(side=side, **points, line_x=x, line_y=mean, low=mean - half, high=mean + half))
        table += [_cells(side, level, column, unit) for level in levels]
    if not drawn:
        return None
    name, what = sides[0][0].measure, words_of(sides[0][0].measure).title
    span = (min(float(each.x.min()) for each in drawn), max(float(each.x.max()) for each in drawn))
    axis = f"{column.name}, {column.unit}" if column.unit not in ("1", "arbitrary") else column.name
    return StillChart(
        identity=f"parameter-{name}-{trials.columns.index(column)}",
        title=f"{what} over {axis}",
        caption=f"{what} over {axis}",
        row=still_row(unit.strip() or what, drawn, span),
        ticks=_ticks(np.unique(np.concatenate([each.x for each in drawn])), span),
        head=(axis, "trials", "mean", "95 % interval"),
        rows=table,
    )


def _cells(side: str, level: Level, column: TrialColumn, unit: str) -> tuple[str, Sequence[str]]:
    known = np.isfinite(level.half)
    decimals = decimals_for(level.half if known and level.half else None, level.mean)
    mean, low, high = (number(v, decimals) for v in (level.mean, level.mean - level.half, level.mean + level.half))
    interval = f"{low} to {high}{unit}" if known else "not known: one trial" if level.trials == 1 else "not known"
    name = f"{level.at:g}" + (f", {side}" if side else "")
    return name, (str(level.trials), f"{mean}{unit}", interval)


def _ticks(levels: np.ndarray, span: tuple[float, float]) -> list[tuple[float, str]]:
    """Return the ticks of the horizontal axis, as (share of the width, text): all levels or, if their number exceeds
    ``MOST_TICKS``, the first, the last and some levels between them.
    """
    if len(levels) > MOST_TICKS:
        levels = levels[np.unique(np.linspace(0, len(levels) - 1, MOST_TICKS).astype(int))]
    return [(float(share), f"{level:g}") for share, level in zip(across(levels, span), levels.tolist(), strict=True)]
