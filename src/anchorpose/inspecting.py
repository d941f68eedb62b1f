"""From a recording folder to pictures of every stage of one frame."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from anchorpose.pages.inspection_page import inspection_facts, inspection_sections, write_inspection
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import with_height
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import Inspection, inspect_frame


def inspect_recording(
    recording: Path, out: Path, frame: int, config: TrackConfig, as_tracked: bool, tick: Callable[[], None]
) -> Inspection:
    """Write pictures of every stage of one frame into an existing, empty folder; see ``inspect_frame``."""
    with one_thread():
        opened = open_recording(recording)
        inspection = inspect_frame(with_height(opened, config.height_m), frame, config, as_tracked, tick)
        title = f"{recording.resolve().name}: frame {frame}, {inspection.frame_set.time_s:.2f} s"
        account = (*opened.notes, *inspection.account, *inspection.frame_set.problems)
        write_inspection(out, title, inspection_sections(inspection, config), account, inspection_facts(inspection))
    return inspection
