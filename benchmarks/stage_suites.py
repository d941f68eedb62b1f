"""Suites of single stages and of parts of the program beside tracking, measured by the scripts in ``probes``."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Final, get_args

import numpy as np
from recordings import MOVEMENTS, Drawn, Real, Simulated
from scores import labelled_sequences
from suite import Case, Probe, Use

from anchorpose.simulate import config as presets
from anchorpose.simulate.config import SimulationConfig

FIRST_SEED: Final[dict[str, dict[Use, int]]] = {
    "calibration": {"tuning": 1, "held-out": 401},
    "placing": {"tuning": 601, "held-out": 651},
    "clocks": {"tuning": 501, "held-out": 551},
    "isolation": {"tuning": 501, "held-out": 601},
    "equipment": {"tuning": 1, "held-out": 111},
    "given-poses": {"tuning": 61_000, "held-out": 61_200},
    "laboratory": {"tuning": 100, "held-out": 300},
    "live": {"tuning": 101, "held-out": 245},
    "descriptor": {"tuning": 901, "held-out": 941},
}


def _seeds(scenes: str, use: Use, count: int) -> range:
    first = FIRST_SEED[scenes][use]
    return range(first, first + count)


STANDING_EQUIPMENT: Final[tuple[presets.Equipment, ...]] = ("standing-frame", "parallel-bars", "walker")


def calibration(use: Use, quick: bool) -> Iterator[Case]:
    """Yield clinics whose cameras are found from the equipment, and clinics without equipment."""
    sensors = get_args(presets.Sensor)
    for seed in _seeds("calibration", use, 1 if quick else 20):
        turn, number = divmod(seed, len(sensors))
        equipment = STANDING_EQUIPMENT[(number + turn) % len(STANDING_EQUIPMENT)]  # each turn has other equipment
        config = SimulationConfig(seed=seed, seconds=4.0, fps=4.0, sensor=sensors[number], equipment=equipment)
        title = "from the equipment, depth " + ("filtered" if config.sensor.endswith("filtered") else "not filtered")
        yield Case(title, Simulated(f"calibration-{seed}", config), probe=Probe("calibration"))
    for seed in _seeds("placing", use, 0 if quick else 6):
        recording = Simulated(f"placing-{seed}", presets.clinic(seed, 60.0, 1.0))
        yield Case("from floor and people", recording, probe=Probe("camera_to_camera"))


def clocks(use: Use, quick: bool) -> Iterator[Case]:
    """Yield clinics whose cameras' clocks are off by up to 2 s and drift by up to 100 parts in a million."""
    for fps in (30.0, 15.0):
        for seed in _seeds("clocks", use, 1 if quick else 4):
            rng = np.random.default_rng(seed)
            late_s, drift = (0.0, *rng.uniform(-2.0, 2.0, 2)), (0.0, *rng.uniform(-1e-4, 1e-4, 2))
            config = replace(presets.clinic(seed, 600.0, fps), clock_late_s=late_s, clock_drift=drift)
            yield Case(f"{fps:g} Hz", Drawn(f"clocks-{fps:g}-{seed}", config), probe=Probe("clocks"))


def isolation(use: Use, quick: bool) -> Iterator[Case]:
    """Yield clinics with two therapists who walk in, hold the patient, and leave."""
    for seed in _seeds("isolation", use, 1 if quick else 6):
        recording = Simulated(f"isolation-{seed}", presets.clinic(seed, 4.0))
        yield Case("clinic", recording, probe=Probe("isolation"))


def descriptor(use: Use, quick: bool) -> Iterator[Case]:
    """Yield people alone, clinics, people in rooms, and things; the learnt descriptor never saw these images."""
    movements = MOVEMENTS if MOVEMENTS.is_file() else None
    for seed in _seeds("descriptor", use, 1 if quick else 8):
        room = presets.room(seed, 6.0, 15.0, movements)
        filtered = "filtered" if room.sensor.endswith("filtered") else "not filtered"
        for title, config in (
            ("one camera, nobody else", presets.single(seed, 6.0)),
            ("clinic: three cameras, frame, two therapists", presets.clinic(seed, 6.0)),
            (f"rooms, depth {filtered}", room),
        ):
            yield Case(title, Drawn(f"descriptor-{title[:4]}-{seed}", config), probe=Probe("descriptor"))
        sensor: presets.Sensor = "realsense" if seed % 2 else "kinect-v2"
        things = Drawn(f"descriptor-things-{seed}", replace(presets.single(seed), sensor=sensor))
        yield Case("nobody", things, probe=Probe("not_people"))
    for folder in ("people_in_line", "five_people", "realsense_board", "iit_rehab_room"):
        yield Case(f"real: {folder}", Real(folder), probe=Probe("people_found"))
    for sequence in labelled_sequences()[:: 8 if quick else 1]:
        yield Case("real: MSR Action3D, labels", Real(f"msr_action3d/{sequence}"), probe=Probe("described_joints"))


def equipment(use: Use, quick: bool) -> Iterator[Case]:
    """Yield empty rooms with each kind of equipment; each seed has other places of the cameras and another sensor, out
    of those without filters.
    """
    sensors = [sensor for sensor in get_args(presets.Sensor) if not sensor.endswith("filtered")]
    for seed in _seeds("equipment", use, 1 if quick else 6):
        for kind in (*STANDING_EQUIPMENT, "wheelchair"):
            config = replace(presets.clinic(seed, 0.1), equipment=kind, sensor=sensors[seed % len(sensors)])
            yield Case(kind.replace("-", " "), Simulated(f"equipment-{kind}-{seed}", config), probe=Probe("equipment"))


GIVEN_SENSORS: Final[tuple[presets.Sensor, ...]] = (
    "kinect-v2",
    "femto-bolt",
    "realsense",
    "kinect-v2",
    "azure-kinect",
    "xtion",
    "kinect-v2",
    "d435",
    "kinect-v2",
    "realsense-filtered",
    "kinect-v2",
    "iphone-lidar",
)
GIVEN_EQUIPMENT: Final[tuple[presets.Equipment, ...]] = (
    "standing-frame",
    "parallel-bars",
    "standing-frame",
    "none",
    "none",
    "parallel-bars",
    "walker",
    "standing-frame",
    "wheelchair",
    "none",
    "none",
    "standing-frame",
)
MIXED: Final[tuple[presets.Sensor, ...]] = ("femto-bolt", "realsense", "kinect-v2")
MIXED_CLINICS: Final = (1, 6)


def given_poses(use: Use, quick: bool) -> Iterator[Case]:
    """Yield twelve clinics with different cameras, equipment and therapists; the probe makes camera poses wrong."""
    for number in range(1 if quick else len(GIVEN_SENSORS)):
        config = replace(
            presets.clinic(FIRST_SEED["given-poses"][use] + number, 6.0, 3.0),
            sensor=GIVEN_SENSORS[number],
            sensors=MIXED if number in MIXED_CLINICS else (),
            equipment=GIVEN_EQUIPMENT[number],
            therapists=number % 3,
            stool=number % 2 == 0,
        )
        yield Case("spoilt", Simulated(f"given-poses-{config.seed}", config), probe=Probe("given_poses"))


def laboratory(use: Use, quick: bool) -> Iterator[Case]:
    """Yield patients, one minute each; the probe simulates a laboratory's markers, clock and coordinate frame."""
    for seed in _seeds("laboratory", use, 1 if quick else 30):
        recording = Drawn(f"laboratory-{seed}", presets.single(seed, seconds=60.0))
        yield Case("one minute", recording, probe=Probe("laboratory"))


def live(use: Use, quick: bool) -> Iterator[Case]:
    """Yield recordings that are played at their own pace, long enough that tracking catches up with the images."""
    seed, seconds = FIRST_SEED["live"][use], 10.0 if quick else 30.0
    clinic = presets.clinic(seed, seconds)
    for title, config in (
        ("one camera, nobody else", presets.single(seed, seconds)),
        ("clinic, three cameras", clinic),
        ("clinic, front camera alone", replace(clinic, cameras=1)),
    ):
        name = f"live-{title.replace(' ', '_').replace(',', '')}-{seed}-{seconds:g}"
        yield Case(title, Simulated(name, config), probe=Probe("live"))
