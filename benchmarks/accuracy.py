"""How far off the joints are on simulated recordings: python benchmarks/accuracy.py --seeds 4 --seconds 6.

Each seed is another body, other clothes and other movements. A recording is made, tracked with the defaults (the body
shape is not known to the tracker) and compared with the truth after the first second; the table has the mean over the
seeds, in brackets the worst seed.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, get_args

from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.results.evaluate import Evaluation, evaluate
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.simulate import config as presets
from anchorpose.simulate.write import simulate_recording

SKIP_S: Final = 1.0  # tracking may settle in it
HOLES_M: Final = (0.03, 0.06, 0.09, 0.12, 0.15)  # the paper's
TRUTH_FILE: Final = "truth/truth.npz"


def _holes(seed: int, seconds: float, radius_m: float) -> presets.SimulationConfig:
    return presets.holes(seed, radius_m, seconds)


def _through(seed: int, seconds: float, lens: presets.LensName) -> presets.SimulationConfig:
    return replace(presets.single(seed, seconds), lens=lens)


def _sensed(seed: int, seconds: float, sensor: presets.Sensor) -> presets.SimulationConfig:
    return replace(presets.single(seed, seconds), sensor=sensor)


def _mixed(seed: int, seconds: float) -> presets.SimulationConfig:
    """Cameras of three makes: other images, lenses, noise and rates, and clocks that nobody set."""
    same = presets.clinic(seed, seconds, fps=30.0)
    return replace(
        same, sensors=("femto-bolt", "realsense", "kinect-v2"), every=(1, 1, 2), clock_late_s=(0.0, 0.35, -0.6)
    )


SENSORS: Final[tuple[presets.Sensor, ...]] = get_args(presets.Sensor)
LENSES: Final[tuple[presets.LensName, ...]] = ("brown-conrady", "rational", "kannala-brandt")
SCENES: Final[dict[str, Callable[[int, float], presets.SimulationConfig]]] = {
    "single": presets.single,
    **{f"hole-{radius_m:.2f}": partial(_holes, radius_m=radius_m) for radius_m in HOLES_M},
    **{f"lens-{lens}": partial(_through, lens=lens) for lens in LENSES},
    **{f"sensor-{sensor}": partial(_sensed, sensor=sensor) for sensor in SENSORS},
    "clinic": presets.clinic,
    "mixed": _mixed,
    "clinic-front": lambda seed, seconds: replace(presets.clinic(seed, seconds), cameras=1),
}
DEFAULT_SCENES: Final = ("single", "hole-0.15", "clinic", "clinic-front")
TITLES: Final = {
    "single": "one camera, nobody else",
    **{f"hole-{radius_m:.2f}": f"the same with holes of {radius_m:.2f} m" for radius_m in HOLES_M},
    **{f"lens-{lens}": f"the same through a lens ({lens})" for lens in LENSES},
    **{f"sensor-{sensor}": f"the same with another sensor ({sensor})" for sensor in SENSORS},
    "clinic": "clinic: three cameras, frame, two therapists",
    "mixed": "the same with a Femto Bolt, a D455 and a Kinect v2, at 30, 30 and 15 pictures a second",
    "clinic-front": "the same clinic, front camera alone",
}
JUDGED_ANGLES: Final = ("knee_flexion", "hip_flexion", "elbow_flexion")
THREADS: Final = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One recording: what the comparison says, joints lost in the last frame, tracking time a frame."""

    scene: str
    seed: int
    evaluation: Evaluation
    lost_at_end: int
    seconds_a_frame: float


def score(job: tuple[str, int], seconds: float) -> Outcome:
    """Simulate, track and evaluate one scene."""
    scene, seed = job
    with TemporaryDirectory() as folder:
        simulated, results = Path(folder) / "simulated", Path(folder) / "results"
        simulate_recording(simulated, SCENES[scene](seed, seconds))
        start = time.perf_counter()
        joints, evaluation = track_simulated(simulated, results, TrackConfig())
        elapsed_s = time.perf_counter() - start
    return Outcome(scene, seed, evaluation, int(joints.lost[-1].sum()), elapsed_s / len(joints.frame))


def track_simulated(simulated: Path, results: Path, config: TrackConfig) -> tuple[JointTable, Evaluation]:
    """Track a simulated recording into a new results folder and compare it with its truth."""
    results.mkdir()
    track_recording(simulated / "recording", results, config, lambda done, total: None)
    return read_joints(results / JOINTS_FILE), evaluate(results, simulated / TRUTH_FILE, SKIP_S)


def table(outcomes: Sequence[Outcome]) -> str:
    """The outcomes as Markdown, one row a scene."""
    lines = [
        "| simulated recording | seeds | mean mm | 95 % mm | hidden joints mm | over 150 mm for s | angles deg "
        "| lost % | in 95 % band | lost at the end | s a frame |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for scene, title in TITLES.items():
        of_scene = [outcome for outcome in outcomes if outcome.scene == scene]
        if not of_scene:
            continue
        found = [outcome.evaluation for outcome in of_scene]
        overall = [evaluation.overall for evaluation in found]
        cells = (
            _mean_and_worst([summary.mean_mm for summary in overall], max),
            _mean_and_worst([summary.p95_mm for summary in overall], max),
            _mean_and_worst([evaluation.hidden.mean_mm for evaluation in found], max),
            _mean_and_worst([evaluation.longest_off.seconds for evaluation in found], max),
            _mean_and_worst([_angle_error(evaluation) for evaluation in found], max),
            _mean_and_worst([_percent(summary.lost_share) for summary in overall], max),
            _mean_and_worst([_percent(summary.coverage_95) for summary in overall], min),
            f"{sum(outcome.lost_at_end > 0 for outcome in of_scene)} of {len(of_scene)}",
            f"{sum(outcome.seconds_a_frame for outcome in of_scene) / len(of_scene):.2f}",
        )
        lines.append(f"| {title} | {len(of_scene)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _angle_error(evaluation: Evaluation) -> float | None:
    """Mean absolute error over knees, hips and elbows."""
    judged = [error.mean_abs_deg for name, error in evaluation.angles if name.startswith(JUDGED_ANGLES)]
    known = [error for error in judged if error is not None]
    return sum(known) / len(known) if known else None


def _percent(share: float | None) -> float | None:
    return None if share is None else 100.0 * share


def _mean_and_worst(values: Sequence[float | None], worst: Callable[[Sequence[float]], float]) -> str:
    """A recording of which everything was lost has no error; it says so instead of improving the mean."""
    known = [value for value in values if value is not None]
    if not known:
        return "–"
    text = f"{sum(known) / len(known):.1f} ({worst(known):.1f})"
    return text if len(known) == len(values) else f"{text}, {len(values) - len(known)} without"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="recordings of each scene")
    parser.add_argument("--first-seed", type=int, default=101)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each recording, at 15 pictures a second")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(DEFAULT_SCENES))
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    for name in THREADS:
        os.environ[name] = "1"  # one core each; a new process reads it before it loads a library
    jobs = list(product(chosen.scenes, range(chosen.first_seed, chosen.first_seed + chosen.seeds)))
    outcomes = []
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn")) as pool:
        for outcome in pool.map(partial(score, seconds=chosen.seconds), jobs):
            outcomes.append(outcome)
            found = outcome.evaluation.overall
            off = outcome.evaluation.longest_off
            far = f"{off.joint} far off for {off.seconds:.2f} s"
            print(f"{outcome.scene} seed {outcome.seed}: mean {found.mean_mm} mm, {far}", file=sys.stderr)
    print(table(outcomes))


if __name__ == "__main__":
    main()
