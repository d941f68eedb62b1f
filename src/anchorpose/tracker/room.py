"""Hold all data that are known before the first frame: room, cameras, initial frames, corrections, settings."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.inverse_kinematics import CorrectedJoints
from anchorpose.body.pose import LIMB_OF_JOINTS
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.clocks import Clocks
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.scene import Scene
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.motion.database import MotionDatabase
from anchorpose.recording.recording import Clock, Recording, half_period_s
from anchorpose.results.corrections import Corrections, JointCorrection
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.sighting import Crowd
from anchorpose.tracker.stopwatch import Stopwatch

NOBODY_SEEN: Final = "nobody was seen in the sampled frames"


@dataclass(frozen=True, slots=True, eq=False)
class InitialFrame:
    """A frame that shows the patient, where tracking may begin."""

    frame: int  # position of the frame in the recording
    choice: PatientChoice  # where the patient stands in this frame, and why this person was chosen
    score: float  # 0 to 1; high if much of the patient is seen and other people are far from the patient
    whole: float  # 0 to 1, the patient's visible area relative to its median over all frames with the patient
    alone: bool  # whether the patient is the only person in the frame
    crowd: Crowd | None = field(default=None, repr=False)  # the people seen; None after they were used
    start: Start | None = field(default=None, repr=False)  # the patient as found here; None before a body is fitted


@dataclass(frozen=True, slots=True, eq=False)
class Room:
    """The room and all other data that are prepared before tracking."""

    recording: Recording  # the recording, with the times of all cameras on one clock
    clocks: Clocks
    calibration: Calibration
    scenes: tuple[Scene, ...]  # one per camera, in the order of the recording
    # possible initial frames, best first; empty if no person was seen in the sampled frames or no person is to be
    # tracked
    initial_frames: tuple[InitialFrame, ...]
    review: Review  # a reviewer's corrections of earlier results
    why_nobody: str = NOBODY_SEEN  # the reason why all joints are lost if no initial frame was found
    notes: tuple[str, ...] = ()  # sentences for the user about mirrors and about gaps in walls

    @property
    def initial_frame(self) -> InitialFrame | None:
        """Return the frame where tracking begins."""
        return self.initial_frames[0] if self.initial_frames else None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """Return the cameras with the poses that tracking uses."""
        return self.calibration.cameras


@dataclass(frozen=True, slots=True, eq=False)
class Review:
    """A reviewer's corrections of earlier results."""

    joints: dict[int, CorrectedJoints] = field(default_factory=dict)  # corrected joints by frame number
    # unusable intervals: first and last frame number, and the reason as a sentence
    unusable: tuple[tuple[int, int, str], ...] = ()
    # each camera's clock in the earlier results; empty = to be estimated
    clocks: dict[str, Clock] = field(default_factory=dict)
    floor_height_m: float | None = None  # m, height of the floor in the earlier results; None = to be estimated

    def why_unusable(self, frame: int) -> str | None:
        """Return the reason given for the first unusable interval that contains the frame; None if the frame is
        usable.
        """
        return next((why for first, last, why in self.unusable if first <= frame <= last), None)

    def corrected(self, frame: int) -> CorrectedJoints | None:
        """Return the corrected joints of a frame; None without corrections, and in an unusable frame."""
        return self.joints.get(frame) if self.why_unusable(frame) is None else None


NO_REVIEW: Final = Review()


def held_joints(review: Review, frames: Sequence[int]) -> np.ndarray:
    """Return (t, 21) bool: in each frame, the joints that a reviewer corrected and the other joints of their limbs."""
    held = np.zeros((len(frames), JOINT_COUNT), bool)
    for row, frame in enumerate(frames):
        corrected = review.corrected(frame)
        if corrected is not None:
            held[row] = np.isin(LIMB_OF_JOINTS, LIMB_OF_JOINTS[corrected.joint])
    return held


def review_of(corrections: Corrections) -> Review:
    """Return the part of a corrections file that tracking needs: corrected joints, unusable intervals, clocks and
    floor.
    """
    by_frame: dict[int, list[JointCorrection]] = {}
    for entry in corrections.joints:
        by_frame.setdefault(entry.frame, []).append(entry)
    unusable = tuple(
        (gone.first_frame, gone.last_frame, f"marked as unusable by {gone.who} on {gone.when[:10]}: {gone.reason}")
        for gone in corrections.unusable
    )
    joints = {frame: _corrected_joints(entries) for frame, entries in by_frame.items()}
    return Review(joints, unusable, corrections.recording.clocks, corrections.recording.floor_height_m)


def require_frames(path: Path, corrections: Corrections, recording: Recording) -> None:
    """Raise InputError if an entry's frame is missing in the recording or has another time there. Also raise it if an
    entry names the patient in a frame marked as unusable.
    """
    clock = corrections.recording.clocks.get(recording.cameras[0].name, Clock())
    time_s = clock.reference_s(recording.streams[0].time_s)
    times_s = dict(zip(recording.streams[0].frame.tolist(), time_s.tolist(), strict=True))
    for frame, stated_s, what in _moments(corrections):
        if frame not in times_s:
            raise InputError(path, f"{what} frame {frame}, which the recording does not have", "take that entry out")
        if abs(stated_s - times_s[frame]) > half_period_s(time_s):
            problem = (
                f"{what} frame {frame} at {stated_s:g} s, but the recording has that frame at {times_s[frame]:g} s"
            )
            raise InputError(path, problem, "correct the frame or the time, or take that entry out")
    patient = corrections.patient
    if patient is not None and review_of(corrections).why_unusable(patient.frame) is not None:
        problem = f"names the patient in frame {patient.frame}, which it marks as unusable"
        raise InputError(path, problem, "name the patient in another frame, or withdraw the interval")


def _moments(corrections: Corrections) -> Iterator[tuple[int, float, str]]:
    """Yield, for each entry of the corrections, its frame, the time stated for this frame, and words that describe the
    entry.
    """
    for joint in corrections.joints:
        yield joint.frame, joint.time_s, "corrects joints of"
    if corrections.patient is not None:
        yield corrections.patient.frame, corrections.patient.time_s, "names the patient in"
    for gone in corrections.unusable:
        yield gone.first_frame, gone.start_s, "marks as unusable, as the first,"
        yield gone.last_frame, gone.end_s, "marks as unusable, as the last,"


def _corrected_joints(entries: list[JointCorrection]) -> CorrectedJoints:
    return CorrectedJoints(
        joint=np.array([JOINT_INDEX[entry.joint] for entry in entries]),
        position_m=np.array([entry.position_m for entry in entries]),
        sigma_m=np.array([entry.sigma_m for entry in entries]),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """The inputs that are the same for every frame of a run."""

    room: Room
    config: TrackConfig
    motions: MotionDatabase | None = None  # reference movements; None if the prediction needs none
    stopwatch: Stopwatch = field(default_factory=Stopwatch)
    associate: Callable[..., Matcher] | None = None  # function to match nodes (``Associate``); None = ``link``
    shape: ShapeBelief | None = None  # belief in the patient's shape; None before learning, or if it is not learnt

    def without_patient(self, why: str) -> Run:
        """Return the run without a patient, because the person who was found is not to be tracked. why: the reason for
        this.
        """
        return replace(self, room=replace(self.room, initial_frames=(), why_nobody=why))

    def with_learnt(self, belief: ShapeBelief) -> Run:
        """Return the run with the uncertainty of the learnt shape; unchanged if the settings leave learning out."""
        return replace(self, shape=belief if self.config.learning.own_shape else None)

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Add the time spent in the enclosed ``with`` block to the stage of this name."""
        return self.stopwatch.stage(name)
