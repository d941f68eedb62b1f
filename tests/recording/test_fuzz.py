"""Whatever is written into a recording's files, it is either read or refused by name."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_builder import HEIGHT, WIDTH, depth_grey, write_recording

from anchorpose.errors import InputError
from anchorpose.recording.depth_image import read_depth_image
from anchorpose.recording.reader import open_recording

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def _places(value: Any, place: tuple = ()) -> list[tuple]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [place, *(deeper for key, child in children for deeper in _places(child, (*place, key)))]


def _put(value: Any, place: tuple, new: Any) -> Any:
    if not place:
        return new
    copy = value.copy()
    copy[place[0]] = _put(value[place[0]], place[1:], new)
    return copy


def _refusal(folder: Path) -> str:
    """What an InputError says; empty where the recording opens. Any other error fails the test."""
    try:
        open_recording(folder)
    except InputError as error:
        return str(error)
    return ""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    return write_recording(tmp_path_factory.mktemp("fuzz") / "r", frames=2)


@pytest.mark.parametrize("name", ["recording.json", "equipment.json"])
@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_any_value_in_any_place_is_read_or_refused_with_the_files_name(folder, name, data):
    text = (folder / name).read_text()
    document = json.loads(text)
    place = data.draw(st.sampled_from(_places(document)))
    try:
        (folder / name).write_text(json.dumps(_put(document, place, data.draw(anything))))
        refusal = _refusal(folder)
    finally:
        (folder / name).write_text(text)
    assert refusal == "" or refusal.startswith(str(folder))
    assert "\n" not in refusal


@settings(max_examples=80, deadline=None)
@given(content=st.binary(max_size=60) | st.text("frame,time_s\n0123456789.-e", max_size=60).map(str.encode))
def test_any_timestamps_are_read_or_refused(folder, content):
    path = folder / "front" / "timestamps.csv"
    before = path.read_bytes()
    try:
        path.write_bytes(content)
        refusal = _refusal(folder)
    finally:
        path.write_bytes(before)
    assert refusal == "" or "front" in refusal


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_a_damaged_picture_is_never_taken_for_another(folder, data):
    recording = open_recording(folder)
    path = recording.streams[0].files[1]
    sound = path.read_bytes()
    damaged = bytearray(sound)
    for _ in range(data.draw(st.integers(1, 3))):
        damaged[data.draw(st.integers(0, len(sound) - 1))] ^= data.draw(st.integers(1, 255))
    cut = data.draw(st.integers(0, len(sound)))
    try:
        path.write_bytes(bytes(damaged[:cut]))
        picture = read_depth_image(path, recording.cameras[0])
    finally:
        path.write_bytes(sound)
    if picture.depth_m is None:
        assert picture.problem
    else:
        np.testing.assert_allclose(picture.depth_m, depth_grey(1) * 0.001, atol=1e-6)
        assert picture.depth_m.shape == (HEIGHT, WIDTH)
