"""The equipment's model drawn into a camera's picture, part by part."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.equipment.render import EquipmentCaster
from anchorpose.camera import Camera, invert_rigid
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.results.canvas import enlarge, projector, scale_of, shade, whole, write
from anchorpose.results.palette import BLACK, GREEN, ORANGE, PURPLE, SKY, VERMILLION, YELLOW
from anchorpose.results.stage_pictures import draw_contour

PART_COLOURS: Final = (ORANGE, SKY, YELLOW, PURPLE, GREEN, VERMILLION)


def draw_model(camera: Camera, depth_m: np.ndarray, model: EquipmentModel | None, axes: bool = False) -> np.ndarray:
    """Each part's outline and name over the depth picture (height, width); other parts may hide a part's outline.

    axes: the world's too, 0.3 m each from its origin.
    """
    picture = enlarge(shade(depth_m), scale_of(camera))
    to_pixel = projector(camera, scale_of(camera))
    rendering = None if model is None else EquipmentCaster(model).render(camera, invert_rigid(camera.require_pose()))
    names = []
    if model is not None and rendering is not None:
        shown = np.full(depth_m.shape, -1)
        shown[rendering.window] = rendering.part
        for number, part in enumerate(model.parts):
            if (shown == number).any():
                draw_contour(picture, shown == number, camera, PART_COLOURS[number % len(PART_COLOURS)])
                names.append((part.name, part.triangles()[0].mean(axis=0)))
    for name, middle_m in names:
        place = to_pixel(middle_m[None])[0]
        if np.isfinite(place).all():
            write(picture, name, whole(place))
    if axes:
        _draw_axes(picture, to_pixel(np.concatenate([np.zeros((1, 3)), 0.3 * np.eye(3)])))
    return picture


def _draw_axes(picture: np.ndarray, ends: np.ndarray) -> None:
    for end, name, colour in zip(ends[1:], "XYZ", (VERMILLION, GREEN, SKY), strict=True):
        if np.isfinite(ends[0]).all() and np.isfinite(end).all():
            cv2.line(picture, whole(ends[0]), whole(end), BLACK, 4, cv2.LINE_AA)
            cv2.line(picture, whole(ends[0]), whole(end), colour, 2, cv2.LINE_AA)
            write(picture, name, whole(end))
