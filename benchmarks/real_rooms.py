"""Real recordings of whole rooms compared with labels by eye: python benchmarks/real_rooms.py RECORDINGS --results OUT.

RECORDINGS holds the recording folders (people_in_line, iit_rehab_room, five_people, realsense_board, ros1_person_1,
ros1_person_2; those that are absent are left out). Every person who is labelled in plain view is tracked by name, with
--patient at the place of the label, and compared with the labels of both labellers (``labels/``). The table has the
share of labelled frames with the person in plain view that are tracked; frames in which another person was tracked;
frames that are lost without a reason; the median distance of clearly seen joints from the labels, and the share within
50 and 100 mm. The last line of each recording has the distance between the two labellers.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import Recording
from anchorpose.research.benchmark.labels import (
    LABELLERS,
    Frames,
    LabelledPerson,
    apart_m,
    off_m,
    place_of,
    read_labels,
    trunk_pixel,
    within,
)
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.threads import one_thread
from anchorpose.tracker.preparation import settle

FOLDER: Final = Path(__file__).parent / "labels"
RECORDINGS: Final = (
    "people_in_line",
    "iit_rehab_room",
    "five_people",
    "realsense_board",
    "ros1_person_1",
    "ros1_person_2",
)
TRACKED: Final = 0.5  # of the joints: with fewer the person is not tracked
NEAR_M: Final = 3.5  # the issue's: farther than this a person need not be followed


@dataclass(slots=True)
class Outcome:
    """What became of one person, against both labellers' labels."""

    frames: int = 0
    tracked: int = 0
    another: int = 0
    unsaid: int = 0
    off_m: list[float] = field(default_factory=list)

    def add(self, other: Outcome) -> None:
        """Sums and joins."""
        self.frames, self.tracked = self.frames + other.frames, self.tracked + other.tracked
        self.another, self.unsaid = self.another + other.another, self.unsaid + other.unsaid
        self.off_m += other.off_m

    def row(self, name: str) -> str:
        """A line of the table."""
        off = np.array(self.off_m) if self.off_m else np.array([np.nan])
        shares = [f"{100 * np.mean(off < reach):.0f}" for reach in (0.05, 0.10)]
        share = f"{100 * self.tracked / max(self.frames, 1):.0f} of {self.frames}"
        median = f"{1000 * float(np.median(off)):.0f}"
        cells = [name, share, str(self.another), str(self.unsaid), str(len(self.off_m)), median, *shares]
        return "| " + " | ".join(cells) + " |"


HEAD: Final = (
    "| person | tracked % of frames | another person | lost, unsaid | joints | median mm | in 50 mm % | in 100 mm % |\n"
    "|---|--:|--:|--:|--:|--:|--:|--:|"
)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("recordings", type=Path)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--only", nargs="*", default=RECORDINGS)
    chosen = parser.parse_args()
    print(HEAD, flush=True)
    for name in chosen.only:
        if (chosen.recordings / name / "recording.json").is_file():
            with one_thread():
                _recording(chosen.recordings / name, chosen.results)


def _recording(folder: Path, results: Path) -> None:
    recording = open_recording(folder)
    labels = {labeller: read_labels(FOLDER, folder.name, labeller) for labeller in LABELLERS}
    camera = settle(recording, TrackConfig()).calibration.cameras[0]
    together = Outcome()
    for person in _people(labels[LABELLERS[0]]):
        named = _named(person, labels[LABELLERS[0]], recording, camera)
        if named is None:
            continue
        out = results / f"{folder.name}-{person}"
        if not (out / RUN_FILE).exists():
            out.mkdir(parents=True)
            place, frame = named
            config = replace(TrackConfig(), patient_xz_m=(float(place[0]), float(place[2])), patient_frame=frame)
            track_recording(folder, out, config, lambda _done, _total: None)
        outcome = Outcome()
        for labeller in LABELLERS:
            outcome.add(_compared(person, labels[labeller], recording, out))
        print(outcome.row(f"{folder.name} {person}"), flush=True)
        together.add(outcome)
    print(together.row(f"**{folder.name}**"), flush=True)
    print(_labellers(folder.name, labels, recording, camera), flush=True)


def _people(frames: Frames) -> list[str]:
    return sorted({one.person for people in frames.values() for one in people if one.plain and one.joints})


def _named(person: str, frames: Frames, recording: Recording, camera: Camera) -> tuple[np.ndarray, int] | None:
    """The place and frame that a user would give: where most joints of the person are clearly seen, within 3.5 m."""
    best, most = None, 0
    for frame, people in frames.items():
        for one in people:
            place = place_of(one, _depth(recording, frame), camera) if one.person == person and one.plain else None
            near = place is not None and np.linalg.norm(place - camera.position_m) < NEAR_M
            if place is not None and near and len(one.joints) > most:
                best, most = (place, frame), len(one.joints)
    return best


def _compared(person: str, frames: Frames, recording: Recording, results: Path) -> Outcome:
    table, run = read_joints(results / JOINTS_FILE), read_run(results / RUN_FILE)
    pose = np.array(run["cameras"][0]["camera_to_world"])
    camera = replace(recording.cameras[0], T_world_camera=pose)
    outcome = Outcome()
    for frame, people in frames.items():
        row, depth_m = int(np.flatnonzero(table.frame == frame)[0]), _depth(recording, frame)
        own = next((one for one in people if one.person == person), None)
        outcome.another += _is_another(own, people, table, row, camera)
        if own is None or not own.plain:
            continue
        outcome.frames += 1
        lost = table.lost[row].mean()
        outcome.tracked += lost < TRACKED
        outcome.unsaid += bool(lost == 1.0 and not _has_reason(run, frame))
        if lost < 1.0:
            outcome.off_m += off_m(own, table.position_m[row], depth_m, camera).values()
    return outcome


def _has_reason(run: dict[str, object], frame: int) -> bool:
    intervals = run["lost"]
    assert isinstance(intervals, list)
    return any(one["first_frame"] <= frame <= one["last_frame"] for one in intervals)


def _is_another(
    own: LabelledPerson | None, people: Sequence[LabelledPerson], table: JointTable, row: int, camera: Camera
) -> bool:
    """Whether the tracked trunk lies in another person's box and not in the own one."""
    place = trunk_pixel(table, row, camera)
    if place is None or (own is not None and within(own.box, place)):
        return False
    return any(within(one.box, place) for one in people if one is not own)


def _labellers(name: str, labels: dict[str, Frames], recording: Recording, camera: Camera) -> str:
    """How far the two labellers are apart."""
    first, second = (labels[labeller] for labeller in LABELLERS)
    apart = list[float]()
    for frame, people in first.items():
        for one in people:
            other = next((two for two in second.get(frame, ()) if two.person == one.person), None)
            if other is not None:
                apart += apart_m(one, other, _depth(recording, frame), camera).values()
    return Outcome(off_m=apart).row(f"{name}: the two labellers")


def _depth(recording: Recording, frame: int) -> np.ndarray:
    position = int(np.flatnonzero(recording.streams[0].frame == frame)[0])
    depth = read_frame(recording, position).depths_m[0]
    assert depth is not None, json.dumps({"frame": frame})
    return depth


if __name__ == "__main__":
    main()
