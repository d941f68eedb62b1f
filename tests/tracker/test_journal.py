"""Values on disk: whole or absent, checked when read, and of harmless kinds only."""

from __future__ import annotations

import os
import re
from collections import deque
from pathlib import Path

import numpy as np
import pytest

import anchorpose
from anchorpose.body.pose import Pose
from anchorpose.errors import InputError
from anchorpose.tracker.journal import DIGEST, Blocks, Journal

Stored = tuple[Pose, deque[int], float, np.ndarray, dict[str, int | None]]


def test_what_was_written_is_read_back(tmp_path):
    pose = Pose(np.eye(3)[None].repeat(2, axis=0), np.array([1.0, np.nan, 3.0]))
    journal = Journal(tmp_path, {"eye": (eye := np.eye(4))})
    journal.write("value", (pose, deque([1], maxlen=3), np.float64(0.5), eye, {"a": None}))
    found, queue, number, same, rest = journal.read("value", Stored)
    np.testing.assert_array_equal(found.rotations, pose.rotations)
    np.testing.assert_array_equal(found.root_m, pose.root_m)
    assert (queue, queue.maxlen, number, rest) == (deque([1]), 3, 0.5, {"a": None})
    assert same is eye


def test_a_value_is_made_once(tmp_path):
    made = []

    def make() -> int:
        made.append(1)
        return 7

    assert [Journal(tmp_path).once("seven", int, make) for _ in range(3)] == [7, 7, 7]
    assert len(made) == 1


def test_an_absent_value_is_no_value(tmp_path):
    with pytest.raises(KeyError):
        Journal(tmp_path).read("value", int)


@pytest.mark.parametrize("place", [0, 70, -1])
def test_a_flipped_bit_is_found(tmp_path, place):
    journal = Journal(tmp_path)
    journal.write("value", list(range(100)))
    data = bytearray((tmp_path / "value").read_bytes())
    data[place] ^= 4
    (tmp_path / "value").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        journal.read("value", list[int])


def test_reading_runs_nothing_that_a_file_names(tmp_path):
    """A pickle that reaches a program through a module of the package, with the right digest."""
    command = f"open({str(tmp_path / 'ran')!r}, 'w')".encode()
    payload = (
        b"\x80\x04\x8c\x17anchorpose.batch.worker\x8c\x0fsubprocess.call\x93"  # the function, by a dotted name
        b"](\x8c\x07python3\x8c\x02-c\x8c" + bytes([len(command)]) + command + b"e\x85R."
    )
    (tmp_path / "value").write_bytes(DIGEST(payload).digest() + payload)
    with pytest.raises(InputError, match="is damaged"):
        Journal(tmp_path).read("value", Pose | None)
    assert not (tmp_path / "ran").exists()


def test_only_the_work_of_a_child_process_is_pickled():
    """It comes to the child from the worker that started it, and never from a disk."""
    package = Path(anchorpose.__file__).parent
    runs = r"^\s*(import|from) (pickle|dill|cloudpickle|marshal|shelve|yaml|joblib)\b"
    found = re.compile(rf"{runs}|allow_pickle=True|(?<![.\w])(eval|exec)\(", re.MULTILINE)
    users = {path.relative_to(package).as_posix() for path in package.rglob("*.py") if found.search(path.read_text())}
    assert users == {"batch/child.py", "batch/engine.py"}


def test_frames_come_in_the_order_of_the_pass_or_against_it(tmp_path):
    blocks = Blocks[int](Journal(tmp_path), int)
    for number in (1, 0, 2):
        blocks.write(number, [10 * number, 10 * number + 1])
    assert list(blocks.read()) == [0, 1, 10, 11, 20, 21]
    assert list(blocks.read(backward=True)) == [21, 20, 11, 10, 1, 0]
    assert (blocks.has(2), blocks.has(3)) == (True, False)


def test_a_block_that_is_gone_is_noticed(tmp_path):
    blocks = Blocks[int](Journal(tmp_path), int)
    for number in range(3):
        blocks.write(number, [number])
    blocks.require(3)
    (tmp_path / "000001.frames").unlink()
    with pytest.raises(InputError, match=r"000001\.frames: is damaged; remove .* and give the same command again"):
        blocks.require(3)


def test_a_folder_that_was_removed_is_reported(tmp_path):
    journal = Journal(tmp_path / "gone")
    with pytest.raises(InputError, match="was removed"):
        journal.write("value", 1)


def test_a_full_disk_is_reported_with_the_place_and_leaves_what_was_there(tmp_path, monkeypatch):
    journal = Journal(tmp_path)
    journal.write("value", 1)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space left on device") as refused:
        journal.write("value", 2)
    assert refused.value.filename == str(tmp_path)
    assert journal.read("value", int) == 1


def test_a_pipe_in_place_of_a_stored_value_is_refused(tmp_path):
    journal = Journal(tmp_path)
    os.mkfifo(tmp_path / "learnt")
    with pytest.raises(InputError, match="learnt: is a named pipe"):
        journal.read("learnt", int)
