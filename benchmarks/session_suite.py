"""Suite of rendered sessions of trials with and without stimulation, and the scores of their tracked results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Final

from measure_scores import joint_pair
from recordings import Ready, Simulated
from suite import Case, Scores, Use

from anchorpose.recording.events import Trials
from anchorpose.results.condition_effect import effects
from anchorpose.results.evaluate import evaluate
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import MEASURES_FILE, Measure, read_trial_measures
from anchorpose.results.session_scores import SessionEvaluation, TrueEvent, read_true_events
from anchorpose.results.trial_table import TRIALS_FILE, read_trial_table
from anchorpose.simulate.sessions.plan import SessionConfig
from anchorpose.simulate.sessions.preset import stimulation

SESSION_SEED: Final[dict[Use, int]] = {"tuning": 81_000, "held-out": 91_000}
SHORT: Final = SessionConfig(trial_s=10.0)
CAMERAS: Final = (1, 3)
HZ: Final = 20.0  # lowest frame rate at which tremor is looked for; events need 10
KNEE: Final = "knee_flexion_upright_mean"
SHAKES: Final = "tremor_knee_time"


def sessions(use: Use, quick: bool) -> Iterator[Case]:
    """Yield a session of twelve short trials in front of one camera, and another session in front of three."""
    for number, cameras in enumerate(CAMERAS[: 1 if quick else None]):
        session = replace(SHORT, trials=4) if quick else SHORT
        config = replace(stimulation(SESSION_SEED[use] + number, session, HZ), cameras=cameras)
        title = f"{cameras} camera{'s' * (cameras > 1)}"
        yield Case(title, Simulated(f"session-{config.seed}-{config.seconds:g}", config), against_session)


def against_session(ready: Ready, results: Path) -> Iterator[tuple[str, Scores]]:
    """Yield the scores of each kind of event, of the durations without help, and of the effect of stimulation on the
    knees.
    """
    assert ready.truth is not None
    found = evaluate(results, ready.truth).session
    assert found is not None
    yield from event_scores(found)
    rows = list(read_trial_measures(results / MEASURES_FILE))
    trials = read_trial_table(results / TRIALS_FILE)
    yield "clonus", clonus_scores(rows, read_true_events(ready.truth) or (), trials)
    if found.times is not None:
        compared, within = found.times.compared, found.times.within
        yield (
            "times of independence",
            {"times": compared, "in_band": within / compared, "one_refuses": found.times.refused},
        )
    exact = joint_pair(results, ready.truth)[1]
    true = measure_session(exact, joint_angles(exact), None, MeasureConfig(), trials)[1]
    for side in ("left", "right"):
        ours, theirs = (effects(_of_knee(each, side), trials)[0] for each in (rows, true))
        known = ours.difference is not None and theirs.difference is not None
        error = float(ours.difference - theirs.difference) if known else float("nan")  # type: ignore[operator]
        p = float("nan") if ours.p is None else ours.p
        yield (
            f"knee, {side}",
            {"true_deg": theirs.difference or 0.0, "error_deg": error, "p": p, "shown": float(ours.shown)},
        )


def event_scores(found: SessionEvaluation) -> Iterator[tuple[str, Scores]]:
    """Yield the counts of each kind of event."""
    for kind, score in found.events:
        late_s = float("nan") if score.late_s is None else score.late_s
        counts = {"true": score.true, "found": score.found, "in_time": score.in_time, "false": score.false}
        yield kind, {name: float(count) for name, count in counts.items()} | {"late_s": late_s}


def clonus_scores(rows: Iterable[Measure], true_events: Sequence[TrueEvent], trials: Trials) -> Scores:
    """Count trials in which a knee shakes. true: knees with true clonus; found: those that the results also report as
    shaking; false: knees reported as shaking without clonus on that side. Knees that were not seen for long enough
    count as not shaking.
    """
    true = {
        (trial.number, event.kind.removeprefix("clonus_"))
        for trial, event in product(trials.rows, true_events)
        if event.kind.startswith("clonus") and trial.start_s <= event.start_s < trial.end_s
    }
    told = {(row.trial, row.side) for row in rows if row.measure == SHAKES and row.trial is not None and row.value}
    return {"true": float(len(true)), "found": float(len(true & told)), "false": float(len(told - true))}


def _of_knee(rows: Iterable[Measure], side: str) -> list[Measure]:
    return [row for row in rows if (row.measure, row.side) == (KNEE, side) and row.trial is not None]
