"""Write the section on the conditions of a session's trials: the main measures under each condition, their differences,
and their curves over the trials' parameters (numbers set in each trial, such as an amplitude).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup
from scipy.special import stdtrit

from anchorpose.errors import InputError
from anchorpose.recording.events import TrialColumn, Trials
from anchorpose.report.comparable import ALIKE, Detectable, grows_with_time, time_gap
from anchorpose.report.measure_section import (
    COMPARED,
    form_within,
    title_of,
    unit_of,
    value_and_error,
    value_and_interval,
    words_of,
)
from anchorpose.report.session import Session
from anchorpose.report.still_chart import Drawn, StillChart, across, still_row
from anchorpose.report.words import decimals_for, listed, number
from anchorpose.results.condition_effect import BLOCKS, FREE, PAIRS, Effect, effects
from anchorpose.results.permutation import ALPHA
from anchorpose.results.ratings import RATING
from anchorpose.results.records import MEASURES_FILE, Measure, MeasureKey
from anchorpose.results.trial_measures import condition_measures
from anchorpose.results.trial_table import TRIALS_FILE
from anchorpose.results.uncertainty import CONFIDENCE, NORMAL_95, systematic_share

CURVES: Final = (
    "upright_share",
    "knee_flexion_upright_mean",
    "hip_flexion_upright_mean",
    "sway_velocity",
    "assistance_share_upright",
    RATING,
)
"""Measures that are drawn as curves over the trials' parameters if the user chose no measures."""

DESIGNS: Final = {
    PAIRS: "Neighbouring trials of two conditions are compared in pairs, since they alternate.",
    BLOCKS: "Trials are compared within the blocks that the events file names.",
    FREE: "All trials of two conditions are compared with each other.",
}


Row = tuple[str, list[str | Markup]]
"""A condition's name, and four cells: the number of its trials that have a value, the mean of these values, the
difference from the reference condition, and the verdict. The verdict states whether the trials demonstrate this
difference, or why they do not.
"""


class ConditionGroup(NamedTuple):
    """A measure with its rows, one per condition."""

    title: str
    meaning: str
    rows: list[Row]


class ConditionSection(NamedTuple):
    """The content of the section on conditions. about: sentences on the trials; designs: sentences on how trials are
    compared; tested: how many differences are tested; groups: one per measure; charts: curves over the trials'
    parameters.
    """

    about: list[str]
    designs: list[str]
    tested: int
    groups: list[ConditionGroup]
    charts: list[StillChart]


def with_reference(session: Session, trials: Trials, reference: str) -> Session:
    """Return the session with ``reference`` as the condition with which all other conditions are compared; raises
    InputError if no trial has this condition.
    """
    if reference not in trials.conditions:
        named = ", ".join(f"'{name}'" for name in trials.conditions)
        raise InputError(session.folder / TRIALS_FILE, f"has no condition '{reference[:40]}'", f"choose from {named}")
    return replace(session, trials=replace(trials, reference=reference))


def condition_section(
    session: Session, detectable: Detectable | None = None, chosen: Sequence[str] = ()
) -> ConditionSection | None:
    """Return the section on the conditions; None if the session has no trials.

    detectable: minimal detectable changes from repeated sessions. chosen: names of measures; empty for the main
    measures. Raises InputError for a measure that the session does not have.
    """
    trials = session.trials
    if trials is None:
        return None
    by_trial = _by_key(session, chosen)
    found = {key: _effects(rows, session, trials, detectable or {}) for key, rows in by_trial.items()}
    means = {(row.condition, row.key): row for row in session.trial_measures if row.trial is None}
    groups = [_group(rows, found[key], trials, means) for key, rows in by_trial.items()]
    used = dict.fromkeys(effect.design for each in found.values() for effect in each)
    drawn = chosen or CURVES
    return ConditionSection(
        about=_about(trials),
        designs=[DESIGNS[design] for design in used],
        tested=sum(effect.p is not None for each in found.values() for effect in each),
        groups=groups,
        charts=parameter_charts(trials, {k: rows for k, rows in by_trial.items() if k[0] in drawn}),
    )


def _by_key(session: Session, chosen: Sequence[str]) -> dict[MeasureKey, list[Measure]]:
    """Return, for each measure that is shown, its table rows for all trials, in the order in which measures are shown;
    a measure without any value is left out.
    """
    found: dict[MeasureKey, list[Measure]] = {}
    for name in chosen or COMPARED:
        rows = [row for row in session.trial_measures if row.measure == name and row.trial is not None]
        if not rows and chosen:
            problem = f"has no measure '{name}' of trials"
            raise InputError(session.folder / MEASURES_FILE, problem, "docs/measures.md names all of them")
        for row in rows:
            if row.part is None and row.person is None:
                found.setdefault(row.key, []).append(row)
    return {key: rows for key, rows in found.items() if any(row.value is not None for row in rows)}


def _effects(rows: Sequence[Measure], session: Session, trials: Trials, detectable: Detectable) -> list[Effect]:
    """Return the effects of the conditions on a measure. If the measure grows with time, the minimal detectable change
    of whole sessions does not apply to trials.
    """
    first = rows[0]
    if not grows_with_time(first):
        return effects(rows, trials, detectable.get((first.measure, first.side, first.unit)))
    untested, allowed = _time_limits(rows, session, trials)
    return effects(rows, trials, untested=untested, allowed=allowed)


def _time_limits(rows: Sequence[Measure], session: Session, trials: Trials) -> tuple[dict[str, str], dict[str, float]]:
    """Return two dicts by condition, for a measure that grows with time: the reason why the measure is not tested (its
    trials with a value differ in duration, or its mean time with known posture differs from that of the reference
    condition); and how much it may differ from the reference condition only because the trials of one condition last
    longer.
    """
    known = {row.trial for row in rows if row.value is not None}
    means = condition_measures(trials, [row for row in session.trial_measures if row.trial in known])
    measures_of = {name: [mean for mean in means if mean.condition == name] for name in trials.conditions}
    reference = measures_of[trials.conditions[0]]
    gaps = {name: time_gap(rows[0], reference, measures) for name, measures in measures_of.items()}
    largest = max((abs(row.value) for row in rows if row.value is not None), default=0.0)
    allowed = {name: largest * gap.share for name, gap in gaps.items()}
    lasting = [trial.duration_s for trial in trials.rows if trial.number in known]
    if lasting and max(lasting) - min(lasting) > ALIKE * max(lasting):
        why = f"it grows with time, and trials last {min(lasting):g} to {max(lasting):g} s"
        return dict.fromkeys(trials.conditions, why), allowed
    return {name: f"it grows with time ({gap.why})" for name, gap in gaps.items() if gap.why}, allowed


def _about(trials: Trials) -> list[str]:
    counts = [f"{sum(trial.condition == name for trial in trials.rows)} of {name}" for name in trials.conditions]
    sentences = [f"{len(trials.rows)} trials: {listed(counts)}."]
    if len(trials.conditions) == 1:
        sentences.append("With a single condition there is nothing to compare.")
    else:
        how = "stands first in the events file" if trials.reference is None else "was chosen as the reference"
        sentences.append(f"Differences are to {trials.conditions[0]}, which {how}.")
    return sentences


def _group(
    rows: Sequence[Measure],
    found: Sequence[Effect],
    trials: Trials,
    means: dict[tuple[str | None, MeasureKey], Measure],
) -> ConditionGroup:
    effect_of = {effect.condition: effect for effect in found}
    named = [_row(name, rows, means[name, rows[0].key], effect_of.get(name)) for name in trials.conditions]
    return ConditionGroup(title_of(rows[0]), words_of(rows[0].measure).meaning, named)


def _row(name: str, rows: Sequence[Measure], mean: Measure, effect: Effect | None) -> Row:
    own = [row for row in rows if row.condition == name]
    known = sum(row.value is not None for row in own)
    unknown = Markup('<i class="why">no value: {}</i>')
    value = unknown.format(mean.why) if mean.value is None else value_and_error(mean)
    trials = f"{known} of {len(own)}"
    if effect is None:
        return name, [trials, value, "reference", ""]
    difference = Markup('<span class="unknown">not known</span>')
    if effect.difference is not None:
        difference = value_and_interval(mean, effect.difference, effect.low, effect.high)
    return name, [trials, value, difference, _verdict(effect, mean)]


def _verdict(effect: Effect, like: Measure) -> Markup:
    cell = Markup('<span class="change {}">{}</span>')
    if effect.p is None:
        return cell.format("untested", f"not tested: {effect.why}")
    p = f"p {_p_text(effect.p)}{'' if effect.exact else ', by a sample of all orders'}"
    if effect.shown:
        return cell.format("exceeds", f"a difference: {p}")
    if effect.p >= ALPHA:
        return cell.format("within", f"not shown: {p}")
    form = form_within(like, effect.difference, effect.low, effect.high)
    limit = form.write(float(effect.detectable or np.nan))
    what = "below the minimal detectable change" if effect.repeated else "within the errors of measurement"
    return cell.format("within", f"not shown: {what} (± {limit}), {p}")


def _p_text(p: float) -> str:
    return "below 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"


LEAST_LEVELS: Final = 2
MOST_TICKS: Final = 9


class Level(NamedTuple):
    """The trials with the same value of a parameter: this value, their number, the measure's mean over them, and half
    the width of the mean's 95 % interval (NaN if unknown).
    """

    at: float
    trials: int
    mean: float
    half: float


def levels_of(at: np.ndarray, value: np.ndarray, sigma: np.ndarray, share: float) -> list[Level]:
    """Return, for each distinct value of the parameter in ascending order, the mean of the trials with this value.

    at, value, sigma (n,): the parameter, the measure's value and its sigma in each trial, NaN where unknown. share: the
    systematic share of the sigmas' variance. The mean's interval covers the scatter of the trials or, if this is
    larger, their random errors. For a single trial, it covers only the random error. The systematic error is left out,
    since it shifts all levels alike.
    """
    return [
        _level(float(place), value[at == place], np.sqrt(1.0 - share) * sigma[at == place]) for place in np.unique(at)
    ]


def _level(at: float, value: np.ndarray, random_sigma: np.ndarray) -> Level:
    count = len(value)
    random = float(np.sum(random_sigma**2)) / count**2
    if count == 1:
        return Level(at, 1, float(value[0]), NORMAL_95 * float(np.sqrt(random)))
    variance = float(np.fmax(value.var(ddof=1) / count, random))
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
    """Return a measure's chart over a column's numbers; None unless a side has values at two different numbers."""
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
    interval = f"{low} to {high}{unit}" if known else "no error is stated"
    name = f"{level.at:g}" + (f", {side}" if side else "")
    return name, (str(level.trials), f"{mean}{unit}", interval)


def _ticks(levels: np.ndarray, span: tuple[float, float]) -> list[tuple[float, str]]:
    """Return the ticks: every level or, if there are many, the first, the last and some between them."""
    if len(levels) > MOST_TICKS:
        levels = levels[np.unique(np.linspace(0, len(levels) - 1, MOST_TICKS).astype(int))]
    return [(float(share), f"{level:g}") for share, level in zip(across(levels, span), levels.tolist(), strict=True)]
