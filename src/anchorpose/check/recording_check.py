"""Check a recording before anybody tracks it: what is good and bad about it."""

from __future__ import annotations

from pathlib import Path

from anchorpose.check.cameras import check_frames, check_poses
from anchorpose.check.depth import check_depth, check_lens
from anchorpose.check.material import Finding, gather_material
from anchorpose.check.patient import check_patient
from anchorpose.recording.reader import open_recording
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig


def check_recording(recording: Path) -> list[Finding]:
    """The findings in the order in which people read them; at most a few dozen depth images per camera are read.

    Raises InputError where the recording cannot be used at all.
    """
    with one_thread():
        material = gather_material(open_recording(recording), TrackConfig())
        return [
            *check_patient(material),
            *check_depth(material),
            *check_frames(material),
            *check_lens(material),
            *check_poses(material),
        ]
