"""Which sessions a command line names: folders, patterns, tables; and what is refused."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from anchorpose.batch.sessions import LONGEST_NAME, Session, find_sessions, open_folder
from anchorpose.cli.track_verbs import TrackOptions
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


def sessions(*given: object) -> tuple[Session, ...]:
    return find_sessions([str(each) for each in given], TrackOptions())


def names(*given: object, out: Path | None = None) -> list[str]:
    """As they are called in the folder of a batch, by default a new one."""
    with TemporaryDirectory() as folder:
        return [session.name for session in open_folder(out or Path(folder) / "out", sessions(*given))]


def test_recordings_folders_and_patterns_lead_to_recordings_once_each_with_short_names(clinic: Path) -> None:
    assert names(clinic / "ben" / "monday" / "recording") == ["recording"]
    assert (names(clinic / "anna"), len(names(clinic))) == (["friday-recording", "monday-recording"], 3)
    assert len(names(str(clinic / "*" / "monday"))) == 2
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
    assert (second.name, second.subject, second.options) == ("", "B. 2", TrackOptions(start=3))
    assert second.recording == clinic / "ben/monday/recording"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("folder\na\n", "no column 'recording'"),
        ("recording,hight\na,1\n", "write 'height' if that is meant"),
        ("recording,height\na,tall\n", "line 2 has the height 'tall'"),
        ("recording,smooth\na,perhaps\n", "write yes or no"),
        ("recording,height\n,1.7\n", "line 2 names no recording"),
        ("recording\na,b\n", "line 2 has more cells"),
        ("recording,session\na,x\nb,x\n", "are both called x"),
        ("recording,session\nrec,a\nrec,A\n", "other names in the column 'session'; capitals and the form of accents"),
        ("recording,session\nrec,\u00e9\nrec,e\u0301\n", "other names in the column 'session'"),
        ("recording,height\n", "names no recording; add a line"),
        ("recording,height\na,1_0\n", "line 2 has the height '1_0'"),
        (f"recording,start\na,{'9' * 400}\n", "line 2 has the start '9{40}'; write a whole number"),
        ("recording,session\na,Anna\nb,anna\n", "are both called Anna"),
        ("recording,height\na,1.7\na,1.8\n", "are both called a"),
        ("recording,recording\na,b\n", "two columns 'recording'"),
        ("recording,start\na,1.7\n", "line 2 has the start '1.7'; write a whole number"),
        (f"recording,subject\na,{'x' * 200_000}\n", "is not CSV in line 2"),
        ("recording\na\0b\n", "null characters"),
        (f"recording,session\na,{'x' * 252}\n", "has a name of 252 bytes"),
    ],
)
def test_tables_with_mistakes_are_refused_by_line(tmp_path: Path, text: str, sentence: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(InputError, match=sentence):
        names(tmp_path / "t.csv")


@pytest.mark.parametrize(("given", "sentence"), [("nowhere", "is not there"), ("no*where", "matches no recording")])
def test_what_leads_nowhere_is_refused(tmp_path: Path, given: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        names(tmp_path / given)


def photographed(folder: Path, first: bytes) -> Path:
    """A recording with one depth image."""
    (recording(folder) / "front" / "depth").mkdir(parents=True)
    (folder / "front" / "depth" / "000000.png").write_bytes(first)
    return folder


def test_a_name_belongs_to_one_recording_over_all_calls_into_one_folder(tmp_path: Path) -> None:
    out, anna, ben = tmp_path / "out", tmp_path / "anna" / "monday", tmp_path / "ben" / "monday"
    photographed(anna, b"a")
    photographed(ben, b"b")
    assert (names(anna, out=out), names(ben, out=out)) == (["monday"], ["ben-monday"])
    assert names(ben, anna, out=out) == ["ben-monday", "monday"]


def test_a_moved_recording_keeps_its_name_and_another_one_at_its_place_gets_its_own(tmp_path: Path) -> None:
    out, anna = tmp_path / "out", photographed(tmp_path / "anna" / "monday", b"a")
    assert names(anna, out=out) == ["monday"]
    moved = anna.rename(tmp_path / "moved")
    photographed(anna, b"c")
    assert (names(anna, out=out), names(anna, out=out)) == (["anna-monday"], ["anna-monday"])
    assert names(photographed(tmp_path / "b" / "latest", b"e"), out=out) == ["latest"]
    assert names((tmp_path / "b" / "latest").rename(tmp_path / "c"), out=out) == ["latest"]
    assert names(moved, out=out) == ["moved"]  # the place that it came from is another recording's now


def test_the_name_of_another_recording_cannot_be_given_and_nothing_is_forgotten(tmp_path: Path) -> None:
    out, table = tmp_path / "out", tmp_path / "t.csv"
    anna, ben = photographed(tmp_path / "anna", b"a"), photographed(tmp_path / "ben", b"b")
    assert names(anna, out=out) == ["anna"]
    before = (out / "batch.json").read_text()
    table.write_text(f"recording,session\n{ben},Anna\n")
    with pytest.raises(InputError, match=r"ben: is called Anna, which is the name of another recording, .*anna"):
        names(table, out=out)
    assert (out / "batch.json").read_text() == before


def test_names_are_short_enough_for_all_that_is_added_and_no_device_of_windows(tmp_path: Path) -> None:
    long = [tmp_path / f"{'ä' * 120}{end}" for end in "12"]
    found = names(*(recording(each) for each in long))
    assert len(set(found)) == 2
    assert all(len(name.encode()) <= LONGEST_NAME for name in found)
    assert names(recording(tmp_path / "aux")) == ["_aux"]
    assert names(recording(tmp_path / "x\x1b[31m\u202ey\nz")) == ["x_31m_y_z"]


def test_a_damaged_file_of_names_is_one_sentence_with_another_folder_as_the_remedy(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    for text in ("", "[]", "{", '{"format": "anchorpose-batch", "sessions": [3]}'):
        (tmp_path / "out" / "batch.json").write_text(text)
        with pytest.raises(InputError, match=r"batch\.json: is damaged.*choose another folder for the batch"):
            names(recording(tmp_path / f"a{len(text)}"), out=tmp_path / "out")


def test_passwords_of_addresses_are_in_no_name_and_no_file(tmp_path: Path) -> None:
    given = ("sftp://u:se%40cret@host/a/x", "sftp://u:secret@other/b/x")
    assert names(*given, out=tmp_path / "out") == ["a-x", "b-x"]
    text = (tmp_path / "out" / "batch.json").read_text()
    assert "sftp://u:***@host/a/x" in text
    assert "cret" not in text
