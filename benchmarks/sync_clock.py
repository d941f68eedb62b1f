"""Find the clock of real inertial sensors on the thigh, and of wrong files.

    python benchmarks/sync_clock.py OUT [NAME...]

Each recording of ../shared/data/utd_mhad, or each that is named, is tracked into OUT, unless it is there already. What
is right is known from the tilt of the thigh, which the data set gives beside the accelerometer: see
tests/sync/test_real_sensor.py. The wrong files are those of all recordings of other exercises.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX
from anchorpose.options import SyncSettings
from anchorpose.results.tables import JointTable, read_joints
from anchorpose.sync.synchronising import synchronise

DATA: Final = Path(__file__).resolve().parents[2] / "shared" / "data" / "utd_mhad"
SHIFT_S: Final = 731.25
WAYS: Final = {"acceleration": ("ax", "ay", "az"), "gyroscope": ("gx", "gy", "gz")}


def tilt_lag_s(joints: JointTable, imu: Any) -> float:
    """How much later the sensor's clock is by the tilt of the thigh from rest, to 5 ms."""
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
    """The sensor's file of a recording, on a clock with another start."""
    imu, path = np.load(DATA / name / "imu.npz"), folder / f"{name}.csv"
    rows = np.column_stack([imu["time_s"] + SHIFT_S, imu["acc_g"], imu["gyro_deg_s"]])
    np.savetxt(path, rows, fmt="%.6f", delimiter=",", header="time_s,ax,ay,az,gx,gy,gz", comments="")
    return path


def found(results: Path, other: Path, way: str, near: float | None) -> tuple[float, float] | None:
    """Offset without the other start, and its sigma, in ms; None where it is refused."""
    settings = SyncSettings(segment="thigh_right", near=near, **{way: WAYS[way]})
    try:
        clock = synchronise(results, other, settings).clock
    except InputError:
        return None
    return 1e3 * (clock.offset_s - SHIFT_S), 1e3 * clock.offset_sigma_s


def run(out: Path, names: list[str]) -> None:
    """Print a row per recording and the sums."""
    out.mkdir(parents=True, exist_ok=True)
    files = {name: write_csv(out, name) for name in sorted(path.name for path in DATA.glob("a*"))}
    kinds = {f"{way}{', near' if near else ''}": (way, near) for way in WAYS for near in (None, SHIFT_S)}
    off: dict[str, list[tuple[float, float]]] = {kind: [] for kind in kinds}
    accepted = {way: [0, 0] for way in WAYS}
    for name in names or list(files):
        results = out / name
        if not results.exists() and main(["track", str(DATA / name), "-o", str(results)]):
            print(f"{name}: not tracked")
            continue
        lag_ms = 1e3 * tilt_lag_s(read_joints(results / "joints.parquet"), np.load(DATA / name / "imu.npz"))
        cells = [f"tilt {lag_ms:5.0f}"]
        for kind, (way, near) in kinds.items():
            one = found(results, files[name], way, near)
            cells.append(
                f"{kind} {'refused' if one is None else f'{one[0]:.0f} ± {one[1]:.0f} ({one[0] - lag_ms:+.0f})'}"
            )
            if one is not None:
                off[kind].append((one[0] - lag_ms, one[1]))
        for way in WAYS:
            others = [file for other, file in files.items() if other[:3] != name[:3]]
            accepted[way][0] += sum(found(results, file, way, None) is not None for file in others)
            accepted[way][1] += len(others)
        print(f"{name:28s} {' | '.join(cells)}", flush=True)
    for kind, rows in off.items():
        if rows:
            error, sigma = np.array(rows).T
            size = np.abs(error)
            print(
                f"{kind}: {len(rows)} found; off by {np.median(size):.0f} ms in the median, {size.max():.0f} at most, "
                f"{(size < 30).sum()} below 30, {(size < 3 * sigma).sum()} within 3 sigma"
            )
    for way, (wrong, count) in accepted.items():
        print(f"{way}: {wrong} of {count} files of other exercises were not refused")


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    run(Path(sys.argv[1]), sys.argv[2:])
