"""Tracked joints and the reference skeletons of MSR Action3D against the same labels by eye.

    python benchmarks/msr_labels.py DATA [--results TRACKS] [--pictures OUT]

DATA holds the sequences, TRACKS what ``tools/score_msr_action3d.py DATA TRACKS`` tracked of them; sequences that are
not tracked are left out, and named. The first table has how far the two labellers are apart. All distances are across
the line of sight, in millimetres at the depth of the skin that a label was set on. *Clearly seen* is a joint that both
labellers set and neither called unclear. Joints are compared with the middle of the two labels. Hips are left out: no
image shows them under clothes. A joint of ours that is lost, and any joint before the skin or far behind it, is
outside of every distance. Of the reference only joints of confidence 1 are compared, most hands and all feet are not.
A hand was labelled at its knuckles, and the project's is the head of the rig's finger base, 3 cm from the wrist: hands
are compared at the knuckles of our body, and once as reported. ``--pictures`` draws the frames of the worst twenty
joints.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from label_frames import depth_of, in_picture, render

from anchorpose.body.asset import stored_asset
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES
from anchorpose.recording.reader import open_recording
from anchorpose.research.benchmark.labels import LABELLERS, LabelledPerson, apart_m, off_m, read_label_set, shift_m
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE, read_joints

NAME: Final = "msr_action3d"
FOLDER: Final = Path(__file__).parent / "labels"
AGREED_M: Final = 0.03  # a third of a hand's length: where labellers are closer, neither has taken another place
HAND: Final = "Hand"
REACHES_MM: Final = (60, 100)
WORST: Final = 20


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A labelled frame. camera: its pose is the identity, so that the world is the camera's; by_labeller: the person as
    each saw it; ours_m, theirs_m: (21, 3) joints tracked and of the reference, NaN where lost."""

    sequence: str
    number: int
    camera: Camera
    depth_m: np.ndarray
    by_labeller: tuple[LabelledPerson, LabelledPerson]
    ours_m: np.ndarray
    reported_m: np.ndarray
    theirs_m: np.ndarray

    def middle(self, clear: bool) -> LabelledPerson:
        """Half-way between the two labellers, of joints that are unclear to neither, or to one at least."""
        one, two = self.by_labeller
        unclear = one.unclear | two.unclear
        joints = {
            name: ((place[0] + two.joints[name][0]) / 2, (place[1] + two.joints[name][1]) / 2)
            for name, place in one.joints.items()
            if name in two.joints and (name not in unclear) == clear
        }
        return replace(one, joints=joints)


@dataclass(frozen=True, slots=True)
class Row:
    """One joint that both labelled: millimetres between the labellers, and from their middle to ours (inf where lost)
    and to the reference's (NaN where it has none). Shifts: ours, and the reference's, less the labels', right and down.
    """

    frame: Frame
    joint: str
    clear: bool
    labellers: float
    ours: float
    theirs: float
    shift_mm: tuple[float, float]
    theirs_shift_mm: tuple[float, float]


def read_frames(data: Path, tracks: Path | None) -> Iterator[Frame]:
    """All labelled frames; our joints are NaN where a sequence was not tracked."""
    first, second = (read_label_set(FOLDER, NAME, labeller) for labeller in LABELLERS)
    for sequence, frames in first.items():
        recording = open_recording(data / sequence)
        camera = replace(recording.cameras[0], T_world_camera=np.eye(4))
        for number, people in frames.items():
            reported_m = _tracked_m(tracks / sequence, number) if tracks else np.full((JOINT_COUNT, 3), np.nan)
            theirs_m = _reference_m(data / sequence / "skeleton.npz", number)
            both = (people[0], second[sequence][number][0])
            yield Frame(sequence, number, camera, depth_of(recording, number), both,
                        _with_knuckles(reported_m), reported_m, theirs_m)  # fmt: skip


def _tracked_m(results: Path, frame: int) -> np.ndarray:
    """(21, 3) camera, all NaN where the sequence was not tracked."""
    if not (results / RUN_FILE).is_file():
        print(f"{results.name} is not tracked: left out")
        return np.full((JOINT_COUNT, 3), np.nan)
    table, run = read_joints(results / JOINTS_FILE), read_run(results / RUN_FILE)
    T_camera_world = invert_rigid(np.array(run["cameras"][0]["camera_to_world"]))
    return transform_points(T_camera_world, table.position_m[int(np.flatnonzero(table.frame == frame)[0])])


def _with_knuckles(joints_m: np.ndarray) -> np.ndarray:
    """Hands at the end of the finger base, straight on from the wrist by the proportions of the mean body."""
    body, found = stored_asset(), joints_m.copy()
    for side in ("Left", "Right"):
        hand, wrist = JOINT_INDEX[f"Hand{side}"], JOINT_INDEX[f"Wrist{side}"]
        root, base = body.bone(f"{side}Hand"), body.bone(f"{side}FingerBase")
        palm = np.linalg.norm(body.bone_tails[base] - body.bone_heads[root])
        longer = palm / np.linalg.norm(body.bone_heads[base] - body.bone_heads[root])
        found[hand] = joints_m[wrist] + longer * (joints_m[hand] - joints_m[wrist])
    return found


def _reference_m(path: Path, frame: int) -> np.ndarray:
    """(21, 3) camera: the file writes y upwards; NaN where its confidence is 0 or it has no such joint."""
    joints = np.full((JOINT_COUNT, 3), np.nan)
    with np.load(path) as skeleton:
        places = [JOINT_INDEX[str(name)] for name in skeleton["names"]]
        stored = skeleton["xyz"][frame]
    joints[places] = np.where(stored[:, 3:] >= 1.0, stored[:, :3] * [1.0, -1.0, 1.0], np.nan)
    return joints


def rows_of(frame: Frame, ours_m: np.ndarray) -> Iterator[Row]:
    """Every joint that both labelled but those by proportion; ours_m: ``frame.ours_m`` or ``frame.reported_m``."""
    labellers = apart_m(*frame.by_labeller, frame.depth_m, frame.camera)
    for clear in (True, False):
        person = frame.middle(clear)
        ours, theirs = (off_m(person, of, frame.depth_m, frame.camera) for of in (ours_m, frame.theirs_m))
        shift, other = (shift_m(person, of, frame.depth_m, frame.camera) for of in (ours_m, frame.theirs_m))
        for name in ours:
            reference = 1e3 * theirs[name] if np.isfinite(other[name]).all() else np.nan
            yield Row(frame, name, clear, 1e3 * labellers[name], 1e3 * ours[name], reference,
                      _mm(shift[name]), _mm(other[name]))  # fmt: skip


def _mm(right_down_m: np.ndarray) -> tuple[float, float]:
    return float(1e3 * right_down_m[0]), float(1e3 * right_down_m[1])


def print_labellers(rows: list[Row]) -> None:
    """How far the two are apart, where both are sure and where one is not."""
    print("| joints | clear: number | median, 95 % | unclear: number | median, 95 % |\n|---|--:|--:|--:|--:|")
    for name, own in {**_kinds(rows), "all": rows}.items():
        clear, unclear = ([row.labellers for row in own if row.clear == which] for which in (True, False))
        print(f"| {name} | {len(clear)} | {_spread(clear)} | {len(unclear)} | {_spread(unclear)} |")
    print()


def _spread(values: list[float]) -> str:
    return f"{np.median(values):.0f}, {np.percentile(values, 95):.0f}" if values else ""


def _kinds(rows: list[Row]) -> dict[str, list[Row]]:
    """Left and right together, in the order of the joints."""
    names = dict.fromkeys(_kind(name) for name in JOINT_NAMES)
    kinds = {name: [row for row in rows if _kind(row.joint) == name] for name in names}
    return {name: own for name, own in kinds.items() if own}


def print_table(rows: list[Row], as_reported: list[Row]) -> None:
    """Per joint, sides together, and overall; as_reported: the same with hands as the results have them."""
    each = "median, 60 mm, 100 mm | right, down"
    print(f"| joints | number | labellers: median, 95 % | ours: {each} | reference: number, {each} |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    clear = [row for row in rows if row.clear]
    groups = _kinds(clear)
    groups["**clearly seen**"] = clear
    groups[f"labellers within {1e3 * AGREED_M:.0f} mm"] = [row for row in clear if row.labellers < 1e3 * AGREED_M]
    groups["unclear to one or both"] = [row for row in rows if not row.clear]
    groups["clearly seen, without feet"] = [row for row in clear if _kind(row.joint) != "Foot"]
    groups["all"] = rows
    reported = [row for row in as_reported if row.clear]
    groups["hands as reported"] = [row for row in reported if _kind(row.joint) == HAND]
    groups["clearly seen, hands as reported"] = reported
    for name, own in groups.items():
        if own:
            _print_row(name, own)


def _kind(joint: str) -> str:
    return joint.removesuffix("Left").removesuffix("Right")


def _print_row(name: str, rows: list[Row]) -> None:
    cells = [name, str(len(rows)), _spread([row.labellers for row in rows])]
    cells += _shares([row.ours for row in rows], [row.shift_mm for row in rows])
    known = [row for row in rows if not np.isnan(row.theirs)]
    theirs = _shares([row.theirs for row in known], [row.theirs_shift_mm for row in known]) if known else ["", ""]
    cells += [f"{len(known)}: {theirs[0]}", theirs[1]]
    print("| " + " | ".join(cells) + " |")


def _shares(off_mm: list[float], shifts_mm: list[tuple[float, float]]) -> list[str]:
    shares = [f"{100 * np.mean(np.array(off_mm) < reach):.1f} %" for reach in REACHES_MM]
    right, down = np.nanmedian(shifts_mm, axis=0)
    return [", ".join([f"{np.median(off_mm):.0f}", *shares]), f"{right:+.0f}, {down:+.0f}"]


def print_worst(rows: list[Row]) -> list[Row]:
    """The clearly seen joints that are farthest from ours."""
    worst = sorted((row for row in rows if row.clear), key=lambda row: -row.ours)[:WORST]
    for row in worst:
        right, down = row.shift_mm
        where = f"{row.frame.sequence} {row.frame.number:3d} {row.joint:13s}"
        ours = f"ours {row.ours:4.0f} mm (right {right:+.0f}, down {down:+.0f})"
        print(f"{where} {ours}, reference {row.theirs:4.0f}, labellers apart {row.labellers:3.0f}")
    return worst


def print_heights(tracks: Path, sequences: Iterable[str]) -> None:
    """What was learnt of the same person in each sequence."""
    by_subject: dict[str, list[str]] = {}
    for sequence in sequences:
        body = read_run(tracks / sequence / RUN_FILE)["body"]
        stated = f"{body['height_m']:.2f} ± {body['height_sigma_m']:.2f}"
        by_subject.setdefault(sequence.split("_")[1], []).append(stated)
    for subject, heights in sorted(by_subject.items()):
        print(f"learnt height of {subject}, m: {', '.join(sorted(heights))}")


def draw(frame: Frame) -> np.ndarray:
    """Labels (white and yellow crosses), ours (green) and the reference (red) over the depth image."""
    picture, box = render(frame.depth_m, frame.camera.intrinsics.fx)
    for joints_m, colour in ((frame.ours_m, (0, 230, 0)), (frame.theirs_m, (60, 60, 255))):
        for name, place in zip(JOINT_NAMES, frame.camera.project(joints_m), strict=True):
            if np.isfinite(place).all():
                at = in_picture(place, box)
                cv2.circle(picture, at, 6, colour, 2)
                cv2.putText(picture, _short(name), (at[0] + 8, at[1]), cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1)
    for person, colour in zip(frame.by_labeller, ((255, 255, 255), (0, 255, 255)), strict=True):
        for place in person.joints.values():
            cv2.drawMarker(picture, in_picture(place, box), colour, cv2.MARKER_CROSS, 14, 2)
    return picture


def _short(joint: str) -> str:
    """KneeLeft is KnL."""
    return _kind(joint)[:2] + (
        joint[-5:].replace("Right", "R").replace("tLeft", "L")[-1] if joint != _kind(joint) else ""
    )


def main() -> None:
    """Prints the table and the worst joints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--pictures", type=Path)
    chosen = parser.parse_args()
    frames = list(read_frames(chosen.data, chosen.results))
    print_labellers([row for frame in frames for row in rows_of(frame, frame.ours_m)])
    tracked = [frame for frame in frames if np.isfinite(frame.reported_m).any()]
    if not tracked:
        return
    rows = [row for frame in tracked for row in rows_of(frame, frame.ours_m)]
    print_table(rows, [row for frame in tracked for row in rows_of(frame, frame.reported_m)])
    print_heights(chosen.results, (frame.sequence for frame in tracked))
    worst = print_worst(rows)
    if chosen.pictures:
        chosen.pictures.mkdir(parents=True, exist_ok=True)
        for frame in {id(row.frame): row.frame for row in worst}.values():
            cv2.imwrite(str(chosen.pictures / f"{frame.sequence}_{frame.number:06d}.png"), draw(frame))


if __name__ == "__main__":
    main()
