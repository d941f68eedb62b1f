"""Score how well the clock of a real inertial sensor on the thigh is found, and how often a wrong file is refused.

The sensor's clock was not measured. The right offset is known from the tilt of the thigh, which the data set gives in
addition to the acceleration (``tests/sync/test_real_sensor.py``). The wrong files are those of all recordings of other
exercises.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from recordings import DATA, Ready
from suite import Scores

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX
from anchorpose.options import SyncSettings
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.sync.synchronising import synchronise

SENSORS: Final = DATA / "utd_mhad"
SHIFT_S: Final = 731.25  # added to the times of the sensor's file; the search does not know it
WAYS: Final = {"acceleration": ("ax", "ay", "az"), "gyroscope": ("gx", "gy", "gz")}
SIGMAS: Final = 3.0


def sensor_clock(ready: Ready, results: Path) -> Iterator[tuple[str, Scores]]:
    """Yield per signal (``WAYS``), without and with a rough offset, whether the clock was found and its error (ms)."""
    own = ready.recording.name
    lag_s = tilt_lag_s(read_joints(results / JOINTS_FILE), np.load(SENSORS / own / "imu.npz"))
    with TemporaryDirectory() as folder:
        for way in WAYS:
            for title, near in ((way, None), (f"{way}, --near", SHIFT_S)):
                yield title, _scores(found(results, write_csv(Path(folder), own), way, near), lag_s)
            others = (path.name for path in sorted(SENSORS.glob("a*")) if path.name[:3] != own[:3])
            wrong = [found(results, write_csv(Path(folder), other), way, None) is not None for other in others]
            yield f"{way}, files of other exercises", {"not_refused_percent": 100.0 * float(np.mean(wrong))}


def _scores(one: tuple[float, float] | None, lag_s: float) -> Scores:
    if one is None:
        return {"found_percent": 0.0}
    off_s, sigma_s = abs(one[0] - lag_s), one[1]
    return {"found_percent": 100.0, "off_ms": 1e3 * off_s, "in_3_sigma_percent": 100.0 * (off_s < SIGMAS * sigma_s)}


def tilt_lag_s(joints: JointTable, imu: Any) -> float:
    """Return the lag of the sensor's clock in s, to 5 ms, at which both tilts of the thigh from rest agree best."""
    hip, knee = (joints.position_m[:, JOINT_INDEX[name]] for name in ("HipRight", "KneeRight"))
    along = (knee - hip) / np.linalg.norm(knee - hip, axis=1, keepdims=True)
    known = np.isfinite(along).all(axis=1)
    along, time_s = along[known], joints.time_s[known]
    rest = np.mean(along[-4:] if str(imu["rest_at"]) == "end" else along[:4], axis=0)
    tilt_deg = np.degrees(np.arccos(np.clip(along @ rest / np.linalg.norm(rest), -1.0, 1.0)))
    lags_s = np.arange(-0.6, 0.601, 0.005)
    theirs = [np.interp(time_s + lag, imu["time_s"], imu["angle_deg"]) for lag in lags_s]
    return float(lags_s[np.argmin([np.mean((tilt_deg - each) ** 2) for each in theirs])])


def write_csv(folder: Path, name: str) -> Path:
    """Write the sensor's file of a recording, with ``SHIFT_S`` added to its times."""
    imu, path = np.load(SENSORS / name / "imu.npz"), folder / f"{name}.csv"
    if not path.exists():
        rows = np.column_stack([imu["time_s"] + SHIFT_S, imu["acc_g"], imu["gyro_deg_s"]])
        np.savetxt(path, rows, fmt="%.6f", delimiter=",", header="time_s,ax,ay,az,gx,gy,gz", comments="")
    return path


def found(results: Path, other: Path, way: str, near: float | None) -> tuple[float, float] | None:
    """Return the found offset less ``SHIFT_S``, and its sigma, in s; None if the file is refused."""
    settings = SyncSettings(segment="thigh_right", near=near, **{way: WAYS[way]})
    try:
        clock = synchronise(results, other, settings).clock
    except InputError:
        return None
    return clock.offset_s - SHIFT_S, clock.offset_sigma_s
