"""The patient's height in recording.json and as given by the user."""

from __future__ import annotations

from pathlib import Path

import pytest

from anchorpose.errors import InputError
from anchorpose.recording.recording import Recording
from anchorpose.recording.recording_file import with_height
from anchorpose.tracker.config import TrackConfig


def recording(height_m: float | None) -> Recording:
    return Recording(
        folder=Path("visit"), cameras=(), streams=(), backgrounds_m=(), equipment=None, subject_height_m=height_m
    )


def test_the_given_height_is_used_where_the_recording_has_none_or_nearly_the_same():
    assert with_height(recording(None), 1.72).subject_height_m == 1.72
    assert with_height(recording(1.70), 1.72).subject_height_m == 1.72


def test_without_a_given_height_the_recordings_own_stays():
    assert with_height(recording(1.70), None).subject_height_m == 1.70
    assert with_height(recording(None), None).subject_height_m is None


def test_two_heights_of_two_people_are_refused():
    with pytest.raises(InputError, match=r"recording\.json: says that the patient is 1\.70 m tall.*1\.85 m; measure"):
        with_height(recording(1.70), 1.85)


@pytest.mark.parametrize("height_m", [172.0, 1.1, 2.3, 0.0, -1.7])
def test_a_height_that_no_adult_has_is_refused(height_m):
    with pytest.raises(ValueError, match=r"height_m is in metres, 1\.2 to 2\.2, got"):
        TrackConfig(height_m=height_m)


def test_a_height_that_is_not_a_number_is_refused():
    with pytest.raises(ValueError, match="height_m"):
        TrackConfig(height_m=float("nan"))
