"""Which sessions a command line names: folders, patterns, tables; and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from anchorpose.batch.sessions import find_sessions
from anchorpose.cli.track import TrackOptions
from anchorpose.errors import InputError


def recording(folder: Path) -> Path:
    folder.mkdir(parents=True)
    (folder / "recording.json").write_text("{}")
    return folder


@pytest.fixture
def clinic(tmp_path: Path) -> Path:
    for name in ("anna/monday", "anna/friday", "ben/monday"):
        recording(tmp_path / "clinic" / name / "recording")
    return tmp_path / "clinic"


def names(*given: object) -> list[str]:
    return [session.name for session in find_sessions([str(each) for each in given], TrackOptions())]


def test_a_recording_a_folder_and_a_pattern_lead_to_recordings(clinic: Path) -> None:
    assert names(clinic / "ben" / "monday" / "recording") == ["recording"]
    assert names(clinic / "anna") == ["friday-recording", "monday-recording"]
    assert len(names(clinic)) == 3
    assert len(names(str(clinic / "*" / "monday"))) == 2


def test_names_are_as_short_as_they_can_be_and_one_recording_given_twice_is_one(clinic: Path) -> None:
    found = names(clinic)
    assert found == ["friday-recording", "anna-monday-recording", "ben-monday-recording"]
    assert names(clinic, clinic / "anna") == found


def test_a_table_has_a_row_per_session_with_its_own_options(clinic: Path) -> None:
    table = clinic / "sessions.csv"
    table.write_text(
        "recording,session,subject,height,smooth,config\n"
        "anna/monday/recording,a1,Anna,1.62,yes,anna.toml\n"
        "\n"
        '"ben/monday/recording",,B. 2,,,\n'
    )
    first, second = find_sessions([str(table)], TrackOptions(start=3))
    assert (first.name, first.subject) == ("a1", "Anna")
    assert first.options == TrackOptions(height=1.62, smooth=True, config=clinic / "anna.toml", start=3)
    assert (second.name, second.subject, second.options) == ("ben-monday-recording", "B. 2", TrackOptions(start=3))
    assert second.recording == clinic / "ben/monday/recording"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("folder\na\n", "no column 'recording'"),
        ("recording,hight\na,1\n", "is 'height' meant"),
        ("recording,height\na,tall\n", "line 2 has the height 'tall'"),
        ("recording,smooth\na,perhaps\n", "write yes or no"),
        ("recording,height\n,1.7\n", "line 2 names no recording"),
        ("recording\na,b\n", "line 2 has more cells"),
        ("recording,session\na,x\nb,x\n", "are both called x"),
    ],
)
def test_tables_with_mistakes_are_refused_by_line(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError, match=sentence):
        find_sessions([str(tmp_path / "t.csv")], TrackOptions())


@pytest.mark.parametrize(("given", "sentence"), [("nowhere", "is not there"), ("no*where", "matches no recording")])
def test_what_leads_nowhere_is_refused(tmp_path: Path, given: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        names(tmp_path / given)
