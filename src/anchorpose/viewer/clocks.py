"""The cameras' clocks as a run used them, so that the viewer shows the pictures that were tracked together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from anchorpose.errors import InputError
from anchorpose.recording.clock import Clock


def clocks_of_run(path: Path, run: dict[str, Any], cameras: tuple[str, ...]) -> tuple[Clock, ...]:
    """One a camera, in the order of the names, from the run.json at ``path``; raises InputError where it tells none."""
    told = {camera["name"]: camera.get("clock") for camera in run["cameras"]}
    if not all(told.get(camera) for camera in cameras):
        raise InputError(path, "does not tell the cameras' clocks", "track the recording again with this version")
    return tuple(Clock(**told[camera]) for camera in cameras)
