"""A camera that measured nothing is left out with a note; where none measured, one sentence refuses the recording."""

import numpy as np
import pytest
from bad_images import BAD, COLUMNS, ROWS, large_recording
from recording_builder import write_picture

from anchorpose.errors import InputError
from anchorpose.recording.reader import input_files, open_recording, read_frames


def _kill(folder, camera, kind, but=()):
    for file in sorted((folder / camera / "depth").iterdir()):
        if int(file.stem) not in but:
            write_picture(file, BAD[kind][0])


@pytest.mark.parametrize("kind", ["saturated", "empty", "clipped", "noise over a room"])
@pytest.mark.parametrize("camera", ["front", "left"])
def test_a_dead_camera_is_left_out_with_a_note_and_the_others_go_on(tmp_path, kind, camera):
    folder = large_recording(tmp_path / "r", cameras=("front", "left", "right"))
    _kill(folder, camera, kind)
    recording = open_recording(folder)
    names = [one.name for one in recording.cameras]
    assert names == [name for name in ("front", "left", "right") if name != camera]
    assert len(recording.streams) == len(recording.backgrounds_m) == 2
    assert recording.notes[0].startswith(f"camera {camera} was left out: it measured nothing from first to last")
    assert BAD[kind][1] in recording.notes[0]
    assert any("times are those of camera left" in note for note in recording.notes) == (camera == "front")
    assert all(depth is not None for one in read_frames(recording) for depth in one.depths_m)
    assert not any(f"/{camera}/" in file.as_posix() for file in input_files(recording))


def test_a_camera_that_measured_for_a_moment_stays(tmp_path):
    folder = large_recording(tmp_path / "r")
    _kill(folder, "left", "empty", but=(4,))
    recording = open_recording(folder)
    assert (len(recording.cameras), recording.notes) == (2, ())


@pytest.mark.parametrize("kind", ["saturated", "empty", "noise over all values"])
def test_where_no_camera_measured_one_sentence_says_so(tmp_path, refusal, kind):
    folder = large_recording(tmp_path / "r")
    for camera in ("front", "left"):
        _kill(folder, camera, kind)
    with pytest.raises(InputError, match=f"front/depth: it measured nothing from first to last.*{BAD[kind][1]}"):
        open_recording(folder)
    assert "record again" in refusal(["track", str(folder), "-o", str(tmp_path / "out")])
    assert [path.name for path in tmp_path.iterdir()] == ["r"]


def test_a_background_that_is_no_measurement_is_refused(tmp_path):
    folder = large_recording(tmp_path / "r")
    write_picture(folder / "left" / "background.png", np.full((ROWS, COLUMNS), 65535, np.uint16))
    with pytest.raises(InputError, match=r"left.background\.png: is saturated.*record the empty room again"):
        open_recording(folder)
