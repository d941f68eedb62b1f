"""Suites of rooms seen by one camera at an unknown place: whole recordings, and the first pose from one frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
import scores
from recordings import MOVEMENTS, OneFrame, Simulated
from suite import Case, Use

from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate import config as presets
from anchorpose.simulate.config import SimulationConfig as Config
from anchorpose.simulate.rooms.plan import RoomConfig

# rooms: cluttered rooms seen by one camera at an unknown place

ROOM_SEED: Final[dict[Use, int]] = {"tuning": 51_000, "held-out": 52_000}


def rooms(use: Use, quick: bool) -> Iterator[Case]:
    """Yield 40 rooms, seen by sensors that filter their depth or do not; the patient is pointed out as by a user."""
    for seed in range(ROOM_SEED[use], ROOM_SEED[use] + (4 if quick else 40)):
        config = presets.room(seed, 6.0, 15.0, MOVEMENTS if MOVEMENTS.is_file() else None)
        filtered = "filtered" if config.sensor.endswith("filtered") else "not filtered"
        recording = Simulated(f"room-{seed}", config)
        yield Case(f"rooms, depth {filtered}", recording, scores.in_a_room, scores.name_patient, scores.not_found)


# starts: the first pose from a single frame


def _highest_hands(joints_m: np.ndarray) -> int:
    hands = joints_m[:, [JOINT_INDEX["WristLeft"], JOINT_INDEX["WristRight"]], 1]
    return int(np.argmax(hands.min(axis=1)))


def _lowest_pelvis(joints_m: np.ndarray) -> int:
    return int(np.argmin(joints_m[:, JOINT_INDEX["SpineBase"], 1]))


def _middle(joints_m: np.ndarray) -> int:
    return len(joints_m) // 2


def _before(seed: int, seconds: float, motions: tuple[str, ...], **room: Any) -> Config:
    """Return the settings of a bare room with a camera at a set place, from which the patient may be turned away."""
    rng = np.random.default_rng(seed)
    plan = RoomConfig(**({"distance_m": rng.uniform(2.2, 3.2), "camera_height_m": 1.2, "tilt_rad": 0.08} | room))
    base = presets.single(seed, seconds)
    return replace(base, motions=motions, room=plan, pose_known=False, stool=plan.posture != "stands")


ALONG: Final = ("squat", "reach", "weight-shift")
STARTS: Final[dict[str, tuple[Callable[[int], Config], Callable[[np.ndarray], int]]]] = {
    "arms raised": (lambda seed: _before(seed, 4.0, ("arm-raise",)), _highest_hands),
    "squat": (lambda seed: _before(seed, 4.0, ("squat",)), _lowest_pelvis),
    "seated": (lambda seed: _before(seed, 2.0, ("reach", "head"), posture="sits", seat="chair"), _middle),
    "turned by a quarter": (lambda seed: _before(seed, 2.0, ALONG, azimuth_rad=(-1) ** seed * np.pi / 2), _middle),
    "turned away": (lambda seed: _before(seed, 2.0, ALONG, azimuth_rad=np.pi), _middle),
    "feet cut off": (
        lambda seed: _before(seed, 2.0, ALONG, distance_m=1.5, camera_height_m=1.4, tilt_rad=0.0),
        _middle,
    ),
}
START_SEED: Final[dict[Use, int]] = {"tuning": 71_000, "held-out": 73_000}


def starts(use: Use, quick: bool) -> Iterator[Case]:
    """Yield single frames of a person in a bare room, in postures and from sides that make the first pose difficult."""
    for title in STARTS:
        for seed in range(START_SEED[use], START_SEED[use] + (1 if quick else 10)):
            yield Case(
                f"one frame: {title}", start_of(title, seed), scores.in_a_room, scores.name_patient, scores.not_found
            )


def start_of(title: str, seed: int) -> OneFrame:
    make, moment = STARTS[title]
    return OneFrame(Simulated(f"start-{title.replace(' ', '_')}-{seed}", make(seed)), moment)
