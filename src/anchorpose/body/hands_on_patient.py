"""Find hands of other people that have the patient's label: readings with this label that lie away from the patient's
posed skin and are connected to another person.

The depth hardly changes from the patient to a hand that holds the patient, so segmentation often gives the hand the
patient's label. The patient's posed skin reveals the error, since this skin lies a hand's thickness below the readings
of the hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np

from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.skin_points import PosedPoints
from anchorpose.camera import Camera, transform_points
from anchorpose.isolation.components import JumpLimit, label_components
from anchorpose.isolation.view import PixelLabel, View

HAND_M: Final = 0.2  # m, length of a hand from the finger tips to the wrist
# m; a reading farther than this outside the patient's posed skin may show another person's fingers; most errors of the
# learnt skin are smaller
STANDS_OFF_M: Final = 0.015
# m, half a thigh's thickness; readings farther than this from all skin points do not show the patient's skin
SKIN_REACH_M: Final = 0.10
# only every second row and column of an image is used: at 2.5 m, the used rows are a finger's width apart
STEP_PX: Final = 2
STEEPEST: Final = 8.0
"""Maximum ratio of depth difference to sideways distance between neighbouring pixels of one arm: a slant of 83 degrees,
as on a forearm that points at the camera. With a ratio of 2, a tenth of the contacts was missed in the four simulated
clinics used for tuning."""


def find_hands(
    posed: PosedPoints, views: Sequence[View | None], cameras: Sequence[Camera]
) -> tuple[np.ndarray, np.ndarray]:
    """Return world points (n, 3) float32 on hands that hold the patient but have the patient's label. Also return the
    label (n,) uint8 of the person to whom each point's hand belongs.
    """
    points, owners = [np.zeros((0, 3), np.float32)], [np.zeros(0, np.uint8)]
    for view, camera in zip(views, cameras, strict=True):
        if view is not None:
            depth_m, labels = (np.ascontiguousarray(each[::STEP_PX, ::STEP_PX]) for each in (view.depth_m, view.labels))
            place_m, row, column = _beside_people(depth_m, labels, camera)
            if len(place_m):
                off = _stands_off(posed, place_m)
                owner = _owners(depth_m, labels, row[off], column[off], camera.intrinsics.fx)
                points.append(place_m[off][owner > 0])
                owners.append(owner[owner > 0])
    return np.concatenate(points), np.concatenate(owners)


def _beside_people(
    depth_m: np.ndarray, labels: np.ndarray, camera: Camera
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the readings with the patient's label within a hand's length of another person's readings: world points
    (n, 3) float32, and rows and columns (n,) in the image reduced by ``STEP_PX``.
    """
    person = (labels >= PixelLabel.OTHER_PERSON).astype(np.uint8)
    if not person.any():
        none = np.zeros(0, np.int64)
        return np.zeros((0, 3), np.float32), none, none
    away_px = STEP_PX * cv2.distanceTransform(1 - person, cv2.DIST_L2, 3)
    near = (labels == PixelLabel.PATIENT) & (depth_m > 0) & (away_px * depth_m < HAND_M * camera.intrinsics.fx)
    row, column = np.nonzero(near)
    depth = depth_m[row, column]
    rays = camera.pixel_rays()[::STEP_PX, ::STEP_PX][row, column]
    in_camera = np.column_stack([rays * depth[:, None], depth])
    return transform_points(camera.require_pose(), in_camera).astype(np.float32), row, column


def _stands_off(posed: PosedPoints, place_m: np.ndarray) -> np.ndarray:
    """Return (n,) bool: whether each of the places (n, 3) lies more than ``STANDS_OFF_M`` outside the nearest skin, or
    more than ``SKIN_REACH_M`` away from all skin.
    """
    nearest = nearest_point(posed.points_m, place_m.astype(np.float64), SKIN_REACH_M)
    outwards = np.einsum("ni,ni->n", place_m - posed.points_m[nearest], posed.normals[nearest])
    return np.asarray((nearest < 0) | (outwards > STANDS_OFF_M))


def _owners(
    depth_m: np.ndarray, labels: np.ndarray, row: np.ndarray, column: np.ndarray, focal_px: float
) -> np.ndarray:
    """Return (n,) uint8: label of the other person to whom each pixel (row, column) is connected without a step in
    depth; 0 if the pixel is connected to no other person.
    """
    person = labels >= PixelLabel.OTHER_PERSON
    mask = person.copy()
    mask[row, column] = True
    piece, count = label_components(depth_m, mask, JumpLimit(0.0, STEEPEST * STEP_PX / focal_px))
    pixels = np.bincount(piece[person] * 256 + labels[person].astype(np.int64), minlength=256 * (count + 1))
    by_label = pixels.reshape(count + 1, 256)
    owner = np.where(by_label.any(axis=1), by_label.argmax(axis=1), 0).astype(np.uint8)
    return np.asarray(owner[piece[row, column]])
