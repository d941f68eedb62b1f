"""events.tsv: trials with their conditions are read as written, and everything that cannot be is refused by line."""

import json
from pathlib import Path

import numpy as np
import pytest

from anchorpose.errors import InputError
from anchorpose.recording.events import RecordedSpan, Trials, read_trials, recorded_span

SPAN = RecordedSpan(1.5, 61.5)
HEAD = "onset\tduration\ttrial_type"
UNITS = {"amplitude": {"Units": "mA", "Description": "current of the stimulator"}, "score": {"Units": "score"}}


def write(folder: Path, *lines: str, units: object = UNITS) -> Path:
    path = folder / "events.tsv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    if units is not None:
        (folder / "events.json").write_text(json.dumps(units), encoding="utf-8")
    return path


def read(folder: Path, *lines: str, units: object = UNITS) -> Trials:
    return read_trials(write(folder, *lines, units=units), SPAN)


def test_a_trial_is_a_row_and_its_numbers_have_units(tmp_path):
    trials = read(
        tmp_path,
        f"{HEAD}\tamplitude\telectrodes\tblock",
        "0\t10\toff\tn/a\tL1-L2\t1",
        "30\t12.5\ton\t40\tL1-L2\t1",
        "15\t10\toff\tn/a\tn/a\t2",
    )
    assert [trial.number for trial in trials.rows] == [1, 2, 3]  # in the order of the file, not of time
    assert [trial.condition for trial in trials.rows] == ["off", "on", "off"]
    assert trials.conditions == ("off", "on")
    assert [(column.name, column.unit) for column in trials.columns] == [
        ("amplitude", "mA"),
        ("electrodes", None),
        ("block", None),
    ]
    assert trials.column("amplitude") == (None, 40.0, None)
    assert trials.column("electrodes") == ("L1-L2", "L1-L2", None)
    assert trials.column("block") == ("1", "1", "2")  # names of blocks, never a quantity
    assert trials.columns[0].description == "current of the stimulator"


def test_onset_0_is_the_first_frame_whatever_its_clock_shows(tmp_path):
    (trial,) = read(tmp_path, HEAD, "2\t3\tquiet", units=None).rows
    assert (trial.onset_s, trial.start_s, trial.end_s) == (2.0, 3.5, 6.5)


def test_the_last_frame_lasts_a_usual_step():
    assert recorded_span(np.array([1.0, 1.1, 1.2])) == RecordedSpan(1.0, pytest.approx(1.3))
    assert recorded_span(np.array([4.0])) == RecordedSpan(4.0, 4.0)


def test_quotes_spaces_empty_lines_and_a_byte_order_mark_of_spreadsheets_are_accepted(tmp_path):
    path = tmp_path / "events.tsv"
    path.write_bytes(b'\xef\xbb\xbfonset\tduration\ttrial_type\r\n 1 \t2\t"arms, raised"\r\n\r\n')
    assert read_trials(path, SPAN).rows[0].condition == "arms, raised"


def test_trials_may_meet_and_may_end_with_the_recording(tmp_path):
    assert len(read(tmp_path, HEAD, "0\t30\ta", "30\t30\tb").rows) == 2


@pytest.mark.parametrize("unit", ["µs", "us", "Hz", "1", "arbitrary", "°"])
def test_sensible_units_are_known(tmp_path, unit):
    trials = read(tmp_path, f"{HEAD}\tx", "0\t1\ta\t3", units={"x": {"Units": unit}})
    assert trials.columns[0].unit in (unit, "us", "deg")


def test_levels_make_numbers_names(tmp_path):
    trials = read(tmp_path, f"{HEAD}\tsite", "0\t1\ta\t3", units={"site": {"Levels": {"3": "third contact"}}})
    assert trials.column("site") == ("3",)


OWN = f"{HEAD}\tamplitude"


@pytest.mark.parametrize(
    ("lines", "problem", "remedy"),
    [
        ((), "line 1 has no column onset, duration, trial_type", "tabs"),
        (("onset,duration,trial_type", "1,2,a"), "line 1 has no column", "a spreadsheet saves this as text with tabs"),
        (("onset\ttrial_type", "1\ta"), "line 1 has no column duration", "tabs"),
        ((HEAD,), "holds no trial", "one line per trial"),
        ((f"{HEAD}\tOnset", "1\t2\ta\t3"), "two columns 'onset'", "keep one"),
        ((f"{HEAD}\tvalue", "1\t2\ta\t3"), "line 1 has a column 'value'", "rename it"),
        ((f"{HEAD}\t", "1\t2\ta\t3"), "line 1 has a column named", "short name"),
        ((HEAD, "1\t2\ta", "5\t2"), "line 3 has 2 cells, not 3", "n/a where a value is missing"),
        ((HEAD, "one\t2\ta"), "line 2 has the onset 'one', which is not a number", "decimal point"),
        ((HEAD, "1,5\t2\ta"), "line 2 has the onset '1,5'", "decimal point"),
        ((HEAD, "1\tinf\ta"), "line 2 has the duration 'inf'", "decimal point"),
        ((HEAD, "1\tn/a\ta"), "line 2 has no duration", "fill it in"),
        ((HEAD, "1\t2\tn/a"), "line 2 has no trial_type", "fill it in"),
        ((HEAD, "1\t-2\ta"), "line 2 has a negative duration", "how many seconds"),
        ((HEAD, "1\t0\ta"), "line 2 has the duration 0", "how many seconds"),
        (
            (HEAD, "-1\t2\ta"),
            "line 2 is a trial from -1 to 1 s, outside of the recording (0 to 60.000 s)",
            "first frame",
        ),
        ((HEAD, "1\t2\ta", "59\t2\ta"), "line 3 is a trial from 59 to 61 s, outside of the recording", "first frame"),
        ((HEAD, "9\t2\ta", "1\t9\ta"), "line 2 begins at 9 s, before the trial of line 3 has ended at 10 s", "overlap"),
        ((OWN, "1\t2\ta\t40 mA"), "line 2 has the amplitude '40 mA', which is not a number", "n/a where there is none"),
        ((f"{HEAD}\twidth", "1\t2\ta\t300"), "numbers in the column 'width' without a unit in events.json", '"Units"'),
        ((HEAD, "1\t2\t" + "a" * 300), "line 2 has the cell", "short text"),
        ((HEAD, "1\t2\ta\0"), "null characters", "UTF-8"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(tmp_path, lines, problem, remedy):
    with pytest.raises(InputError) as refused:
        read(tmp_path, *lines)
    text = str(refused.value)
    assert text.startswith(f"{tmp_path / 'events.tsv'}: ")
    assert problem in text
    assert remedy in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("units", "problem", "remedy"),
    [
        ({"amplitude": {"Units": "ma"}}, "amplitude.Units is the unknown unit 'ma'", "write 'mA'"),
        ({"amplitude": {"Units": "furlong"}}, "the unknown unit 'furlong'", "known units are s, ms"),
        ({"amplitude": {"Units": 3}}, "amplitude.Units is 3", "text"),
        ({"amplitude": "mA"}, "amplitude", "object"),
        ([], "is not a JSON object", "curly bracket"),
        (None, "numbers in the column 'amplitude' without a unit in events.json", '"Units"'),
    ],
)
def test_units_that_cannot_be_are_refused_too(tmp_path, units, problem, remedy):
    with pytest.raises(InputError) as refused:
        read(tmp_path, OWN, "1\t2\ta\t40", units=units)
    assert problem in str(refused.value)
    assert remedy in str(refused.value)


def test_files_that_are_no_text_or_too_large_are_refused(tmp_path):
    path = tmp_path / "events.tsv"
    path.write_bytes(HEAD.encode() + b"\n1\t2\t\xff\xfe\n")
    with pytest.raises(InputError, match="UTF-8"):
        read_trials(path, SPAN)
    path.write_bytes(HEAD.encode() + b"\n" + b"1\t2\ta\n" * 700_000)
    with pytest.raises(InputError, match="at most"):
        read_trials(path, SPAN)
    path.write_bytes(HEAD.encode() + b"\n" + b"1\t2\ta\n" * 3000)
    with pytest.raises(InputError, match="3000 trials"):
        read_trials(path, SPAN)
    with pytest.raises(InputError, match="no such file"):
        read_trials(tmp_path / "none.tsv", SPAN)
