"""How well the cameras' clocks are found: python benchmarks/clocks.py --seeds 4.

Ten minutes of a simulated clinic, three cameras, whose clocks are off by up to 2 s and drift by up to 100 parts in a
million. Only the frames that the estimate reads are rendered. Errors are those of the times that frames get on
the first camera's clock: in the middle of the recording (offset) and between its two ends (drift over ten minutes).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from lazy_clinic import LazyClinic, lazy_clinic

from anchorpose.calibration.clock_signal import Level, pose_level
from anchorpose.calibration.clocks import ClockConfig, Clocks, estimate_clocks
from anchorpose.camera import Camera
from anchorpose.simulate import config as presets


@dataclass(frozen=True, slots=True)
class Outcome:
    """One camera of one seed: errors of its clock in ms, the standard error that was stated, whether it was kept."""

    offset_ms: float
    drift_ms: float
    sigma_ms: float
    corrected: bool


@dataclass(frozen=True, slots=True, eq=False)
class Blind:
    """Depth frames without poses."""

    clinic: LazyClinic

    @property
    def cameras(self) -> tuple[Camera, ...]:
        return tuple(replace(camera, T_world_camera=None) for camera in self.clinic.clinic.cameras)

    @property
    def times_s(self) -> tuple[np.ndarray, ...]:
        return self.clinic.times_s

    def read(self, camera: int, position: int) -> np.ndarray:
        return self.clinic.read(camera, position)


def draw_config(seed: int, seconds: float, fps: float, jitter_s: float) -> presets.SimulationConfig:
    """A clinic whose clocks disagree."""
    rng = np.random.default_rng(seed)
    return replace(
        presets.clinic(seed, seconds, fps),
        clock_late_s=(0.0, *rng.uniform(-2.0, 2.0, 2)),
        clock_drift=(0.0, *rng.uniform(-1e-4, 1e-4, 2)),
        stamp_jitter_s=jitter_s,
    )


def score(footage: LazyClinic, clocks: Clocks) -> list[Outcome]:
    """Errors of all cameras but the first."""
    config = footage.clinic.config
    outcomes = []
    for index, found in enumerate(clocks.cameras[1:], start=1):
        stamps = np.array([0.0, 0.5, 1.0]) * config.seconds
        true_s = stamps + config.clock_late_s[index] + config.clock_drift[index] * stamps
        error_ms = 1000.0 * (found.clock.reference_s(stamps) - true_s)
        sigma_ms = 1000.0 * (found.sigma_s or np.nan)
        outcomes.append(Outcome(error_ms[1], error_ms[2] - error_ms[0], sigma_ms, found.doubt is None))
    return outcomes


def row(title: str, outcomes: Sequence[Outcome], seconds: Sequence[float], frames: Sequence[int]) -> str:
    """One line of the table."""
    offset, drift = (np.abs([getattr(o, name) for o in outcomes if o.corrected]) for name in ("offset_ms", "drift_ms"))
    within = np.mean([abs(o.offset_ms) < 1.96 * o.sigma_ms for o in outcomes if o.corrected])
    kept = sum(not outcome.corrected for outcome in outcomes)
    return (
        f"| {title} | {len(outcomes)} | {np.median(offset):.1f} ({offset.max():.1f}) | "
        f"{np.median(drift):.1f} ({drift.max():.1f}) | {100 * within:.0f} | {kept} | "
        f"{np.mean(frames):.0f} | {np.mean(seconds):.0f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=501)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rates", type=float, nargs="+", default=[30.0, 15.0])
    parser.add_argument("--jitter", type=float, default=0.0, help="standard deviation of the stamps in seconds")
    chosen = parser.parse_args()
    print("| clocks | cameras | offset error ms | drift error ms | in 95 % band | kept | frames read | s |", flush=True)
    print("|---|--:|--:|--:|--:|--:|--:|--:|", flush=True)
    for fps in chosen.rates:
        known, blind = ([], [], []), ([], [], [])
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
            footage = lazy_clinic(draw_config(seed, chosen.seconds, fps, chosen.jitter))
            for places, seen in ((known, footage), (blind, Blind(footage))):
                estimate_clocks(seen, _levels(footage), ClockConfig())  # renders
                start = time.perf_counter()
                clocks = estimate_clocks(seen, _levels(footage), ClockConfig())
                for place, values in zip(
                    places,
                    (score(footage, clocks), [time.perf_counter() - start], [clocks.frames_read]),
                    strict=True,
                ):
                    place += values
                print("  ", seed, score(footage, clocks), f"{time.perf_counter() - start:.1f} s", flush=True)
        print(row(f"{fps:.0f} Hz, poses known", *known), flush=True)
        print(row(f"{fps:.0f} Hz, poses unknown", *blind), flush=True)


def _levels(footage: LazyClinic) -> list[Level | None]:
    return [pose_level(camera) for camera in footage.clinic.cameras]


if __name__ == "__main__":
    main()
