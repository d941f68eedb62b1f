"""No number of any option is too absurd for one sentence: every numeric option that a verb declares is tried."""

import time
from collections.abc import Iterator
from typing import Any, get_args

import pytest

from anchorpose.cli import app, main
from anchorpose.errors import AnchorposeError
from anchorpose.live.page_server import PageOutput
from anchorpose.tracker.config import TrackConfig

ABSURD = ("inf", "-inf", "nan", "1e308", "-1", "9" * 400, "0x", "1_0", "")
ZERO_IS_FINE = {"--seed", "--therapists", "--skip-s", "--frame", "--start", "--stop", "--index", "--port"}
ZERO_IS_FINE |= {"--empty-room", "--longest-gap"}
ZERO_IS_FINE |= {"--near", "--effect-deg", "--effect-seconds", "--incidents"}
NEGATIVE_IS_FINE = {"--near"}
NEED_OUTPUT = {"batch", "live", "record", "sync", "track"}


def numeric_options(verb: Any = app, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], str, bool]]:
    """(verb, option, whether it is whole) of every parameter that is a number, as the command line declares it."""
    for name in verb:
        if name.startswith("-"):
            continue
        command = verb[name]
        yield from numeric_options(command, (*path, name))
        if command.default_command is None:
            continue
        for argument in command.assemble_argument_collection():
            kinds = {argument.hint, *get_args(argument.hint)}
            if kinds & {int, float}:
                yield (*path, name), argument.name, int in kinds


ALL = sorted(set(numeric_options()))
OPTIONS = [(verb, option) for verb, option, _ in ALL]
WHOLE = [(verb, option) for verb, option, whole in ALL if whole]


def test_every_verb_with_a_number_is_among_them():
    assert len(OPTIONS) >= 28
    assert {verb[0] for verb, _ in OPTIONS} >= {"simulate", "track", "live", "record", "inspect", "measure", "convert"}


@pytest.mark.parametrize(("verb", "option"), OPTIONS, ids=lambda value: value if isinstance(value, str) else value[-1])
@pytest.mark.parametrize("value", [*ABSURD, "0"], ids=lambda value: value[:6] or "empty")
def test_an_absurd_number_is_one_sentence_that_names_its_option(verb, option, value, capsys):
    if (value == "0" and option in ZERO_IS_FINE) or (value == "-1" and option in NEGATIVE_IS_FINE):
        return
    begin = time.monotonic()
    output = ["-o", "out"] if verb[0] in NEED_OUTPUT else []
    assert main([*verb, "somewhere", "elsewhere", *output, f"{option}={value}"]) == 2
    said = " ".join("".join(capsys.readouterr()).replace("│", " ").split())
    assert option.strip("-").upper() in said.upper()
    assert "Traceback" not in said
    assert len(said) < 700 + len(value)
    assert time.monotonic() - begin < 20.0


@pytest.mark.parametrize(("verb", "option"), WHOLE, ids=lambda value: value if isinstance(value, str) else value[-1])
def test_a_fraction_is_no_whole_number(verb, option, capsys):
    output = ["-o", "out"] if verb[0] in NEED_OUTPUT else []
    assert main([*verb, "somewhere", "elsewhere", *output, f"{option}=1.7"]) == 2
    assert f'{option}: "1.7" is not a whole number' in capsys.readouterr().err


def test_what_is_no_number_is_called_that(refusal):
    assert '"nan" is not a number' in " ".join(refusal(["simulate", "out", "--fps", "nan"]).split())


@pytest.mark.parametrize("place", ["1e300,0", "0,-101", "1_0,0"])
def test_a_patient_is_nowhere_that_no_room_reaches(place, capsys):
    assert main(["track", "somewhere", "-o", "out", "--patient", place]) == 2
    assert "two numbers in metres with a comma, up to 100" in " ".join(capsys.readouterr().err.split())
    with pytest.raises(ValueError, match="patient_xz_m is in metres"):
        TrackConfig(patient_xz_m=(1e300, 0.0))


@pytest.mark.parametrize("host", ["\u0130" * 70, "a" * 300])
def test_a_host_that_has_no_such_name_is_refused(host):
    """By the page of ``live``; that of ``view`` is served by the same class."""
    with pytest.raises(AnchorposeError, match="Cannot listen on"):
        PageOutput(host, 0)


@pytest.mark.parametrize(
    "given", [["batch", "a\udcff", "-o", "x"], ["report", "r", "--by", "\udcff"], ["check", "\udcff"]]
)
def test_bytes_that_are_no_text_are_refused_by_every_verb(given, tmp_path, monkeypatch, refusal):
    monkeypatch.chdir(tmp_path)
    assert "is not text in UTF-8" in refusal(given)
    assert not list(tmp_path.iterdir())
