"""Read where markers are in Gamma_0 (markers.json, format ``marker-layout``), and find their corners in an image."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, ClassVar, Final, Literal

import cv2
import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from anchorpose.camera import Camera, transform_points
from anchorpose.recording.document import Entry, Pose, Version, Whole, read_document
from anchorpose.settings import STRICT, Unfit, nearest_key, shown

SMALLEST_M: Final = 1e-3
LARGEST_M: Final = 5.0  # a printed marker; anything larger was written in millimetres

Squares = Annotated[Whole, Field(gt=1, le=100, description="how many squares a row or a column has")]


@dataclass(frozen=True, slots=True, eq=False)
class Tag:
    """A square tag: side of its black square, pose with x to its right, y up and z out of it, towards the reader."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    number: Annotated[Whole, Field(alias="id", ge=0, le=100_000, description="the tag's number in its dictionary")]
    size_m: Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M, description="the side of the black square in metres")]
    T_world_tag: Annotated[Pose, Field(alias="pose")]  # (4, 4)

    def corners_m(self) -> np.ndarray:
        """(4, 3) world: from the upper left clockwise, as detectors report them."""
        square = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * self.size_m / 2.0
        return np.asarray(square @ self.T_world_tag[:3, :3].T + self.T_world_tag[:3, 3])


@dataclass(frozen=True, slots=True, eq=False)
class Board:
    """A ChArUco board: pose with x along its rows, y down its columns and z into it, from its upper left corner."""

    __pydantic_config__: ClassVar[ConfigDict] = STRICT
    squares_x: Squares
    squares_y: Squares
    square_m: Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M, description="the side of a chess square in metres")]
    marker_m: Annotated[float, Field(ge=SMALLEST_M, description="the side of a marker in a square, in metres")]
    T_world_board: Annotated[Pose, Field(alias="pose")]  # (4, 4)

    def __post_init__(self) -> None:
        if self.marker_m > self.square_m:
            raise Unfit(f"is {self.marker_m:g}", f"it must be at most square_m, {self.square_m:g}", "marker_m")


@dataclass(frozen=True, slots=True, eq=False)
class MarkerLayout:
    """dictionary: OpenCV's name, such as DICT_APRILTAG_36h11; tags, or one board (then tags is empty)."""

    dictionary: str
    tags: tuple[Tag, ...]
    board: Board | None


def _require_dictionary(name: str) -> str:
    known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    if name not in known:
        raise Unfit(f"is {shown(name)}", f"did you mean {nearest_key(name, known) or 'DICT_APRILTAG_36h11'}")
    return name


class LayoutDocument(Entry):
    """markers.json: single tags or one board."""

    format: Literal["marker-layout"]
    version: Version
    dictionary: Annotated[str, AfterValidator(_require_dictionary)]
    tags: tuple[Tag, ...] | None = None
    board: Board | None = None

    @model_validator(mode="after")
    def _require_one_kind(self) -> LayoutDocument:
        if (self.tags is None) == (self.board is None):
            problem = "and board are both given or both missing"
            raise Unfit(problem, "describe either single tags or one board", "tags")
        if self.tags is not None and not 0 < len(self.tags) == len({tag.number for tag in self.tags}):
            raise Unfit("is empty or names an id twice", "list every tag once; no two may have the same id", "tags")
        return self


def read_marker_layout(path: Path) -> MarkerLayout:
    """A checked markers.json; raises InputError naming the file, the key and the remedy."""
    document = read_document(path, LayoutDocument)
    return MarkerLayout(document.dictionary, document.tags or (), document.board)


LEAST_SIDE_PX: Final = 14.0  # the bits of a smaller tag are two pixels wide, its corners less accurate than assumed
LEAST_BOARD_CORNERS: Final = 6
DEPTH_READINGS: Final = 40  # at most, on a marker


class NoMarkers(StrEnum):
    """Why the image gives no pose."""

    NONE_SEEN = "none of the markers of the layout is seen whole"
    TOO_SMALL = "the markers seen are too small in the image"
    AMBIGUOUS = "the flat markers allow two poses that explain the image equally well"
    INCONSISTENT = "the markers seen do not fit the layout: one was moved, or the layout is wrong"
    TOO_UNCERTAIN = "the markers seen do not give the pose accurately enough"


@dataclass(frozen=True, slots=True, eq=False)
class SeenMarkers:
    """Corners: pixel (n, 2), world_m (n, 3), marker (n,) id of each; depth rows: rays (k, 2), depth_m (k,), plane (k,)
    index of the marker that each reading lies on."""

    pixel: np.ndarray
    world_m: np.ndarray
    marker: np.ndarray
    rays: np.ndarray
    depth_m: np.ndarray
    plane: np.ndarray

    def without(self, marker: int) -> SeenMarkers:
        keep, on = self.marker != marker, self.plane != marker
        return SeenMarkers(
            self.pixel[keep], self.world_m[keep], self.marker[keep], self.rays[on], self.depth_m[on], self.plane[on]
        )


def detect_markers(
    image: np.ndarray, camera: Camera, layout: MarkerLayout, depth_m: np.ndarray | None
) -> SeenMarkers | NoMarkers:
    """The markers of the layout in an image, see ``pose_from_markers``, or why there are none."""
    grey = _grey(image)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, layout.dictionary))
    parameters = cv2.aruco.DetectorParameters()
    if layout.board is not None:
        found = _board_corners(grey, layout.board, dictionary, parameters)
    else:
        # quads by fitted edges: half the error of corners refined one by one
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_APRILTAG
        found = _tag_corners(grey, layout, cv2.aruco.ArucoDetector(dictionary, parameters))
    if not found:
        return NoMarkers.NONE_SEEN
    found = {number: pair for number, pair in found.items() if _side_px(pair[0]) >= LEAST_SIDE_PX}
    if not found:
        return NoMarkers.TOO_SMALL
    pixel = np.concatenate([pair[0] for pair in found.values()])
    world = np.concatenate([pair[1] for pair in found.values()])
    marker = np.repeat(list(found), [len(pair[0]) for pair in found.values()])
    rows = [_depth_inside(corners, number, camera, depth_m) for number, (corners, _) in found.items()]
    rays, depth, plane = (np.concatenate(part) for part in zip(*rows, strict=True))
    return SeenMarkers(pixel, world, marker, rays, depth, plane)


def _grey(image: np.ndarray) -> np.ndarray:
    """8-bit grey; 16-bit infrared is scaled, without its brightest specks, by the root that evens near and far."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if grey.dtype == np.uint8:
        return grey
    top = max(float(np.percentile(grey, 99.0)), 1.0)
    return np.asarray(255.0 * np.sqrt(np.clip(grey / top, 0.0, 1.0)), dtype=np.uint8)


def _tag_corners(
    grey: np.ndarray, layout: MarkerLayout, detector: cv2.aruco.ArucoDetector
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Pixel and world corners of each tag of the layout that is seen exactly once: of two equal ones, one is a copy."""
    corners, numbers, _ = detector.detectMarkers(grey)
    listed = [] if numbers is None else [int(number) for number in np.ravel(numbers)]
    places = {tag.number: tag.corners_m() for tag in layout.tags}
    return {
        number: (corner.reshape(4, 2).astype(np.float64), places[number])
        for number, corner in zip(listed, corners, strict=True)
        if number in places and listed.count(number) == 1
    }


def _board_corners(
    grey: np.ndarray, board: Board, dictionary: cv2.aruco.Dictionary, parameters: cv2.aruco.DetectorParameters
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """All chessboard corners of the board under the id 0; nothing where fewer than ``LEAST_BOARD_CORNERS`` are seen."""
    size = (board.squares_x, board.squares_y)
    known = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, dictionary)
    detector = cv2.aruco.CharucoDetector(known, cv2.aruco.CharucoParameters(), parameters)
    corners, numbers, _, _ = detector.detectBoard(grey)
    if numbers is None or len(numbers) < LEAST_BOARD_CORNERS:
        return {}
    places = np.asarray(known.getChessboardCorners(), dtype=np.float64)[np.asarray(numbers).ravel()]
    return {0: (corners.reshape(-1, 2).astype(np.float64), transform_points(board.T_world_board, places))}


def _side_px(corners: np.ndarray) -> float:
    """Of a tag its shortest side; of a board's corners, half the breadth of what they span."""
    if len(corners) == 4:
        return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).min())
    return float(np.ptp(corners, axis=0).min()) / 2.0


def _depth_inside(
    corners: np.ndarray, number: int, camera: Camera, depth_m: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays and depths of readings on a marker, without its edge: there depth mixes with what is behind."""
    if depth_m is None:
        return np.empty((0, 2)), np.empty(0), np.empty(0, dtype=np.int64)
    mask = np.zeros(depth_m.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint(cv2.convexHull(corners.astype(np.float32))).astype(np.int32), 1)
    inside = (cv2.erode(mask, np.ones((5, 5), np.uint8)) > 0) & (depth_m > 0)
    place = np.argwhere(inside)
    place = place[:: max(1, len(place) // DEPTH_READINGS)]
    row, column = place.T
    rays = camera.pixel_rays()[row, column].astype(np.float64)
    return rays, depth_m[row, column].astype(np.float64), np.full(len(place), number)
