"""The equipment's model drawn into a camera's picture, part by part."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.equipment import equipment_depth
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.results.canvas import enlarge, projector, scale_of, shade, whole, write
from anchorpose.results.palette import GREEN, ORANGE, PURPLE, SKY, VERMILLION, YELLOW
from anchorpose.results.stage_pictures import draw_contour

PART_COLOURS: Final = (ORANGE, SKY, YELLOW, PURPLE, GREEN, VERMILLION)


def draw_model(camera: Camera, depth_m: np.ndarray, model: EquipmentModel) -> np.ndarray:
    """Each part's outline and name over the depth picture (height, width); other parts may hide a part's outline."""
    picture = enlarge(shade(depth_m), scale_of(camera))
    to_pixel = projector(camera, scale_of(camera))
    rays = camera.pixel_rays()
    whole_model = equipment_depth(camera, rays, model)
    names = []
    for number, part in enumerate(model.parts):
        alone = equipment_depth(camera, rays, EquipmentModel((part,)))
        seen = (alone > 0) & (alone <= whole_model + 1e-3)
        if seen.any():
            draw_contour(picture, seen, camera, PART_COLOURS[number % len(PART_COLOURS)])
            names.append((part.name, part.triangles()[0].mean(axis=0)))
    for name, middle_m in names:
        place = to_pixel(middle_m[None])[0]
        if np.isfinite(place).all():
            write(picture, name, whole(place))
    return picture
