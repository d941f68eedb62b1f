"""What the cameras truly see of the patient: of the skin around each joint, and behind people who pass by."""

from __future__ import annotations

from functools import cache
from typing import Final

import numpy as np

from anchorpose.body.skin_points import SkinPoints, body_points
from anchorpose.body.visibility import GRAZING, skin_around_joints
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.joints import JOINT_COUNT
from anchorpose.rotations import rotate
from anchorpose.simulate.person import Person
from anchorpose.simulate.render import PATIENT, Figure, TrueImage, draw_figures

SAME_SKIN_M: Final = 0.03  # between a point of the skin and the depth of its pixel: a pixel covers 7 mm at 2.5 m


def seen_shares(person: Person, bones: np.ndarray, skin_m: np.ndarray, camera: Camera, image: TrueImage) -> np.ndarray:
    """(21,) of the patient's skin around each joint that faces a camera, the share that nothing hides from it.

    Hidden is what other skin of the patient, people or equipment cover and what lies outside the image; 0 where no skin
    around the joint faces the camera. bones (b, 4, 4), skin_m (v, 3): the patient when the image was taken.
    """
    points = _points()
    place = skin_m[points.vertex].astype(np.float64)
    normals = rotate(bones[points.part, :3, :3], person.normals[points.vertex])
    towards = camera.position_m - place
    facing = (normals * towards).sum(axis=1) > GRAZING * np.linalg.norm(towards, axis=1)
    seen = facing & _unhidden(transform_points(invert_rigid(camera.require_pose()), place), camera, image)
    shares = np.zeros(JOINT_COUNT)
    for joint, around in enumerate(skin_around_joints(points)):
        shares[joint] = seen[around].sum() / max(facing[around].sum(), 1)
    return shares


def share_behind(
    camera: Camera, still: TrueImage, figures: tuple[Figure, ...], passers: int, image: TrueImage
) -> float:
    """Of the patient's pixels that a camera would have without the last ``passers`` figures, the share it has not."""
    if not passers or not (image.label >= PATIENT + len(figures) - passers).any():
        return 0.0
    without = int((draw_figures(camera, still, figures[:-passers]).label == PATIENT).sum())
    return 1.0 - int((image.label == PATIENT).sum()) / without if without else 0.0


def _unhidden(inside_m: np.ndarray, camera: Camera, image: TrueImage) -> np.ndarray:
    """(p,) bool: points in the camera's frame whose pixel shows the patient at their depth."""
    ahead = inside_m[:, 2] > 0.0
    columns, rows = np.rint(camera.project(np.where(ahead[:, None], inside_m, [0.0, 0.0, 1.0]))).astype(np.int64).T
    inside = ahead & (rows >= 0) & (rows < camera.height) & (columns >= 0) & (columns < camera.width)
    rows, columns = rows.clip(0, camera.height - 1), columns.clip(0, camera.width - 1)
    near = np.abs(image.depth_m[rows, columns] - inside_m[:, 2]) < SAME_SKIN_M
    return inside & near & (image.label[rows, columns] == PATIENT)


@cache
def _points() -> SkinPoints:
    return body_points()
