"""Conversion as a whole: stopped and gone on with, refused, turned, several inputs, and verbs that are given a file."""

import errno
import os
import random
import shutil
import signal
import sqlite3
import subprocess
import sys
import time

import numpy as np
import pytest
import sources_builder as build
from sources_builder import GIVEN, HEIGHT, LENS, WIDTH, content, depth_of, expected, noise, nothing, run

from anchorpose.cli import main
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.lens import Intrinsics, LensModel, lens_array, project
from anchorpose.options import ConvertOptions, parse_intrinsics
from anchorpose.recording.document import read_document
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording_file import RECORDING_FILE, RecordingDocument
from anchorpose.sources import image_folder
from anchorpose.sources.convert import convert, look_at, make_recording, read_conversion
from anchorpose.sources.plan import can_turn, folder_name, make_plan, turn_image, turn_lens, turn_pose
from anchorpose.sources.source import SourceCamera, SourceFrame

GIVE = ["--intrinsics", ",".join(map(str, LENS)), "--depth-scale", "0.001", "--fps", "30"]


class Killed(BaseException):
    """What a kill is within a process: nothing catches it."""


def stop_after(frames: int):
    left = frames

    def progress(done: int, total: int | None) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            raise Killed

    return progress


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """An input and what an undisturbed conversion makes of it."""
    folder = tmp_path_factory.mktemp("whole")
    build.plain_folder(folder / "in", noise(20))
    run(folder / "in", folder / "out", GIVEN)
    return folder


@pytest.mark.parametrize("seed", range(12))
def test_a_stopped_conversion_goes_on_to_the_same_bytes(whole, tmp_path, seed):
    """Stopped at random points, also within the last image and within its row."""
    chance, out = random.Random(seed), tmp_path / "out"
    for _ in range(3):
        with pytest.raises(Killed):
            convert([whole / "in"], out, GIVEN, stop_after(chance.randrange(1, 7)))
        with pytest.raises(InputError):
            open_recording(out)
        rows, images = out / "in" / "timestamps.csv", sorted((out / "in" / "depth").iterdir())
        if images and chance.random() < 0.5:
            images[-1].write_bytes(images[-1].read_bytes()[: chance.randrange(2000)])
        if chance.random() < 0.5:
            rows.write_bytes(rows.read_bytes()[: -chance.randrange(1, 9)])
        if images and chance.random() < 0.3:
            images[len(images) // 2].unlink()
    run(whole / "in", out, GIVEN)
    assert content(out) == content(whole / "out")


def mkv(path, count):
    """Azure Kinect's, with an image of the wrong size among the others."""
    azure = pytest.importorskip("azure_builder")
    whole = azure.mkv(
        azure.images(count, "NFOV_2X2BINNED"), range(0, count * 33_333, 33_333), attached=azure.calibration()
    )
    place = whole.index(bytes.fromhex("1f43b675"), len(whole) // 3)
    path.write_bytes(whole[:place] + azure.cluster(5, [(2, b"small")]) + whole[place:])


def bag(form):
    """A driver's, with an image of another size among the others."""

    def write(path, count):
        bags = pytest.importorskip("bags_builder")
        sizes = [bags.SIZE if k != 2 else (10, 10) for k in range(count)]
        sent = [bags.Sent("/depth/camera_info", "sensor_msgs/msg/CameraInfo", 1, bags.Info())]
        for k, size in enumerate(sizes):
            image = bags.image_of(np.full(size, 1000 + k, np.uint16), "16UC1", bags.stamp_ns(k))
            sent.append(bags.Sent("/depth/image", "sensor_msgs/msg/Image", bags.stamp_ns(k), image))
        bags.write_bag(path.parent, form, sent).rename(path)

    return write


RECORDERS = {"mkv": mkv, "ros1": bag("ros1"), "db3": bag("db3"), "mcap": bag("mcap")}


@pytest.mark.parametrize("name", RECORDERS)
def test_a_stopped_conversion_of_a_recorder_s_file_goes_on_to_the_same_bytes(tmp_path, name):
    """A damaged image before the stop is not counted as one that was taken."""
    RECORDERS[name](tmp_path / "in", 12)
    whole = run(tmp_path / "in", tmp_path / "whole")
    assert "damaged" in " ".join(whole.notes)
    for stop in (1, 4, 3):
        with pytest.raises(Killed):
            convert([tmp_path / "in"], tmp_path / "out", ConvertOptions(), stop_after(stop))
    assert run(tmp_path / "in", tmp_path / "out").notes == whole.notes
    assert content(tmp_path / "out") == content(tmp_path / "whole")


def test_the_progress_of_a_resumed_conversion_moves_from_the_first_image_on(tmp_path):
    build.plain_folder(tmp_path / "in", noise(6))
    with pytest.raises(Killed):
        convert([tmp_path / "in"], tmp_path / "out", GIVEN, stop_after(4))
    shown = []
    convert([tmp_path / "in"], tmp_path / "out", GIVEN, lambda done, total: shown.append(done))
    assert shown == list(range(7))


def test_a_resumed_conversion_of_one_file_does_not_read_its_first_images_again(tmp_path, monkeypatch):
    np.save(tmp_path / "a.npy", noise(6))
    run(tmp_path / "a.npy", tmp_path / "whole", GIVEN)
    with pytest.raises(Killed):
        convert([tmp_path / "a.npy"], tmp_path / "out", GIVEN, stop_after(4))
    made, read = image_folder._reader, []

    def counted(*given):
        return lambda position: (read.append(position), made(*given)(position))[1]

    monkeypatch.setattr(image_folder, "_reader", counted)
    run(tmp_path / "a.npy", tmp_path / "out", GIVEN)
    assert read == [4, 5]
    assert content(tmp_path / "out") == content(tmp_path / "whole")


class Unplugged:
    """A disk that a conversion is read from, and that is unplugged once ``progress`` has counted three images."""

    gone = False

    def __init__(self, monkeypatch):
        from anchorpose.sources import azure_kinect, bag_file

        opened, bags = azure_kinect.open_regular, bag_file._RosbagsFile._read
        rows = bag_file.Ros2Database._read
        monkeypatch.setattr(azure_kinect, "open_regular", lambda path: UnpluggedFile(opened(path), self))
        monkeypatch.setattr(bag_file._RosbagsFile, "_read", lambda bag, topics: self.until_gone(bags(bag, topics)))
        monkeypatch.setattr(bag_file.Ros2Database, "_read", lambda bag, topics: self.of_sqlite(rows(bag, topics)))

    def progress(self, done, total):
        self.gone |= done >= 3

    def require(self):
        if self.gone:
            raise OSError(errno.EIO, os.strerror(errno.EIO))

    def until_gone(self, messages):
        for message in messages:
            self.require()
            yield message

    def of_sqlite(self, rows):
        try:
            yield from self.until_gone(rows)
        except OSError:
            error = sqlite3.OperationalError("disk I/O error")
            error.sqlite_errorcode = sqlite3.SQLITE_IOERR_READ
            raise error from None


class UnpluggedFile:
    """An opened file on a disk that may be unplugged."""

    def __init__(self, file, disk):
        self.file, self.disk, self.seek, self.tell = file, disk, file.seek, file.tell

    def read(self, size=-1):
        self.disk.require()
        return self.file.read(size)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.file.close()


@pytest.mark.parametrize("name", RECORDERS)
def test_a_disk_that_is_unplugged_leaves_no_recording_and_the_conversion_goes_on(tmp_path, monkeypatch, name):
    """What was read before would otherwise be a whole recording, for good."""
    RECORDERS[name](tmp_path / "in", 60)  # FFmpeg reads the first 5 MB ahead
    with monkeypatch.context() as patches:
        disk = Unplugged(patches)
        with pytest.raises(OSError, match=os.strerror(errno.EIO)) as failed:
            convert([tmp_path / "in"], tmp_path / "out", ConvertOptions(), disk.progress)
    assert failed.value.filename == str(tmp_path / "in")
    with pytest.raises(InputError, match=r"recording\.json"):
        open_recording(tmp_path / "out")
    run(tmp_path / "in", tmp_path / "out")
    run(tmp_path / "in", tmp_path / "whole")
    assert content(tmp_path / "out") == content(tmp_path / "whole")


@pytest.mark.parametrize("name", RECORDERS)
def test_what_is_missing_from_a_conversion_is_a_note_of_its_recording(tmp_path, name):
    RECORDERS[name](tmp_path / "in", 6)
    done = run(tmp_path / "in", tmp_path / "out")
    recorded = read_document(tmp_path / "out" / RECORDING_FILE, RecordingDocument).notes
    (note,) = [note for note in recorded if "damaged" in note]
    assert note in " ".join(done.notes)
    assert not any("pose" in note for note in recorded)


SLOWLY = """
import cv2, signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a program in the background is born deaf to it
quick = cv2.imencode
def slow(*given):
    time.sleep(0.05)
    return quick(*given)
cv2.imencode = slow
"""
"""So that a busy machine does not come too late to stop it."""


def images_of(path, count):
    build.plain_folder(path, noise(count, 160, 120))


KILL = getattr(signal, "SIGKILL", signal.SIGTERM)  # Windows has no other
STOPPED = [(images_of, GIVEN, KILL), (images_of, GIVEN, signal.SIGINT), (images_of, GIVEN, signal.SIGTERM)]
STOPPED += [(RECORDERS[name], ConvertOptions(), KILL) for name in ("mkv", "ros1")]


@pytest.mark.thorough
@pytest.mark.parametrize(("write", "options", "stop"), STOPPED)
def test_a_killed_process_leaves_no_recording_and_can_be_gone_on_with(tmp_path, write, options, stop):
    write(tmp_path / "in", 80)
    given = GIVE if options is GIVEN else []
    script = f"{SLOWLY}from anchorpose.cli import main; sys.exit(main({['convert', 'in', 'out', *given]}))"
    going = subprocess.Popen([sys.executable, "-c", script], cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    until = time.monotonic() + 60
    while time.monotonic() < until and len(list(tmp_path.glob("out/*/depth/*"))) < 6:
        time.sleep(0.002)
    going.send_signal(stop)
    _, said = going.communicate(timeout=60)
    assert going.returncode != 0
    assert not (tmp_path / "out" / "recording.json").exists()
    if stop == signal.SIGINT:
        assert "same command again" in said
    run(tmp_path / "in", tmp_path / "out", options)
    run(tmp_path / "in", tmp_path / "undisturbed", options)
    assert content(tmp_path / "out") == content(tmp_path / "undisturbed")


def test_another_input_or_other_options_are_refused_and_a_moved_input_is_still_the_same(whole, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(Killed):
        convert([whole / "in"], out, GIVEN, stop_after(5))
    build.plain_folder(tmp_path / "other", noise(20, seed=1))
    for given, options in (
        (tmp_path / "other", GIVEN),
        (whole / "in", ConvertOptions(intrinsics=LENS, depth_scale=0.001, fps=15.0)),
    ):
        with pytest.raises(InputError, match="begun with other"):
            run(given, out, options)
    shutil.copytree(whole / "in", tmp_path / "moved" / "in")
    run(tmp_path / "moved" / "in", out, GIVEN)
    assert content(out) == content(whole / "out")
    with pytest.raises(InputError, match="finished recording"):
        run(whole / "in", out, GIVEN)


@pytest.mark.parametrize("what", ["file", "folder", "inside", "around", "twice", "recording"])
def test_places_that_cannot_be(whole, tmp_path, what):
    (tmp_path / "file").write_text("x")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "letter.txt").write_text("x")
    out = {"inside": whole / "in" / "out", "around": whole}.get(what, tmp_path / what)
    inputs = {"twice": [whole / "in"] * 2, "recording": [whole / "out"]}.get(what, [whole / "in"])
    before = content(tmp_path) | content(whole)
    with pytest.raises(InputError):
        convert(inputs, out, GIVEN, nothing)
    assert content(tmp_path) | content(whole) == before


def test_several_inputs_become_cameras_with_names_of_their_own(tmp_path):
    for name, seed in (("a", 1), ("b", 2)):
        build.tum(tmp_path / name / "cam", noise(seed=seed))
    build.open3d(tmp_path / "side", noise(seed=3))
    inputs = [tmp_path / "a" / "cam", tmp_path / "b" / "cam", tmp_path / "side"]
    done = run(inputs, tmp_path / "out", ConvertOptions(intrinsics=LENS))
    assert [name for name, _ in done.cameras] == ["cam", "cam-2", "side"]
    for name, seed in (("cam", 1), ("cam-2", 2), ("side", 3)):
        assert np.array_equal(depth_of(tmp_path / "out", name), expected(noise(seed=seed)))
    assert len(open_recording(tmp_path / "out").cameras) == 3


def test_options_that_the_file_contradicts_are_refused(tmp_path):
    build.open3d(tmp_path / "o", noise())
    for options in (ConvertOptions(intrinsics=LENS), ConvertOptions(fps=30.0)):
        with pytest.raises(InputError, match="leave --"):
            run(tmp_path / "o", tmp_path / "out", options)
    run(tmp_path / "o", tmp_path / "out", ConvertOptions(depth_scale=0.002))
    assert open_recording(tmp_path / "out").cameras[0].depth_scale == 0.002


class MadeSource:
    """A source with given times, in memory."""

    def __init__(self, path, times, camera=None, grey=None):
        self.path, self.notes = path, ()
        self._times, self._grey = times, noise(len(times)) if grey is None else grey
        lens = Intrinsics(fx=30.0, fy=30.0, cx=15.5, cy=11.5)
        self.cameras = (
            camera or SourceCamera(name="c", width=WIDTH, height=HEIGHT, depth_scale=0.001, intrinsics=lens),
        )

    def frames(self):
        for k in range(len(self._times)):
            yield SourceFrame(0, self._times[k], self._grey[k])


def convert_made(monkeypatch, tmp_path, source, options=None):
    source.path.write_bytes(b"x")
    monkeypatch.setattr("anchorpose.sources.convert.open_source", lambda path: source)
    return run(source.path, tmp_path / "out", options)


def test_times_that_repeat_are_left_out_and_a_clock_set_back_is_refused(monkeypatch, tmp_path):
    times = [1e9 + k / 30 for k in range(30)]
    times[7] = times[6]
    done = convert_made(monkeypatch, tmp_path, MadeSource(tmp_path / "f", times))
    assert done.cameras == (("c", 29),)
    assert any("1 of 30 times" in note for note in done.notes)
    assert open_recording(tmp_path / "out").streams[0].frame.tolist() == [k for k in range(30) if k != 7]
    shutil.rmtree(tmp_path / "out")
    with pytest.raises(InputError, match="clock was set back"):
        convert_made(monkeypatch, tmp_path, MadeSource(tmp_path / "f", [*times[15:], *times[:15]]))
    assert not (tmp_path / "out").exists()


def test_files_that_were_added_meanwhile_survive_a_conversion_that_is_refused(monkeypatch, tmp_path):
    class Visited(MadeSource):
        def frames(self):
            (tmp_path / "out" / "notes.txt").write_text("mine")
            yield from super().frames()

    with pytest.raises(InputError, match="record or export it again"):
        convert_made(monkeypatch, tmp_path, Visited(tmp_path / "f", [0.0, 33.333, 66.667]))
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert not (tmp_path / "out" / "recording.json").exists()


@pytest.mark.parametrize("times", [[0.0, 33.333, 66.667], [0.0, 1e12], [1e15, 1e15 + 1 / 30], [0.0, 5e-5, 1e-4]])
def test_times_that_no_recording_may_have_are_refused_by_the_name_of_the_source(monkeypatch, tmp_path, times):
    """They were written, and the recording was refused when it was tracked."""
    with pytest.raises(InputError, match=r"/f: the clock of c .*record or export it again"):
        convert_made(monkeypatch, tmp_path, MadeSource(tmp_path / "f", times))
    assert not (tmp_path / "out").exists()


def test_a_file_that_ends_early_is_kept_as_far_as_it_goes(tmp_path):
    grey = noise(10)
    np.save(tmp_path / "a.npy", grey)
    data = (tmp_path / "a.npy").read_bytes()
    (tmp_path / "a.npy").write_bytes(data[:-1000])
    done = run(tmp_path / "a.npy", tmp_path / "out", GIVEN)
    assert any(note.startswith("Only a part could be read") for note in done.notes)
    (note,) = open_recording(tmp_path / "out").notes
    assert note == "Only a part could be read: a.npy: ends within image 9; copy or save it again"
    assert np.array_equal(depth_of(tmp_path / "out", "a"), expected(grey[:9]))


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
def test_a_damaged_image_whose_name_is_no_text_spoils_no_recording(tmp_path):
    build.plain_folder(tmp_path / "p", noise(8))
    (tmp_path / "p" / "depth_7.png").rename(tmp_path / "p" / os.fsdecode(b"depth_\xff7.png"))
    damaged = next((tmp_path / "p").glob("depth_?7.png"))
    damaged.write_bytes(damaged.read_bytes()[:-100])
    run(tmp_path / "p", tmp_path / "out", GIVEN)
    (note,) = read_document(tmp_path / "out" / RECORDING_FILE, RecordingDocument).notes
    assert "the first, depth_?7.png" in note
    assert read_conversion(tmp_path / "out")["notes"][0] == note


def test_poses_of_several_inputs_are_left_out(monkeypatch, tmp_path):
    lens = Intrinsics(fx=30.0, fy=30.0, cx=15.5, cy=11.5)
    camera = SourceCamera(
        name="c", width=WIDTH, height=HEIGHT, depth_scale=0.001, intrinsics=lens, T_world_camera=np.eye(4)
    )
    sources = [MadeSource(tmp_path / name, [0.0], camera) for name in "ab"]
    alone, both = make_plan(sources[:1], ConvertOptions()), make_plan(sources, ConvertOptions())
    mirrored = make_plan(sources[:1], ConvertOptions(mirror=True))
    assert alone.cameras[0][0].camera.T_world_camera is not None
    for plan in (both, mirrored):
        assert all(own.camera.T_world_camera is None for group in plan.cameras for own in group)
        assert any("left out" in note for note in plan.notes)
    assert [own.camera.name for group in both.cameras for own in group] == ["a-c", "b-c"]


RATIONAL = (0.1, 0.1, 1e-3, -2e-3, 0.01, 0.2, 0.2, 0.03, 0.01, 0.02, -0.03, 0.04)
LENSES = [
    Intrinsics(fx=30, fy=31, cx=14, cy=12.5, model=model, distortion=distortion)
    for model, distortion in (
        (LensModel.BROWN_CONRADY, (0.1, -0.05, 0.01, -0.02, 0.003)),
        (LensModel.RATIONAL, (0.5, 0.1, 1e-3, -2e-3, 0.01, 0.6, 0.2, 0.03)),
        (LensModel.RATIONAL, RATIONAL),
        (LensModel.RATIONAL, (*RATIONAL, 0.05, -0.07)),
        (LensModel.KANNALA_BRANDT, (0.1, 0.02, -0.01, 0.002)),
    )
]


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("degrees", [0, 90, 180, 270])
@pytest.mark.parametrize("lens", LENSES)
def test_a_turned_lens_sees_the_same_points_in_the_turned_image(lens, degrees, mirror):
    """The law: where a point falls in the image, its pixel is turned; the turned lens puts the turned point there."""
    if not can_turn(lens, degrees):
        pytest.skip("refused: OpenCV's tilt has an order")
    points = np.random.default_rng(0).uniform([-0.3, -0.3, 1], [0.3, 0.3, 2], (50, 3))
    where = np.rint(project(points, lens_array(lens))).astype(int)
    inside = (where >= 0).all(axis=1) & (where[:, 0] < WIDTH) & (where[:, 1] < HEIGHT)
    assert inside.sum() > 20
    pose = turn_pose(np.eye(4), degrees)
    turned_points = points @ pose[:3, :3]
    if mirror:
        turned_points = turned_points * [-1, 1, 1]
    seen = project(turned_points, lens_array(turn_lens(lens, (WIDTH, HEIGHT), degrees, mirror)))
    exact = project(points, lens_array(lens))
    for point in np.flatnonzero(inside):
        mark = np.zeros((HEIGHT, WIDTH), np.uint16)
        mark[where[point, 1], where[point, 0]] = 1
        (row,), (column,) = np.nonzero(turn_image(mark, degrees, mirror))
        off = np.abs(exact[point] - where[point])
        assert np.abs(seen[point] - [column, row]) == pytest.approx(off[::-1] if degrees % 180 else off, abs=1e-9)


def test_a_tilted_sensor_is_not_turned_by_a_quarter(monkeypatch, tmp_path):
    camera = SourceCamera(name="c", width=WIDTH, height=HEIGHT, depth_scale=0.001, intrinsics=LENSES[3])
    with pytest.raises(InputError, match="quarter turn"):
        convert_made(monkeypatch, tmp_path, MadeSource(tmp_path / "f", [0.0], camera), ConvertOptions(rotate=90))


def test_turned_images_are_written(tmp_path):
    grey = noise()
    build.open3d(tmp_path / "o", grey)
    run(tmp_path / "o", tmp_path / "out", ConvertOptions(rotate=90, mirror=True))
    turned = np.stack([np.fliplr(np.rot90(image, -1)) for image in expected(grey)])
    assert np.array_equal(depth_of(tmp_path / "out", "o"), turned)
    (camera,) = open_recording(tmp_path / "out").cameras
    assert (camera.width, camera.height, camera.intrinsics.fx) == (HEIGHT, WIDTH, LENS[1])


@pytest.mark.parametrize("text", ["", "1,2,3", "a,b,c,d", "0,1,2,3", "-5,5,1,1", "nan,1,1,1", "1,1,1,1,1"])
def test_intrinsics_that_are_none(text):
    with pytest.raises(AnchorposeError, match="fx,fy,cx,cy"):
        parse_intrinsics(text)


@pytest.mark.parametrize("text", ["front", "a/b", "..", "", "Kinect (2)", ".hidden", "x" * 300, "日本", "a. "])
def test_any_name_becomes_one_that_a_recording_may_have(text):
    from anchorpose.recording.recording_file import _require_folder_name

    assert _require_folder_name(folder_name(text))


def test_a_verb_converts_once_and_again_where_the_file_changed(tmp_path):
    build.open3d(tmp_path / "walk", noise())
    made = tmp_path / "walk.anchorpose"
    assert look_at(tmp_path / "walk") == (made, False)
    make_recording(tmp_path / "walk", nothing)
    assert look_at(tmp_path / "walk") == look_at(made) == (made, True)
    build.open3d(tmp_path / "walk", noise(seed=5, frames=3))
    (tmp_path / "walk.anchorpose" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="rename or remove"):
        look_at(tmp_path / "walk")
    (tmp_path / "walk.anchorpose" / "notes.txt").unlink()
    document = tmp_path / "walk.anchorpose" / "recording.json"
    text = document.read_text()
    document.write_text(text.replace("null", '{"height_m": 1.7}'))
    with pytest.raises(InputError, match="rename or remove"):
        look_at(tmp_path / "walk")
    document.write_text(text)
    assert look_at(tmp_path / "walk") == (made, False)


def test_a_link_in_the_place_of_the_made_recording_is_refused(tmp_path):
    """It leads to a conversion of another content, which would be made again."""
    build.open3d(tmp_path / "walk", noise())
    make_recording(tmp_path / "walk", nothing)
    (tmp_path / "walk.anchorpose").rename(tmp_path / "mine")
    (tmp_path / "walk.anchorpose").symlink_to(tmp_path / "mine")
    build.open3d(tmp_path / "walk", noise(seed=5, frames=3))
    before = content(tmp_path / "mine")
    with pytest.raises(InputError, match="is a link; rename it"):
        look_at(tmp_path / "walk")
    assert content(tmp_path / "mine") == before


def test_a_file_in_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    build.open3d(tmp_path / "walk", noise())
    monkeypatch.setattr("anchorpose.sources.convert.os.access", lambda path, mode: False)
    with pytest.raises(InputError, match="anchorpose convert walk OUT"):
        make_recording(tmp_path / "walk", nothing)


def test_a_folder_marked_as_read_only_is_left_alone_even_by_an_administrator(tmp_path):
    build.open3d(tmp_path / "archive" / "walk", noise())
    before = content(tmp_path)
    (tmp_path / "archive").chmod(0o555)
    try:
        with pytest.raises(InputError, match="cannot be written"):
            make_recording(tmp_path / "archive" / "walk", nothing)
        assert content(tmp_path) == before
    finally:
        (tmp_path / "archive").chmod(0o755)


def test_the_verbs_take_a_recorders_folder(tmp_path, capsys, refusal, monkeypatch):
    monkeypatch.chdir(tmp_path)
    build.plain_folder(tmp_path / "in", noise())
    assert "--intrinsics" in refusal(["track", "in", "-o", "results"])
    assert main(["convert", "in", "out", *GIVE]) == 0
    assert "in with 7 depth images" in capsys.readouterr().out
    build.open3d(tmp_path / "walk", noise())
    for verb in (["calibrate", "walk"], ["inspect", "walk", "--frame", "99"], ["track", "walk", "-o", "results"]):
        shutil.rmtree(tmp_path / "walk.anchorpose", ignore_errors=True)
        main(verb)  # noise shows nobody
        assert "Converting walk" in capsys.readouterr().err
        assert (tmp_path / "walk.anchorpose" / "recording.json").is_file()
    assert main(["view", "results", "other"]) == 2
    assert main(["convert", "in"]) == 2
    assert "missing" in refusal(["convert", "missing", "o"])
    assert main(["convert", "in", "o", "--fps", "0"]) == 2
