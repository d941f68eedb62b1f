"""Values on disk: whole or absent, checked when read, and of harmless kinds only."""

import json
import os
import re
import shutil
from collections import deque
from dataclasses import dataclass, field
from enum import Enum, IntEnum, StrEnum
from io import BytesIO
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import anchorpose
from anchorpose.body.asset import BodyAsset
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import SkinPoints
from anchorpose.errors import InputError
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.frame_record import Kept
from anchorpose.tracker.journal import Blocks, Journal, read_value, write_value
from anchorpose.tracker.learning_pass import LearntPatient
from anchorpose.tracker.passes import _PassState
from anchorpose.tracker.room import Room, Run
from anchorpose.tracker.stopwatch import Stopwatch

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


def test_a_value_is_made_once_and_an_absent_one_is_none(tmp_path):
    made = []

    def make() -> int:
        made.append(1)
        return 7

    assert [Journal(tmp_path).once("seven", int, make) for _ in range(3)] == [7, 7, 7]
    assert len(made) == 1
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
    (tmp_path / "value").write_bytes(Journal(tmp_path)._digest("value", memoryview(payload)) + payload)
    with pytest.raises(InputError, match="is damaged"):
        Journal(tmp_path).read("value", Pose | None)
    assert not (tmp_path / "ran").exists()


def test_only_the_work_of_a_child_process_is_pickled():
    """It comes to the child from the worker that started it, and never from a disk."""
    package = Path(anchorpose.__file__).parent
    runs = r"^\s*(import|from) (pickle|dill|cloudpickle|marshal|shelve|yaml|joblib)\b"
    found = re.compile(rf"{runs}|allow_pickle=True|(?<![.\w])(eval|exec)\(", re.MULTILINE)
    users = {path.relative_to(package).as_posix() for path in package.rglob("*.py") if found.search(path.read_text())}
    assert users == {"batch/worker.py", "batch/cluster.py"}


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
    gone = r"000001\.frames: is damaged; remove .* and give the same command again"
    with pytest.raises(InputError, match=gone):
        blocks.require(3)
    with pytest.raises(InputError, match=gone):
        list(blocks.read())
    (tmp_path / "000002.frames").unlink()
    assert list(blocks.read()) == [0]
    blocks.write_count(2)
    with pytest.raises(InputError, match=gone):
        list(blocks.read())


SPOILT = {
    "learnt": lambda path: path.write_bytes(b""),
    "forward/state": lambda path: path.write_bytes(path.read_bytes()[:-7]),
    "forward/000000.frames": lambda path: os.truncate(path, 4 * 10**12),
    "forward/000001.frames": lambda path: shutil.copy(path.with_name("000000.frames"), path),
    "forward": lambda path: (shutil.rmtree(path), path.write_text("x")),
    "forward/000002.frames": os.mkfifo,
    "forward/begun.json": Path.mkdir,
    "start.partial": os.mkfifo,
}


@pytest.mark.parametrize("place", SPOILT)
def test_damage_anywhere_is_found_before_anything_is_done(tmp_path, place):
    journal = Journal(tmp_path)
    journal.write("learnt", 1)
    journal.inside("forward").write("state", 2)
    Blocks[int](journal.inside("forward"), int).write(0, [1, 2])
    (tmp_path / "begun.json").write_text("{}")
    (tmp_path / "learnt.partial").write_text("cut off")
    (tmp_path / "first-seconds" / "start-1").mkdir(parents=True)
    journal.require_whole(("begun.json", "first-seconds"))
    SPOILT[place](tmp_path / place)
    with pytest.raises(InputError, match=f"{place}: .*; remove .* and give the same command again"):
        journal.require_whole(("begun.json", "first-seconds"))


def test_a_file_in_the_place_of_a_folder_is_named(tmp_path):
    (tmp_path / "forward").write_text("x")
    with pytest.raises(InputError, match=f"forward: is damaged; remove {tmp_path} and give the same command again"):
        Journal(tmp_path).inside("forward")


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


class Colour(StrEnum):
    RED = "#f00"


class Level(IntEnum):
    HIGH = 2


class Pair(NamedTuple):
    first: int
    second: float


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    value: np.ndarray
    name: str = ""


class Plain:
    """Not a dataclass; it has a part that is not stored."""

    leaf: Leaf
    cache: deque[Leaf | None]

    def __init__(self, leaf: Leaf) -> None:
        self.leaf, self.cache = leaf, deque([leaf], maxlen=2)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"cache": deque([None], maxlen=2)}


@dataclass(slots=True, eq=False)
class Tree:
    leaves: list[Leaf]
    colour: Colour | None = Colour.RED
    level: Level = Level.HIGH
    pair: Pair | None = None
    pairs: tuple[tuple[str, int], ...] = ()
    by_number: dict[int, Leaf] = field(default_factory=dict)
    marks: frozenset[int] = frozenset()
    share: float = 0.0
    data: bytes = b""
    plain: Plain | None = None


def stored(value: object, kind: Any, shared: dict[str, object] | None = None) -> Any:
    stream = BytesIO()
    write_value(stream, value, shared or {})
    stream.seek(0)
    return read_value(stream, kind, shared or {})


def test_every_kind_of_value_is_read_back_as_it_was():
    leaf = Leaf(np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)), "é\n")
    tree = Tree(
        [leaf],
        None,
        pair=Pair(1, np.inf),
        pairs=(("a", 1),),
        by_number={7: leaf},
        marks=frozenset({3, 1}),
        data=b"\x00\xff",
        plain=Plain(leaf),
    )
    found = stored(tree, Tree)
    assert (found.colour, found.level, found.pair, found.pairs) == (None, Level.HIGH, Pair(1, np.inf), (("a", 1),))
    assert (found.marks, found.share, found.data, type(found.pair)) == ({1, 3}, 0.0, b"\x00\xff", Pair)
    assert found.leaves[0].name == "é\n"
    assert found.leaves[0].value.flags.f_contiguous
    assert found.leaves[0].value.flags.writeable
    assert found.leaves[0].value.dtype == np.float32
    np.testing.assert_array_equal(found.leaves[0].value, leaf.value)
    assert (list(found.plain.cache), found.plain.cache.maxlen) == ([None], 2)
    assert stored(Tree([]), Tree).colour is Colour.RED


def test_objects_and_arrays_keep_their_identity():
    array = np.zeros(2)
    one, shared = Leaf(array), Leaf(array, "shared")
    found = stored([one, one, Leaf(array), shared], list[Leaf], {"it": shared})
    assert found[0] is found[1] is not found[2]
    assert found[0].value is found[2].value
    assert found[3] is shared


@pytest.mark.parametrize("number", [0.1 + 0.2, -0.0, 5e-324, float("nan"), np.float32(0.1), np.float64(0.1), 3])
def test_a_number_keeps_its_bits_and_its_type(number):
    found = stored(number, float)
    assert type(found) is type(number)
    assert np.array(found).tobytes() == np.array(number).tobytes()


def test_a_member_of_an_enumeration_is_its_value_where_no_more_is_declared():
    assert (stored(Level.HIGH, int), stored([Colour.RED], list[str])) == (2, ["#f00"])


def crafted(tree: Any, *arrays: np.ndarray) -> BytesIO:
    stream = BytesIO()
    for array in (np.frombuffer(json.dumps(tree).encode(), np.uint8), *arrays):
        np.lib.format.write_array(stream, array, allow_pickle=True)
    stream.seek(0)
    return stream


LEAF = {"value": {"array": 0}, "name": "a"}


@pytest.mark.parametrize(
    "tree",
    [
        *({"Leaf": LEAF | {"more": 1}}, {"Leaf": {"name": "a"}}, {"Leaf": LEAF, "Plain": {}}, {"Leaf": [1]}, {}),
        *({"Leaf": LEAF | {"name": 1}}, {"Leaf": LEAF | {"name": None}}, {"Leaf": LEAF | {"value": 1}}),
        *({"Leaf": LEAF | {"value": {"bytes": 0}}}, {"Leaf": LEAF | {"value": {"array": 1}}}),
        *({"Popen": {"args": "ls"}}, {"Plain": {}}, {"type": {}}, {"again": 0}, {"again": "x"}, {"shared": "other"}),
        *(None, 1, "Leaf", [], [1], [[[[1]]]], {"array": 0}),
    ],
)
def test_a_tree_that_is_no_such_value_is_refused(tree):
    assert isinstance(read_value(crafted({"Leaf": LEAF}, np.zeros(3)), Leaf, {}), Leaf)
    with pytest.raises(ValueError, match="holds no value"):
        read_value(crafted(tree, np.zeros(3)), Leaf, {"other": Plain(Leaf(np.zeros(1)))})


@pytest.mark.parametrize(
    ("node", "kind"),
    [
        *((True, int), (True, float), (1.5, int), (1, bool), ("1", float), (1, str), ("RED", Colour), (3, Level)),
        *(([1, "a"], list[int]), ([1, 2, 3], tuple[int, int]), ([1], Pair), ([["a", 1, 2]], dict[str, int])),
        *(([-1.5, 1], deque[int]), ([], deque[int]), ([[1]], frozenset[int]), (10**30, int), ({"int": {}}, int)),
    ],
)
def test_a_value_of_another_type_is_refused(node, kind):
    with pytest.raises(ValueError, match="holds no value"):
        read_value(crafted(node), kind, {})


@pytest.mark.parametrize("array", [np.array([{}], dtype=object), np.array(["a"]), np.zeros(1, [("a", float)])])
def test_an_array_of_anything_but_numbers_is_refused(array):
    with pytest.raises(ValueError, match="holds no value"):
        read_value(crafted({"array": 0}, array), np.ndarray, {})


@pytest.mark.parametrize("end", [0, 5, 60, 200, -1])
def test_bytes_that_were_cut_off_are_refused(end):
    data = crafted({"array": 0}, np.zeros(20)).getvalue()
    with pytest.raises(ValueError, match="holds no value"):
        read_value(BytesIO(data[:end]), np.ndarray, {})


def test_every_class_of_a_run_declares_what_can_be_stored():
    """From what the journal of a run holds on; shared objects are made again, and matches are found again."""
    known, open_kinds = (
        {Run, Room, TrackConfig, Stopwatch, SkinPoints, BodyAsset, Matcher},
        [LearntPatient, _PassState, Kept],
    )
    while open_kinds:
        kind = open_kinds.pop()
        origin = get_origin(kind) or kind
        if get_args(kind):
            assert origin in (UnionType, Union, tuple, list, dict, set, frozenset, deque), kind
            open_kinds += [each for each in get_args(kind) if each is not ...]
        elif origin not in known and not issubclass(origin, Enum | int | float | str | bytes | NoneType | np.ndarray):
            known.add(origin)
            declared = get_type_hints(origin)
            assert declared, f"{origin} declares no attributes"
            open_kinds += declared.values()
    assert len(known) > 60
