"""Whatever is written into a recording's files, it is either read or refused by name."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recording_builder import HEIGHT, WIDTH, depth_grey, write_recording

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
from fuzz import recording_outcome
from spoil_recording import spoil

from anchorpose.calibration.marker_layout import MarkerLayout
from anchorpose.errors import InputError
from anchorpose.recording.depth_image import read_depth_image
from anchorpose.recording.document import load_config, read_document
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import read_calibration
from anchorpose.results.corrections import read_corrections
from anchorpose.results.run_record import as_json
from anchorpose.tracker.config import TrackConfig

anything = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


BEYOND_ALL_LIMITS = (10**400, -(10**4000), 1e308, float("nan"), float("inf"), "x" * 5000, "a\nb", [[[[[[[[[[1]]]]]]]]]])


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


def _marker_layout(pose: list[list[float]]) -> dict[str, Any]:
    tag = {"id": 4, "size_m": 0.16, "pose": pose}
    return {"format": "marker-layout", "version": 1, "dictionary": "DICT_APRILTAG_36h11", "tags": [tag]}


def _corrections(pose: list[list[float]]) -> dict[str, Any]:
    by = {"reason": "a curtain", "who": "AB", "when": "2026-03-01T09:30:00Z"}
    interval = {"first_frame": 3, "last_frame": 9, "start_s": 0.3, "end_s": 0.9, **by}
    joint = {"frame": 4, "time_s": 0.4, "joint": "KneeLeft", "position_m": [0, 0, 0], "sigma_m": 0.1, **by}
    recording = {"name": "ward", "sha256": "a", "cameras": [{"name": "front", "camera_to_world": pose}]}
    taken = {"entry": interval, "who": "AB", "when": by["when"]}
    head = {"format": "anchorpose-corrections", "version": 1, "recording": recording}
    return {**head, "unusable": [interval], "joints": [joint], "withdrawn": [taken]}


def _calibration(pose: list[list[float]]) -> dict[str, Any]:
    return {"format": "camera-calibration", "version": 1, "cameras": [{"name": "front", "camera_to_world": pose}]}


DOCUMENTS = {
    "markers": (_marker_layout, lambda path: read_document(path, MarkerLayout)),
    "corrections": (_corrections, read_corrections),
    "calibration": (_calibration, read_calibration),
    "settings": (lambda pose: as_json(TrackConfig()), lambda path: load_config(path, TrackConfig)),
}


@pytest.mark.parametrize("kind", DOCUMENTS)
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_any_value_in_any_place_of_any_document_is_read_or_refused_in_one_sentence(tmp_path_factory, kind, data):
    make, read = DOCUMENTS[kind]
    document, path = make(np.eye(4).tolist()), tmp_path_factory.getbasetemp() / f"{kind}.json"
    path.write_text(json.dumps(document))
    read(path)
    place = data.draw(st.sampled_from(_places(document)))
    path.write_text(json.dumps(_put(document, place, data.draw(anything | st.sampled_from(BEYOND_ALL_LIMITS)))))
    try:
        read(path)
        refusal = str(path)
    except InputError as error:
        refusal = str(error)
    assert refusal.startswith(str(path))
    assert "\n" not in refusal
    assert len(refusal) < len(str(path)) + 800


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


@settings(max_examples=200, deadline=None)
@given(number=st.integers(0, 2**32))
def test_a_recording_spoilt_in_any_way_is_read_or_refused_in_one_sentence(tmp_path_factory, folder, number):
    bad = tmp_path_factory.mktemp("spoilt") / "bad"
    shutil.copytree(folder, bad)
    spoil(bad, number)
    assert recording_outcome(bad) in ("read", "refused")
