"""Draw over one camera's depth image: masks with names, nodes with values and arrows, and the equipment's parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.equipment_model import EquipmentCaster
from anchorpose.camera import Camera, invert_rigid
from anchorpose.pages.canvas import Colour, Ink, draw_contour, enlarge, projector, scale_of, shade, whole, write
from anchorpose.recording.equipment import EquipmentModel, EquipmentPart

COLOUR_STRENGTH: Final = 0.7
"""Share of the colour in a tinted pixel; the remaining share is the grey of the depth image, which shows the shape."""

HATCH_PX: Final = 14  # px, distance between two stripes
ARROW_TIP: Final = 0.35  # length of an arrow's tip, as a share of the arrow's length


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A mask (height, width) bool of pixels with one meaning, and their colour; a hatched layer is drawn in stripes."""

    mask: np.ndarray
    colour: Colour
    hatched: bool = False


def draw_depth(depth_m: np.ndarray, camera: Camera) -> np.ndarray:
    """Draw the distance as colour, yellow near and blue far, with a colour bar below."""
    seen = depth_m > 0
    near, far = np.percentile(depth_m[seen], [1, 99]) if seen.any() else (0.0, 1.0)
    far = max(float(far), float(near) + 1e-3)
    level = np.clip((far - depth_m) / (far - near), 0.0, 1.0)
    picture = cv2.applyColorMap((255 * level).astype(np.uint8), cv2.COLORMAP_CIVIDIS)
    picture[~seen] = Ink.NO_READING
    picture = enlarge(picture, scale_of(camera))
    return draw_bar(picture, f"{near:.1f} m", f"{far:.1f} m", reverse=True)


def draw_layers(depth_m: np.ndarray, camera: Camera, layers: Sequence[Layer]) -> np.ndarray:
    """Draw masks over the grey depth image, later masks on top; masked pixels without a reading are coloured too."""
    scale = scale_of(camera)
    picture = enlarge(shade(depth_m), scale)
    for layer in layers:
        mask = enlarge(layer.mask.astype(np.uint8), scale) > 0
        if layer.hatched:
            diagonal = np.add.outer(np.arange(mask.shape[0]), np.arange(mask.shape[1]))
            mask &= diagonal % HATCH_PX < HATCH_PX // 3 + 1
            picture[mask] = layer.colour
        else:
            mixed = (1.0 - COLOUR_STRENGTH) * picture[mask] + COLOUR_STRENGTH * np.array(layer.colour)
            picture[mask] = mixed.astype(np.uint8)
    return picture


def name_masks(picture: np.ndarray, camera: Camera, masks: Sequence[np.ndarray], names: Sequence[str]) -> None:
    """Write each mask's name at the middle of the mask."""
    for mask, name in zip(masks, names, strict=True):
        place = np.argwhere(mask)
        if len(place):
            row, column = np.median(place, axis=0) * scale_of(camera)
            write(picture, name, whole(np.array([column, row])))


def draw_values(
    picture: np.ndarray, camera: Camera, pixel: np.ndarray, values: np.ndarray, highest: float, iso: float | None
) -> None:
    """Draw nodes coloured by value, from dark at 0 to light at ``highest``, grey where not finite. pixel (n, 2): row
    and column of each node. iso: step of the value between two contour lines; None for no lines.
    """
    finite = np.isfinite(values)
    level = np.where(finite, np.clip(values / max(highest, 1e-9), 0.0, 1.0), 0.0)
    colour = cv2.applyColorMap((255 * level).astype(np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0]
    colour[~finite] = 110
    fill_blocks(picture, camera, pixel, colour)
    if iso is not None:
        _draw_iso_lines(picture, camera, pixel, np.where(finite, np.floor(values / iso), -1.0))


def draw_arrows(picture: np.ndarray, starts: np.ndarray, ends: np.ndarray, colour: Colour) -> None:
    """Draw arrows between pixels (m, 2), each with a dot at its start; an arrow with an end that is NaN is left out."""
    for start, end in zip(starts, ends, strict=True):
        if np.isfinite(start).all() and np.isfinite(end).all():
            cv2.circle(picture, whole(start), 2, colour, -1, cv2.LINE_AA)
            cv2.arrowedLine(picture, whole(start), whole(end), colour, 1, cv2.LINE_AA, tipLength=ARROW_TIP)


def draw_crosses(picture: np.ndarray, places: np.ndarray, colour: Colour) -> None:
    """Draw small crosses at pixels (n, 2), except where NaN."""
    for place in places[np.isfinite(places).all(axis=1)]:
        cv2.drawMarker(picture, whole(place), colour, cv2.MARKER_TILTED_CROSS, 6, 1, cv2.LINE_AA)


def draw_bar(picture: np.ndarray, low: str, high: str, reverse: bool = False) -> np.ndarray:
    """Return the picture with a colour bar below, from ``low`` (left) to ``high``: dark to light or, if ``reverse``,
    light to dark.
    """
    ramp = np.linspace(255, 0, 240) if reverse else np.linspace(0, 255, 240)
    colours = cv2.COLORMAP_CIVIDIS if reverse else cv2.COLORMAP_VIRIDIS
    strip = np.zeros((34, picture.shape[1], 3), np.uint8)
    left = (strip.shape[1] - 240) // 2
    strip[8:26, left : left + 240] = cv2.applyColorMap(ramp.astype(np.uint8)[None], colours)
    for text, at in ((low, left - 12), (high, left + 252)):
        (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.55, 1)
        corner = (at - width if text == low else at, 23)
        cv2.putText(strip, text, corner, cv2.FONT_HERSHEY_SIMPLEX, 0.55, Ink.WHITE, 1, cv2.LINE_AA)
    return np.vstack([picture, strip])


def fill_blocks(picture: np.ndarray, camera: Camera, pixel: np.ndarray, colour: np.ndarray) -> None:
    """Draw nodes as square blocks that touch each other. pixel (n, 2): row and column; colour (n, 3) uint8."""
    large = _blocks(picture, camera, pixel, np.insert(colour, 3, 1, axis=1), np.zeros(4, np.uint8))
    filled = large[..., 3] > 0
    picture[filled] = large[filled][:, :3]


def _draw_iso_lines(picture: np.ndarray, camera: Camera, pixel: np.ndarray, band: np.ndarray) -> None:
    """Draw contour lines in black, between the blocks of neighbouring nodes whose values are separated by a contour
    value. band (n,): for each node, the number of the interval between contour values in which its value lies.
    """
    large = _blocks(picture, camera, pixel, band, np.array(np.nan))
    for axis in (0, 1):
        jump = np.diff(large, axis=axis)
        line = np.isfinite(jump) & (jump != 0)
        target = picture[1:] if axis == 0 else picture[:, 1:]
        target[line] = Ink.BLACK


def _blocks(
    picture: np.ndarray, camera: Camera, pixel: np.ndarray, values: np.ndarray, empty: np.ndarray
) -> np.ndarray:
    """Return an image (height, width, ...) in which each node is a square block of pixels with the node's value; all
    other pixels are ``empty``.

    A block is as wide as the nodes' spacing, the greatest common divisor of all their rows and columns.
    """
    step = max(1, int(np.gcd.reduce(pixel.ravel().astype(np.int64)))) if len(pixel) else 1
    small = np.full((-(-camera.height // step), -(-camera.width // step), *empty.shape), empty)
    small[pixel[:, 0] // step, pixel[:, 1] // step] = values
    size = scale_of(camera) * step
    return np.asarray(small.repeat(size, axis=0).repeat(size, axis=1)[: picture.shape[0], : picture.shape[1]])


PART_COLOURS: Final = (Ink.ORANGE, Ink.SKY, Ink.YELLOW, Ink.PURPLE, Ink.GREEN, Ink.VERMILLION)


def draw_model(camera: Camera, depth_m: np.ndarray, model: EquipmentModel | None, axes: bool = False) -> np.ndarray:
    """Draw the outline and name of each part of the equipment over the depth image (height, width); outlines are left
    out where another part is in front.

    axes: whether to draw the axes of the world, each 0.3 m long from the origin.
    """
    picture = enlarge(shade(depth_m), scale_of(camera))
    to_pixel = projector(camera, scale_of(camera))
    parts = [] if model is None else _draw_part_outlines(picture, camera, depth_m, model)
    for part in parts:
        place = to_pixel(part.triangles()[0].mean(axis=0)[None])[0]
        if np.isfinite(place).all():
            write(picture, part.name, whole(place))
    if axes:
        _draw_axes(picture, to_pixel(np.concatenate([np.zeros((1, 3)), 0.3 * np.eye(3)])))
    return picture


def _draw_part_outlines(
    picture: np.ndarray, camera: Camera, depth_m: np.ndarray, model: EquipmentModel
) -> list[EquipmentPart]:
    """Draw the outline of each part that the camera sees; return these parts."""
    rendering = EquipmentCaster(model).render(camera, invert_rigid(camera.require_pose()))
    if rendering is None:
        return []
    number_of_part = np.full(depth_m.shape, -1)
    number_of_part[rendering.window] = rendering.part
    drawn = []
    for number, part in enumerate(model.parts):
        if (number_of_part == number).any():
            draw_contour(picture, number_of_part == number, camera, PART_COLOURS[number % len(PART_COLOURS)])
            drawn.append(part)
    return drawn


def _draw_axes(picture: np.ndarray, ends: np.ndarray) -> None:
    for end, name, colour in zip(ends[1:], "XYZ", (Ink.VERMILLION, Ink.GREEN, Ink.SKY), strict=True):
        if np.isfinite(ends[0]).all() and np.isfinite(end).all():
            cv2.line(picture, whole(ends[0]), whole(end), Ink.BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, whole(ends[0]), whole(end), colour, 2, cv2.LINE_AA)
            write(picture, name, whole(end))
