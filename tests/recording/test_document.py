"""JSON text becomes values within limits of size, depth and numbers; every refusal is a sentence, in linear time."""

import json
import time
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anchorpose.errors import InputError
from anchorpose.recording.document import DEEPEST, LARGEST_INTEGER, parse_json, read_rows, require_plain
from anchorpose.settings import Unfit

TEXTS = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=8)
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**64), 2**64) | st.floats(allow_nan=False) | TEXTS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=4),
)


@given(VALUES)
def test_what_json_writes_comes_back(values):
    assert parse_json(json.dumps(values)) == values
    assert parse_json(json.dumps(values, ensure_ascii=False).encode()) == values


@given(st.binary(max_size=60) | st.text(max_size=60) | VALUES.map(lambda values: json.dumps(values)[:-1]))
def test_any_text_is_parsed_or_refused(text):
    with suppress(Unfit):  # and nothing else
        parse_json(text)


def nested(depth: int) -> str:
    return "[" * depth + "]" * depth


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (nested(DEEPEST + 2), "levels deep"),
        (nested(100_000), "levels deep"),
        ('{"a":' * 100_000, "levels deep"),
        ("1" + "0" * 400, "64 bits"),
        ("-" + "9" * 5000, "64 bits"),
        (str(2 * LARGEST_INTEGER), "64 bits"),
        ('{"a": 1, "b": 2, "a": 3}', "'a' is given twice"),
        ('["a\\u0000b"]', "no meaning"),
        ('{"\\ud800": 1}', "no meaning"),
        ("[1,\n2,]", "line 2"),
        (b'"\xff"', "UTF-8"),
        ("[" + "1," * 100 + "1]", "larger than"),
    ],
)
def test_texts_that_no_recorder_writes_are_refused(text, problem):
    with pytest.raises(Unfit, match=problem):
        parse_json(text, 150 if problem == "larger than" else 10**7)


def test_values_from_elsewhere_are_held_to_the_same_limits():
    require_plain({"a": [1, "b", None, "😀"]})
    with pytest.raises(Unfit, match="64 bits"):
        require_plain({"a": [10**400]})


def test_a_hundred_thousand_keys_of_which_one_is_twice_there_take_no_minute():
    keys = ",".join(f'"{number}": 0' for number in range(100_000))
    start = time.perf_counter()
    with pytest.raises(Unfit, match="'99999' is given twice"):
        parse_json("{" + keys + ', "99999": 1}')
    assert time.perf_counter() - start < 5


def test_a_quotation_mark_that_is_not_closed_is_refused_and_swallows_no_lines(tmp_path):
    path = tmp_path / "events.tsv"
    path.write_text('a\tb\n1\t"open\n2\tx\n')
    with pytest.raises(InputError, match=r"is not a table in line 3 .*must also end with one"):
        read_rows(path, "\t")
    path.write_text('a\tb\n1\t5" step\n2\t"said ""no"" twice"\n')
    assert read_rows(path, "\t") == [(1, ["a", "b"]), (2, ["1", '5" step']), (3, ["2", 'said "no" twice'])]
