"""How far off the cameras' poses are that are found from the equipment: python benchmarks/calibration.py --clinics 10.

Each seed is another clinic of three cameras, a frame (in every fifth clinic parallel bars), a patient and two
therapists; the sensor changes from seed to seed. Each is calibrated with the depth image of the empty room, without it
(people always in view), and with the equipment.json of another clinic, which must be refused. A pose is wrong if it is
off by more than ``WRONG_M`` at the equipment or ``WRONG_RAD``.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Final, get_args

import numpy as np

from anchorpose.calibration.equipment_pose import angle_between
from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.config import Equipment, Sensor, SimulationConfig
from anchorpose.simulate.shoot import set_up
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import calibrate as find_poses

SAMPLES: Final = 16  # frames, as in tracking
WRONG_M, WRONG_RAD = 0.02, np.radians(1.0)
WAYS: Final = {
    "background": "with the depth image of the empty room",
    "people": "without it: people always in view",
    "wrong": "with another clinic's equipment.json",
}
THREADS: Final = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One clinic, calibrated one way: errors of each camera, or why it was refused."""

    seed: int
    way: str
    refusal: str | None
    shift_m: tuple[float, ...] = ()  # at the equipment
    turn_rad: tuple[float, ...] = ()
    camera_m: tuple[float, ...] = ()  # of the camera's own place
    sigma_m: tuple[float, ...] = ()
    seconds: float = 0.0


def shoot_clinic(config: SimulationConfig, samples: int = SAMPLES) -> tuple[Clinic, Recording, list[FrameSet]]:
    """A clinic, its recording with the poses left out, and frames spread over it; nothing is written."""
    clinic = draw_clinic(config)
    studio = set_up(clinic)
    chosen = np.unique(np.linspace(0, config.frames - 1, min(samples, config.frames)).astype(int)).tolist()
    frames = [
        FrameSet(
            frame=k, time_s=k / config.fps,
            depths_m=tuple((depth * 0.001).astype(np.float32) for depth in studio.shoot(k).depths_mm),
        )
        for k in chosen
    ]  # fmt: skip
    recording = Recording(
        folder=Path(f"clinic-{config.seed}"),
        cameras=tuple(replace(camera, T_world_camera=None) for camera in clinic.cameras),
        streams=(),
        backgrounds_m=tuple(
            (studio.background_mm(index) * 0.001).astype(np.float32) for index in range(config.cameras)
        ),
        equipment=clinic.equipment,
        subject_height_m=None,
    )
    return clinic, recording, frames


def clinic_config(seed: int, seconds: float) -> SimulationConfig:
    """Sensors in turn, every fifth clinic with parallel bars."""
    sensors = get_args(Sensor)
    sensor = sensors[seed % len(sensors)]
    equipment: Equipment = "parallel-bars" if seed % 5 == 4 else "standing-frame"
    return SimulationConfig(seed=seed, seconds=seconds, fps=15.0, sensor=sensor, equipment=equipment)


def calibrate(seed: int, way: str, recording: Recording, frames: Sequence[FrameSet], clinic: Clinic) -> Outcome:
    """One calibration and its error."""
    config = TrackConfig()
    start = time.perf_counter()
    try:
        found = find_poses(recording, frames, config)
    except InputError as error:
        return Outcome(seed, way, error.problem, seconds=time.perf_counter() - start)
    seconds = time.perf_counter() - start
    errors = [_errors(*pair, clinic.equipment) for pair in zip(found.cameras, clinic.cameras, strict=True)]
    shift, turn, place = (tuple(values) for values in zip(*errors, strict=True))
    sigma = tuple(pose.sigma_m or 0.0 for pose in found.poses)
    return Outcome(seed, way, None, shift, turn, place, sigma, seconds)


def score(job: tuple[int, float, tuple[str, ...]]) -> list[Outcome]:
    """Simulate and calibrate one clinic every way."""
    seed, seconds, ways = job
    clinic, recording, frames = shoot_clinic(clinic_config(seed, seconds))
    bare = replace(recording, backgrounds_m=(None,) * len(recording.cameras))
    other = draw_clinic(replace(clinic_config(seed, seconds), seed=seed + 1000))
    variants = {"background": recording, "people": bare, "wrong": replace(recording, equipment=other.equipment)}
    return [calibrate(seed, way, variants[way], frames, clinic) for way in ways]


def _errors(found: Camera, true: Camera, equipment: EquipmentModel | None) -> tuple[float, float, float]:
    """Metres at the equipment's middle, radians, metres at the camera."""
    vertices = equipment.triangles()[0] if equipment is not None else np.zeros((1, 3))
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2.0
    T_found, T_true = found.require_pose(), true.require_pose()
    shift = transform_points(T_found @ np.linalg.inv(T_true), middle) - middle
    return (
        float(np.linalg.norm(shift)),
        angle_between(T_found, T_true),
        float(np.linalg.norm(found.position_m - true.position_m)),
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """The outcomes as Markdown, one row per way."""
    lines = [
        "| calibrated | clinics | mm at the equipment | degrees | mm at the camera | refused | wrong accepted | s |",
        "|---|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for way, title in WAYS.items():
        of_way = [outcome for outcome in outcomes if outcome.way == way]
        if not of_way:
            continue
        accepted = [outcome for outcome in of_way if outcome.refusal is None]
        wrong = sum(
            max(outcome.shift_m) > WRONG_M or max(outcome.turn_rad) > WRONG_RAD for outcome in accepted
        )  # fmt: skip
        cells = (
            _spread([1000 * value for outcome in accepted for value in outcome.shift_m]),
            _spread([np.degrees(value) for outcome in accepted for value in outcome.turn_rad], 2),
            _spread([1000 * value for outcome in accepted for value in outcome.camera_m]),
            str(len(of_way) - len(accepted)),
            str(wrong),
            f"{np.mean([outcome.seconds for outcome in of_way]):.1f}",
        )
        lines.append(f"| {title} | {len(of_way)} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _spread(values: Sequence[float], digits: int = 1) -> str:
    """Mean, 95 % and worst."""
    if not values:
        return "–"
    return " / ".join(f"{value:.{digits}f}" for value in (np.mean(values), np.percentile(values, 95), max(values)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clinics", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of each recording")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--processes", type=int, default=1)
    chosen = parser.parse_args()
    for name in THREADS:
        os.environ[name] = "1"  # one core each; a new process reads it before it loads a library
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.clinics)
    jobs = [(seed, chosen.seconds, tuple(chosen.ways)) for seed in seeds]
    outcomes: list[Outcome] = []
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn")) as pool:
        for each in pool.map(score, jobs):
            outcomes += each
            for outcome in each:
                shifts = " ".join(
                    f"{1000 * a:.1f}/{np.degrees(b):.2f}"
                    for a, b in zip(outcome.shift_m, outcome.turn_rad, strict=True)
                )
                print(f"seed {outcome.seed} {outcome.way}: {outcome.refusal or shifts}", file=sys.stderr)
    print("Mean / 95 % / worst of all cameras:")
    print(table(outcomes))


if __name__ == "__main__":
    main()
