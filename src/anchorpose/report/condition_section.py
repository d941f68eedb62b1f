"""Write the section on the conditions of a session's trials: the main measures under each condition, their differences,
and their curves over the trials' parameters (numbers set in each trial, such as an amplitude).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup

from anchorpose.errors import InputError
from anchorpose.recording.events import Trials
from anchorpose.report.comparable import ALIKE, grows_with_time, time_gap
from anchorpose.report.detectable import Detectable
from anchorpose.report.measure_section import (
    COMPARED,
    form_within,
    title_of,
    value_and_error,
    value_and_interval,
    words_of,
)
from anchorpose.report.parameter_curves import parameter_charts
from anchorpose.report.session import Session
from anchorpose.report.still_chart import StillChart
from anchorpose.report.words import listed
from anchorpose.results.condition_effect import BLOCKS, FREE, PAIRS, Effect, effects
from anchorpose.results.permutation import ALPHA
from anchorpose.results.ratings import RATING
from anchorpose.results.records import MEASURES_FILE, Measure, MeasureKey
from anchorpose.results.trial_measures import condition_measures
from anchorpose.results.trial_table import TRIALS_FILE

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


class ConditionRow(NamedTuple):
    """A row for one condition: its name, the number of its trials that have a value, the mean of these values, the
    difference from the reference condition, and the verdict. The verdict states whether the trials demonstrate this
    difference, or why they do not.
    """

    condition: str
    trials: str
    value: Markup
    difference: str
    verdict: str


class ConditionGroup(NamedTuple):
    """A measure with its rows, one per condition."""

    title: str
    meaning: str
    rows: list[ConditionRow]


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
    """Return, for each measure that the section shows, its rows in the table of measures, one per trial. The measures
    are in the order in which the section shows them; a measure that has a value in no trial is left out.
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
    is not used: it was found from whole sessions, which last longer than trials.
    """
    first = rows[0]
    if not grows_with_time(first):
        return effects(rows, trials, detectable.get((first.measure, first.side, first.unit)))
    untested, allowed = _time_limits(rows, session, trials)
    return effects(rows, trials, untested=untested, allowed=allowed)


def _time_limits(rows: Sequence[Measure], session: Session, trials: Trials) -> tuple[dict[str, str], dict[str, float]]:
    """Return two dicts by condition, for a measure that grows with time. The first dict has the reason why the measure
    is not tested: the trials with a value differ in duration, or the mean time over which the measure is taken (such as
    the time with known posture) is unknown, or differs between the condition and the reference condition. The second
    dict has how much the measure may differ from the reference condition only because the trials of one condition last
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


def _row(name: str, rows: Sequence[Measure], mean: Measure, effect: Effect | None) -> ConditionRow:
    own = [row for row in rows if row.condition == name]
    known = sum(row.value is not None for row in own)
    unknown = Markup('<i class="why">no value: {}</i>')
    value = unknown.format(mean.why) if mean.value is None else value_and_error(mean)
    trials = f"{known} of {len(own)}"
    if effect is None:
        return ConditionRow(name, trials, value, "reference", "")
    difference = Markup('<span class="unknown">not known</span>')
    if effect.difference is not None:
        difference = value_and_interval(mean, effect.difference, effect.low, effect.high)
    return ConditionRow(name, trials, value, difference, _verdict(effect, mean))


def _verdict(effect: Effect, like: Measure) -> Markup:
    cell = Markup('<span class="change {}">{}</span>')
    if effect.p is None:
        return cell.format("untested", f"not tested: {effect.why}")
    p = f"p {_p_text(effect.p)}{'' if effect.exact else ', by a sample of all orders'}"
    if effect.shown:
        return cell.format("exceeds", f"a difference: {p}")
    if effect.p >= ALPHA:
        return cell.format("within", f"not shown: {p}")
    if effect.open:
        return cell.format("within", f"not shown: the interval includes 0, {p}")
    form = form_within(like, effect.difference, effect.low, effect.high)
    limit = form.write(float(effect.detectable or np.nan))
    what = "below the minimal detectable change" if effect.repeated else "within the errors of measurement"
    return cell.format("within", f"not shown: {what} (± {limit}), {p}")


def _p_text(p: float) -> str:
    return "below 0.001" if p < 0.001 else f"{p:.3f}" if p < 0.1 else f"{p:.2f}"
