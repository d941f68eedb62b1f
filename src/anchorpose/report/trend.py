"""Compute the trend of each measure over the dates of several sessions: a straight line with its 95 % band, or the
reason why no line is fitted.

The line is fitted by ordinary least squares over time. Each session is one observation, and sessions are assumed to
scatter independently about the line. If the observed scatter is smaller than the stated errors of measurement, these
errors are used in its place. So the band is never narrower than the errors, even if three sessions happen to lie on a
line.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup
from scipy.special import stdtrit

from anchorpose.errors import InputError
from anchorpose.report.comparable import time_gap
from anchorpose.report.detectable import Detectable
from anchorpose.report.measure_section import (
    COMPARED,
    title_of,
    unit_of,
    value_and_interval,
    value_form,
    value_text,
    words_of,
)
from anchorpose.report.session import Session
from anchorpose.report.still_chart import Drawn, StillChart, across, still_row
from anchorpose.results.records import Measure, MeasureKey
from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95

LEAST_SESSIONS: Final = 3
DAYS: Final = 7.0
"""Number of days to which a slope refers (a week)."""

NO_DATES: Final = "There is no trend: the dates of the sessions are not known. Give --date once for each session."
TOO_FEW: Final = "There is no trend: it needs {} sessions of different days at least, and these are {}."


def parse_dates(texts: Sequence[str], count: int, page: Path) -> list[date] | None:
    """Parse the dates of the sessions; None without dates. Raises InputError unless each session has a valid date, in
    the order of time.
    """
    if not texts:
        return None
    if len(texts) != count:
        problem = f"{len(texts)} dates are given for {count} sessions"
        raise InputError(page, problem, "give --date once for each session, in the same order")
    dates = [_parse(text, page) for text in texts]
    if any(later < before for before, later in pairwise(dates)):
        raise InputError(page, "the dates of the sessions go back in time", "give sessions and dates in order of time")
    return dates


def _parse(text: str, page: Path) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise InputError(page, f"'{text[:40]}' is not a date", "write year, month and day as 2025-03-28") from None


def dates_in(labels: Sequence[str]) -> list[str]:
    """Return the labels if all of them are dates in the order of time, else an empty list."""
    try:
        dates = [date.fromisoformat(label) for label in labels]
    except ValueError:
        return []
    return list(labels) if dates == sorted(dates) else []


@dataclass(frozen=True, slots=True)
class Fit:
    """A straight line through sessions: slope per unit of x, half the width of the slope's 95 % interval, intercept,
    and the values from which the band is computed: scatter (standard deviation about the line), quantile (of Student's
    t), middle (mean of x), squares (sum of the squared deviations of x) and count of sessions.
    """

    slope: float
    half: float
    intercept: float
    scatter: float
    quantile: float
    middle: float
    squares: float
    count: int

    def band(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the line's values at x (k,), and half the width of its 95 % interval at each x."""
        half = self.quantile * self.scatter * np.sqrt(1.0 / self.count + (x - self.middle) ** 2 / self.squares)
        return self.intercept + self.slope * x, half


def fit_line(x: np.ndarray, y: np.ndarray, sigma: np.ndarray) -> Fit:
    """Fit a line by least squares. x, y (n,): at least 3 sessions, not all at the same x. sigma (n,): standard
    deviation of each y, NaN if not stated; if any is NaN, only the sessions' scatter determines the band.
    """
    count, middle = len(x), float(x.mean())
    squares = float(np.sum((x - middle) ** 2))
    slope = float(np.sum((x - middle) * (y - y.mean())) / squares)
    intercept = float(y.mean()) - slope * middle
    found = float(np.sum((y - intercept - slope * x) ** 2)) / (count - 2)
    scatter = float(np.sqrt(np.fmax(found, np.mean(sigma**2))))
    quantile = float(stdtrit(count - 2, 0.5 + CONFIDENCE / 2.0))
    return Fit(slope, quantile * scatter / np.sqrt(squares), intercept, scatter, quantile, middle, squares, count)


class TrendRow(NamedTuple):
    """A measure's trend: title and meaning of the measure, slope per week, change over the whole time, and the verdict
    on this change.
    """

    title: str
    meaning: str
    slope: Markup
    change: Markup
    verdict: Markup


class TrendSection(NamedTuple):
    """All trends. why: the reason why no trend is shown; empty if rows and charts exist."""

    why: str
    rows: list[TrendRow]
    charts: list[StillChart]


def trend_section(sessions: Sequence[Session], dates: Sequence[date] | None, detectable: Detectable) -> TrendSection:
    """Return the trends of the main measures, in the order of ``COMPARED``. dates: the day of each session, None if the
    days are unknown. detectable: minimal detectable changes; a smaller change over the whole time is not called a
    trend.
    """
    if dates is None:
        return TrendSection(NO_DATES, [], [])
    days = len(set(dates))
    if days < LEAST_SESSIONS:
        return TrendSection(TOO_FEW.format(LEAST_SESSIONS, days), [], [])
    x = np.array([(each - dates[0]).days / DAYS for each in dates])
    rows, drawn = list[TrendRow](), dict[str, list[_Followed]]()
    for key in _keys(sessions):
        followed = _follow(sessions, key, x)
        rows.append(_row(followed, detectable))
        if followed.fit is not None:
            drawn.setdefault(key[0], []).append(followed)
    return TrendSection("", rows, [_chart(name, sides, dates) for name, sides in drawn.items()])


def _keys(sessions: Sequence[Session]) -> list[MeasureKey]:
    found = dict.fromkeys(row.key for each in sessions for row in each.measures if not (row.part or row.person))
    return [key for name in COMPARED for key in found if key[0] == name]


class _Followed(NamedTuple):
    """A measure over all sessions. like: one of its table rows, which has its name and unit; x (n,): weeks since the
    first session; value, sigma (n,): NaN where missing; why: the reason why no line is fitted, empty if a line is
    fitted.
    """

    like: Measure
    x: np.ndarray
    value: np.ndarray
    sigma: np.ndarray
    fit: Fit | None
    why: str


def _follow(sessions: Sequence[Session], key: MeasureKey, x: np.ndarray) -> _Followed:
    rows = [next((row for row in each.measures if row.key == key), None) for each in sessions]
    value = np.array([np.nan if row is None or row.value is None else row.value for row in rows])
    sigma = np.array([np.nan if row is None or row.sigma is None else row.sigma for row in rows])
    like = next(row for row in rows if row is not None)
    known = np.isfinite(value)
    if len(np.unique(x[known])) < LEAST_SESSIONS:
        days = len(np.unique(x[known]))
        return _Followed(like, x, value, sigma, None, f"only {days} days have a value, {LEAST_SESSIONS} are needed")
    used = [each for each, here in zip(sessions, known, strict=True) if here]
    gaps = [time_gap(like, used[0].measures, each.measures) for each in used]
    why = next((gap.why for gap in gaps if gap.why), None)
    if why is not None:
        return _Followed(like, x, value, sigma, None, f"it grows with time ({why})")
    if np.ptp(value[known]) == 0.0:
        return _Followed(like, x, value, sigma, None, "it has the same value in all sessions")
    allowed = float(np.abs(value[known]).max()) * np.array([gap.share for gap in gaps])
    return _Followed(like, x, value, sigma, fit_line(x[known], value[known], np.hypot(sigma[known], allowed)), "")


def _row(followed: _Followed, detectable: Detectable) -> TrendRow:
    like, fit = followed.like, followed.fit
    title, meaning = title_of(like), words_of(like.measure).meaning
    cell = Markup('<span class="change {}">{}</span>')
    if fit is None:
        empty = Markup('<span class="unknown">none</span>')
        return TrendRow(title, meaning, empty, empty, cell.format("untested", f"not tested: {followed.why}"))
    known = followed.x[np.isfinite(followed.value)]
    weeks = float(known[-1] - known[0])
    limit = detectable.get((like.measure, like.side, like.unit))
    change = fit.slope * weeks
    intervals = ((fit.slope, fit.half), (change, fit.half * weeks))
    slope, over_all = (value_and_interval(like, value, value - half, value + half) for value, half in intervals)
    return TrendRow(title, meaning, slope, over_all, cell.format(*_verdict(fit, change, limit, like)))


def _verdict(fit: Fit, change: float, limit: float | None, like: Measure) -> tuple[str, str]:
    if abs(fit.slope) <= fit.half:
        return "within", "not shown: the interval holds 0"
    if limit is not None and abs(change) <= limit:
        return "within", f"not shown: below the minimal detectable change (± {value_form(like).write(limit)})"
    return "exceeds", f"{'▲ rising' if change > 0 else '▼ falling'}"


def _chart(name: str, sides: Sequence[_Followed], dates: Sequence[date]) -> StillChart:
    """Return a chart of a measure over all sessions, left and right together, with the lines and their bands."""
    times, unit = unit_of(sides[0].like.unit)
    span = (float(sides[0].x[0]), float(sides[0].x[-1]))
    title = words_of(name).title
    shares = across(sides[0].x, span)
    return StillChart(
        identity=f"trend-{name}",
        title=f"{title} over the dates of the sessions",
        caption=title,
        row=still_row(unit.strip() or title, [_side(each, span, times) for each in sides], span),
        ticks=[(float(share), each.isoformat()) for share, each in _spread(shares, dates)],
        head=("session", "value"),
        rows=[cells for each in sides for cells in _cells(each, dates)],
    )


DRAWN: Final = 25
"""Number of points along a line at which the edges of its band, which are curved, are computed."""


def _side(followed: _Followed, span: tuple[float, float], times: float) -> Drawn:
    known, line_x = np.isfinite(followed.value), np.linspace(*span, DRAWN)
    assert followed.fit is not None
    y, half = followed.fit.band(line_x)
    return Drawn(
        side=followed.like.side or "",
        x=followed.x[known],
        y=times * followed.value[known],
        reach=NORMAL_95 * times * followed.sigma[known],
        line_x=line_x,
        line_y=times * y,
        low=times * (y - half),
        high=times * (y + half),
    )


def _cells(followed: _Followed, dates: Sequence[date]) -> list[tuple[str, Sequence[str]]]:
    side, rows = followed.like.side, list[tuple[str, Sequence[str]]]()
    for day, value, sigma in zip(dates, followed.value.tolist(), followed.sigma.tolist(), strict=True):
        if np.isfinite(value):
            own = replace(followed.like, value=value, sigma=sigma if sigma > 0 else None, why=None)
            rows.append((day.isoformat() + (f", {side}" if side else ""), (value_text(own),)))
    return rows


APART: Final = 0.12
"""Minimum distance between two dates below a chart, as a share of its width: about the width of a written date."""


def _spread(shares: np.ndarray, dates: Sequence[date]) -> list[tuple[float, date]]:
    """Return the dates that can be written below the chart without overlap, each with its place as a share of the
    width.
    """
    kept = list[tuple[float, date]]()
    for share, day in zip(shares.tolist(), dates, strict=True):
        if not kept or share - kept[-1][0] >= APART:
            kept.append((share, day))
    return kept
