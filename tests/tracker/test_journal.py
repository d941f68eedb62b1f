"""Values on disk: whole or absent, checked when read, and of harmless kinds only."""

from __future__ import annotations

import os
import pickle
import shutil
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from anchorpose.body.pose import Pose
from anchorpose.errors import InputError
from anchorpose.tracker.journal import DIGEST, Blocks, Journal


@dataclass
class Foreign:
    """Not of the package."""

    number: int = 1


def test_what_was_written_is_read_back(tmp_path):
    pose = Pose(np.eye(3)[None].repeat(2, axis=0), np.array([1.0, np.nan, 3.0]))
    journal = Journal(tmp_path, {"eye": (eye := np.eye(4))})
    journal.write("value", (pose, deque([1], maxlen=3), np.float64(0.5), eye, {"a": None}))
    found, queue, number, same, rest = journal.read("value")
    np.testing.assert_array_equal(found.rotations, pose.rotations)
    np.testing.assert_array_equal(found.root_m, pose.root_m)
    assert (queue, queue.maxlen, number, rest) == (deque([1]), 3, 0.5, {"a": None})
    assert same is eye


def test_a_value_is_made_once(tmp_path):
    made = []

    def make() -> int:
        made.append(1)
        return 7

    assert [Journal(tmp_path).once("seven", make) for _ in range(3)] == [7, 7, 7]
    assert len(made) == 1


def test_an_absent_value_is_no_value(tmp_path):
    with pytest.raises(KeyError):
        Journal(tmp_path).read("value")


@pytest.mark.parametrize("place", [0, 70, -1])
def test_a_flipped_bit_is_found(tmp_path, place):
    journal = Journal(tmp_path)
    journal.write("value", list(range(100)))
    data = bytearray((tmp_path / "value").read_bytes())
    data[place] ^= 4
    (tmp_path / "value").write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        journal.read("value")


@pytest.mark.parametrize("value", [Foreign(), Path.unlink, shutil.rmtree, print])
def test_reading_runs_no_foreign_code(tmp_path, value):
    payload = pickle.dumps(value)
    (tmp_path / "value").write_bytes(DIGEST(payload).digest() + payload)
    with pytest.raises(pickle.UnpicklingError, match="does not belong"):
        Journal(tmp_path).read("value")


def test_frames_come_in_the_order_of_the_pass_or_against_it(tmp_path):
    blocks = Blocks[int](Journal(tmp_path))
    for number in (1, 0, 2):
        blocks.write(number, [10 * number, 10 * number + 1])
    assert list(blocks.read()) == [0, 1, 10, 11, 20, 21]
    assert list(blocks.read(backward=True)) == [21, 20, 11, 10, 1, 0]
    assert (blocks.has(2), blocks.has(3)) == (True, False)


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
    with pytest.raises(InputError, match=r"No space left on device.*--resume"):
        journal.write("value", 2)
    assert journal.read("value") == 1


def test_a_pipe_in_place_of_a_stored_value_is_refused(tmp_path):
    journal = Journal(tmp_path)
    os.mkfifo(tmp_path / "learnt")
    with pytest.raises(InputError, match="learnt: is a named pipe"):
        journal.read("learnt")
