"""People who pass close to a camera, between it and the patient."""

from __future__ import annotations

import numpy as np

from anchorpose.camera import Camera
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.patient import Actor, draw_waves, resting_channels
from anchorpose.simulate.person import draw_person
from anchorpose.simulate.therapist import STANCE_M, WALK_STEP_S, Therapist
from anchorpose.simulate.timeline import Footwork, stance_places, walk

NEAREST_M, FARTHEST_M = 0.6, 1.5  # from the camera
BESIDE_M = 3.2  # where they come from and go to: outside the room
SLANTS_RAD = np.linspace(-0.6, 0.6, 25)  # of the course, against the way across
CLEAR_M = 0.7  # from the other cameras, where there is such a course
HALFWAY = (0.35, 0.65)  # of the recording: when they are before the camera


def draw_passer_by(
    rng: np.random.Generator, config: SimulationConfig, cameras: tuple[Camera, ...], camera: int | None = None
) -> Therapist:
    """Somebody who walks across the line from a camera, drawn where None, to the patient in mid-recording."""
    person = draw_person(rng, config.clothing_m)
    chosen = cameras[int(rng.integers(len(cameras))) if camera is None else camera]
    towards = -chosen.position_m[[0, 2]]
    away_m = float(np.linalg.norm(towards))
    towards = towards / away_m
    crossing = chosen.position_m[[0, 2]] + min(rng.uniform(NEAREST_M, FARTHEST_M), away_m - 1.0) * towards
    slant = rng.uniform(-0.25, 0.25)
    across = np.array([-towards[1], towards[0]]) * rng.choice([-1.0, 1.0])
    courses = np.cos(SLANTS_RAD)[:, None] * across + np.sin(SLANTS_RAD)[:, None] * towards
    others_m = np.array([other.position_m[[0, 2]] for other in cameras if other is not chosen]).reshape(-1, 2)
    course = courses[_clear_course(courses, crossing, others_m, slant)]
    start, goal = crossing - BESIDE_M * course, crossing + BESIDE_M * course
    facing = float(np.arctan2(-course[1], course[0]))
    standing = Footwork(stance_places(start, facing, STANCE_M), np.full(2, facing))
    steps = len(walk(standing, goal, facing, 0.0, WALK_STEP_S, STANCE_M).steps)
    start_s = rng.uniform(*HALFWAY) * config.seconds - 0.5 * steps * WALK_STEP_S
    footwork = walk(standing, goal, facing, start_s, WALK_STEP_S, STANCE_M)
    return Therapist(Actor(person, resting_channels(person, in_frame=False), [], footwork, draw_waves(rng)), None)


def _clear_course(courses: np.ndarray, crossing_m: np.ndarray, others_m: np.ndarray, slant: float) -> int:
    """The index of the course (n, 2) nearest to a slant that keeps clear of other cameras (k, 2) and of the patient.

    The one that comes least near to any where none keeps clear.
    """
    to_others = np.concatenate([others_m, np.zeros((1, 2))]) - crossing_m
    beside_m = np.abs(courses[:, :1] * to_others[:, 1] - courses[:, 1:] * to_others[:, 0]).min(axis=1)
    strayed = np.abs(SLANTS_RAD - slant)
    return int(np.argmin(np.where(beside_m >= CLEAR_M, strayed, 10.0 - beside_m)))
