"""Does the evidence win over a wrong prediction? python benchmarks/kidnapped_limbs.py --trials 200 --out kidnapped.json

In the middle of simulated recordings the tracker's pose is spoilt (``spoilt_poses.Kind``): an arm is put into the
trunk, the arms are exchanged, a leg is put onto the other, the body is turned round. The tracker is as sure of it as it
was of the right pose, its past and what it has looked at already are spoilt alike (``kidnapping.kidnap``), and it goes
on. It is right again when, 0.5 s later at the latest and until 1 s, every joint of the limbs concerned is within 100 mm
of the truth, or within 50 mm more than the error of the tracker that was left alone: by its pose, also of joints that
it calls lost. Only frames count in which one camera sees most of each of these limbs for that second.

Recordings are simulated once and kept in --recordings. Each is tracked forward and backward in time.
The table has the share of trials that were right again with its 95 % interval (Wilson), and the median time until they
were. --out writes all trials, so that failures can be looked at.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, product
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from cached_recordings import KEPT, cached_recording
from hard_scenes import hard_scenes
from intervals import wilson
from kidnapping import Judge, Limits, Outcome, Past, kidnap
from spoilt_poses import Kind, Spoil, spoilt
from ways import Undisturbed, Way, undisturbed, ways_through

from anchorpose.results.evaluate_confidence import LIMBS_JUDGED, in_plain_view
from anchorpose.results.truth import Truth, read_truth
from anchorpose.simulate import config as presets
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.patient import PatientTracker

Choice = TypeVar("Choice")
LIMITS: Final = Limits()
SPOILT_M: Final = 0.15  # off the truth by less, a limb is not spoilt: an arm that lay on the belly anyhow
HEIGHTS: Final = (0.2, 0.75)  # of a hand in the trunk: from the belly to the chest
LEAST_LIMBS: Final = 3  # of a body that was turned round, in plain view, the trunk among them


def _arms(seed: int, seconds: float) -> presets.SimulationConfig:
    return replace(presets.single(seed, seconds), motions=("reach", "arm-raise", "rails"))


SCENES: Final[dict[str, Callable[[int, float], presets.SimulationConfig]]] = {
    "single": presets.single,
    "single-arms": _arms,
    "clinic": presets.clinic,
}


@dataclass(frozen=True, slots=True)
class Trial:
    """One spoilt frame and what became of it. name: scene and seed of the recording; seconds: of processor time."""

    name: tuple[str, int]
    direction: str
    frame: int
    spoil: Spoil
    outcome: Outcome
    seconds: float


def draw_spoil(kind: Kind, seed: int, frame: int) -> Spoil:
    """Side and height, the same for the same frame."""
    rng = np.random.default_rng([seed, frame, list(Kind).index(kind)])
    return Spoil(kind, ("Left", "Right")[rng.integers(2)], float(rng.uniform(*HEIGHTS)))


def judged_joints(spoil: Spoil, visible: Mapping[str, bool]) -> np.ndarray | None:
    """(k,) the joints that count; None where too little is in plain view. visible: each limb, all the time."""
    limbs = [limb for limb in spoil.limbs if visible[limb]]
    enough = len(limbs) == len(spoil.limbs)
    if spoil.kind is Kind.TURNED_ROUND:
        enough = "trunk_and_head" in limbs and len(limbs) >= LEAST_LIMBS
    return np.concatenate([LIMBS_JUDGED[limb] for limb in limbs]) if enough else None


@dataclass(frozen=True, slots=True, eq=False)
class Chance:
    """A frame that may be spoilt, and the joints (k,) that count."""

    frame: int
    spoil: Spoil
    joints: np.ndarray


def chances(way: Way, alone: Undisturbed, truth: Truth, kind: Kind, seed: int) -> list[Chance]:
    """The frames of a way in which this kind can be tried: in plain view all the time, right before, wrong after."""
    body, frames, visible = way.body, list(alone.poses), in_plain_view(truth)
    after = int(np.ceil(LIMITS.until_s / float(np.median(np.diff(truth.time_s)))))
    found = []
    for place in range(way.run.config.follow.history, len(frames) - after):
        frame, then = frames[place], frames[place : place + after + 1]
        spoil = draw_spoil(kind, seed, frame)
        joints = judged_joints(spoil, {limb: bool(seen[then].all()) for limb, seen in visible.items()})
        if joints is None:
            continue
        true_m, wrong = truth.position_m[frame, joints], body.joints(spoilt(body, alone.poses[frame], spoil))
        usual_m, wrong_m = (_largest_m(at[joints] - true_m) for at in (alone.joints_m[frame], wrong))
        if usual_m < LIMITS.absolute_m and wrong_m > SPOILT_M:
            found.append(Chance(frame, spoil, joints))
    return found


def _largest_m(offset_m: np.ndarray) -> float:
    """The largest of some joints' errors (k, 3)."""
    return float(np.linalg.norm(offset_m, axis=1).max())


def spread(choices: Sequence[Choice], count: int) -> list[Choice]:
    """``count`` of the choices, evenly spread; all of them where there are no more."""
    if count >= len(choices):
        return list(choices)
    return [choices[int((k + 0.5) * len(choices) / count)] for k in range(count)]


def go_on(way: Way, kidnapped: PatientTracker, place: int, judge: Judge) -> Outcome:
    """Track on from the frame at a place of the way until the outcome is certain."""
    estimates = (kidnapped.step(way.read(later)) for later in range(place, len(way.positions)))
    for estimate in chain(estimates, kidnapped.finish()):
        if estimate is not None:
            seen, joints_m = estimate.frame_set, kidnapped.body.joints(kidnapped.belief.pose)
            judge.take(seen.frame, seen.time_s, joints_m)
        if judge.done:
            break
    return judge.outcome()


def try_way(
    name: tuple[str, int], way: Way, alone: Undisturbed, truth: Truth, chosen: Sequence[Chance]
) -> Iterator[Trial]:
    """All chosen trials of a way, while it is tracked once more. name: scene and seed."""
    past: Past | None = None
    for read, tracker, _ in way.trackers():
        if past is None:
            past = Past.of(tracker)
        else:
            past.note(tracker)
        frame_set = tracker.window[0].frame_set
        for chance in chosen:
            if chance.frame != frame_set.frame:
                continue
            judge = Judge(frame_set.time_s, chance.joints, truth.position_m.__getitem__, alone.joints_m.__getitem__)
            began = time.process_time()
            outcome = go_on(way, kidnap(tracker, past, chance.spoil), read, judge)
            spoil, seconds = chance.spoil, time.process_time() - began
            yield Trial(name, way.direction, frame_set.frame, spoil, outcome, seconds)


def try_recording(
    name: tuple[str, int], simulated: Path, kinds: Sequence[Kind], wanted: Mapping[Kind, int]
) -> Iterator[Trial]:
    """As many trials of each kind as wanted, as far as the recording has chances for them."""
    truth = read_truth(simulated / "truth" / "truth.npz")
    ways = ways_through(simulated / "recording", TrackConfig())
    alone = [undisturbed(way) for way in ways]
    chosen = {
        kind: spread(
            [(number, chance) for number, way in enumerate(ways)
             for chance in chances(way, alone[number], truth, kind, name[1])],
            wanted[kind],
        )
        for kind in kinds
    }  # fmt: skip
    for number, way in enumerate(ways):
        of_way = [chance for kind in kinds for here, chance in chosen[kind] if here == number]
        if of_way:
            yield from try_way(name, way, alone[number], truth, of_way)


def summary(trials: Sequence[Trial]) -> dict[str, Any]:
    """Share right, its interval, and times, of the trials of one kind."""
    right = [trial for trial in trials if trial.outcome.right]
    low, high = wilson(len(right), len(trials)) if trials else (None, None)
    recovered = [trial.outcome.recovered_s for trial in right if trial.outcome.recovered_s is not None]
    return {
        "trials": len(trials),
        "right": len(right),
        "share": len(right) / len(trials) if trials else None,
        "low": low,
        "high": high,
        "median_recovery_s": float(np.median(recovered)) if recovered else None,
        "seconds_per_trial": float(np.mean([trial.seconds for trial in trials])) if trials else None,
    }


def table(trials: Sequence[Trial]) -> str:
    """Markdown, one row per kind, and per kind and scene."""
    lines = ["| spoilt | scene | trials | right % | 95 % interval | median s until right | processor s per trial |",
             "|---|---|--:|--:|--:|--:|--:|"]  # fmt: skip
    for kind in Kind:
        of_kind = [trial for trial in trials if trial.spoil.kind is kind]
        scenes = dict.fromkeys(trial.name[0] for trial in of_kind)
        for scene, some in (("all", of_kind), *((s, [t for t in of_kind if t.name[0] == s]) for s in scenes)):
            if some:
                lines.append(_row(kind, scene, summary(some)))
    return "\n".join(lines)


def _row(kind: Kind, scene: str, found: Mapping[str, Any]) -> str:
    until = "–" if found["median_recovery_s"] is None else f"{found['median_recovery_s']:.2f}"
    interval = f"{100 * found['low']:.0f} to {100 * found['high']:.0f}"
    cells = (str(found["trials"]), f"{100 * found['share']:.0f}", interval, until, f"{found['seconds_per_trial']:.2f}")
    return f"| {kind} | {scene} | {' | '.join(cells)} |"


def as_json(trial: Trial) -> dict[str, Any]:
    """One trial for programs."""
    (scene, seed), spoil, outcome = trial.name, trial.spoil, trial.outcome
    return {
        "scene": scene, "seed": seed, "direction": trial.direction, "frame": trial.frame, "kind": str(spoil.kind),
        "side": spoil.side, "height": round(spoil.height, 3), "right": outcome.right,
        "recovered_s": None if outcome.recovered_s is None else round(outcome.recovered_s, 3),
        "worst_mm": round(1000 * outcome.worst_m, 1),
        "seconds": round(trial.seconds, 3),
    }  # fmt: skip


def chosen_recordings(options: argparse.Namespace) -> dict[tuple[str, int], presets.SimulationConfig]:
    """By scene and seed."""
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    found = {(scene, seed): SCENES[scene](seed, options.seconds) for scene, seed in product(options.scenes, seeds)}
    return found | (hard_scenes(options.hard, options.movements, options.seconds) if options.hard else {})


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=200, help="of each kind, over all recordings")
    parser.add_argument("--kinds", nargs="+", type=Kind, choices=list(Kind), default=list(Kind))
    parser.add_argument("--scenes", nargs="*", choices=list(SCENES), default=list(SCENES))
    parser.add_argument("--seeds", type=int, default=3, help="recordings of each scene")
    parser.add_argument("--first-seed", type=int, default=1101)
    parser.add_argument("--seconds", type=float, default=6.0, help="length of each recording, at 15 frames a second")
    parser.add_argument("--hard", choices=("tuning", "held-out"), help="the hard scenes as well (hard_scenes.py)")
    parser.add_argument("--movements", type=Path, help="captured movements that the hard scenes need")
    parser.add_argument("--recordings", type=Path, default=KEPT, help="where they are kept, %(default)s")
    parser.add_argument("--as-they-are", action="store_true", help="use recordings that another simulator made, too")
    parser.add_argument("--out", type=Path, help="all trials as JSON")
    options = parser.parse_args()
    if options.hard and not (options.movements and options.movements.is_file()):
        sys.exit("--hard needs --movements with the file of captured movements.")
    recordings = chosen_recordings(options)
    trials = list[Trial]()
    for number, ((scene, seed), config) in enumerate(recordings.items()):
        done = {kind: sum(trial.spoil.kind is kind for trial in trials) for kind in options.kinds}
        wanted = {kind: -(-(options.trials - done[kind]) // (len(recordings) - number)) for kind in options.kinds}
        folder = f"{scene}-{seed}-{options.seconds:g}"
        simulated = cached_recording(options.recordings, folder, config, options.as_they_are)
        with one_thread():
            for trial in try_recording((scene, seed), simulated, options.kinds, wanted):
                trials.append(trial)
                print(json.dumps(as_json(trial)), file=sys.stderr, flush=True)
    if options.out is not None:
        by_kind = {str(kind): summary([t for t in trials if t.spoil.kind is kind]) for kind in options.kinds}
        failures = [as_json(trial) for trial in trials if not trial.outcome.right]
        document = {"kinds": by_kind, "failures": failures, "trials": [as_json(trial) for trial in trials]}
        options.out.write_text(json.dumps(document, indent=1) + "\n")
    print(table(trials))


if __name__ == "__main__":
    main()
