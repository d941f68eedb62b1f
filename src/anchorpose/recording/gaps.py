"""What is missing of each camera, in one sentence a camera instead of one a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.recording.pairing import pair_frames
from anchorpose.recording.recording import Recording

PAUSE_S: Final = 1.0
"""A longer stretch without pictures is told apart from dropped ones."""


@dataclass(frozen=True, slots=True)
class CameraGaps:
    """What one camera's stream lacks, on the reference clock.

    pictures: usable files; dropped: missing between its first and last, by its own usual period, pauses left out;
    doubled, repeated: left out because the picture or the time is that of the file before; late_s, early_s: how much
    later it starts and earlier it ends than the first camera (0 where it does not); pauses: (from, to) without
    pictures; paired_share: of the first camera's frames that have a picture of this one.
    """

    camera: str
    pictures: int
    dropped: int
    doubled: int
    repeated: int
    late_s: float
    early_s: float
    pauses: tuple[tuple[float, float], ...]
    paired_share: float

    @property
    def sentence(self) -> str:
        """What people should know; empty where nothing is missing."""
        parts = []
        if self.dropped:
            parts.append(f"{self.dropped} of {self.pictures + self.dropped} pictures are missing")
        if self.doubled:
            parts.append(f"{self.doubled} hold the picture before once more and were left out")
        if self.repeated:
            parts.append(f"{self.repeated} have the time of the one before and were left out")
        if self.late_s:
            parts.append(f"it starts {self.late_s:.1f} s late")
        if self.early_s:
            parts.append(f"it ends {self.early_s:.1f} s early")
        parts += [f"it has no pictures from {begin_s:.1f} to {end_s:.1f} s" for begin_s, end_s in self.pauses]
        return f"camera {self.camera}: {'; '.join(parts)}" if parts else ""


def find_gaps(recording: Recording) -> tuple[CameraGaps, ...]:
    """One a camera; the times of ``recording`` are on the reference clock (``recording.clock``)."""
    pairs, reference_s = pair_frames(recording), recording.streams[0].time_s
    return tuple(_of_camera(recording, index, pairs[:, index], reference_s) for index in range(len(recording.cameras)))


def _of_camera(recording: Recording, index: int, pair: np.ndarray, reference_s: np.ndarray) -> CameraGaps:
    stream = recording.streams[index]
    time_s = stream.time_s
    steps = np.diff(time_s)
    period_s = float(np.median(steps)) if len(steps) else 0.0
    paused = steps > max(PAUSE_S, 3.0 * period_s)
    missing = np.rint(steps / period_s) - 1.0 if len(steps) else np.zeros(0)
    doubled = 0 if stream.doubled is None else int(stream.doubled.sum())
    late_s, early_s = float(time_s[0] - reference_s[0]), float(reference_s[-1] - time_s[-1])
    return CameraGaps(
        camera=recording.cameras[index].name,
        pictures=len(time_s) - doubled,
        dropped=int(np.maximum(missing, 0.0)[~paused].sum()),
        doubled=doubled,
        repeated=stream.repeated,
        late_s=late_s if late_s > PAUSE_S else 0.0,
        early_s=early_s if early_s > PAUSE_S else 0.0,
        pauses=tuple((float(time_s[k]), float(time_s[k + 1])) for k in np.flatnonzero(paused)),
        paired_share=float((pair >= 0).mean()),
    )
