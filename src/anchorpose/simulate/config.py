"""Configure one simulated recording."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field

from anchorpose.settings import Count, NotNegative, Share, settings
from anchorpose.simulate.bodies import OtherBody
from anchorpose.simulate.choices import Equipment, LensName, Scene, Sensor, Speed
from anchorpose.simulate.movement_file import MOVEMENTS, STEPPING, SUBJECTS, movement_of
from anchorpose.simulate.rooms.plan import Posture, RoomConfig, draw_room_config, draw_sensor
from anchorpose.simulate.sessions.plan import SessionConfig

TaskName = Literal[
    "both knees from the front",
    "left knee and hip",
    "right knee and hip",
    "hips from behind",
    "trunk from behind",
    "left knee from the front",
    "right knee from the front",
]

MOTIONS: Final = (
    *("standing", "squat", "weight-shift", "trunk", "steps", "sit-to-stand"),
    *("reach", "arm-raise", "head", "rails"),
    "buckle",
)
"""Motions that a simulated patient can do. ``mixed`` draws motions of legs and arms together, from all except
``NAMED_ONLY``.
"""

NAMED_ONLY: Final = ("buckle",)
"""Motions that are simulated only if the user names them, since patients do not do them on purpose."""

BEHIND_AND_BEFORE: Final[tuple[TaskName, ...]] = ("trunk from behind", "both knees from the front")
FRAMELESS_MOTIONS: Final = frozenset({"sit-to-stand"})
"""Motions for which a standing frame with a knee bar leaves no space."""

SMALLEST_HOLE_M, LARGEST_HOLE_M = 0.03, 0.15  # m, limits of ``hole_radius_m``, from the paper that README.md cites
ROUGH_KEY, MOVEMENT_KEY, PLAN_KEY = 1000, 1001, 1003  # keys of random streams that are not in ``clinic.STREAMS``
ROOM_MOTIONS: Final[dict[Posture, tuple[tuple[str, ...], ...]]] = {
    "stands": (("mixed",), ("squat", "reach", "arm-raise"), ("weight-shift", "trunk", "steps", "head", "reach")),
    "sits": (("reach", "arm-raise"), ("reach", "head"), ("arm-raise", "head", "standing")),
    "stands-up": (("sit-to-stand", "reach"), ("sit-to-stand", "squat", "arm-raise"), ("sit-to-stand", "trunk", "head")),
}
# without "sit-to-stand", since ``RoomConfig.posture`` decides whether the patient sits
ROOM_MOVEMENTS: Final = tuple(name for name in MOVEMENTS if name != "sit-to-stand")
# share of the standing patients in cluttered rooms who do a captured movement, if a file of such movements is given
CAPTURED_SHARE: Final = 0.6
ABSENT_SHARE: Final = 0.15  # share of the recording after which a late patient comes into view
HIDDEN_S: Final = 2.0  # s, duration for which the patient is behind a curtain
LONGEST_S, HIGHEST_HZ = 24 * 3600.0, 1000.0  # s and Hz, maximum values of the settings ``seconds`` and ``fps``
# m, maximum height of the folds of clothes; higher folds would hide the body's shape
THICKEST_CLOTHING_M: Final = 0.015

ProperShare = Annotated[float, Field(ge=0, lt=1)]


@settings
class SimulationConfig:
    """The settings of one simulated recording. Equal settings give files that are equal byte for byte."""

    seed: Annotated[int, Field(ge=0)]
    seconds: Annotated[float, Field(gt=0, le=LONGEST_S)] = 10.0
    fps: Annotated[float, Field(gt=0, le=HIGHEST_HZ)] = 30.0  # Hz; 30 = the rate of every simulated sensor
    cameras: Annotated[int, Field(ge=1, le=4)] = 3  # number of cameras, in this order: in front, left, right, behind
    sensor: Sensor = "kinect-v2"  # default = the sensor of the paper that README.md cites
    sensors: tuple[Sensor, ...] = ()  # one sensor per camera; empty = every camera has ``sensor``
    lens: LensName | None = None  # lens of the sensor; None = the usual lens of its model
    equipment: Equipment = "standing-frame"
    chest_pad: bool = False  # whether the parallel bars have a chest pad, with straps around the hips
    equipment_moves_at_s: float | None = None  # s, time at which the equipment is pushed; None = never
    equipment_shift_m: tuple[float, float] = (0.0, 0.0)  # m, distances along X and Z by which the equipment is pushed
    stool: bool = True  # whether a patient who sits has a stool
    therapists: Annotated[int, Field(ge=0, le=3)] = 2  # number of therapists
    # tasks of the first therapists; the tasks of all further therapists are drawn
    therapist_tasks: tuple[TaskName, ...] = ()
    therapists_stay: bool = False  # True: all therapists are present in all frames
    # number of people who walk through the room, between a camera and the patient
    passers_by: Annotated[int, Field(ge=0, le=3)] = 0
    motions: Annotated[tuple[str, ...], Field(min_length=1)] = ("mixed",)
    movement_file: Path | None = None  # file of captured movements; if given, it replaces ``motions``
    movement: str | None = None  # one of ``MOVEMENTS`` in movement_file.py, or the name of a clip in the file
    subjects: tuple[int, ...] = SUBJECTS  # numbers of the subjects of ``movement_file`` whose movements may be drawn
    speed: Speed = "mixed"
    clothing_m: Annotated[float, Field(ge=0, le=THICKEST_CLOTHING_M)] = 0.009  # m, height of the folds of clothes
    away_s: tuple[tuple[float, float], ...] = ()  # s, start and end of each absence; the patient walks out and in again
    # s, start and end of the time in which a curtain hides the patient from all cameras; None = no curtain
    curtain_s: tuple[float, float] | None = None
    hole_radius_m: float = 0.0  # m, radius of the hole cut into some frames; 0 = no holes
    hole_share: Share = 0.5  # number of frames with a hole, as a share of all frames
    height_m: Annotated[float, Field(ge=1.0, le=2.0)] | None = None  # m; None = drawn, for adults from 1.5 to 1.9
    # the patient's body; by default, its shape is drawn at random from the asset's distribution of shapes
    body: OtherBody = OtherBody()
    pose_known: bool = True  # False: camera_to_world is null in recording.json
    # s, for each camera: true time of an image minus the time in its stamp
    clock_late_s: tuple[float, ...] = ()
    clock_drift: tuple[float, ...] = ()  # s per second, for each camera, by which ``clock_late_s`` grows
    clock_epoch_s: tuple[float, ...] = ()  # s, for each camera: time stamp at the start of the recording
    stamp_jitter_s: NotNegative = 0.0  # s, standard deviation of the error of every stamp
    # share of the depth images that are not written to the disk; the first camera writes all images
    dropped_share: ProperShare = 0.0
    doubled_share: ProperShare = 0.0  # share of each camera's files that contain the previous depth image again
    starts_late_s: tuple[NotNegative, ...] = ()  # s, per camera: time without images at the start; camera 0: 0
    ends_early_s: tuple[NotNegative, ...] = ()  # s, per camera: time without images at the end; camera 0: 0
    # per camera, a number n: the camera records only every n-th image; 1 for the first camera; empty = every image
    every: tuple[Count, ...] = ()
    room: RoomConfig | None = None  # a cluttered room seen by one camera; None = a plain training room
    session: SessionConfig | None = None  # trials with and without stimulation, which replace ``motions``

    def __post_init__(self) -> None:
        _check_equipment(self)
        _check_cameras(self)
        _check_scene(self)

    @property
    def frames(self) -> int:
        """Return the number of depth images of each camera."""
        return max(1, round(self.seconds * self.fps))

    def sensor_of(self, camera: int) -> Sensor:
        """Return the sensor that one camera imitates."""
        return self.sensors[camera] if self.sensors else self.sensor


def _check_equipment(config: SimulationConfig) -> None:
    """Raise ValueError if motions, captured movement, equipment and therapists' tasks do not fit together, or if the
    patient's height or the radius of holes in the depth images is outside its range.
    """
    for motion in config.motions:
        _require(motion in ("mixed", *MOTIONS), f"motion must be mixed or one of {MOTIONS}, got {motion}")
    captured = config.movement_file is not None
    # a captured movement is not tested: a standing frame is fitted around it and leaves space for it
    in_frame = config.equipment == "standing-frame" and not captured
    clash = FRAMELESS_MOTIONS.intersection(config.motions) if in_frame else frozenset()
    _require(not clash, f"{', '.join(sorted(clash))} does not fit into a standing frame; choose other equipment")
    _require(not config.chest_pad or config.equipment == "parallel-bars", "a chest pad needs parallel bars")
    _require((config.movement is None) != captured, "movement and movement_file belong together")
    _require(not captured or config.motions == ("mixed",), "a captured movement cannot follow motions as well")
    name = config.movement if config.movement is None else movement_of(config.movement)
    _require(
        config.movement is None or name is not None, f"movement must be one of {tuple(MOVEMENTS)} or a clip's name"
    )
    in_the_way = config.chest_pad or config.equipment in ("standing-frame", "walker", "wheelchair")
    _require(
        not (name in STEPPING and in_the_way), f"{name} needs room: choose none, sling or parallel-bars without pad"
    )
    shortest_m = 1.0 if config.body.build == "child" else 1.45
    _require(config.height_m is None or config.height_m >= shortest_m, f"an adult is at least {shortest_m} m tall")
    _require(len(config.therapist_tasks) <= config.therapists, "therapist_tasks needs a therapist for each task")
    _require(
        config.hole_radius_m == 0 or SMALLEST_HOLE_M <= config.hole_radius_m <= LARGEST_HOLE_M,
        f"hole_radius_m must be 0 or {SMALLEST_HOLE_M} to {LARGEST_HOLE_M}, got {config.hole_radius_m}",
    )


def _check_cameras(config: SimulationConfig) -> None:
    """Raise ValueError if the values given per camera do not fit the cameras."""
    for name in ("sensors", "clock_late_s", "clock_drift", "clock_epoch_s", "starts_late_s", "ends_early_s", "every"):
        values = getattr(config, name)
        _require(len(values) in (0, config.cameras), f"{name} needs one value per camera, got {len(values)}")
    for name in ("starts_late_s", "ends_early_s"):
        values = getattr(config, name)
        _require(not values or values[0] == 0, f"{name} must be 0 for the first camera: its frames number the truth")
    _require(config.every[:1] in ((), (1,)), "every must be 1 for the first camera: its frames number the truth")
    missing_s = np.add(config.starts_late_s or [0.0], config.ends_early_s or [0.0])
    _require(bool((missing_s < config.seconds).all()), "a camera must run for some time of the recording")


def _check_scene(config: SimulationConfig) -> None:
    """Raise ValueError if absences, curtain, room or session do not fit the other settings."""
    times = [time_s for span in config.away_s for time_s in span]
    _require(times == sorted(times), f"away_s must be spans in the order of time, got {config.away_s}")
    held = config.equipment != "none" or config.movement_file is not None
    _require(not (times and held), "a patient in equipment or with a captured movement cannot walk out")
    bare = config.cameras == 1 and not config.sensors and config.equipment == "none" and config.therapists == 0
    _require(config.room is None or bare, "a room needs one camera, no equipment and no therapists")
    late_only = config.curtain_s is None and all(span[0] <= 0.0 for span in config.away_s)
    _require(config.room is None or late_only, "in a room the patient can come late, but not leave or hide")
    span = config.curtain_s or (0.0, 1.0)
    otherwise = config.movement_file or config.room or config.motions != ("mixed",) or times or config.chest_pad
    fits = config.equipment in ("parallel-bars", "none") and not otherwise
    _require(config.session is None or fits, "a session needs parallel bars or no equipment, and no other movements")
    _require(config.session is None or config.therapists < 3, "a session has room for two therapists")
    _require(span[0] < span[1], f"curtain_s must end after it begins, got {config.curtain_s}")


def _require(holds: bool, problem: str) -> None:
    if not holds:
        raise ValueError(problem)


def clinic(seed: int, seconds: float = 10.0, fps: float = 15.0) -> SimulationConfig:
    """Return the settings of stand training with three cameras, a standing frame and two therapists."""
    return SimulationConfig(seed=seed, seconds=seconds, fps=fps)


def scene(config: SimulationConfig, name: Scene) -> SimulationConfig:
    """Return ``config`` with a patient who is hard to track: absent at first or later, behind a curtain, or seated.

    A patient who walks or sits has no standing frame. Raises ValueError if other equipment keeps the patient from
    walking, or if the configuration has a captured movement.
    """
    seconds = config.seconds
    equipment: Equipment = "none" if config.equipment == "standing-frame" else config.equipment
    free = replace(config, equipment=equipment, stool=False, motions=("squat", "reach"))
    match name:
        case "enters-late":
            return replace(free, away_s=((-1.0, 0.3 * seconds),))
        case "leaves":
            # the walk out has the first 0.4 of the recording, and the walk back has the last 0.4
            return replace(free, away_s=((0.4 * seconds, 0.6 * seconds),))
        case "hidden":
            return replace(config, curtain_s=(0.45 * seconds, 0.45 * seconds + HIDDEN_S))
        case "sits":
            return replace(config, equipment=equipment, stool=True, motions=("sit-to-stand", "reach"))


def rough_recorder(config: SimulationConfig) -> SimulationConfig:
    """Return ``config`` with unsynchronised cameras that lose images; the seed determines clock errors and losses."""
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
    """Return settings for the experiment in Section VI of the paper that README.md cites: one camera and one person; in
    random frames, the depth image has a hole around the body's centre.
    """
    return SimulationConfig(
        seed=seed,
        seconds=seconds,
        fps=fps,
        cameras=1,
        equipment="none",
        stool=False,
        therapists=0,
        hole_radius_m=radius_m,
    )


def single(seed: int, seconds: float = 10.0, fps: float = 15.0) -> SimulationConfig:
    """Return settings of a recording with one camera, one person and nothing that hides the person."""
    return SimulationConfig(seed=seed, seconds=seconds, fps=fps, cameras=1, equipment="none", stool=False, therapists=0)


def room(seed: int, seconds: float = 10.0, fps: float = 15.0, movement_file: Path | None = None) -> SimulationConfig:
    """Draw the settings of a cluttered room seen by one camera whose pose the recording does not state.

    If a file of captured movements is given, some patients do one of its movements.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(PLAN_KEY,)))
    height_m, sensor = rng.uniform(1.5, 1.9), draw_sensor(rng)
    plan = draw_room_config(rng, sensor, height_m)
    movement = str(rng.choice(ROOM_MOVEMENTS))
    captured = (
        movement_file is not None and plan.posture == "stands" and not plan.late and rng.random() < CAPTURED_SHARE
    )
    return SimulationConfig(
        seed=seed,
        seconds=seconds,
        fps=fps,
        cameras=1,
        sensor=sensor,  # type: ignore[arg-type]
        equipment="none",
        stool=plan.posture != "stands",
        therapists=0,
        passers_by=plan.passers_by,
        motions=("mixed",) if captured else ROOM_MOTIONS[plan.posture][int(rng.integers(3))],
        movement_file=movement_file if captured else None,
        movement=movement if captured else None,
        away_s=((-1.0, ABSENT_SHARE * seconds),) if plan.late else (),
        height_m=height_m,
        pose_known=False,
        room=plan,
    )


def rehabilitation(
    config: SimulationConfig, movement_file: Path, movement: str | None, equipment: Equipment, passers_by: int = 0
) -> SimulationConfig:
    """Return ``config`` with a captured movement, which has already begun when the recording begins. movement: None =
    drawn by the seed.

    In parallel bars, the patient has a chest pad and straps, a therapist behind, and a therapist in front who holds the
    knees. For a movement with steps or a raised leg, pad, straps and the therapist in front are left out.
    """
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(MOVEMENT_KEY,)))
    roomy = equipment in ("none", "sling", "parallel-bars")
    drawn = str(rng.choice([name for name in MOVEMENTS if roomy or name not in STEPPING]))
    movement = drawn if movement is None else movement
    in_bars, steps = equipment == "parallel-bars", movement_of(movement) in STEPPING
    tasks = BEHIND_AND_BEFORE if in_bars else ()
    if steps:  # no therapist kneels in front of a leg that is raised
        config, tasks = replace(config, therapists=min(config.therapists, 1)), BEHIND_AND_BEFORE[:1]
    return replace(
        config,
        movement_file=movement_file,
        movement=movement,
        equipment=equipment,
        chest_pad=in_bars and not steps,
        stool=not in_bars,
        therapist_tasks=tasks[: config.therapists],
        therapists_stay=True,
        passers_by=passers_by,
    )
