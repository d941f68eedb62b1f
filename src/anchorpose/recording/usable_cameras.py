"""Cameras that were dead throughout a recording: the others go on without them."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.recording.depth_image import read_stream_image
from anchorpose.recording.recording import Recording

LOOKED_AT: Final = 40  # depth images of each camera, evenly spread: about as many as the empty room is learnt from


def without_dead_cameras(recording: Recording) -> Recording:
    """The recording without the cameras that measured nothing from first to last, and with a note on each.

    Such a camera was blinded, covered or broken: its files are whole and hold no measurement (``content_problem``).
    Raises InputError where no camera is left.
    """
    dead = {number: why for number in range(len(recording.cameras)) if (why := _why_dead(recording, number))}
    if not dead:
        return recording
    alive = [number for number in range(len(recording.cameras)) if number not in dead]
    if not alive:
        remedy = "nothing was measured: uncover the lens, keep the sun out, and record again"
        raise InputError(recording.folder / recording.cameras[0].name / "depth", dead[0], remedy)
    notes = [f"camera {recording.cameras[number].name} was left out: {why}" for number, why in dead.items()]
    if 0 in dead:
        notes.append(
            f"frames and times are those of camera {recording.cameras[alive[0]].name}, the first that measured"
        )
    return replace(
        recording,
        cameras=tuple(recording.cameras[number] for number in alive),
        streams=tuple(recording.streams[number] for number in alive),
        backgrounds_m=tuple(recording.backgrounds_m[number] for number in alive),
        notes=(*recording.notes, *notes),
    )


def _why_dead(recording: Recording, camera: int) -> str:
    """Why no depth image of a camera can be used; empty where one can."""
    count = len(recording.streams[camera].files)
    problem = ""
    for position in np.unique(np.linspace(0, count - 1, LOOKED_AT).astype(int)).tolist():
        image = read_stream_image(recording, camera, position)
        if not image.problem:
            return ""
        problem = problem or f"{recording.streams[camera].files[position].name} {image.problem}"
    return f"it measured nothing from first to last ({problem})"
