"""What to simulate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import numpy as np

Sensor = Literal["kinect-v2", "azure-kinect", "realsense"]
Speed = Literal["slow", "normal", "fast", "mixed"]
Scene = Literal["enters-late", "leaves", "hidden", "sits"]

MOTIONS: Final = (
    "standing", "squat", "weight-shift", "trunk", "steps", "sit-to-stand",
    "reach", "arm-raise", "head", "rails",
)  # fmt: skip
"""What a patient can be asked to do; ``mixed`` draws from all of them, legs and arms at once."""

FRAMELESS_MOTIONS: Final = frozenset({"sit-to-stand"})
"""Motions that a standing frame with a knee bar does not leave room for."""

SMALLEST_HOLE_M, LARGEST_HOLE_M = 0.03, 0.15  # the paper's five sizes, Section V
ROUGH_KEY: Final = 1000  # a stream of its own beside those of ``clinic``
HIDDEN_S: Final = 2.0  # behind a curtain
THICKEST_CLOTHING_M = 0.015  # beyond this the skin says little about the body


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationConfig:
    """One simulated recording. The same values give the same bytes."""

    seed: int
    seconds: float = 10.0
    fps: float = 30.0  # every sensor simulated here runs at 30 Hz
    cameras: int = 3  # front, left, right, then behind
    sensor: Sensor = "kinect-v2"  # the paper's
    standing_frame: bool = True
    parallel_bars: bool = False  # instead of the standing frame: two rails that look the same from both ends
    equipment_moves_at_s: float | None = None  # when somebody pushes the equipment; None: nobody does
    equipment_shift_m: tuple[float, float] = (0.0, 0.0)  # along X and Z
    equipment_turn_rad: float = 0.0  # about the vertical
    stool: bool = True  # something solid under a patient who sits
    therapists: int = 2
    motions: tuple[str, ...] = ("mixed",)
    speed: Speed = "mixed"
    clothing_m: float = 0.009  # how far loose clothes stand off the skin where they stand off most
    away_s: tuple[
        tuple[float, float], ...
    ] = ()  # from when to when the patient is out of the room; he walks out and in
    curtain_s: tuple[float, float] | None = (
        None  # from when to when a curtain hangs between the patient and all cameras
    )
    hole_radius_m: float = 0.0  # 0: no holes
    hole_share: float = 0.5  # of the frames
    height_m: float | None = None  # None: drawn between 1.5 and 1.9
    room: bool = True
    pose_known: bool = True  # False: camera_to_world is null
    clock_late_s: tuple[float, ...] = ()  # one a camera: how much later than its stamps say it looked
    clock_drift: tuple[float, ...] = ()  # one a camera: seconds of further lateness a second
    clock_epoch_s: tuple[float, ...] = ()  # one a camera: what its stamps say at the start
    stamp_jitter_s: float = 0.0  # standard deviation of every stamp
    dropped_share: float = 0.0  # of the pictures of every camera but the first, lost on the way to the disk
    doubled_share: float = 0.0  # of the files of every camera that hold the picture before once more
    starts_late_s: tuple[float, ...] = ()  # one a camera, the first 0: seconds without pictures at the start
    ends_early_s: tuple[float, ...] = ()  # one a camera, the first 0: seconds without pictures at the end

    def __post_init__(self) -> None:
        _require(self.seconds > 0 and self.fps > 0, f"seconds and fps must be positive: {self.seconds}, {self.fps}")
        _require(1 <= self.cameras <= 4, f"cameras must be 1 to 4, got {self.cameras}")
        _require(0 <= self.therapists <= 3, f"therapists must be 0 to 3, got {self.therapists}")
        _require(self.sensor in get_args(Sensor), f"sensor must be one of {get_args(Sensor)}, got {self.sensor}")
        _require(self.speed in get_args(Speed), f"speed must be one of {get_args(Speed)}, got {self.speed}")
        _require(len(self.motions) > 0, "motions must name at least one motion")
        for motion in self.motions:
            _require(motion in ("mixed", *MOTIONS), f"motion must be mixed or one of {MOTIONS}, got {motion}")
        clash = FRAMELESS_MOTIONS.intersection(self.motions) if self.standing_frame else frozenset()
        _require(not clash, f"{', '.join(sorted(clash))} does not fit into a standing frame; set standing_frame=False")
        _require(
            0 <= self.clothing_m <= THICKEST_CLOTHING_M,
            f"clothing_m must be 0 to {THICKEST_CLOTHING_M}, got {self.clothing_m}",
        )
        _require(
            self.hole_radius_m == 0 or SMALLEST_HOLE_M <= self.hole_radius_m <= LARGEST_HOLE_M,
            f"hole_radius_m must be 0 or {SMALLEST_HOLE_M} to {LARGEST_HOLE_M}, got {self.hole_radius_m}",
        )
        _require(
            self.standing_frame or not self.parallel_bars, "parallel bars stand in for the standing frame: ask for it"
        )
        _require(self.seed >= 0, f"seed must not be negative, got {self.seed}")
        _require(0 <= self.dropped_share < 1, f"dropped_share must be 0 to below 1, got {self.dropped_share}")
        _require(0 <= self.doubled_share < 1, f"doubled_share must be 0 to below 1, got {self.doubled_share}")
        _require(self.stamp_jitter_s >= 0, f"stamp_jitter_s must not be negative, got {self.stamp_jitter_s}")
        _require(0 <= self.hole_share <= 1, f"hole_share must be 0 to 1, got {self.hole_share}")
        _require(
            self.height_m is None or 1.45 <= self.height_m <= 2.0,
            f"height_m must be 1.45 to 2.0 (the bodies the shape space knows), got {self.height_m}",
        )
        for name in ("clock_late_s", "clock_drift", "clock_epoch_s", "starts_late_s", "ends_early_s"):
            values = getattr(self, name)
            _require(len(values) in (0, self.cameras), f"{name} needs one value a camera, got {len(values)}")
        for name in ("starts_late_s", "ends_early_s"):
            values = getattr(self, name)
            _require(
                not values or values[0] == 0, f"{name} must be 0 for the first camera: its frames number the truth"
            )
            _require(all(value >= 0 for value in values), f"{name} must not be negative, got {values}")
        _check_scene(self)
        missing_s = np.add(self.starts_late_s or [0.0], self.ends_early_s or [0.0])
        _require(bool((missing_s < self.seconds).all()), "a camera must run for some time of the recording")

    @property
    def frames(self) -> int:
        """Pictures of each camera."""
        return max(1, round(self.seconds * self.fps))


def _check_scene(config: SimulationConfig) -> None:
    """Raises ValueError where the patient cannot be away or hidden as asked."""
    times = [time_s for span in config.away_s for time_s in span]
    _require(times == sorted(times), f"away_s must be spans in the order of time, got {config.away_s}")
    _require(not (times and config.standing_frame), "a patient in a standing frame cannot walk out; set it to False")
    span = config.curtain_s or (0.0, 1.0)
    _require(span[0] < span[1], f"curtain_s must end after it begins, got {config.curtain_s}")


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise ValueError(problem)


def clinic(seed: int, seconds: float = 10.0, fps: float = 15.0) -> SimulationConfig:
    """Stand training: three cameras, a standing frame, two therapists."""
    return SimulationConfig(seed=seed, seconds=seconds, fps=fps)


def scene(config: SimulationConfig, name: Scene) -> SimulationConfig:
    """``config`` with what makes a tracker lose the patient: he is away at first or in the middle, hidden, or sits."""
    seconds = config.seconds
    free = replace(config, standing_frame=False, stool=False, motions=("squat", "reach"))
    match name:
        case "enters-late":
            return replace(free, away_s=((-1.0, 0.3 * seconds),))
        case "leaves":
            return replace(free, away_s=((0.4 * seconds, 0.65 * seconds),))
        case "hidden":
            return replace(config, curtain_s=(0.45 * seconds, 0.45 * seconds + HIDDEN_S))
        case "sits":
            return replace(config, standing_frame=False, stool=True, motions=("sit-to-stand", "reach"))


def rough_recorder(config: SimulationConfig) -> SimulationConfig:
    """``config`` recorded by devices that were not made to work together; how, is drawn from its seed."""
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(ROUGH_KEY,)))
    others = config.cameras - 1
    return replace(
        config,
        clock_late_s=(0.0, *rng.uniform(-2.0, 2.0, others).tolist()),
        clock_drift=(0.0, *rng.uniform(-1e-4, 1e-4, others).tolist()),
        stamp_jitter_s=0.004,
        dropped_share=0.03,
        doubled_share=0.03,
    )


def holes(seed: int, radius_m: float, seconds: float = 10.0, fps: float = 15.0) -> SimulationConfig:
    """The paper's experiment: one camera, one person, a hole at the body's centre in random frames (Section V)."""
    return SimulationConfig(
        seed=seed,
        seconds=seconds,
        fps=fps,
        cameras=1,
        standing_frame=False,
        stool=False,
        therapists=0,
        hole_radius_m=radius_m,
    )


def single(seed: int, seconds: float = 10.0, fps: float = 15.0) -> SimulationConfig:
    """One camera, one person, nothing in the way."""
    return SimulationConfig(
        seed=seed, seconds=seconds, fps=fps, cameras=1, standing_frame=False, stool=False, therapists=0
    )
