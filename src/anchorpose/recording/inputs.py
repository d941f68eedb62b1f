"""Which files a recording consists of, so that a result can name what it was made from."""

from __future__ import annotations

from pathlib import Path

from anchorpose.recording.document import read_json_object
from anchorpose.recording.format import read_recording_document
from anchorpose.recording.recording import Recording


def input_files(recording: Recording) -> tuple[Path, ...]:
    """Every file that was read for ``recording``, pictures included, in a fixed order."""
    document = recording.folder / "recording.json"
    files = [document]
    equipment_file = read_recording_document(document).equipment_file
    if equipment_file:
        equipment = recording.folder / equipment_file
        parts = read_json_object(equipment).objects("parts")
        files += [equipment, *(equipment.parent / part.text("file") for part in parts if part.has("file"))]
    for camera, stream in zip(recording.cameras, recording.streams, strict=True):
        beside = (recording.folder / camera.name / name for name in ("timestamps.csv", "background.png"))
        files += [path for path in beside if path.exists()]
        files += stream.files
    return tuple(files)
