"""Test measures of sessions of trials: python benchmarks/sessions.py [--use USE] [--sessions N] [--sigma-mm S]

Many sessions (``anchorpose simulate --preset stimulation``) are simulated without images. Their contacts are the true
ones; their joints are the true joints with errors like those of tracking (``event_builder.tracked``: 70 % of the
variance is constant, the rest changes within seconds, and 1 mm from frame to frame). Prints how often a change of the
knees is shown if stimulation changes them by 5 degrees or not at all, how many durations without help (times of
independence) lie within 1.96 sigma, and how many events are found. Sessions with images are measured by ``python
benchmarks/run.py sessions``. Takes some seconds per session.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "builders"))

from event_builder import tracked
from intervals import wilson
from session_suite import clonus_scores
from suite import Use

from anchorpose.recording.events import Trial, TrialColumn, Trials
from anchorpose.results.condition_effect import Effect, effects
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.measuring import MeasureConfig, measure_session
from anchorpose.results.records import EVENT_KINDS, Contact, Measure
from anchorpose.results.session_scores import TrueEvent, score_events, score_times, true_joints
from anchorpose.results.stand_training.extension import extension_measures
from anchorpose.results.stand_training.independence import independence_measures
from anchorpose.results.stand_training.stance import Session
from anchorpose.results.stand_training.tremor import tremor_measures
from anchorpose.results.tables import JointTable
from anchorpose.results.trial_measures import measures_by_trial
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.sessions.patient import SessionPatient
from anchorpose.simulate.sessions.plan import PlannedTrial, SessionConfig
from anchorpose.simulate.sessions.preset import stimulation
from anchorpose.simulate.sessions.truth import true_events

FIRST_SEED: Final[dict[Use, int]] = {"tuning": 81_100, "held-out": 91_100}
HZ: Final = 20.0  # lowest frame rate at which tremor is looked for
MEANS_HZ: Final = 5.0  # frame rate if only means over trials are needed
PART: Final = 300  # number of frames that are posed at once
KNEE: Final = "knee_flexion_upright_mean"
EFFECTS_DEG: Final = (5.0, 0.0)
INCIDENTS: Final = 3  # of each kind in a session with events; each happens in a trial of its own


class Simulated(NamedTuple):
    """A session. clinic: as it was drawn; found, exact: the patient's joints with errors and without errors."""

    clinic: Clinic
    found: JointTable
    exact: JointTable


def simulated(seed: int, session: SessionConfig, sigma_m: float, hz: float) -> Simulated:
    """Simulate a session without rendering images."""
    clinic = draw_clinic(stimulation(seed, session, hz))
    times_s, body = np.arange(clinic.config.frames) / hz, clinic.patient.person.body
    parts = [clinic.patient.bones(times_s[first : first + PART]) for first in range(0, len(times_s), PART)]
    position_m = np.array([body.joints(bones) for part in parts for bones in part])
    found = tracked(position_m, sigma_m, seed, hz)
    return Simulated(clinic, found, true_joints(found, position_m))


def trials_of(plan: Sequence[PlannedTrial]) -> Trials:
    """Return the trials in the form that events.tsv has."""
    columns = (TrialColumn("amplitude", "V"), TrialColumn("block", None))
    rows = [
        Trial(k, t.condition, t.onset_s, t.duration_s, t.onset_s, (t.amplitude_v, str(t.block)))
        for k, t in enumerate(plan, 1)
    ]
    return Trials(columns, tuple(rows))


def contacts_of(plan: Sequence[PlannedTrial], hz: float) -> tuple[Contact, ...]:
    """Return the contacts of each trial, as if always seen: a helper at knees, thighs and pelvis; hands on rails."""
    found = list[Contact]()
    for trial in plan:
        if trial.helped:
            parts = ("pelvis", *(f"{part}_{side}" for part in ("knee", "thigh") for side in ("left", "right")))
            found += [_contact(part, trial, hz, person="person") for part in parts]
        if not trial.hands_off:
            found += [_contact(f"hand_{s}", trial, hz, person=None, with_=f"rail-{s}") for s in ("left", "right")]
    return tuple(found)


def _contact(part: str, trial: PlannedTrial, hz: float, **who: Any) -> Contact:
    first, last = round(trial.onset_s * hz), round(trial.end_s * hz) - 1
    ends = {"first_frame": first, "last_frame": last, "start_s": first / hz, "end_s": last / hz}
    return Contact(part=part, **who, **ends, seen_share=1.0, area_cm2=0.0, gap_mm=0.0)


def measures_of(joints: JointTable, clinic: Clinic) -> tuple[Session, list[Measure]]:
    """Return the session, and the measures of extension, independence and tremor of the whole session and of each
    trial.
    """
    config, contacts = MeasureConfig(), contacts_of(clinic.plan, clinic.config.fps)
    session, _ = measure_session(joints, joint_angles(joints), contacts, config, equipment=("rail-left", "rail-right"))

    def measure(part: Session, rows: slice) -> list[Measure]:
        return [
            *extension_measures(part, config.extension),
            *independence_measures(part),
            *tremor_measures(part, config.tremor),
        ]

    whole = measure(session, slice(0, len(joints.frame)))
    by_trial = measures_by_trial(session, trials_of(clinic.plan), whole, config.sway.settle_s, measure)
    return session, [*whole, *by_trial]


def knee_effects(measures: Sequence[Measure], clinic: Clinic) -> list[Effect]:
    """Return the effect of the stimulation on the mean flexion of the left knee, and of the right knee."""
    trials, found = trials_of(clinic.plan), list[Effect]()
    for side in ("left", "right"):
        rows = [row for row in measures if (row.measure, row.side) == (KNEE, side) and row.trial is not None]
        found += effects(rows, trials)
    return found


def share(hits: int, total: int) -> str:
    """Describe ``hits`` of ``total`` in words, with the percentage and its 95 % interval."""
    low, high = wilson(hits, total)
    return f"{hits} of {total} ({100 * hits / total:.1f} %, {100 * low:.1f} to {100 * high:.1f})"


def conditions(seeds: range, sigma_m: float) -> None:
    """Print how often a change of a knee is shown, for stimulation that changes the knees and that does not."""
    for effect_deg in EFFECTS_DEG:
        shown, true_deg, found_deg = list[bool](), list[float](), list[float]()
        for seed in seeds:
            one = simulated(seed, SessionConfig(effect_deg=effect_deg, incidents=0), sigma_m, MEANS_HZ)
            pairs = zip(*(knee_effects(measures_of(j, one.clinic)[1], one.clinic) for j in one[1:]), strict=True)
            for found, exact in pairs:
                shown.append(found.shown)
                true_deg.append(exact.difference or 0.0)
                found_deg.append(found.difference or 0.0)
        off_deg = float(np.std(np.subtract(found_deg, true_deg)))
        print(
            f"knees held {effect_deg:g} degrees straighter, mean of a trial {np.mean(true_deg):+.1f} (SD "
            f"{np.std(true_deg):.1f}), error {off_deg:.2f}: a change of {share(sum(shown), len(shown))} knees",
            flush=True,
        )


def events(seeds: range, sigma_m: float) -> None:
    """Print how many events are found, and how many durations without help are within 1.96 sigma of the truth."""
    counts, late_s, seconds = dict.fromkeys(EVENT_KINDS, (0, 0, 0, 0)), list[float](), 0.0
    compared, within, clonus = 0, 0, dict.fromkeys(("true", "found", "false"), 0.0)
    for seed in seeds:
        one = simulated(seed, SessionConfig(incidents=INCIDENTS), sigma_m, HZ)
        (session, found), (_, exact) = (measures_of(joints, one.clinic) for joints in one[1:])
        for kind, score in score_events(session, known_events(one.clinic)):
            counts[kind] = tuple(np.add(counts[kind], (score.true, score.found, score.in_time, score.false)).tolist())
            late_s += [] if score.late_s is None else [score.late_s]
        times, trials = score_times(found, exact), trials_of(one.clinic.plan)
        for name, count in clonus_scores(found, known_events(one.clinic), trials).items():
            clonus[name] += count
        compared, within, seconds = compared + times.compared, within + times.within, seconds + session.seconds.sum()
    for kind, (true, found_, in_time, false) in counts.items():
        print(f"{kind}: found {share(found_, true)}, with the onset within 0.1 s {in_time}; {false} false")
    print(f"clonus: found {share(int(clonus['found']), int(clonus['true']))}; {clonus['false']:.0f} other knees shake")
    print(f"onset late by {np.mean(late_s):+.3f} s, false in ten minutes {false_rate(counts, seconds):.2f}")
    print(f"times of independence within 1.96 sigma: {share(within, compared)}")


def known_events(clinic: Clinic) -> tuple[TrueEvent, ...]:
    """Return the true events in the form that truth.npz has."""
    assert isinstance(clinic.patient, SessionPatient)
    return tuple(TrueEvent(e.kind, e.start_s, e.end_s, e.depth) for e in true_events(clinic.patient))


def false_rate(counts: dict[str, tuple[int, ...]], seconds: float) -> float:
    """Return the number of false events of all kinds in ten minutes."""
    return 600.0 * sum(each[-1] for each in counts.values()) / seconds


def main() -> None:
    """Print how well conditions, events and durations without help are measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--use", choices=get_args(Use), default="tuning")
    parser.add_argument("--sessions", type=int, default=100)
    parser.add_argument("--sigma-mm", type=float, default=10.0, help="of the errors of joints, per axis")
    chosen = parser.parse_args()
    first, sigma_m = FIRST_SEED[chosen.use], 1e-3 * chosen.sigma_mm
    seeds = range(first, first + chosen.sessions)
    conditions(seeds, sigma_m)
    events(seeds, sigma_m)


if __name__ == "__main__":
    main()
