"""What a reviewer of earlier results said of some frames: which are of no use, and where joints are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.body.limbs import LIMB_OF_JOINTS
from anchorpose.body.told_joints import ToldJoints
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.recording import Recording
from anchorpose.results.corrections import Corrections, JointCorrection


@dataclass(frozen=True, slots=True, eq=False)
class Review:
    """joints: by frame number. unusable: first and last frame, both included, and the sentence that says why."""

    joints: dict[int, ToldJoints] = field(default_factory=dict)
    unusable: tuple[tuple[int, int, str], ...] = ()

    def why_unusable(self, frame: int) -> str | None:
        """The sentence of the first interval that holds the frame, None where the frame may be used."""
        return next((why for first, last, why in self.unusable if first <= frame <= last), None)


NOTHING_SAID: Final = Review()


def held_joints(review: Review, frames: Sequence[int]) -> np.ndarray:
    """(t, 21) bool: the told joints of the frames with these numbers, and all joints of their limbs."""
    held = np.zeros((len(frames), JOINT_COUNT), bool)
    for row, frame in enumerate(frames):
        told = review.joints.get(frame)
        if told is not None:
            held[row] = np.isin(LIMB_OF_JOINTS, LIMB_OF_JOINTS[told.joint])
    return held


def review_of(corrections: Corrections) -> Review:
    """What tracking needs of a file of corrections."""
    by_frame: dict[int, list[JointCorrection]] = {}
    for entry in corrections.joints:
        by_frame.setdefault(entry.frame, []).append(entry)
    unusable = tuple(
        (gone.first_frame, gone.last_frame, f"marked as unusable by {gone.who} on {gone.when[:10]}: {gone.reason}")
        for gone in corrections.unusable
    )
    return Review({frame: _told(entries) for frame, entries in by_frame.items()}, unusable)


def require_frames(path: Path, review: Review, recording: Recording) -> None:
    """Raises InputError where joints are corrected in a frame that the recording does not have."""
    strangers = sorted(set(review.joints) - set(recording.streams[0].frame.tolist()))
    if strangers:
        problem = f"corrects joints of frame {strangers[0]}, which the recording does not have"
        raise InputError(path, problem, "take that correction out")


def _told(entries: list[JointCorrection]) -> ToldJoints:
    return ToldJoints(
        joint=np.array([JOINT_INDEX[entry.joint] for entry in entries]),
        position_m=np.array([entry.position_m for entry in entries]),
        sigma_m=np.array([entry.sigma_m for entry in entries]),
    )
