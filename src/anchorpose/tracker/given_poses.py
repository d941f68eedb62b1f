"""Check the camera poses that a recording states, before tracking begins. The floor, the equipment and the other
cameras serve as references.

If a contradiction is far larger than the noise of the depth images, the recording is refused. A smaller contradiction
is noted, and increases the sigma of every joint. A single camera can be checked only by the floor and the equipment. If
the camera sees neither of them, a wrong pose remains unnoticed and displaces all joints equally.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration, DoubtSource, PoseDoubt, PoseSource
from anchorpose.calibration.clocks import Clocks, NoClock
from anchorpose.errors import InputError
from anchorpose.isolation.other_place import without_other_places
from anchorpose.isolation.scene import Scene
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.pose_agreement import SOME_OF_ROOM, CameraPair, compare_cameras, doubt_of, seen_past

# ratio of the assumed displacement of joints to the error of one camera's pose, for recordings with several cameras;
# with a single camera, the ratio is 1
AMONG_OTHERS: Final = 0.5
REMEDY: Final = (
    "find the poses with 'anchorpose calibrate RECORDING --ignore-given' and track with --calibration, or correct "
    "camera_to_world"
)
TURN: Final = "turn its images by 180 degrees, or give camera_to_world as the camera stands, null where that is unknown"
MOVED: Final = "the cameras agree with each other, so it stands elsewhere than equipment.json has it"


@dataclass(frozen=True, slots=True)
class PosesAsked:
    """The results of checking all camera poses."""

    # one comparison per pair of cameras; empty for a single camera, and if no pose is given
    pairs: tuple[CameraPair, ...]
    doubts: tuple[PoseDoubt, ...]  # one doubt for each contradiction between a camera pose and what the cameras see


def agreeing_poses(
    recording: Recording, calibration: Calibration, clocks: Clocks, scenes: Sequence[Scene], samples: Sequence[FrameSet]
) -> Calibration:
    """Return the calibration with notes on minor contradictions between camera poses; raises InputError if a given pose
    cannot be right.
    """
    asked = ask_poses(recording, calibration, clocks, scenes, samples)
    _refuse_contradicted(recording, asked, scenes)
    notes = (*calibration.notes, *(f"{doubt.sentence}; the given pose is used" for doubt in asked.doubts))
    off_m = max((doubt.off_m for doubt in asked.doubts if np.isfinite(doubt.off_m)), default=0.0)
    displaced_m = float(off_m) * (1.0 if len(scenes) == 1 else AMONG_OTHERS)
    return replace(calibration, notes=notes, doubts=asked.doubts, displaced_m=displaced_m)


def ask_poses(
    recording: Recording, calibration: Calibration, clocks: Clocks, scenes: Sequence[Scene], samples: Sequence[FrameSet]
) -> PosesAsked:
    """Return the results of checking all camera poses: the doubts that the calibration has noted, and the
    contradictions between two cameras.

    scenes: one per camera, with the poses that tracking uses; samples: frames of all cameras, on one clock. Camera
    poses that were computed instead of given have already been checked in ``calibration``.
    """
    found = calibration.doubts
    if len(scenes) < 2 or not any(pose.source is PoseSource.GIVEN for pose in calibration.poses):
        return PosesAsked((), found)
    usual = [without_other_places(sample, scenes) for sample in samples]
    known = all(camera.doubt in (None, NoClock.SWITCHED_OFF, NoClock.NO_MOTION) for camera in clocks.cameras)
    pairs = compare_cameras(scenes, recording.backgrounds_m, usual, known)
    between = [doubt for pair in pairs if (doubt := doubt_of(pair)) is not None]
    agree = not between and all(pair.measured for pair in pairs)
    return PosesAsked(tuple(pairs), (*(_excused(doubt) if agree else doubt for doubt in found), *between))


def _excused(doubt: PoseDoubt) -> PoseDoubt:
    """Return a doubt about a camera pose, reduced to a mere note if a comparison with the equipment raised it. A note
    neither refuses the recording nor increases sigma; any other doubt is returned unchanged. Call this function only if
    all cameras agree with each other, since the equipment was then moved, not a camera.
    """
    if doubt.source is not DoubtSource.EQUIPMENT:
        return doubt
    return replace(doubt, sentence=f"{doubt.sentence}; {MOVED}", off_m=float("nan"), refuted=False)


def _refuse_contradicted(recording: Recording, asked: PosesAsked, scenes: Sequence[Scene]) -> None:
    """Raise InputError if a contradiction between camera poses is far larger than noise can explain. The error states
    the contradiction, its size and a remedy.
    """
    refuted = [doubt for doubt in asked.doubts if doubt.refuted]
    if not refuted:
        return
    exchanged = exchanged_cameras(scenes)
    if exchanged:
        one, other = exchanged
        problem = f"cameras {one} and {other} seem to be exchanged: with each other's poses they show one room"
        raise InputError(
            recording.folder / "recording.json", problem, "exchange their folders, or their entries camera_to_world"
        )
    named = Counter(camera for doubt in refuted for camera in doubt.cameras)
    most = named.most_common(1)[0][0]
    worst = next(doubt for doubt in refuted if most in doubt.cameras)
    raise InputError(recording.folder / "recording.json", worst.sentence, remedy_of(worst))


def remedy_of(doubt: PoseDoubt) -> str:
    """Return the remedy that is suggested to the user for a doubtful camera pose."""
    return TURN if doubt.source is DoubtSource.UPSIDE_DOWN else REMEDY


def exchanged_cameras(scenes: Sequence[Scene]) -> tuple[str, str] | None:
    """Return the names of two cameras that were probably exchanged; None without such cameras. Two cameras count as
    exchanged if the depth images of all cameras show the same room once these two have swapped their poses and lenses.
    """
    for a, b in combinations(range(len(scenes)), 2):
        first, second = scenes[a].camera, scenes[b].camera
        if (first.width, first.height) != (second.width, second.height):
            continue
        swapped = list(scenes)
        swapped[a] = replace(scenes[a], camera=replace(second, name=first.name))
        swapped[b] = replace(scenes[b], camera=replace(first, name=second.name))
        shares = np.array([pair.of_room for pair in seen_past(swapped, ())])
        if np.isfinite(shares).any() and np.nanmax(shares) <= SOME_OF_ROOM:
            return first.name, second.name
    return None
