"""How far off the joints are in simulated rooms: python benchmarks/room_accuracy.py ROOMS --results RESULTS.

ROOMS is what ``room_scenes.py --out`` wrote. The patient is named with --patient in the first frame in plain view, as a
user would; the poses of camera and world are the program's own, so joints are compared in the camera's frame. A room
whose results are there is not tracked again. By room: whether the first pose is right (every joint that is seen is
within 100 mm, in some frame of the first second of plain view), whether a wrong one was accepted (the mean of the seen
joints is over 150 mm off in all of them), the share of joints lost in plain view, the mean of all joints that are not,
in mm, and of those seen, and joints over 100 mm off and outside of four sigma.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.camera import invert_rigid, transform_points
from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_INDEX
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.recording.reader import open_recording
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.threads import one_thread
from anchorpose.tracker.preparation import settle

SEEN: Final = 0.5  # of the skin around a joint that faces the camera
PLAIN: Final = 0.6  # of the trunk's and head's joints
RIGHT_M, WRONG_M, FAR_M = 0.10, 0.15, 0.10
FAR_SIGMAS: Final = 4.0
TRUNK: Final = [JOINT_INDEX[name] for name in ("SpineMid", "SpineShoulder", "Head", "ShoulderLeft", "ShoulderRight")]


@dataclass(frozen=True, slots=True)
class Row:
    """One room; NaN where nothing was tracked. why: what the program said where it refused the whole recording."""

    room: str
    right: float
    wrong: float
    lost: float
    mean_mm: float
    seen_mm: float
    confident: float
    why: str = ""

    def line(self) -> str:
        """A line of the table."""
        shares = (f"{100 * self.lost:.0f}", f"{1000 * self.mean_mm:.1f}", f"{1000 * self.seen_mm:.1f}")
        cells = [self.room, f"{self.right:.0f}", f"{self.wrong:.0f}", *shares, f"{100 * self.confident:.2f}", self.why]
        return "| " + " | ".join(cells) + " |"


HEAD: Final = "| room | right | wrong | lost % | mm | seen mm | confident % | |\n|---|--:|--:|--:|--:|--:|--:|---|"


def in_plain_view(seen_share: np.ndarray) -> np.ndarray:
    """(t,) bool: frames in which most of trunk and head is seen; seen_share (t, 21, cameras)."""
    return np.asarray((seen_share[:, TRUNK].max(axis=2) > SEEN).mean(axis=1) >= PLAIN)


def named(recording: Path, truth_m: np.ndarray, plain: np.ndarray) -> tuple[tuple[float, float], int]:
    """The patient's place in the program's own world, and the frame, in which a user would name the patient.

    truth_m (t, 21, 3) in the camera's frame.
    """
    opened = open_recording(recording)
    camera = settle(opened, TrackConfig()).calibration.cameras[0]
    first = int(np.argmax(plain))
    place = transform_points(camera.require_pose(), truth_m[first, JOINT_INDEX["SpineBase"]])
    return (float(place[0]), float(place[2])), int(opened.streams[0].frame[first])


def track_room(room: Path, results: Path) -> Row | None:
    """None where the patient is never in plain view."""
    with np.load(room / "truth" / "truth.npz") as file:
        truth = {key: file[key] for key in ("joints", "seen_share", "camera_to_world", "time")}
    truth_m = transform_points(invert_rigid(truth["camera_to_world"][0]), truth["joints"])
    plain = in_plain_view(truth["seen_share"])
    if not plain.any():
        return None
    out = results / room.name
    nothing = (float("nan"),) * 3
    try:
        with one_thread():
            if not (out / RUN_FILE).exists():
                out.mkdir(parents=True, exist_ok=True)
                place, frame = named(room / "recording", truth_m, plain)
                config = replace(TrackConfig(), patient_xz_m=place, patient_frame=frame)
                track_recording(room / "recording", out, config, lambda _done, _total: None)
    except AnchorposeError as error:
        return Row(room.name, 0, 0, 1.0, *nothing, why=str(error)[-80:])
    table, run = read_joints(out / JOINTS_FILE), read_run(out / RUN_FILE)
    T_world_camera = np.array(run["cameras"][0]["camera_to_world"])
    own_m = transform_points(invert_rigid(T_world_camera), table.position_m)
    off_m = np.linalg.norm(own_m - truth_m[table.frame], axis=2)
    return _row(room.name, off_m, table.sigma_m, truth["seen_share"][table.frame], plain[table.frame], truth["time"])


def _row(
    name: str, off_m: np.ndarray, sigma_m: np.ndarray, seen_share: np.ndarray, plain: np.ndarray, time_s: np.ndarray
) -> Row:
    seen, first = seen_share.max(axis=2) > SEEN, int(np.argmax(plain))
    second = np.flatnonzero((time_s >= time_s[first]) & (time_s <= time_s[first] + 1.0) & plain)
    rights = [bool((off_m[k][seen[k]] < RIGHT_M).all()) for k in second]  # NaN, a lost joint, is not right
    began = [float(np.nanmean(off_m[k][seen[k]])) for k in second if np.isfinite(off_m[k][seen[k]]).any()]
    known = np.isfinite(off_m) & plain[:, None]
    far = known & (off_m > FAR_M) & (off_m > FAR_SIGMAS * np.sqrt(3.0) * np.nan_to_num(sigma_m, nan=np.inf))
    return Row(
        name,
        float(any(rights)),
        float(bool(began) and min(began) > WRONG_M),
        float(np.isnan(off_m[plain]).mean()),
        _mean(off_m[known]),
        _mean(off_m[known & seen]),
        float(far.sum() / max(1, known.sum())),
    )


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else float("nan")


def _all(rows: list[Row]) -> Row:
    fields = ("right", "wrong", "lost", "mean_mm", "seen_mm", "confident")
    return Row(f"all {len(rows)}", *(100 * v if k < 2 else v for k, v in enumerate(_means(rows, fields))))


def _means(rows: list[Row], fields: tuple[str, ...]) -> Iterator[float]:
    for field in fields:
        yield float(np.nanmean([getattr(row, field) for row in rows]))


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rooms", type=Path)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    rooms = sorted(path.parent for path in chosen.rooms.glob("*/recording"))
    if not rooms:
        sys.exit(f"{chosen.rooms} has no rooms: make them with room_scenes.py")
    print(HEAD, flush=True)
    found = list[Row]()
    with ProcessPoolExecutor(chosen.processes, mp_context=get_context("spawn")) as pool:
        for row in pool.map(partial(track_room, results=chosen.results), rooms):
            if row is not None:
                print(row.line(), flush=True)
                found.append(row)
    print(_all(found).line())


if __name__ == "__main__":
    main()
