"""A simulated patient with an inertial sensor on the right thigh: results, and the sensor's file on its own clock.

The sensor sits on the skin, 8 cm off the bone, turned at random; it has noise and a constant error. Results are the
true joints with errors that change over a fifth of a second, as the tracker's do.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from results_builder import make_frame, write_results
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate.config import single
from anchorpose.simulate.patient import draw_patient
from anchorpose.simulate.person import draw_person

RESULTS_HZ: Final = 30.0
SENSOR_HZ: Final = 100.0
ERROR_M: Final = 0.006
GRAVITY: Final = np.array([0.0, 9.81, 0.0])


@dataclass(frozen=True, slots=True, eq=False)
class Sensor:
    """Results, and the sensor's own measurement: the true clock is ``t * (1 + drift) + offset_s``."""

    results: Path
    time_s: np.ndarray  # (n,) on the clock of the results
    acceleration: np.ndarray  # (n, 3) in g
    gyroscope: np.ndarray  # (n, 3) in degrees per second
    offset_s: float
    drift: float

    @property
    def clock_s(self) -> np.ndarray:
        """The sensor's times on its own clock."""
        return self.true_s(self.time_s)

    def true_s(self, time_s: np.ndarray) -> np.ndarray:
        """What the sensor's clock shows at times of the results."""
        return time_s * (1.0 + self.drift) + self.offset_s

    def write_csv(self, path: Path, chosen: slice = slice(None)) -> Path:
        """The sensor's file with accelerometer and gyroscope."""
        rows = np.column_stack([self.clock_s, self.acceleration, self.gyroscope])[chosen]
        np.savetxt(path, rows, fmt="%.6f", delimiter=",", header="time_s,ax,ay,az,gx,gy,gz", comments="")
        return path


def make_sensor(folder: Path, seed: int, seconds: float) -> Sensor:
    """A patient who squats and reaches, with the sensor strapped to the right thigh."""
    rng = np.random.default_rng([seed, 2])
    config = single(seed, seconds=seconds)
    person = draw_person(rng, config.clothing_m)
    actor = draw_patient(rng, config, person, None)
    results_s, sensor_s = (np.arange(0.0, seconds, 1.0 / hz) for hz in (RESULTS_HZ, SENSOR_HZ))
    joints = np.stack([person.body.joints(bones) for bones in actor.bones(results_s)])
    noise = gaussian_filter1d(rng.normal(size=joints.shape), 0.2 * RESULTS_HZ, axis=0)
    measured = joints + ERROR_M * noise / noise.std(axis=0) + rng.normal(scale=0.002, size=joints.shape)
    frames = [make_frame(k, float(t), place) for k, (t, place) in enumerate(zip(results_s, measured, strict=True))]
    thigh = actor.bones(sensor_s)[:, person.body.asset.bone("RightUpLeg")]
    hip, knee = (joints[0, JOINT_INDEX[name]] for name in ("HipRight", "KneeRight"))
    force, rate = _measurement(thigh, 0.4 * hip + 0.6 * knee + np.array([0.08, 0.0, 0.02]))
    mounting = Rotation.random(random_state=seed).as_matrix()
    return Sensor(
        write_results(folder / "results", frames),
        sensor_s,
        (force @ mounting + rng.normal(scale=0.2, size=force.shape) + rng.normal(scale=0.3, size=3)) / 9.81,
        np.degrees(rate @ mounting + rng.normal(scale=0.02, size=rate.shape) + rng.normal(scale=0.02, size=3)),
        float(rng.uniform(-100.0, 300.0)),
        float(rng.uniform(-1e-4, 1e-4)),
    )


def _measurement(T_world_rest: np.ndarray, place_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Specific force and angular velocity (n, 3) in the bone's axes; place_m (3,): of the sensor in the first frame."""
    turn = T_world_rest[:, :3, :3]
    path_m = (T_world_rest @ np.linalg.inv(T_world_rest[0]) @ np.append(place_m, 1.0))[:, :3]
    step_s = 1.0 / SENSOR_HZ
    force = np.gradient(np.gradient(path_m, step_s, axis=0), step_s, axis=0) + GRAVITY
    change = np.gradient(turn.reshape(-1, 9), step_s, axis=0).reshape(-1, 3, 3)
    rate = np.einsum("nij,nik->njk", turn, change)
    rate = np.stack([rate[:, 2, 1], rate[:, 0, 2], rate[:, 1, 0]], axis=1)
    return np.einsum("nij,ni->nj", turn, force), rate
