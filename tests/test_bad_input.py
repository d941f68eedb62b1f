"""Bad recordings through the command line: one sentence with file and remedy, exit code 2, nothing half-written."""

import json
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
import stand_in_pipeline
from recording_builder import HEIGHT, WIDTH, camera_entry, edit_json, write_picture, write_recording, write_timestamps

from anchorpose.cli import main
from anchorpose.errors import DegenerateGeometry, InputError, MissingPackage


@pytest.mark.parametrize(
    "error",
    [
        InputError(Path("a/recording.json"), "it is empty", "record again"),
        MissingPackage("The viewer", "starlette", "viewer"),
        DegenerateGeometry("three points on a line"),
    ],
)
def test_errors_come_whole_out_of_a_worker_process(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert str(again) == str(error)
    assert vars(again) == vars(error)


@pytest.fixture(autouse=True)
def _stand_in_for_the_tracker(monkeypatch):
    monkeypatch.setitem(sys.modules, "anchorpose.pipeline", stand_in_pipeline)


def _document(change):
    return lambda folder: edit_json(folder / "recording.json", change)


def _camera(change):
    return _document(lambda document: change(document["cameras"][0]))


def _intrinsics(**values):
    return _camera(lambda camera: camera["intrinsics"].update(values))


def _pose(change):
    def change_pose(camera):
        pose = np.array(camera["camera_to_world"], dtype=float)
        camera["camera_to_world"] = change(pose).tolist()

    return _camera(change_pose)


def _raw(text: str | bytes):
    data = text.encode() if isinstance(text, str) else text
    return lambda folder: (folder / "recording.json").write_bytes(data)


def _replace(old: str, new: str):
    def change(folder):
        text = (folder / "recording.json").read_text()
        assert old in text
        (folder / "recording.json").write_text(text.replace(old, new, 1))

    return change


def _timestamps(text: str):
    return lambda folder: (folder / "front" / "timestamps.csv").write_text(text)


def _times(times: float, epoch: float = 0.0):
    """Of images 0.1 s apart, in another unit."""
    return _timestamps("frame,time_s\n" + "".join(f"{k},{epoch + 0.1 * times * k!r}\n" for k in range(4)))


def _every_picture(grey: np.ndarray):
    def change(folder):
        for path in (folder / "front" / "depth").iterdir():
            write_picture(path, grey)

    return change


def _truncate_all(folder: Path) -> None:
    for path in (folder / "front" / "depth").iterdir():
        path.write_bytes(path.read_bytes()[:-16])


def _rename(old: str, new: str):
    return lambda folder: (folder / "front" / "depth" / old).rename(folder / "front" / "depth" / new)


def _remove(name: str):
    def change(folder):
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    return change


def _never_overlapping(folder: Path) -> None:
    write_recording(folder, cameras=("front", "left"))
    write_timestamps(folder / "left", [(frame, 70 + 0.1 * frame) for frame in range(4)])


def _scaled(pose: np.ndarray) -> np.ndarray:
    pose[:3, :3] *= 1.01
    return pose


def _mirrored(pose: np.ndarray) -> np.ndarray:
    pose[:3, 0] *= -1
    return pose


def _millimetres(pose: np.ndarray) -> np.ndarray:
    pose[:3, 3] *= 1000
    return pose


def _bad_last_row(pose: np.ndarray) -> np.ndarray:
    pose[3] = [0, 0, 1, 1]
    return pose


DOCUMENT = "recording.json"
# what is done to the recording, the file that has to be named, and words of the sentence
CASES = {
    "no recording.json": (_remove("recording.json"), DOCUMENT, "no such file"),
    "not JSON": (_raw("{'format'"), DOCUMENT, "line 1"),
    "empty file": (_raw(""), DOCUMENT, "not JSON"),
    "a list": (_raw("[]"), DOCUMENT, "curly bracket"),
    "not UTF-8": (_raw(b'{"format": "\xff"}'), DOCUMENT, "UTF-8"),
    "nested without end": (_raw("[" * 100000), DOCUMENT, "correct the file"),
    "not a number": (_replace("30.0", "NaN"), DOCUMENT, "NaN"),
    "infinity": (_replace("30.0", "-Infinity"), DOCUMENT, "-Infinity"),
    "larger than any number": (_replace("30.0", "1e999"), DOCUMENT, "finite number"),
    "a whole number beyond floats": (_replace("30.0", "1" + "0" * 400), DOCUMENT, "64 bits"),
    "a key twice": (_replace('"width"', '"name": "x", "width"'), DOCUMENT, "'name' is given twice"),
    "another format": (_document(lambda d: d.update(format="equipment-model")), DOCUMENT, "rgbd-recording"),
    "another version": (_document(lambda d: d.update(version=2)), DOCUMENT, "version is 2; it must be 1"),
    "no cameras": (_document(lambda d: d.update(cameras=[])), DOCUMENT, "at least one camera"),
    "cameras no list": (_document(lambda d: d.update(cameras={"name": "front"})), DOCUMENT, "it must be a list"),
    "unknown key": (_document(lambda d: d.update(equipmnt=1)), DOCUMENT, "did you mean 'equipment'"),
    "unknown camera key": (_camera(lambda c: c.update(depthscale=1)), DOCUMENT, "did you mean 'depth_scale'"),
    "unknown lens key": (_intrinsics(f_x=3.0), DOCUMENT, "'cameras[0].intrinsics.f_x'; did you mean 'fx'"),
    "unknown subject key": (_document(lambda d: d.update(subject={"height": 1.7})), DOCUMENT, "'height_m'"),
    "missing key": (_camera(lambda c: c.pop("width")), DOCUMENT, "'cameras[0].width' is missing"),
    "width no number": (
        _camera(lambda c: c.update(width="32")),
        DOCUMENT,
        'cameras[0].width is "32"; it must be a whole number',
    ),
    "width true": (_camera(lambda c: c.update(width=True)), DOCUMENT, "width is true; it must be a whole number"),
    "width half": (_camera(lambda c: c.update(width=32.5)), DOCUMENT, "whole number"),
    "width none": (_camera(lambda c: c.update(width=0)), DOCUMENT, "more than 0"),
    "depth_scale none": (_camera(lambda c: c.update(depth_scale=0)), DOCUMENT, "metres per grey value"),
    "depth_scale of metres": (_camera(lambda c: c.update(depth_scale=1.0)), DOCUMENT, "at most 0.1"),
    "name leads out": (_camera(lambda c: c.update(name="../front")), DOCUMENT, "names a folder"),
    "names twice": (_document(lambda d: d["cameras"].append(camera_entry("Front"))), DOCUMENT, "two cameras"),
    "intrinsic text": (_intrinsics(fx="wide"), DOCUMENT, 'fx is "wide"; it must be a number: the focal length'),
    "intrinsic null": (_intrinsics(cx=None), DOCUMENT, "cx is null; it must be a number"),
    "intrinsic zero": (_intrinsics(fy=0), DOCUMENT, "at least 1"),
    "intrinsic next to nothing": (_intrinsics(fx=1e-300), DOCUMENT, "fx is 1e-300; it must be at least 1"),
    "principal point nowhere": (_intrinsics(cx=1e308), DOCUMENT, "cx is 1e+308; it must be at most 100000"),
    "distortion without limits": (_intrinsics(distortion=[1e308] * 5), DOCUMENT, "at most 10000"),
    "images larger than any": (_camera(lambda c: c.update(width=16384, height=16384)), DOCUMENT, "16384 x 16384"),
    "thousands of cameras": (
        _document(lambda d: d.update(cameras=[camera_entry(f"c{k}") for k in range(5000)])),
        DOCUMENT,
        "5000 cameras; list 16 at most",
    ),
    "a name too long for a folder": (_camera(lambda c: c.update(name="x" * 5000)), DOCUMENT, "names a file"),
    "a name too long for a file": (_document(lambda d: d.update(equipment="x" * 5000)), DOCUMENT, "names a file"),
    "a line break in a file's name": (_document(lambda d: d.update(equipment="a\nb")), DOCUMENT, "names a file"),
    "a null character in a name": (_document(lambda d: d.update(equipment="a\0b")), DOCUMENT, "character"),
    "a frame in a minute": (_document(lambda d: d.update(fps=1e-300)), DOCUMENT, "at least 0.1"),
    "four distortions": (_intrinsics(distortion=[0, 0, 0, 0]), DOCUMENT, '"model": "kannala-brandt"'),
    "three distortions": (_intrinsics(distortion=[0, 0, 0]), DOCUMENT, "k1, k2, p1, p2, k3"),
    "seven of eight": (_intrinsics(model="rational", distortion=[0] * 7), DOCUMENT, "8 or 12 or 14"),
    "unknown lens": (_intrinsics(model="equidistant"), DOCUMENT, "kannala-brandt"),
    "lens of no radius": (_intrinsics(valid_radius=0), DOCUMENT, "at least 0.01"),
    "pose text": (_camera(lambda c: c["camera_to_world"][0].__setitem__(0, "x")), DOCUMENT, "camera_to_world"),
    "pose of three rows": (_camera(lambda c: c["camera_to_world"].pop()), DOCUMENT, "4 x 4"),
    "pose scaled": (_pose(_scaled), DOCUMENT, "not a rigid motion"),
    "pose mirrored": (_pose(_mirrored), DOCUMENT, "not a rigid motion"),
    "pose last row": (_pose(_bad_last_row), DOCUMENT, "not a rigid motion"),
    "pose in millimetres": (_pose(_millimetres), DOCUMENT, "metres"),
    "height in centimetres": (_document(lambda d: d["subject"].update(height_m=172)), DOCUMENT, "in metres"),
    "fps none": (_document(lambda d: d.update(fps=0)), DOCUMENT, "at least 0.1"),
    "equipment outside": (_document(lambda d: d.update(equipment="../e.json")), DOCUMENT, "leads out"),
    "equipment missing": (_remove("equipment.json"), "equipment.json", "no such file"),
    "no camera folder": (_remove("front"), "front/depth", "no such folder"),
    "no pictures": (_remove("front/depth"), "front/depth", "no such folder"),
    "an empty recording": (
        lambda folder: [path.unlink() for path in (folder / "front" / "depth").iterdir()],
        "front/depth",
        "holds no depth images",
    ),
    "a missing picture": (_remove("front/depth/000002.png"), "front/depth/000002.png", "no such file"),
    "a picture without a time": (_timestamps("frame,time_s\n0,0\n1,0.1\n2,0.2\n"), "timestamps.csv", "000003.png"),
    "a misnamed picture": (_rename("000003.png", "last.png"), "last.png", "000000.png"),
    "a number twice": (_rename("000003.png", "2.png"), "2.png", "same number"),
    "no times": (_remove("front/timestamps.csv"), "timestamps.csv", '"fps"'),
    "times without header": (_timestamps("0,0\n1,0.1\n"), "timestamps.csv", "frame,time_s"),
    "times empty": (_timestamps(""), "timestamps.csv", "frame,time_s"),
    "times without rows": (_timestamps("frame,time_s\n"), "timestamps.csv", "lists no frame"),
    "time no number": (_timestamps("frame,time_s\n0,soon\n"), "timestamps.csv", "line 2"),
    "time not finite": (_timestamps("frame,time_s\n0,nan\n"), "timestamps.csv", "line 2"),
    "time missing": (_timestamps("frame,time_s\n0\n"), "timestamps.csv", "line 2"),
    "times in milliseconds": (_times(1e3), "timestamps.csv", "milliseconds; write seconds: divide the times by 1,000."),
    "times in microseconds": (_times(1e6), "timestamps.csv", "microseconds; write seconds: divide"),
    "times in nanoseconds since 1970": (_times(1e9, 1.7e18), "timestamps.csv", "nanoseconds; write seconds: divide"),
    "times too small": (_times(1e-11), "timestamps.csv", "not 0.1 ms later"),
    "times too large": (_times(1e308), "timestamps.csv", "write when each image was taken, in seconds"),
    "times from nowhere": (_times(1.0, 1e14), "timestamps.csv", "write seconds"),
    "times at both ends of numbers": (
        _timestamps("frame,time_s\n0,-1e308\n1,0\n2,0.1\n3,1e308\n"),
        "timestamps.csv",
        "in seconds",
    ),
    "time standing still": (_timestamps("frame,time_s\n0,0\n1,0\n"), "timestamps.csv", "frame 1 is not later"),
    "frames out of order": (_timestamps("frame,time_s\n1,0\n0,1\n"), "timestamps.csv", "sort the rows"),
    "every picture 8-bit": (_every_picture(np.zeros((HEIGHT, WIDTH), np.uint8)), "000000.png", "16-bit grey"),
    "every picture wrongly sized": (_every_picture(np.ones((7, 9), np.uint16)), "000000.png", "9 x 7"),
    "every picture truncated": (_truncate_all, "000000.png", "truncated"),
    "background damaged": (
        lambda folder: (folder / "front" / "background.png").write_bytes(b"\x89PNG"),
        "background.png",
        "empty room",
    ),
    "cameras that never overlap": (_never_overlapping, "left/timestamps.csv", "never overlaps"),
}


@pytest.mark.parametrize("case", CASES)
def test_a_bad_recording_is_refused_in_one_sentence_and_leaves_nothing(tmp_path, capsys, case):
    spoil, file, words = CASES[case]
    folder = write_recording(tmp_path / "ward", frames=4)
    spoil(folder)
    code = main(["track", str(folder), "-o", str(tmp_path / "out")])
    sentence = capsys.readouterr().err.strip().splitlines()[-1]
    assert code == 2
    assert sentence.startswith(str(folder))
    assert file in sentence.split(": ")[0]
    assert words in sentence
    assert sentence.endswith(".")
    assert ";" in sentence  # the remedy
    assert {path.name for path in tmp_path.iterdir()} == {"ward"}


@pytest.mark.parametrize("kind", ["absent", "a file", "an empty folder"])
def test_a_recording_that_is_no_folder_is_refused(tmp_path, refusal, kind):
    path = tmp_path / "ward"
    if kind == "a file":
        path.write_text(json.dumps({}))
    if kind == "an empty folder":
        path.mkdir()
    assert str(path) in refusal(["track", str(path), "-o", str(tmp_path / "out")])
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("place", ["ward/results", "ward", "."])
def test_results_never_go_into_the_recording_or_over_it(tmp_path, refusal, place):
    folder = write_recording(tmp_path / "ward", frames=2)
    before = sorted(tmp_path.rglob("*"))
    assert "; choose" in refusal(["track", str(folder), "-o", str(tmp_path / place), "--overwrite"])
    assert sorted(tmp_path.rglob("*")) == before


def test_the_recording_itself_is_never_changed(tmp_path):
    folder = write_recording(tmp_path / "ward", frames=2)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    assert main(["track", str(folder), "-o", str(tmp_path / "out")]) == 0
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
