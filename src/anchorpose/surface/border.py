"""What lies beyond each node: where the patient ends, and where something else cuts him off.

A bar or a therapist's arm before the shin ends the surface there, and an end looks like a foot to a geodesic
extremum. Only the node's surroundings in the picture tell the two apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import cv2
import numpy as np

from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.surface import Surface

REACH_PX = 5  # two nodes, and the pixels that a depth edge loses
IN_FRONT_M = 0.03  # beyond sensor noise and the depth a surface gains over REACH_PX
TOUCHING_M = 0.10  # a hand that holds the patient lies at the patient's own depth
HOLE_RADIUS_PX = 3  # the rim of lost readings around every silhouette is thinner
HOLE_ENCLOSED = 0.4  # share of a hole's rim that is patient; half a hole over a limb's end still counts


class Border(IntEnum):
    """What is within reach of a node; the highest that applies."""

    INSIDE = 0  # skin all around, or the patient's own silhouette before what is farther away
    SELF = 1  # another part of the patient stands in front
    CUT = 2  # equipment, another person, an unknown thing in front, a hole, or the edge of the picture


def border(surface: Surface, views: Sequence[View]) -> np.ndarray:
    """(n,) uint8 of ``Border`` for each node; views: one a camera, in the order of ``surface.camera``."""
    kind = np.zeros(len(surface), np.uint8)
    for camera, view in enumerate(views):
        seen = surface.camera == camera
        row, column = surface.pixel[seen].T
        depth = view.depth_m[row, column]
        nearest_patient = _nearest(view.depth_m, view.patient)[row, column]
        nearest_other = _nearest(view.depth_m, _foreign(view.labels))[row, column]
        nearest_holder = _nearest(view.depth_m, _holders(view.labels))[row, column]
        behind_self = nearest_patient < depth - TOUCHING_M
        cut = (nearest_other < depth - IN_FRONT_M) | (nearest_holder < depth + TOUCHING_M)
        cut |= _near(_holes(view))[row, column] | _off_picture(row, column, depth.size, view.depth_m.shape)
        kind[seen] = np.where(cut, Border.CUT, np.where(behind_self, Border.SELF, Border.INSIDE))
    return kind


def _holders(labels: np.ndarray) -> np.ndarray:
    """Things that may touch the patient: at his own depth they cut as well as in front of him."""
    return (labels == PixelLabel.EQUIPMENT) | (labels >= PixelLabel.OTHER_PERSON)


def _foreign(labels: np.ndarray) -> np.ndarray:
    return (labels != PixelLabel.PATIENT) & (labels != PixelLabel.NO_READING)


def _nearest(depth_m: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Smallest depth of masked readings within reach of each pixel; inf where there is none."""
    depth = np.where(mask & (depth_m > 0), depth_m, np.inf).astype(np.float32)
    return cv2.erode(depth, _disc(REACH_PX), borderValue=np.inf)


def _near(mask: np.ndarray) -> np.ndarray:
    return cv2.dilate(mask.astype(np.uint8), _disc(REACH_PX)) > 0


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _off_picture(row: np.ndarray, column: np.ndarray, count: int, shape: tuple[int, ...]) -> np.ndarray:
    margin = np.minimum(np.minimum(row, shape[0] - 1 - row), np.minimum(column, shape[1] - 1 - column))
    return np.asarray(margin < REACH_PX)


def _holes(view: View) -> np.ndarray:
    """(height, width) bool: lost readings thick enough to hide something and largely within the patient.

    Recordings whose background was removed lose everything around the patient; that is no hole, for it reaches the
    edge of the picture.
    """
    lost = (view.labels == PixelLabel.NO_READING).astype(np.uint8)
    thick = cv2.morphologyEx(lost, cv2.MORPH_OPEN, _disc(HOLE_RADIUS_PX))
    count, component, box, _ = cv2.connectedComponentsWithStats(thick, connectivity=4)
    hole = np.zeros(count, bool)
    for k in range(1, count):
        left, top, width, height, _ = box[k]
        if left == 0 or top == 0 or left + width == lost.shape[1] or top + height == lost.shape[0]:
            continue
        inside = np.s_[max(0, top - 3) : top + height + 3, max(0, left - 3) : left + width + 3]
        own = (component[inside] == k).astype(np.uint8)
        rim = (cv2.dilate(own, _disc(2)) > own) & (view.labels[inside] != PixelLabel.NO_READING)
        hole[k] = rim.any() and view.patient[inside][rim].mean() >= HOLE_ENCLOSED
    return hole[component]
