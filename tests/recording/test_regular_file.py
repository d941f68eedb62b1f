"""A pipe, a device, a folder or a broken link in place of a file is refused at once, by its name."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from recording_builder import depth_grey, write_picture, write_recording

from anchorpose.errors import InputError
from anchorpose.recording import regular_file
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.regular_file import Unreadable, list_file, read_bounded, read_whole

resource = pytest.importorskip("resource", reason="limits of a process exist on POSIX only")
pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _link(target: str):
    return lambda path: path.symlink_to(target)


IN_PLACE = {
    "a pipe": (_pipe, "named pipe"),
    "a folder": (Path.mkdir, "folder"),
    "an endless device": (_link("/dev/zero"), "device"),
    "an empty device": (_link("/dev/null"), "device"),
    "a broken link": (_link("nowhere"), "link to a file that is not there"),
    "a link to itself": (lambda path: path.symlink_to(path.name), "cannot be read"),
}
FILES = ("front/depth/000002.png", "front/background.png", "front/timestamps.csv", "recording.json", "equipment.json")


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("kind", IN_PLACE)
def test_a_recording_with_anything_but_files_is_refused_in_one_sentence(tmp_path, kind, name):
    folder = write_recording(tmp_path / "r", frames=4)
    (folder / name).unlink()
    IN_PLACE[kind][0](folder / name)
    with pytest.raises(InputError) as refusal:
        open_recording(folder)
    assert str(folder / name) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("kind", [kind for kind in IN_PLACE if "link" not in kind])
def test_what_it_is_is_reported(tmp_path, kind):
    make, words = IN_PLACE[kind]
    make(tmp_path / "x")
    with pytest.raises(InputError, match=words):
        list_file(tmp_path / "x")
    with pytest.raises(InputError, match=f"{words}.*; put it right"):
        read_whole(tmp_path / "x", 100, "put it right")


def test_a_link_to_a_file_is_a_file(tmp_path):
    folder = write_recording(tmp_path / "r", frames=3)
    file = folder / "front" / "depth" / "000001.png"
    file.rename(tmp_path / "elsewhere.png")
    file.symlink_to(tmp_path / "elsewhere.png")
    assert all(one.depths_m[0] is not None for one in read_frames(open_recording(folder)))


def test_a_file_is_read_up_to_its_bound_and_a_name_that_none_can_have_is_unreadable(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"12345")
    assert read_bounded(path, 5) == b"12345"
    with pytest.raises(Unreadable, match=r"5 bytes.*4 at most"):
        read_bounded(path, 4)
    for name in ("a\0b", "x" * 5000):
        with pytest.raises(Unreadable, match="cannot be read"):
            read_bounded(Path(name), 5)


def test_two_huge_image_files_in_a_row_are_not_compared(tmp_path):
    """Equal images in a row are one; of so many bytes none is an image, and a terabyte would not be compared."""
    folder = write_recording(tmp_path / "r", frames=6)
    for frame in (1, 2):
        with (folder / "front" / "depth" / f"{frame:06d}.png").open("r+b") as grown:
            grown.truncate(1 << 40)
    recording = open_recording(folder)
    assert not recording.streams[0].duplicate.any()
    frames = list(read_frames(recording))
    assert [one.depths_m[0] is None for one in frames] == [False, True, True] + 3 * [False]
    assert "at most" in frames[1].problems[0]


@pytest.mark.parametrize("how", ["replaced", "written to", "taken away"])
def test_an_image_that_changes_while_the_recording_is_read_ends_the_run(tmp_path, how):
    folder = write_recording(tmp_path / "r", frames=4)
    recording = open_recording(folder)
    frames, file = read_frames(recording), folder / "front" / "depth" / "000002.png"
    next(frames), next(frames)
    if how == "replaced":
        write_picture(tmp_path / "new.png", depth_grey(1))
        shutil.copystat(file, tmp_path / "new.png")
        (tmp_path / "new.png").replace(file)
    elif how == "written to":
        write_picture(file, depth_grey(9))
    else:
        file.unlink()
        assert next(frames).depths_m == (None,)
        return
    with pytest.raises(InputError, match=r"000002\.png: was changed or replaced"):
        next(frames)


@pytest.mark.thorough
def test_a_pipe_never_stops_a_verb(tmp_path):
    folder = write_recording(tmp_path / "r", frames=3)
    (folder / "front" / "depth" / "000001.png").unlink()
    os.mkfifo(folder / "front" / "depth" / "000001.png")
    script = "import sys; from anchorpose.cli import main; sys.exit(main(['track', sys.argv[1], '-o', sys.argv[2]]))"

    def little_memory() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))

    command = [sys.executable, "-c", script, str(folder), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, preexec_fn=little_memory)
    assert done.returncode == 2
    assert "named pipe" in done.stderr


def test_a_file_that_would_be_waited_for_is_refused(tmp_path, monkeypatch):
    """As the system's log, which is a regular file; here a pipe that passes for one and is held open."""
    os.mkfifo(tmp_path / "log")
    held = os.open(tmp_path / "log", os.O_RDWR)
    monkeypatch.setattr(regular_file, "_not_a_file", lambda mode: "")
    with pytest.raises(Unreadable, match="cannot be read"):
        read_bounded(tmp_path / "log", 100)
    with regular_file.open_regular(tmp_path / "log") as file:
        for read in (file.read, lambda: file.read(8), file.peek):
            with pytest.raises(OSError, match="has no end") as refused:
                read()
            assert refused.value.filename == str(tmp_path / "log")
    os.close(held)
