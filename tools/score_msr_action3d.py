"""Track the MSR Action3D depth sequences and say how far the joints lie from the skeletons recorded with them.

    python tools/score_msr_action3d.py DATA_FOLDER OUT [--sequences a01_s01_e02 ...] [--jobs 2]

DATA_FOLDER holds one recording folder a sequence, ``aAA_sSS_eEE``, each with ``skeleton.npz``. Tracks go to OUT, one
results folder a sequence; those that exist are reused, so a broken run goes on where it stopped.

The reference is an early tracker's output, good to 5 to 10 cm, not motion capture (Li, Zhang and Liu 2010,
doi:10.1109/CVPRW.2010.5543273). Only its joints of confidence 1 are compared, and a joint that we call lost counts as a
miss. Some joints are other points of the body than ours: such a joint keeps the same offset from subject to subject,
and many of the reference's lie on the visible skin where ours lie inside the limb: see the column "behind skin".
In some frames the skeleton is plainly not the person's (see ``reference_soundness``): every share is given twice, raw
and over the joints whose reference is sound, and each of both twice, as it is and less the systematic offsets.
Results are reused whatever code made them: choose a new OUT after a change of the tracker.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from reference_soundness import RIGID, Body, Soundness, judge, own_lengths

from anchorpose.errors import AnchorposeError
from anchorpose.joints import JOINT_INDEX
from anchorpose.pipeline import TrackConfig, track_recording
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.recording import Recording
from anchorpose.results.folder import new_results_folder
from anchorpose.results.run_record import RUN_FILE, read_run
from anchorpose.results.tables import JOINTS_FILE, read_joints

WITHIN_MM = 100.0  # the reference's own error at its worst
ON_SKIN_MM = 25.0  # a joint's centre lies deeper in every limb; the wrist, the thinnest, is 4 cm thick
DEFINITION_MM = 40.0  # less is within the coarse depth steps, 9 to 27 mm, and the unknown depth unit, 5 %
SUBJECTS_NEEDED, FRAMES_NEEDED = 3, 10  # for a median that one slip of the reference does not move
DEFINITION_RATIO = 2.0  # an offset is systematic where it is twice the spread of the subjects about it


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """One sequence against its reference; m joints of the reference, in its order.

    offset_mm (t, m, 3): ours minus the reference in world axes (forward, up, to the patient's right), NaN where ours
    is lost or the reference is not sure. sure (t, m) bool: confidence 1. behind_skin_mm (t, m): how far the reference
    lies behind the depth picture at its own pixel, NaN where the picture has no reading there or it is not sure.
    other_side_mm (t, m, 3): as offset_mm, with left and right of the reference exchanged. soundness: what is wrong with
    the reference. bones_mm (t, n): length of each of our rigid bones, NaN where an end is lost.
    """

    sequence: str
    names: tuple[str, ...]
    offset_mm: np.ndarray
    sure: np.ndarray
    behind_skin_mm: np.ndarray
    other_side_mm: np.ndarray
    soundness: Soundness
    bones_mm: np.ndarray

    @property
    def action(self) -> str:
        """The ``aAA`` of the sequence's name."""
        return self.sequence.split("_")[0]

    @property
    def subject(self) -> str:
        """The ``sSS`` of the sequence's name."""
        return _subject(self.sequence)

    @property
    def judged(self) -> np.ndarray:
        """(t, m) bool: sure, and sound."""
        return np.asarray(self.sure & self.soundness.sound)


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The skeleton recorded with a sequence: names of m joints, camera_m (t, m, 3) in camera axes, NaN where it is
    missing, sure (t, m) bool: confidence 1."""

    names: tuple[str, ...]
    camera_m: np.ndarray
    sure: np.ndarray


def _subject(sequence: str) -> str:
    return sequence.split("_")[1]


def read_reference(recording: Path) -> Reference:
    """The reference of one sequence; it writes a missing joint as the origin, and y upwards."""
    with np.load(recording / "skeleton.npz") as skeleton:
        names, stored = tuple(str(name) for name in skeleton["names"]), skeleton["xyz"]
    missing = (stored[..., :3] == 0.0).all(axis=-1)
    camera_m = np.where(missing[..., None], np.nan, stored[..., :3] * [1.0, -1.0, 1.0])
    return Reference(names, camera_m, (stored[..., 3] >= 1.0) & ~missing)


def lengths_of_subjects(data: Path, sequences: list[str]) -> dict[str, np.ndarray]:
    """subject -> the lengths of the reference's bones, from all of the sequences."""
    read: dict[str, list[Reference]] = {}
    for sequence in sequences:
        read.setdefault(_subject(sequence), []).append(read_reference(data / sequence))
    return {
        subject: own_lengths([r.camera_m for r in of], [r.sure for r in of], of[0].names)
        for subject, of in read.items()
    }


def track_sequence(sequence: str, data: Path, out: Path) -> str | None:
    """Tracks one sequence unless its results exist; returns what went wrong, or None."""
    if (out / sequence / RUN_FILE).is_file():
        return None
    try:
        with new_results_folder(out / sequence, data / sequence) as folder:
            track_recording(data / sequence, folder, TrackConfig(), lambda _done, _total: None)
    except Exception as error:  # the other sequences are still worth scoring; the failure is printed and counted
        return f"{sequence}: {type(error).__name__}: {error}"
    return None


def compare(sequence: str, data: Path, out: Path, own_m: np.ndarray, lag: int = 0) -> Comparison:
    """Brings the reference into the world of the track and takes the difference; own_m: the subject's own lengths.

    lag: so many frames later the reference is read; where it has ended, it is not sure.
    """
    table = read_joints(out / sequence / JOINTS_FILE)
    pose = read_run(out / sequence / RUN_FILE)["cameras"][0]["camera_to_world"]
    if pose is None:
        raise AnchorposeError(f"{sequence}: the run gives no camera pose, so nothing can be compared.")
    T_world_camera = np.array(pose)
    reference = read_reference(data / sequence)
    read = np.minimum(table.frame + lag, len(reference.sure) - 1)
    names, camera_m = reference.names, reference.camera_m[read]
    sure = reference.sure[read] & (read == table.frame + lag)[:, None]
    world_m = camera_m @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    behind = _behind_skin_mm(data / sequence, table.frame, camera_m)
    opened = open_recording(data / sequence)
    pixels = np.stack([opened.cameras[0].project(joints_m) for joints_m in camera_m])
    soundness = judge(_bodies(opened, table.frame), camera_m, pixels, sure, own_m, names)
    own = [JOINT_INDEX[name] for name in names]
    opposite = [JOINT_INDEX[_other_side(name)] for name in names]
    offset, other = (table.position_m[:, joints] - world_m for joints in (own, opposite))
    offset[~sure], other[~sure] = np.nan, np.nan
    bones = [(JOINT_INDEX[start], JOINT_INDEX[end]) for start, end in RIGID]
    length = [np.linalg.norm(table.position_m[:, start] - table.position_m[:, end], axis=1) for start, end in bones]
    return Comparison(
        sequence, names, 1000.0 * offset, sure, np.where(sure, behind, np.nan), 1000.0 * other, soundness,
        1000.0 * np.stack(length, axis=1),
    )  # fmt: skip


def _bodies(opened: Recording, frames: np.ndarray) -> Iterator[Body]:
    """The person's pixels of each frame: the data has no others."""
    lens = opened.cameras[0].intrinsics
    for frame_set in read_frames(opened, int(frames[0]), int(frames[-1]) + 1):
        depth = frame_set.depths_m[0]
        if depth is None:
            raise AnchorposeError(f"{opened.folder}: frame {frame_set.frame} has no picture to judge the reference by.")
        yield Body(depth > 0, opened.cameras[0].back_project(depth), depth**2 / (lens.fx * lens.fy))


def _other_side(name: str) -> str:
    """The joint's name with left and right exchanged."""
    if name.endswith("Left"):
        return name.removesuffix("Left") + "Right"
    return name.removesuffix("Right") + "Left" if name.endswith("Right") else name


def _behind_skin_mm(recording: Path, frames: np.ndarray, camera_m: np.ndarray) -> np.ndarray:
    """(t, m) depth of camera points (t, m, 3) less the picture's at the same pixel, NaN where nothing was read."""
    opened = open_recording(recording)
    behind = np.full(camera_m.shape[:2], np.nan)
    for row, frame_set in enumerate(read_frames(opened, int(frames[0]), int(frames[-1]) + 1)):
        depth = frame_set.depths_m[0]
        if depth is None:
            continue
        column, line, inside = opened.cameras[0].pixel_of(camera_m[row])
        seen = depth[line, column]
        behind[row] = np.where(inside & (seen > 0), 1000.0 * (camera_m[row, :, 2] - seen), np.nan)
    return behind


def subject_offsets(comparisons: list[Comparison]) -> dict[str, np.ndarray]:
    """subject -> (m, 3) median offset of each joint where the reference is sound, NaN where that is in few frames."""
    medians = {}
    for subject in sorted({comparison.subject for comparison in comparisons}):
        mine = [c for c in comparisons if c.subject == subject]
        offset = np.concatenate([np.where(c.judged[..., None], c.offset_mm, np.nan) for c in mine])
        few = np.isfinite(offset).all(axis=2).sum(axis=0) < FRAMES_NEEDED
        medians[subject] = np.where(few[:, None], np.nan, _median(offset))
    return medians


def systematic(offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which joints differ by definition: offsets (s, m, 3) of s subjects -> bool (m,), offset (m, 3), spread (m,).

    A joint that fewer than ``SUBJECTS_NEEDED`` show is not called so.
    """
    centre = _median(offsets)
    spread = _median(np.linalg.norm(offsets - centre, axis=2))
    size = np.linalg.norm(centre, axis=1)
    enough = np.isfinite(offsets).all(axis=2).sum(axis=0) >= SUBJECTS_NEEDED
    return enough & (size > DEFINITION_MM) & (size > DEFINITION_RATIO * spread), centre, spread


def without_definition(comparison: Comparison, offsets: dict[str, np.ndarray]) -> np.ndarray:
    """(t, m, 3) offsets less what the *other* subjects say is systematic, so that no subject corrects itself."""
    others = np.array([own for subject, own in offsets.items() if subject != comparison.subject])
    if len(others) < 2:
        return comparison.offset_mm
    differs, centre, _ = systematic(others)
    return comparison.offset_mm - np.where(differs[:, None], centre, 0.0)


def share_within(offsets_mm: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """(m,) share of the sure reference joints that have ours within ``WITHIN_MM``; lost joints are misses."""
    near = np.linalg.norm(offsets_mm, axis=2) < WITHIN_MM  # NaN compares as a miss
    return np.where(sure.any(axis=0), (near & sure).sum(axis=0) / np.maximum(sure.sum(axis=0), 1), np.nan)


def print_scores(comparisons: list[Comparison]) -> None:
    """Joints, actions, overall shares, joints that differ by definition, our bones, and the worst sequences."""
    names = comparisons[0].names
    offset, sure = np.concatenate([c.offset_mm for c in comparisons]), np.concatenate([c.sure for c in comparisons])
    judged = np.concatenate([c.judged for c in comparisons])
    by_subject = subject_offsets(comparisons)
    corrected = np.concatenate([without_definition(comparison, by_subject) for comparison in comparisons])
    differs, _, spread = systematic(np.array(list(by_subject.values())))
    shares = [share_within(*of) for of in product((offset, corrected), (sure, judged))]
    middle = _median(np.where(judged[..., None], offset, np.nan))
    error, gone = _median(np.linalg.norm(offset, axis=2)), sure & ~np.isfinite(offset).all(axis=2)
    skin = _median(np.concatenate([c.behind_skin_mm for c in comparisons]))
    print("                            share within 100 mm")
    print(
        "                            raw         less offsets                ours - reference, sound   subjects  behind"
    )
    print("joint           sure  sound all   sound all   sound  lost  median   forward  up right  (mm)       ±    skin")
    for j, name in enumerate(names):
        forward, up, right = middle[j]
        mark = "  differs by definition" if differs[j] else ""
        lost = gone[:, j].sum() / max(1, sure[:, j].sum())
        four = " ".join(f"{shares[kind][j]:5.2f}" for kind in range(4))
        print(f"{name:14s} {sure[:, j].sum():5d} {judged[:, j].sum():5d} {four} {lost:6.2f} {error[j]:7.0f}   "
              f"{forward:+7.0f} {up:+4.0f} {right:+4.0f} {spread[j]:14.0f} {skin[j]:7.0f}{mark}")  # fmt: skip
    _print_actions(comparisons, by_subject)
    seen = f"{len(comparisons)} sequences, {len(by_subject)} subjects, {len(offset)} frames"
    print(f"\n{seen}, {sure.sum()} joints of confidence 1, {gone.sum() / sure.sum():.3f} of them lost by us: misses")
    print(f"share within {WITHIN_MM:.0f} mm: {_overall(offset, sure):.3f}; "
          f"where the reference is sound: {_overall(offset, judged):.3f}")  # fmt: skip
    print(f"the same with the systematic offsets of the other subjects removed: {_overall(corrected, sure):.3f}; "
          f"where the reference is sound: {_overall(corrected, judged):.3f}")  # fmt: skip
    print("joints that differ by definition: " + (", ".join(np.array(names)[differs]) or "none"))
    on_skin = [name for name, depth in zip(names, skin, strict=True) if depth < ON_SKIN_MM]
    print(f"joints that the reference puts on the skin, less than {ON_SKIN_MM:.0f} mm deep: " + ", ".join(on_skin))
    _print_unsound(comparisons, sure)
    _print_exchanged(comparisons, sure)
    change = max(float(np.max(np.nanmax(c.bones_mm, axis=0) - np.nanmin(c.bones_mm, axis=0))) for c in comparisons)
    print(f"largest change of a bone's length of ours within a sequence: {change:.3g} mm")
    worst = sorted((_overall(c.offset_mm, c.judged), c.sequence) for c in comparisons)
    print("by sequence where sound, worst first: " + ", ".join(f"{name} {share:.2f}" for share, name in worst))


def _print_actions(comparisons: list[Comparison], offsets: dict[str, np.ndarray]) -> None:
    """The four shares of each action."""
    print("\naction  sure  sound  raw: all sound   less offsets: all sound")
    for action in sorted({c.action for c in comparisons}):
        mine = [c for c in comparisons if c.action == action]
        sure, judged = np.concatenate([c.sure for c in mine]), np.concatenate([c.judged for c in mine])
        as_is = np.concatenate([c.offset_mm for c in mine])
        less = np.concatenate([without_definition(c, offsets) for c in mine])
        a, b, c, d = (_overall(*of) for of in product((as_is, less), (sure, judged)))
        print(f"{action:7s} {sure.sum():5d} {judged.sum():5d} {a:8.2f} {b:5.2f} {c:17.2f} {d:5.2f}")


def _print_unsound(comparisons: list[Comparison], sure: np.ndarray) -> None:
    """How many joints of confidence 1 each question takes away; a joint may fail several."""
    print(
        f"of the joints of confidence 1, {np.concatenate([c.judged for c in comparisons])[sure].mean():.3f} are sound"
    )
    for what, field in (
        ("a limb of the body is far from all bones", "unexplained"), ("legs laid through each other", "tangled"),
        ("not on the body", "off_body"), ("at a bone of a wrong length", "wrong_length"),
    ):  # fmt: skip
        share = np.concatenate([getattr(c.soundness, field) for c in comparisons])[sure].mean()
        print(f"  {what}: {share:.4f}")


def print_lag(comparisons: list[Comparison], later: list[Comparison]) -> None:
    """Whether the skeleton of the next frame fits this frame's picture better: the reference comes late.

    How many joints are off the body says so without our track.
    """
    for what, of in (("same", comparisons), ("next", later)):
        by_subject = subject_offsets(of)
        sure, judged = np.concatenate([c.sure for c in of]), np.concatenate([c.judged for c in of])
        off = np.concatenate([c.soundness.off_body for c in of])[sure].mean()
        as_is = np.concatenate([c.offset_mm for c in of])
        less = np.concatenate([without_definition(c, by_subject) for c in of])
        a, b, c, d = (_overall(*pair) for pair in product((as_is, less), (sure, judged)))
        print(f"with the reference of the {what} frame: {off:.4f} of its joints off the body; "
              f"within {WITHIN_MM:.0f} mm: {a:.3f}, sound {b:.3f}; less offsets {c:.3f}, sound {d:.3f}")  # fmt: skip


def _print_exchanged(comparisons: list[Comparison], sure: np.ndarray) -> None:
    """Sequences that fit better with the reference's left and right exchanged: it turned the person round.

    The score itself picks the naming, so this share is an upper bound.
    """
    wrong = [_overall(c.other_side_mm, c.sure) > _overall(c.offset_mm, c.sure) for c in comparisons]
    either = [c.other_side_mm if swap else c.offset_mm for c, swap in zip(comparisons, wrong, strict=True)]
    print(
        f"the same with the better of the two namings of left and right: {_overall(np.concatenate(either), sure):.3f}"
    )
    named = [c.sequence for c, swap in zip(comparisons, wrong, strict=True) if swap]
    print(f"sequences that fit better with left and right exchanged ({len(named)}): {', '.join(named) or 'none'}")


def _overall(offsets_mm: np.ndarray, sure: np.ndarray) -> float:
    return float((np.linalg.norm(offsets_mm, axis=2) < WITHIN_MM)[sure].mean()) if sure.any() else float("nan")


def _median(values: np.ndarray) -> np.ndarray:
    """Median over the first axis without NaN; NaN where there is nothing."""
    empty = np.isnan(values).all(axis=0)
    return np.where(empty, np.nan, np.nanmedian(np.where(empty, 0.0, values), axis=0))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder with the sequences")
    parser.add_argument("out", type=Path, help="folder for the tracks")
    parser.add_argument("--sequences", nargs="+", help="names of sequences; the default is all of them")
    parser.add_argument("--jobs", type=int, default=2, help="sequences tracked at the same time")
    arguments = parser.parse_args()

    everything = sorted(folder.parent.name for folder in arguments.data.glob("*/skeleton.npz"))
    sequences = arguments.sequences or everything
    if not sequences:
        parser.error(f"{arguments.data} holds no sequence with a skeleton.npz")
    arguments.out.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # one core a job
    failures: list[str] = []
    with ProcessPoolExecutor(arguments.jobs, mp_context=get_context("spawn")) as pool:
        work = pool.map(partial(track_sequence, data=arguments.data, out=arguments.out), sequences)
        for sequence, problem in zip(sequences, work, strict=True):
            print(f"{sequence}: {'FAILED' if problem else 'tracked'}", file=sys.stderr, flush=True)
            failures += [problem] if problem else []
    tracked = [name for name in sequences if (arguments.out / name / RUN_FILE).is_file()]
    if tracked:
        own = lengths_of_subjects(arguments.data, everything)
        at_once, later = (
            [compare(name, arguments.data, arguments.out, own[_subject(name)], lag) for name in tracked]
            for lag in (0, 1)
        )
        print_scores(at_once)
        print_lag(at_once, later)
    for problem in failures:
        print(f"FAILED {problem}")
    return 1 if failures else 0


if __name__ == "__main__":
    raise SystemExit(main())
