"""Real recordings with an inertial sensor on the right thigh: the clock of its file is found from the thigh's movement.

What the clock truly is nobody has measured: images and sensor began within some tenths of a second of each other. It is
known from the tilt of the thigh, which the data set gives beside the accelerometer: the tilt of the tracked thigh is
moved in time until it fits best. The sensor's file has another start here, so that nothing is found by accident.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from anchorpose.cli import main
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.tables import JointTable, read_joints

pytestmark = pytest.mark.slow

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "utd_mhad"
SHIFT_S = 731.25

THERE_AND_BACK = ("a27_s1_t1_squat", "a27_s3_t1_squat", "a22_s1_t1_jog")
"""Movements that return: the tracked tilt's errors in them do not look like time."""

ONE_WAY = ("a25_s4_t1_stand_to_sit",)


def tilt_lag_s(joints: JointTable, imu) -> float:
    """How much later the sensor's clock is by the tilt of the thigh from rest, to 5 ms."""
    hip, knee = (joints.position_m[:, JOINT_INDEX[name]] for name in ("HipRight", "KneeRight"))
    along = (knee - hip) / np.linalg.norm(knee - hip, axis=1, keepdims=True)
    rest = np.mean(along[-4:] if str(imu["rest_at"]) == "end" else along[:4], axis=0)
    tilt_deg = np.degrees(np.arccos(np.clip(along @ rest / np.linalg.norm(rest), -1.0, 1.0)))
    lags_s = np.arange(-0.4, 0.401, 0.005)
    theirs = [np.interp(joints.time_s + lag, imu["time_s"], imu["angle_deg"]) for lag in lags_s]
    return float(lags_s[np.argmin([np.mean((tilt_deg - each) ** 2) for each in theirs])])


@pytest.fixture(scope="module", params=[*THERE_AND_BACK, *ONE_WAY])
def tracked(request, tmp_path_factory):
    if not (DATA / request.param).is_dir():
        pytest.skip(f"the recording {request.param} is for development only and is not here")
    folder = tmp_path_factory.mktemp(request.param)
    assert main(["track", str(DATA / request.param), "-o", str(folder / "results")]) == 0
    imu = np.load(DATA / request.param / "imu.npz")
    rows = np.column_stack([imu["time_s"] + SHIFT_S, imu["acc_g"], imu["gyro_deg_s"]])
    np.savetxt(folder / "imu.csv", rows, fmt="%.6f", delimiter=",", header="time_s,ax,ay,az,gx,gy,gz", comments="")
    return request.param, folder, imu


@pytest.mark.parametrize("way", [("--acceleration", "ax,ay,az"), ("--gyroscope", "gx,gy,gz")], ids=lambda way: way[0])
def test_the_clock_of_a_real_sensor_is_found(tracked, way, tmp_path):
    name, folder, imu = tracked
    options = ("--segment", "thigh_right", "--near", f"{SHIFT_S:g}", *way)
    assert main(["sync", str(folder / "results"), str(folder / "imu.csv"), "-o", str(tmp_path / "out"), *options]) == 0
    clock = json.loads((tmp_path / "out/clock.json").read_text(encoding="utf-8"))
    off_s = clock["offset_s"] - SHIFT_S - tilt_lag_s(read_joints(folder / "results/joints.parquet"), imu)
    assert abs(off_s) < 3.0 * clock["offset_sigma_s"]
    if name in THERE_AND_BACK:
        assert abs(off_s) < 0.03
    assert "another recording of the same exercise might fit" in clock["notes"][0]
