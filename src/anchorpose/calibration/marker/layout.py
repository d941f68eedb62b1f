"""markers.json, the format ``marker-layout``: which AprilTags or which ChArUco board hang where in Gamma_0."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from anchorpose.recording.document import JsonObject, check_format, nearest_key, read_json_object
from anchorpose.recording.equipment_file import is_rotation

LARGEST_M = 5.0  # a printed marker; anything larger was written in millimetres


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A square tag: side of its black square, pose with x to its right, y up and z out of it, towards who reads it."""

    number: int
    size_m: float
    T_world_tag: np.ndarray  # (4, 4)

    def corners_m(self) -> np.ndarray:
        """(4, 3) world: from the upper left clockwise, as detectors report them."""
        square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * self.size_m / 2.0
        return np.asarray(square @ self.T_world_tag[:3, :3].T + self.T_world_tag[:3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A ChArUco board: pose with x along its rows, y down its columns and z into it, from its upper left corner."""

    squares_x: int
    squares_y: int
    square_m: float
    marker_m: float
    T_world_board: np.ndarray  # (4, 4)


@dataclass(frozen=True, slots=True, eq=False)
class MarkerLayout:
    """dictionary: OpenCV's name, such as DICT_APRILTAG_36h11; tags, or one board (then tags is empty)."""

    dictionary: str
    tags: tuple[Tag, ...]
    board: Board | None


def read_marker_layout(path: Path) -> MarkerLayout:
    """A checked markers.json; raises InputError naming the file, the key and the remedy."""
    top = read_json_object(path)
    top.only("format", "version", "dictionary", "tags", "board")
    check_format(top, "marker-layout")
    dictionary = top.text("dictionary")
    known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if dictionary not in known:
        nearest = nearest_key(dictionary.upper(), known)
        raise top.refuse("dictionary", f"is '{dictionary}'", f"did you mean {nearest or 'DICT_APRILTAG_36h11'}")
    if top.has("tags") == top.has("board"):
        raise top.refuse("tags", "and board are both given or both missing", "describe either single tags or one board")
    if top.has("board"):
        return MarkerLayout(dictionary, (), _parse_board(top.object("board")))
    tags = tuple(_parse_tag(tag) for tag in top.objects("tags"))
    numbers = [tag.number for tag in tags]
    if not tags or len(set(numbers)) < len(numbers):
        raise top.refuse("tags", "is empty or names an id twice", "list every tag once; no two may have the same id")
    return MarkerLayout(dictionary, tags, None)


def _parse_tag(entry: JsonObject) -> Tag:
    entry.only("id", "size_m", "pose")
    return Tag(
        number=entry.whole_number("id", above=-1, at_most=100_000, meaning="the tag's number in its dictionary"),
        size_m=entry.number("size_m", above=0, at_most=LARGEST_M, meaning="the side of the black square in metres"),
        T_world_tag=_parse_pose(entry),
    )


def _parse_board(entry: JsonObject) -> Board:
    entry.only("squares_x", "squares_y", "square_m", "marker_m", "pose")
    square = entry.number("square_m", above=0, at_most=LARGEST_M, meaning="the side of a chess square in metres")
    return Board(
        squares_x=entry.whole_number("squares_x", above=1, at_most=100, meaning="squares in a row"),
        squares_y=entry.whole_number("squares_y", above=1, at_most=100, meaning="squares in a column"),
        square_m=square,
        marker_m=entry.number("marker_m", above=0, at_most=square, meaning="the side of a marker in a square, metres"),
        T_world_board=_parse_pose(entry),
    )


def _parse_pose(entry: JsonObject) -> np.ndarray:
    pose = entry.numbers("pose", (4, 4), "four rows of four numbers: the pose of the marker in the equipment's frame")
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9 or not is_rotation(pose[:3, :3]):
        raise entry.refuse(
            "pose", "is no rigid motion", "write a rotation and a translation in metres, last row 0 0 0 1"
        )
    return pose
