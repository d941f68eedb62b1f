"""Do geodesics earn their keep? python benchmarks/geodesics_worth.py --seeds 12 --out worth.json

Where they should help most: a first pose from one frame in any posture, a patient who was lost, fast arms at 3 and 5
frames a second, a body whose shape is not learnt, and a clinic seen by one camera. Each recording is tracked with

- geodesic: matches by geodesic descriptors, and the anchors, where the body leaves a frame unexplained (the default);
- always: the same in every frame (``hypotheses.always = true``), as in the paper;
- position: matches by position (``hypotheses.feature = "position"``), and the anchors, in every frame;
- neither: neither matches nor anchors in the registration (``registration.held_steps = 0``).

A first pose is found with the anchors (geodesic) and without them (neither). Differences are paired by recording, with
Student's 95 % interval over the recordings; negative means better or faster than geodesic. A joint without a place
counts as 250 mm off, so that giving up is not an advantage. Times are processor time, summed over the
tracker's stages.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest import mock

import numpy as np
from cached_recordings import KEPT, cached_recording
from paired_variants import ALWAYS, GEODESIC, NEITHER, POSITION, Score, compare, score, table

from anchorpose.body.config import LearningConfig, RegistrationConfig
from anchorpose.body.skin_points import body_points, build_body
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.joints import JOINT_COUNT
from anchorpose.motion.database_file import load_motions
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.results.truth import read_truth
from anchorpose.simulate import config as presets
from anchorpose.threads import one_thread
from anchorpose.track_tree.hypotheses import Feature, HypothesisConfig
from anchorpose.tracker import start as starting
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.observation import Observation, Start
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run
from anchorpose.tracker.start import find_start
from anchorpose.tracker.stopwatch import Stopwatch

VARIANTS: Final[Mapping[str, Callable[[TrackConfig], TrackConfig]]] = {
    GEODESIC: lambda config: config,
    ALWAYS: lambda config: replace(config, hypotheses=HypothesisConfig(always=True)),
    POSITION: lambda config: replace(config, hypotheses=HypothesisConfig(feature=Feature.POSITION, always=True)),
    NEITHER: lambda config: replace(config, registration=RegistrationConfig(held_steps=0)),
}
LONG_S: Final = 12.0  # time to be lost and found
SKIP_S: Final = 1.0  # tracking may settle in it
FIRST_POSES: Final = 4  # frames of a recording from which a first pose is found


@dataclass(frozen=True, slots=True)
class Situation:
    """Recordings of one kind, by seed; from_s: what comes before does not count; own_shape: the body is learnt."""

    title: str
    recording: Callable[[int], presets.SimulationConfig]
    from_s: float = SKIP_S
    own_shape: bool = True
    first_pose: bool = False


def _fast_arms(seed: int, fps: float) -> presets.SimulationConfig:
    return replace(presets.single(seed, 8.0, fps), speed="fast", motions=("reach", "arm-raise"))


def _lost(seed: int, scene: presets.Scene) -> presets.SimulationConfig:
    return presets.scene(presets.single(seed, LONG_S), scene)


SITUATIONS: Final[Mapping[str, Situation]] = {
    "first-pose": Situation("first pose from one frame", lambda seed: presets.single(seed, 6.0), 0.0, first_pose=True),
    "first-pose-sits": Situation(
        "first pose, seated or rising", lambda seed: _lost(seed, "sits"), 0.0, first_pose=True
    ),
    "hidden": Situation("after a curtain", partial(_lost, scene="hidden"), 0.45 * LONG_S + presets.HIDDEN_S),
    "leaves": Situation("after leaving the room", partial(_lost, scene="leaves"), 0.65 * LONG_S),
    "arms-3": Situation("fast arms, 3 frames a second", partial(_fast_arms, fps=3.0)),
    "arms-5": Situation("fast arms, 5 frames a second", partial(_fast_arms, fps=5.0)),
    "unknown-body": Situation("shape not learnt", lambda seed: presets.single(seed, 6.0), own_shape=False),
    "clinic-front": Situation("clinic, front camera alone", lambda seed: replace(presets.clinic(seed, 6.0), cameras=1)),
}


def prepared(simulated: Path, own_shape: bool) -> Run:
    """Everything that does not depend on the variant."""
    config = TrackConfig(learning=LearningConfig(own_shape=own_shape))
    recording = open_recording(simulated / "recording")
    room = prepare_room(recording, config)
    return Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))


def of_variant(run: Run, variant: str) -> Run:
    """The run with a variant's settings and a stopwatch of its own."""
    return replace(run, config=VARIANTS[variant](run.config), stopwatch=Stopwatch(time.process_time))


def compile_all(folder: Path) -> None:
    """Everything once, so that no measured time holds the loading or compiling of kernels."""
    simulated = cached_recording(folder, "compile", presets.single(1, 1.0))
    run, truth = prepared(simulated, True), read_truth(simulated / "truth" / "truth.npz")
    for variant in VARIANTS:
        tracked(of_variant(run, variant), truth.position_m)
    first_joints(run, 0, anchors=True)


def tracked(run: Run, truth_m: np.ndarray) -> np.ndarray:
    """(t, 21) error in mm of every frame, NaN where lost; learnt, then followed to both ends as ``track`` does."""
    route = plan_route(run.room, run.config, lambda: None)
    learnt = learn_on(route, run)
    run.stopwatch.seconds.clear()  # the pass that learns is not a frame's work
    error_mm = np.full((len(truth_m), JOINT_COUNT), np.nan)
    for positions in (route.backward, route.forward):
        for estimate in follow_patient(run, route.frames(positions), None if learnt is None else learnt.shape):
            frame = estimate.frame_set.frame
            error_mm[frame] = 1000.0 * np.linalg.norm(estimate.joints_m - truth_m[frame], axis=1)
    return error_mm


def scores_of_tracking(name: str, seed: int, simulated: Path) -> Iterator[Score]:
    """Each variant on one recording."""
    situation, truth = SITUATIONS[name], read_truth(simulated / "truth" / "truth.npz")
    run, judged = prepared(simulated, situation.own_shape), truth.time_s >= situation.from_s - 1e-9
    for variant in VARIANTS:
        varied = of_variant(run, variant)
        error_mm = tracked(varied, truth.position_m)
        per_frame_s = sum(varied.stopwatch.seconds.values()) / len(error_mm)
        yield score(name, seed, variant, error_mm[judged], per_frame_s * judged.sum())


def scores_of_first_poses(name: str, seed: int, simulated: Path) -> Iterator[Score]:
    """First poses from single frames, drawn by the seed, with the anchors and without."""
    truth, run = read_truth(simulated / "truth" / "truth.npz"), prepared(simulated, True)
    rng = np.random.default_rng(seed)
    frames = np.sort(rng.choice(len(truth.time_s), FIRST_POSES, replace=False))
    for variant in (GEODESIC, NEITHER):
        error_mm, began = np.full((len(frames), JOINT_COUNT), np.nan), time.process_time()
        for row, frame in enumerate(frames.tolist()):
            joints_m = first_joints(run, frame, anchors=variant == GEODESIC)
            if joints_m is not None:
                error_mm[row] = 1000.0 * np.linalg.norm(joints_m - truth.position_m[frame], axis=1)
        yield score(name, seed, variant, error_mm, time.process_time() - began)


def first_joints(run: Run, frame: int, anchors: bool) -> np.ndarray | None:
    """(21, 3) joints of the first pose in a frame, None where there is none; anchors: whether it may use them."""
    initial = run.room.initial_frame
    if initial is None:
        return None
    observe_first = starting.observe_first

    def without_anchors(*arguments: Any) -> Observation:
        return replace(observe_first(*arguments), anchors=no_anchors())

    with mock.patch.object(starting, "observe_first", observe_first if anchors else without_anchors):
        found = find_start(read_frame(run.room.recording, frame), run, initial.choice, None)
    if not isinstance(found, Start):
        return None
    return build_body(body_points(), found.shape).joints(found.belief.pose)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=12, help="recordings of each situation")
    parser.add_argument("--first-seed", type=int, default=1201)
    parser.add_argument("--situations", nargs="+", choices=list(SITUATIONS), default=list(SITUATIONS))
    parser.add_argument("--recordings", type=Path, default=KEPT, help="where they are kept, %(default)s")
    parser.add_argument("--out", type=Path, help="all scores and comparisons as JSON")
    options = parser.parse_args()
    scores = list[Score]()
    with one_thread():
        compile_all(options.recordings)
    for name in options.situations:
        measure = scores_of_first_poses if SITUATIONS[name].first_pose else scores_of_tracking
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            config = SITUATIONS[name].recording(seed)
            simulated = cached_recording(options.recordings, f"{name}-{seed}", config)
            with one_thread():
                for one in measure(name, seed, simulated):
                    scores.append(one)
                    print(json.dumps(asdict(one)), file=sys.stderr, flush=True)
    comparisons = compare(scores)
    if options.out is not None:
        document = {"comparisons": [asdict(one) for one in comparisons], "scores": [asdict(one) for one in scores]}
        options.out.write_text(json.dumps(document, indent=1) + "\n")
    titles = {name: situation.title for name, situation in SITUATIONS.items()}
    print(table(comparisons, titles, options.seeds))


if __name__ == "__main__":
    main()
