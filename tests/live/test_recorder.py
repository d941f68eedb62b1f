"""A recording that is written while the cameras run is whole at the end, and can be finished after a power cut."""

import errno
import json
import os
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from anchorpose.camera import Camera
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.lens import Intrinsics
from anchorpose.live import recorder as module
from anchorpose.live.feed import Intake, LiveImage
from anchorpose.live.markers import MARKERS_FILE
from anchorpose.live.recorder import UNFINISHED_FILE, Recorder, finish_recording
from anchorpose.recording.events import EVENTS_FILE, read_trials, recorded_span
from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.sources.plan import CameraPlan

LENS = Intrinsics(fx=60.0, fy=60.0, cx=32.0, cy=24.0)
CAMERA = CameraPlan(
    camera=Camera(name="left", width=64, height=48, depth_scale=0.001, intrinsics=LENS), model="Stand-in", serial="7"
)


def image(number: int) -> LiveImage:
    grey = np.full((48, 64), 1000 + number, np.uint16)
    return LiveImage(0, number, 5.0 + number / 30.0, time.monotonic(), grey)


def test_what_was_given_is_what_is_recorded_with_its_numbers_and_times(tmp_path):
    recorder = Recorder(tmp_path / "out", [CAMERA])
    for number in (3, 4, 6):
        recorder.put(image(number))
    assert not (tmp_path / "out" / "recording.json").exists()
    recording = open_recording(recorder.finish())
    assert recording.streams[0].frame.tolist() == [3, 4, 6]
    assert recording.streams[0].time_s == pytest.approx([5.1, 5.0 + 4 / 30, 5.2], abs=1e-6)
    assert np.all(read_frame(recording, 2).depths_m[0] == np.float32(1006) * np.float32(0.001))


def test_a_note_that_the_full_disk_does_not_take_leaves_a_whole_recording(tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(errno.ENOSPC, "No space left on device")

    recorder = Recorder(tmp_path / "out", [CAMERA])
    recorder.put(image(3))
    monkeypatch.setattr(module, "write_text_whole", full)
    assert len(open_recording(recorder.finish(["2 depth images could not be recorded"])).streams[0].files) == 1


def cut_off(folder):
    """As a power cut leaves it: an image without its row, another without its end, half a row."""
    recorder = Recorder(folder, [CAMERA])
    for number in range(4):
        recorder.put(image(number))
    recorder.abandon()
    depth, rows = folder / "left" / "depth", folder / "left" / "timestamps.csv"
    shutil.copyfile(depth / "000003.png", depth / "000009.png")
    (depth / "000003.png").write_bytes((depth / "000003.png").read_bytes()[:-20])
    rows.write_text(rows.read_text() + "4,5.")


def test_after_a_power_cut_all_that_is_whole_is_kept(tmp_path):
    cut_off(tmp_path / "out")
    with pytest.raises(InputError, match=r"recording\.json"):
        open_recording(tmp_path / "out")
    recording = open_recording(finish_recording(tmp_path / "out"))
    assert recording.streams[0].frame.tolist() == [0, 1, 2]
    assert not (tmp_path / "out" / UNFINISHED_FILE).exists()


def test_a_camera_without_an_image_is_left_out_with_a_note_and_the_others_are_kept(tmp_path):
    right = CameraPlan(camera=replace(CAMERA.camera, name="right"))
    recorder = Recorder(tmp_path / "out", [CAMERA, right])
    recorder.mark("begin a", image(0).taken_s)
    for number in range(2):
        recorder.put(replace(image(number), camera=1))
    recording = open_recording(recorder.finish())
    assert [camera.name for camera in recording.cameras] == ["right"]
    assert recording.notes == ("camera left was left out: it gave no depth image",)
    document = json.loads((tmp_path / "out" / "recording.json").read_text())
    assert "utc" in document["start"]
    assert "begin a" in (tmp_path / "out" / MARKERS_FILE).read_text()
    with pytest.raises(InputError, match="left: holds no depth image; record again"):
        Recorder(tmp_path / "none", [CAMERA, right]).finish()


def test_only_a_recording_that_was_cut_off_can_be_finished(tmp_path):
    with pytest.raises(InputError, match="no unfinished recording"):
        finish_recording(tmp_path)
    cut_off(tmp_path / "out")
    finish_recording(tmp_path / "out")
    with pytest.raises(InputError, match="is a finished recording"):
        finish_recording(tmp_path / "out")
    with pytest.raises(InputError, match="not empty"):
        Recorder(tmp_path / "out", [CAMERA])


def test_a_disk_that_is_nearly_full_is_said_before_it_is_full(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ROOM_EVERY", 2)
    monkeypatch.setattr(module, "LEAST_FREE_BYTES", shutil.disk_usage(tmp_path).total * 2)
    recorder = Recorder(tmp_path / "out", [CAMERA])
    recorder.put(image(0))
    with pytest.raises(AnchorposeError, match="nearly full"):
        recorder.put(image(1))
    assert len(open_recording(recorder.finish()).streams[0].files) == 2


def test_finishing_removes_images_of_the_recorder_only_and_follows_no_link(tmp_path):
    cut_off(tmp_path / "out")
    depth = tmp_path / "out" / "left" / "depth"
    (depth / "notes.txt").write_text("mine")
    finish_recording(tmp_path / "out")
    assert sorted(path.name for path in depth.iterdir()) == ["000000.png", "000001.png", "000002.png", "notes.txt"]
    cut_off(tmp_path / "two")
    (tmp_path / "two" / "left").rename(tmp_path / "mine")
    (tmp_path / "two" / "left").symlink_to(tmp_path / "mine")
    with pytest.raises(InputError, match="left: is a link"):
        finish_recording(tmp_path / "two")
    assert (tmp_path / "mine" / "depth" / "000009.png").exists()


@pytest.mark.parametrize("text", ['{"cameras": [{"name": "../mine"}]}', '{"format": "other"}', "[]"])
def test_what_describes_no_recording_is_refused_by_one_sentence(tmp_path, text):
    (tmp_path / UNFINISHED_FILE).write_text(text)
    with pytest.raises(InputError, match=UNFINISHED_FILE):
        finish_recording(tmp_path)


class Given:
    """A source of ten images, whose clock is set back by ``back_s`` before the sixth."""

    name, cameras, about = "given", (CAMERA,), None

    def __init__(self, back_s=0.0):
        self.back_s = back_s

    def images(self, stop):
        for number in range(10):
            one = image(number)
            yield replace(one, time_s=one.time_s - self.back_s * (number > 5))


@pytest.mark.parametrize(
    ("back_s", "numbers", "told"),
    [
        (0.08, [0, 1, 2, 3, 4, 5, 8, 9], "2 depth images could not be recorded (their times are not later"),
        (3600.0, [0, 1, 2, 3, 4, 5], "given: its clock was set back by 3600 s"),
    ],
)
def test_images_of_a_clock_that_was_set_back_are_reported(tmp_path, back_s, numbers, told):
    intake, recorder = Intake([Given(back_s)]), Recorder(tmp_path / "out", [CAMERA])
    intake.add(recorder.put)
    intake.start()
    while intake.running:
        time.sleep(0.01)
    intake.stop()
    assert open_recording(recorder.finish()).streams[0].frame.tolist() == numbers
    assert len(intake.failed) == 1
    assert intake.failed[0].startswith(told)


def test_a_camera_that_restarts_writes_over_no_image(tmp_path):
    """As a RealSense whose cable was loose: its numbers begin again."""
    recorder = Recorder(tmp_path / "out", [CAMERA])
    for place, number in enumerate((3, 4, 6, 1, 2, 5)):
        recorder.put(replace(image(place), number=number))
    recording = open_recording(recorder.finish())
    assert recording.streams[0].frame.tolist() == [3, 4, 6, 7, 8, 11]
    grey = [round(1000 * float(read_frame(recording, place).depths_m[0].max())) for place in range(6)]
    assert grey == [1000, 1001, 1002, 1003, 1004, 1005]
    assert recording.notes == ("camera left restarted before image 7: check its cable",)


@pytest.mark.parametrize("step_s", [4.0, 0.0])
def test_a_trial_covers_the_same_images_if_the_clock_is_set_during_the_recording(tmp_path, step_s):
    """As the computer's clock, which times a RealSense's images, when a time server is found after 2 s."""
    recorder, began_s = Recorder(tmp_path / "out", [CAMERA]), time.monotonic()
    for number in range(60):
        stamp_s = 5.0 + number / 10.0 + step_s * (number >= 20)
        recorder.put(replace(image(number), time_s=stamp_s, taken_s=began_s + number / 10.0))
        if number in (30, 40):
            recorder.mark("begin a" if number == 30 else "end", began_s + number / 10.0)
    recording = open_recording(recorder.finish())
    time_s = recording.streams[0].time_s
    (trial,) = read_trials(tmp_path / "out" / EVENTS_FILE, recorded_span(time_s)).rows
    inside = recording.streams[0].frame[(time_s > trial.start_s - 0.01) & (time_s < trial.end_s - 0.01)]
    assert inside.tolist() == list(range(30, 40))
    assert recording.notes == (("camera left: its clock was set by +4.0 s before image 20",) if step_s else ())


def test_images_that_come_late_move_no_marker_and_are_no_set_clock(tmp_path):
    """The disk stalls for two seconds: twenty images wait, and the computer sees them when it goes on."""
    recorder, began_s = Recorder(tmp_path / "out", [CAMERA]), time.monotonic()
    for number in range(60):
        taken_s = max(number / 10.0, 4.0 if number >= 20 else 0.0)
        recorder.put(replace(image(number), time_s=5.0 + number / 10.0, taken_s=began_s + taken_s))
        if number == 25:
            recorder.mark("begin a", began_s + 4.2)
    recorder.mark("end", began_s + 5.2)
    recording = open_recording(recorder.finish())
    (trial,) = read_trials(tmp_path / "out" / EVENTS_FILE, recorded_span(recording.streams[0].time_s)).rows
    assert (trial.start_s - 5.0, trial.duration_s) == pytest.approx((4.2, 1.0), abs=0.001)
    assert recording.notes == ()


def test_an_image_that_cannot_be_written_is_lost_alone(tmp_path, monkeypatch):
    write = module.CameraWriter.write

    def without_descriptors(self, time_s, grey, number=None):
        if number in (3, 4):
            raise OSError(errno.EMFILE, os.strerror(errno.EMFILE), "000003.png")
        return write(self, time_s, grey, number)

    monkeypatch.setattr(module.CameraWriter, "write", without_descriptors)
    intake, recorder = Intake([Given()]), Recorder(tmp_path / "out", [CAMERA])
    intake.add(recorder.put)
    intake.start()
    while intake.running:
        time.sleep(0.01)
    intake.stop()
    assert open_recording(recorder.finish()).streams[0].frame.tolist() == [0, 1, 2, 5, 6, 7, 8, 9]
    assert intake.failed == (f"2 depth images could not be recorded ({os.strerror(errno.EMFILE)})",)


def test_an_image_that_is_under_way_at_the_end_ends_no_camera(tmp_path, monkeypatch):
    """As in the first seconds of ``live``, whose recorder ends while the cameras run on."""
    write, begun = module.CameraWriter.write, Event()

    def slowly(self, time_s, grey, number=None):
        begun.set()
        time.sleep(0.3)
        return write(self, time_s, grey, number)

    monkeypatch.setattr(module.CameraWriter, "write", slowly)
    recorder = Recorder(tmp_path / "out", [CAMERA])
    with ThreadPoolExecutor(1) as threads:
        under_way = threads.submit(recorder.put, image(0))
        assert begun.wait(5.0)
        recorder.abandon()
        under_way.result()
        recorder.put(image(1))
    assert len(open_recording(recorder.finish()).streams[0].files) == 1
