"""Provide the functions for pictures drawn over a depth image: colours, grey shading, projection to pixels, names
beside dots, and encoding as PNG.

The colours were chosen by Okabe and Ito so that colour-blind readers can distinguish them. Each colour is (blue, green,
red), OpenCV's order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import cv2
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel

Colour = tuple[int, int, int]


class Ink:
    """The colours of all pictures."""

    SKY: Final = (233, 180, 86)
    ORANGE: Final = (0, 159, 230)
    GREEN: Final = (115, 158, 0)
    YELLOW: Final = (66, 228, 240)
    BLUE: Final = (178, 114, 0)
    VERMILLION: Final = (0, 94, 213)
    PURPLE: Final = (167, 121, 204)
    WHITE: Final = (255, 255, 255)
    GREY: Final = (150, 150, 150)
    BLACK: Final = (0, 0, 0)
    NO_READING: Final = (48, 24, 16)  # nearly black, bluish
    PATIENT: Final = SKY
    EQUIPMENT: Final = ORANGE
    # colours of people other than the patient, by their labels; the fifth such person has the first colour again
    OTHERS: Final = (PURPLE, GREEN, YELLOW, WHITE)


PICTURE_WIDTH: Final = 960
"""Width of a picture in pixels. Pictures of this width are large enough to read the names on a phone held sideways, and
small enough to embed a dozen of them in a page.
"""


def colour_of_person(label: int) -> Colour:
    """Return the colour of a person's pixel label."""
    if label == PixelLabel.PATIENT:
        return Ink.PATIENT
    return Ink.OTHERS[(label - PixelLabel.OTHER_PERSON) % len(Ink.OTHERS)]


def as_hex(colour: Sequence[float]) -> str:
    """Return the colour (blue, green, red) as web pages write it."""
    blue, green, red = (int(part) for part in colour)
    return f"#{red:02x}{green:02x}{blue:02x}"


def scale_of(camera: Camera) -> int:
    """Return the factor by which the camera's depth image is enlarged: picture pixels per depth pixel."""
    return max(1, round(PICTURE_WIDTH / camera.width))


def shade(depth_m: np.ndarray, tint: np.ndarray | None = None) -> np.ndarray:
    """Shade a depth image as (height, width, 3) uint8: near is light, far is dark. tint (height, width, 3), 0 to 255: a
    colour for each pixel in place of white.
    """
    seen = depth_m > 0
    near, far = np.percentile(depth_m[seen], [1, 99]) if seen.any() else (0.0, 1.0)
    grey = 0.75 - 0.6 * np.clip((depth_m - near) / max(far - near, 1e-6), 0.0, 1.0)
    colour = np.full(3, 255.0) if tint is None else tint
    picture = np.where(seen[..., None], grey[..., None] * colour, Ink.NO_READING)
    return np.ascontiguousarray(picture, dtype=np.uint8)


def enlarge(picture: np.ndarray, scale: int) -> np.ndarray:
    """Enlarge every pixel to a square of ``scale`` pixels."""
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST))


def projector(camera: Camera, scale: int) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function that converts world points (n, 3) to pixels (n, 2) of the enlarged picture. Its result is NaN
    for points that are NaN, behind the camera or far outside the image.
    """
    T_camera_world = invert_rigid(camera.require_pose())

    def to_pixel(points_m: np.ndarray) -> np.ndarray:
        pixels = camera.project(transform_points(T_camera_world, np.asarray(points_m, dtype=np.float64)))
        # a point far outside counts as unknown, since OpenCV's fixed-point coordinates would overflow
        pixels[(np.abs(pixels) > 10 * max(camera.width, camera.height)).any(axis=1)] = np.nan
        return (pixels + 0.5) * scale - 0.5

    return to_pixel


def write(picture: np.ndarray, text: str, place: tuple[int, int]) -> None:
    """Write a text beside the pixel ``place``, inside the picture, in white with a black rim."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 2)
    left = place[0] + 14 if place[0] + 14 + width < picture.shape[1] else place[0] - 14 - width
    corner = (left, int(np.clip(place[1] + height // 2, height + 2, picture.shape[0] - 4)))
    ink = np.zeros(picture.shape[:2], np.uint8)
    cv2.putText(ink, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255, 1, cv2.LINE_AA)
    picture[cv2.dilate(ink, np.ones((5, 5), np.uint8)) > 0] = Ink.BLACK
    picture[ink > 0] = ink[ink > 0][:, None]


def whole(place: np.ndarray) -> tuple[int, int]:
    """Return the column and row of a place (2,) as whole numbers, as OpenCV's drawing functions need them."""
    column, row = np.rint(place).astype(int)
    return int(column), int(row)


def draw_contour(picture: np.ndarray, mask: np.ndarray, camera: Camera, colour: Colour) -> None:
    """Draw the outline of a mask (height, width) of depth pixels into an enlarged picture."""
    large = enlarge(mask.astype(np.uint8), scale_of(camera))
    contours, _ = cv2.findContours(large, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, Ink.BLACK, 3, cv2.LINE_AA)
    cv2.drawContours(picture, contours, -1, colour, 1, cv2.LINE_AA)


def draw_lines(picture: np.ndarray, starts: np.ndarray, ends: np.ndarray, colour: Colour) -> None:
    """Draw lines between pixels (m, 2); a line with an end that is NaN is left out."""
    for start, end in zip(starts, ends, strict=True):
        if np.isfinite(start).all() and np.isfinite(end).all():
            cv2.line(picture, whole(start), whole(end), colour, 1, cv2.LINE_AA)


def draw_dots(
    picture: np.ndarray,
    places: np.ndarray,
    colour: Colour,
    radius: int,
    names: Sequence[str] = (),
    *,
    hollow: bool = False,
    rim: bool = True,
) -> None:
    """Draw dots at pixels (n, 2), except where NaN. names: texts beside the dots; rim: with a black rim."""
    for number, place in enumerate(places):
        if np.isfinite(place).all():
            if rim:
                cv2.circle(picture, whole(place), radius + 2, Ink.BLACK, 4 if hollow else -1, cv2.LINE_AA)
            cv2.circle(picture, whole(place), radius, colour, 2 if hollow else -1, cv2.LINE_AA)
            if names:
                write(picture, names[number], whole(place))


def as_png(picture: np.ndarray) -> bytes:
    """Return the picture as the bytes of a PNG file; the same picture gives the same bytes."""
    # compression level 9 would make files 3 % smaller, but would take eight times as long
    _, encoded = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return bytes(encoded)
