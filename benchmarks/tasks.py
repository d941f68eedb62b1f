"""Tests that clinics name, from depth images: python benchmarks/tasks.py [--movements skeletons.npz] [--keep FOLDER]

Simulated patients do each test before one camera, some slowly or not completely, and some before three cameras with a
therapist. Recordings are tracked with the defaults. Their measures are compared with the same measures of the true
joints: difference, whether it is within 1.96 sigma, and where one of the two refuses and the other does not. Swings are
compared one by one. With --movements, patients also do what people did before a Kinect (UI-PRMD).
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from accuracy import TRUTH_FILE
from measures import pair

from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.records import STEP_LEFT, STEP_RIGHT, Episode, Measure
from anchorpose.results.stand_training.measure import MeasureConfig, measure_session
from anchorpose.results.tables import JointTable
from anchorpose.results.uncertainty import NORMAL_95
from anchorpose.simulate.clinic import Programme
from anchorpose.simulate.config import SimulationConfig, TaskName, single
from anchorpose.simulate.movements import REST_ELBOW, STRAIGHT_ELBOW
from anchorpose.simulate.patient import LONG_AGO_S, Actor, draw_waves, resting_channels, seated_offsets
from anchorpose.simulate.person import Person
from anchorpose.simulate.posture import OUTWARD
from anchorpose.simulate.timeline import Footwork, Movement, Step, ball_ahead_m, final_stance, stand
from anchorpose.simulate.write import simulate_recording
from anchorpose.threads import one_thread

FIRST_SEED: Final = 71_000
CLINICAL: Final = (
    "_range", "five_times_sit_to_stand", "functional_reach", "single_leg_stance", "step_count", "swing_time_mean",
    "step_time_mean", "step_length_mean",
)  # fmt: skip
"""Ends of the names of the measures that are compared."""

SLOW: Final = 1.8
SIDES: Final = ("left", "right")


def rises(rng: np.random.Generator, person: Person, pace: float = 1.0, whole: int = 5) -> Actor:
    """Five rises from a seat and four times down again; those after the first ``whole`` stop at half the way."""
    seated = seated_offsets(person)
    rise_s, stood_s, sat_s = rng.uniform((1.0, 0.5, 0.3), (1.5, 0.9, 0.7)) * (pace, pace, 1.0)
    cycle_s, first_s = 2.0 * rise_s + stood_s + sat_s, rng.uniform(2.5, 3.5)
    movements = [Movement(seated, LONG_AGO_S, 1.0, 1e3, 1.0)]
    for k in range(5):
        up = tuple((channel, -amount * (1.0 if k < whole else 0.5)) for channel, amount in seated)
        lean = (("trunk_flex", rng.uniform(0.3, 0.6)), ("pelvis_flex", 0.25))
        start_s, stays_s = first_s + k * cycle_s, stood_s if k < 4 or whole < 5 else 1e3
        movements += [
            Movement(up, start_s, rise_s, stays_s, rise_s),
            Movement(lean, start_s - 0.3 * rise_s, 0.6 * rise_s, 0.05, 0.7 * rise_s),
            Movement(lean, start_s + rise_s + stays_s, 0.6 * rise_s, 0.05, 0.6 * rise_s),
        ]
    return _actor(rng, person, movements)


def reaches(rng: np.random.Generator, person: Person, pace: float = 1.0, share: float = 1.0) -> Actor:
    """Each arm in turn is raised forward and then goes on forward as the trunk leans, by a share of a usual reach."""
    movements, start_s = [], rng.uniform(1.5, 2.0)
    for side in rng.permutation(SIDES):
        raised = (
            (f"shoulder_flex_{side}", 1.5),
            (f"shoulder_abduct_{side}", -0.2),
            (f"elbow_{side}", STRAIGHT_ELBOW - REST_ELBOW),
        )
        bend, tilt = share * rng.uniform((0.25, 0.1), (0.45, 0.25))
        lean = (
            ("trunk_flex", bend),
            ("pelvis_flex", tilt),
            ("pelvis_forward", -0.3 * tilt),
            (f"shoulder_flex_{side}", bend + tilt),
        )
        movements += [
            Movement(raised, start_s, 1.0, 1.5 + pace * 3.0, 1.0),
            Movement(lean, start_s + 2.0, 1.3 * pace, 0.5 * pace, 1.0 * pace),
        ]
        start_s += 4.0 + 3.0 * pace
    return _actor(rng, person, movements)


def stances(rng: np.random.Generator, person: Person, seconds: float = 8.0) -> Actor:
    """Each foot in turn is lifted beside the other leg for about so long, the weight over the standing foot."""
    footwork, movements, start_s = _feet(rng, person), [], rng.uniform(1.5, 2.5)
    places, yaws = final_stance(footwork)
    steps = []
    for side in rng.permutation(2):
        lasts_s = seconds * rng.uniform(0.75, 1.25)
        steps.append(Step(int(side), start_s, lasts_s, tuple(places[side]), float(yaws[side])))
        shift = (("pelvis_right", -OUTWARD[side] * rng.uniform(0.05, 0.08)),)
        movements.append(Movement(shift, start_s - 0.5, 0.6, lasts_s - 0.2, 0.6))
        start_s += lasts_s + 1.5
    return _actor(rng, person, movements, replace(footwork, steps=tuple(steps)))


def _feet(rng: np.random.Generator, person: Person) -> Footwork:
    return stand(np.array([ball_ahead_m(person.body), 0.0]), 0.0, rng.uniform(0.20, 0.30))


def _actor(
    rng: np.random.Generator, person: Person, movements: list[Movement], footwork: Footwork | None = None
) -> Actor:
    """A person who does that and sways."""
    feet = _feet(rng, person) if footwork is None else footwork
    return Actor(person, resting_channels(person, in_frame=False), movements, feet, draw_waves(rng))


@dataclass(frozen=True, slots=True)
class Recording:
    """What is simulated; programme None: the configuration says what the patient does."""

    name: str
    config: SimulationConfig
    programme: Programme | None = None


MIXED: Final = ("squat", "reach", "arm-raise", "trunk", "head")
BESIDE: Final[TaskName] = "left knee from the front"
BEHIND: Final[TaskName] = "trunk from behind"


def recordings(first_seed: int, movements: Path | None) -> list[Recording]:
    """Every recording has a seed of its own: another body, other clothes, other amounts and durations."""
    seeds = iter(range(first_seed, first_seed + 1000))

    def one(name: str, seconds: float, programme: Programme | None = None, **changes: object) -> Recording:
        config = replace(single(next(seeds), seconds), stool=True, **changes)  # type: ignore[arg-type]
        return Recording(f"{name}-{config.seed}", config, programme)

    def three(name: str, seconds: float, task: TaskName, programme: Programme | None = None, **changes: object):
        return one(f"three-{name}", seconds, programme, cameras=3, therapists=1, therapist_tasks=(task,), **changes)

    found = [
        one("rises", 26.0, rises),
        one("rises-slow", 38.0, partial(rises, pace=SLOW)),
        one("rises-half", 26.0, partial(rises, whole=3)),
        one("reach", 18.0, reaches),
        one("reach-slow", 22.0, partial(reaches, pace=SLOW)),
        one("reach-small", 18.0, partial(reaches, share=0.1)),
        one("stance", 26.0, stances),
        one("stance-short", 10.0, partial(stances, seconds=1.8)),
        one("steps", 20.0, motions=("steps",)),
        one("steps-slow", 20.0, motions=("steps",), speed="slow"),
        one("mixed", 20.0, motions=MIXED),
        one("mixed-slow", 20.0, motions=MIXED, speed="slow"),
        three("rises", 26.0, BESIDE, rises),
        three("reach", 18.0, BEHIND, reaches),
        three("stance", 26.0, BEHIND, stances),
        three("steps", 20.0, BEHIND, motions=("steps",)),
    ]
    captured = () if movements is None else ("sit-to-stand", "hurdle-step", "leg-raise", "deep-squat")
    return found + [one(name, 24.0, movement_file=movements, movement=name) for name in captured]


def tracked(recording: Recording, folder: Path) -> tuple[JointTable, JointTable]:
    """Tracked and true joints; neither simulated nor tracked again where the folder holds them."""
    simulated, results = folder / recording.name, folder / recording.name / "results"
    if not simulated.exists():
        simulate_recording(simulated, recording.config, programme=recording.programme)
    if not (results / "run.json").exists():
        results.mkdir(exist_ok=True)
        with one_thread():
            track_recording(simulated / "recording", results, TrackConfig(), lambda done, total: None)
    return pair(results, simulated / TRUTH_FILE)


@dataclass(frozen=True, slots=True)
class Compared:
    """One measure of the tracked joints and the same of the true ones."""

    found: Measure
    true: Measure

    @property
    def difference(self) -> float | None:
        """Measured less true; None where one of the two refuses."""
        if self.found.value is None or self.true.value is None:
            return None
        return self.found.value - self.true.value

    @property
    def verdict(self) -> str:
        """The difference is ``within`` 1.96 sigma (of counts: none) or ``outside``; or one or neither has a value."""
        if self.difference is not None:
            return "within" if abs(self.difference) <= NORMAL_95 * (self.found.sigma or 0.0) + 1e-9 else "outside"
        if self.found.value is None:
            return "neither" if self.true.value is None else "only true"
        return "only measured"


@dataclass(frozen=True, slots=True)
class Swings:
    """late_s: (foot off, foot strike) of each swing that both have, tracked less true; missed; extra."""

    late_s: list[tuple[float, float]]
    missed: int
    extra: int


def compare(found: JointTable, true: JointTable) -> tuple[list[Compared], Swings]:
    """The clinical measures, and the swings."""
    (ours, rows), (theirs, exact) = (
        measure_session(joints, joint_angles(joints), None, MeasureConfig()) for joints in (found, true)
    )
    pairs = [Compared(row, known) for row, known in zip(rows, exact, strict=True) if row.measure.endswith(CLINICAL)]
    return pairs, compare_swings(ours.episodes, theirs.episodes)


def compare_swings(found: Sequence[Episode], true: Sequence[Episode]) -> Swings:
    """Each true swing with the first tracked one of the same foot that overlaps it and has not been taken."""
    late_s, missed = list[tuple[float, float]](), 0
    left = [one for one in found if one.kind in (STEP_LEFT, STEP_RIGHT)]
    for swing in (one for one in true if one.kind in (STEP_LEFT, STEP_RIGHT)):
        same = [
            one for one in left if one.kind == swing.kind and one.start_s < swing.end_s and swing.start_s < one.end_s
        ]
        if same:
            left.remove(same[0])
            late_s.append((same[0].start_s - swing.start_s, same[0].end_s - swing.end_s))
        else:
            missed += 1
    return Swings(late_s, missed, len(left))


def row_lines(recording: str, pairs: Sequence[Compared]) -> list[str]:
    """Markdown, a row per measure."""
    return [
        f"| {recording} | {each.found.measure} {each.found.side or ''} | {_number(each.true.value)} "
        f"| {_number(each.found.value)} | {_number(each.difference)} | {_number(each.found.sigma)} "
        f"| {each.verdict} | {each.found.why or each.true.why or ''} |"
        for each in pairs
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def summary_lines(pairs: Sequence[Compared]) -> list[str]:
    """Markdown, a row per measure over all recordings, left and right together."""
    groups = defaultdict[str, list[Compared]](list)
    for each in pairs:
        groups[f"{each.found.measure}, {each.found.unit}"].append(each)
    counted = ("within", "outside", "only true", "only measured", "neither")
    lines = [
        f"| measure | {' | '.join(counted)} | difference: median, largest | sigma, median |",
        "|---|" + "--:|" * (len(counted) + 2),
    ]
    for name, rows in groups.items():
        verdicts = [row.verdict for row in rows]
        off = [abs(row.difference) for row in rows if row.difference is not None]
        sigma = [row.found.sigma for row in rows if row.difference is not None and row.found.sigma is not None]
        lines.append(
            f"| {name} | {' | '.join(str(verdicts.count(verdict)) for verdict in counted)} "
            f"| {_number(_median(off))}, {_number(max(off, default=None))} | {_number(_median(sigma))} |"
        )
    return lines


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def swing_line(swings: Sequence[Swings]) -> str:
    """How many swings were found, and how late their ends are."""
    late_s = np.array([each for one in swings for each in one.late_s]).reshape(-1, 2)
    missed, extra = sum(one.missed for one in swings), sum(one.extra for one in swings)
    text = f"swings: {len(late_s)} found, {missed} missed, {extra} extra"
    if len(late_s):
        (off, strike), (off_sd, strike_sd) = late_s.mean(axis=0), late_s.std(axis=0)
        text += f"; foot off {off:+.3f} s late (SD {off_sd:.3f}), foot strike {strike:+.3f} (SD {strike_sd:.3f})"
    return text


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--movements", type=Path, help="the Kinect skeletons of UI-PRMD as .npz")
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--only", nargs="+", default=[""], help="recordings whose names contain one of these")
    parser.add_argument("--keep", type=Path, help="folder for recordings and results; those there are used again")
    options = parser.parse_args()
    pairs, swings = list[Compared](), list[Swings]()
    print("| recording | measure | true | measured | difference | sigma | verdict | why not |")
    print("|---|---|--:|--:|--:|--:|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        for recording in recordings(options.first_seed, options.movements):
            if any(part in recording.name for part in options.only):
                found, seen = compare(*tracked(recording, options.keep or Path(temporary)))
                pairs, swings = pairs + found, [*swings, seen]
                print("\n".join(row_lines(recording.name, found)), flush=True)
                print(f"{recording.name}: {swing_line([seen])}", file=sys.stderr, flush=True)
    print("\n".join(["", *summary_lines(pairs), "", swing_line(swings)]))


if __name__ == "__main__":
    main()
