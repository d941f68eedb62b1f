"""The patient's height in recording.json and as given by the user."""

from pathlib import Path

import pytest
from recording_builder import edit_json, write_recording

from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import UNKNOWN, Recording, Subject
from anchorpose.recording.recording_file import with_height
from anchorpose.tracker.config import TrackConfig


def recording(height_m: float | None) -> Recording:
    parts = dict.fromkeys(("cameras", "streams", "backgrounds_m"), ())
    return Recording(folder=Path("visit"), **parts, equipment=None, subject=Subject(height_m=height_m))


def test_the_given_height_is_used_where_the_recording_has_none_or_nearly_the_same():
    assert with_height(recording(None), 1.72).subject.height_m == 1.72
    assert with_height(recording(1.70), 1.72).subject.height_m == 1.72
    assert with_height(recording(1.70), None).subject.height_m == 1.70
    assert with_height(recording(None), None).subject.height_m is None
    with pytest.raises(InputError, match=r"recording\.json: says that the patient is 1\.70 m tall.*1\.85 m; measure"):
        with_height(recording(1.70), 1.85)


@pytest.mark.parametrize("height_m", [172.0, 1.1, 2.3, 0.0, -1.7, float("nan")])
def test_a_height_that_no_adult_has_is_refused(height_m):
    with pytest.raises(ValueError, match="height_m" if height_m != height_m else r"in metres, 1\.2 to 2\.2, got"):
        TrackConfig(height_m=height_m)


def stated(tmp_path: Path, subject: dict[str, object]) -> Subject:
    folder = write_recording(tmp_path / "visit")
    edit_json(folder / "recording.json", lambda document: document.update(subject=subject))
    return open_recording(folder).subject


def test_what_is_stated_about_the_patient_comes_back(tmp_path):
    given = {"height_m": 1.5, "age_years": 12.0, "sex": "female", "missing": ["hand_left"]}
    read = stated(tmp_path, given | {"covered": ["trunk", "head"]})
    assert (read.height_m, read.age_years, read.sex) == (1.5, 12.0, "female")
    assert (read.missing, read.covered) == (("hand_left",), ("trunk", "head"))
    assert read.grown is False


@pytest.mark.parametrize(
    ("subject", "why"),
    [
        ({"height_m": 17.2}, r"recording\.json: subject\.height_m is 17\.2; it must be at most 2\.8"),
        ({"age_years": -3}, r"subject\.age_years is -3; it must be at least 0"),
        ({"birth_year": 1066}, r"subject\.birth_year is 1066; it must be at least 1900"),
        ({"sex": "m"}, r"subject\.sex is \"m\"; it must be 'female' or 'male'"),
        ({"missing": ["tail"]}, r"subject\.missing\[0\] is \"tail\"; it must be 'arm_left'"),
        ({"covered": ["hair"]}, r"subject\.covered\[0\] is \"hair\"; it must be 'head'"),
        ({"weight_kg": 70}, "weight_kg"),
    ],
)
def test_an_impossible_statement_is_refused_in_one_sentence(tmp_path, subject, why):
    with pytest.raises(InputError, match=why) as refused:
        stated(tmp_path, subject)
    assert "\n" not in str(refused.value)


def test_who_is_grown_does_not_depend_on_todays_date():
    assert Subject(birth_year=1980).grown is True
    assert Subject(birth_year=2012).grown is None
    assert Subject(age_years=15.0).grown is False
    assert UNKNOWN.grown is None
