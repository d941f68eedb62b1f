"""The patient's height where somebody measured it: in recording.json, or told when tracking."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording

SAME_HEIGHT_M: Final = 0.03  # shoes and the time of day; more is another person, or a slip of the pen


def with_height(recording: Recording, height_m: float | None) -> Recording:
    """The recording with the told height, or its own where none is told.

    Raises InputError where the two contradict each other: nobody can know which one is wrong.
    """
    own_m = recording.subject_height_m
    if height_m is None:
        return recording
    if own_m is not None and abs(own_m - height_m) > SAME_HEIGHT_M:
        raise InputError(
            recording.folder / "recording.json",
            f"says that the patient is {own_m:.2f} m tall, and the told height is {height_m:.2f} m",
            "measure again, and correct the one or leave the other out",
        )
    return replace(recording, subject_height_m=height_m)
