"""Read the sizes and poses of printed markers in the world (Gamma_0) from markers.json (format ``marker-layout``)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

import cv2
import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from anchorpose.recording.document import Entry, Pose, Version, Whole
from anchorpose.settings import STRICT, Unfit, nearest_key, shown

SMALLEST_M: Final = 1e-3
LARGEST_M: Final = 5.0  # m, maximum side length of a printed marker; a larger value was probably written in millimetres

Squares = Annotated[Whole, Field(gt=1, le=100, description="the number of squares in a row or a column")]


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A square tag: the side length of its black square, and its pose: x to the right, y up and z out of the sheet,
    towards the reader.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    number: Annotated[Whole, Field(alias="id", ge=0, le=100_000, description="the tag's number in its dictionary")]
    size_m: Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M, description="the side of the black square in metres")]
    T_world_tag: Annotated[Pose, Field(alias="pose")]  # (4, 4)

    def corners_m(self) -> np.ndarray:
        """Return the corners (4, 3), world, from the upper left clockwise, as detectors report them."""
        square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * self.size_m / 2.0
        return np.asarray(square @ self.T_world_tag[:3, :3].T + self.T_world_tag[:3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A ChArUco board. The board's frame, whose pose ``T_world_board`` states, has its origin at the upper left corner,
    x along the rows, y down the columns and z into the board.
    """

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    squares_x: Squares
    squares_y: Squares
    square_m: Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M, description="the side of a chess square in metres")]
    marker_m: Annotated[float, Field(ge=SMALLEST_M, description="the side of a marker in a square, in metres")]
    T_world_board: Annotated[Pose, Field(alias="pose")]  # (4, 4)

    def __post_init__(self) -> None:
        if self.marker_m > self.square_m:
            raise Unfit(f"is {self.marker_m:g}", f"it must be at most square_m, {self.square_m:g}", "marker_m")


def _require_dictionary(name: str) -> str:
    known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if name not in known:
        raise Unfit(f"is {shown(name)}", f"did you mean {nearest_key(name, known) or 'DICT_APRILTAG_36h11'}")
    return name


class MarkerLayout(Entry):
    """The content of markers.json: single tags or one board; dictionary: OpenCV's name, such as DICT_APRILTAG_36h11."""

    format: Literal["marker-layout"]
    version: Version
    dictionary: Annotated[str, AfterValidator(_require_dictionary)]
    tags: tuple[Tag, ...] | None = None
    board: Board | None = None

    @model_validator(mode="after")
    def _require_one_kind(self) -> MarkerLayout:
        if (self.tags is None) == (self.board is None):
            problem = "and board are both given or both missing"
            raise Unfit(problem, "describe either single tags or one board", "tags")
        if self.tags is not None and not 0 < len(self.tags) == len({tag.number for tag in self.tags}):
            raise Unfit("is empty or names an id twice", "list every tag once; no two may have the same id", "tags")
        return self
