"""What verbs print acts on no terminal: markup, control characters and passwords of names stay text."""

import json
from pathlib import Path

import pytest
from recording_builder import write_recording
from report_builder import squats, write_session

from anchorpose.cli import main
from anchorpose.cli.console import printable, progress_bar, say, show_table

NASTY = "[/bold][red]x\x1b[31m\x07\x9b\r\u202e\u2066\u2028:smile:"
SHOWN = r"[/bold][red]x\x1b[31m\x07\x9b\r\u202e\u2066\u2028:smile:"
ACTING = "\x1b\x07\x9b\r\u202e\u2066\u2028"


def harmless(text: str) -> bool:
    return not any(character in text for character in ACTING)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        (NASTY, SHOWN),
        ("a\nb\tc", r"a\nb\tc"),
        ("\udcff", r"\udcff"),  # a byte of a file's name that is no UTF-8
        ("Zoë Ağaoğlu, 王 – ±", "Zoë Ağaoğlu, 王 – ±"),
        ("sftp://u:p@ss@host/x and s3://bucket/x", "sftp://u:***@host/x and s3://bucket/x"),
        ("sftp:/u:pw@host/x", "sftp:/u:***@host/x"),
        ("sftp://host:22/a@b", "sftp://host:22/a@b"),
        ("https://h/x?X-Amz-Signature=abc&n=1", "https://h/x?X-Amz-Signature=***&n=1"),
    ],
)
def test_characters_that_act_are_written_as_escapes(text: str, shown: str, capsys) -> None:
    assert printable(text) == shown
    say(text)
    say(text, error=True)
    assert capsys.readouterr() == (f"{shown}\n", f"{shown}\n")


def test_tables_and_progress_show_every_text_as_it_stands(capsys, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    show_table((NASTY,), [(NASTY,)], title=NASTY)
    with progress_bar(NASTY) as progress:
        progress(1, 2)
    printed, errors = capsys.readouterr()
    assert printed.count(SHOWN) == 3
    assert SHOWN in errors
    assert harmless(printed)


def nasty_name(folder: Path) -> Path:
    """A folder whose name acts on a terminal and has markup in it."""
    return folder / "[red]x\x1b[31m\u202e"


VERBS = {
    "track": ["track", "{name}", "-o", "{out}"],
    "track into": ["track", "{recording}", "-o", "{name}/x/y"],
    "check": ["check", "{recording}"],
    "calibrate": ["calibrate", "{recording}", "-o", "{out}"],
    "evaluate": ["evaluate", "{results}", "--truth", "{name}"],
    "report": ["report", "{results}"],
    "verify": ["verify", "{results}"],
    "verify of nothing": ["verify", "{name}"],
    "measure": ["measure", "{results}", "--by", "[/bold]"],
    "export": ["export", "{results}", "--to", "csv", "-o", "{name}"],
    "convert": ["convert", "{name}", "{out}"],
    "inspect": ["inspect", "{recording}", "--frame", "1", "-o", "{out}"],
    "reliability": ["reliability", "{table}"],
    "batch": ["batch", "{recording}", "-o", "{out}", "--workers", "1"],
    "batch of a table": ["batch", "{table}", "-o", "{out}"],
    "a number": ["track", "a", "-o", "b", "--height", "{name}"],
    "an option": ["track", "a", "-o", "b", "--{name}"],
    "a verb": ["{name}"],
    "view": ["view", "{name}"],
    "demo": ["demo", "{recording}"],
    "simulate": ["simulate", "{recording}"],
    "equipment": ["equipment", "fit", "{name}", "-o", "{out}"],
    "motions": ["motions", "build", "{out}", "{name}"],
    "experiment": ["experiment", "{out}", "--config", "{name}"],
    "benchmark": ["benchmark", "score", "{name}", "{out}"],
    "live": ["live", "{name}", "-o", "{out}"],
}


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A recording, results and a table in folders with such names; cameras and parts have markup in their names."""
    name = nasty_name(tmp_path_factory.mktemp("names"))
    name.mkdir()
    recording = write_recording(name / "[bold]r", frames=2)
    document = json.loads((recording / "recording.json").read_text())
    document["cameras"][0]["name"] = "[/bold]\x1b[31m"
    spoilt = write_recording(name / "spoilt", frames=2)
    (spoilt / "recording.json").write_text(json.dumps(document))
    write_session(name / "[/red]", squats(30))
    (name / "t.csv").write_text("subject,session,measure,value\n[/bold]\x1b[31m,\u202e1,[red]\x1b[2J,x\n")
    return {
        "name": name / "[/bold]",
        "recording": recording,
        "spoilt": spoilt,
        "results": name / "[/red]",
        "table": name / "t.csv",
    }


@pytest.mark.parametrize(
    "verb", [pytest.param(verb, marks=pytest.mark.thorough) if verb == "batch" else verb for verb in VERBS]
)
def test_no_verb_prints_a_character_that_acts_on_a_terminal(verb, given, tmp_path, capsys) -> None:
    out = nasty_name(tmp_path)
    code = main([each.format(out=out, **given) for each in VERBS[verb]])
    printed = "".join(capsys.readouterr())
    assert code in (0, 1, 2), printed
    assert harmless(printed), printed


@pytest.mark.parametrize("verb", ["track", "check", "calibrate"])
def test_names_in_a_file_are_refused_or_shown_as_text(verb, given, tmp_path, capsys) -> None:
    output = [] if verb == "check" else ["-o", str(tmp_path / "out")]
    assert main([verb, str(given["spoilt"]), *output]) in (1, 2)
    assert harmless("".join(capsys.readouterr()))
