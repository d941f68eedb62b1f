"""Find the kind of border at which the surface ends near each node: the patient's own outline, or an object that cuts
the surface off.

If a bar or a therapist's arm is in front of the shin, the visible surface of the leg ends above the bar or arm. The
geodesic extremum at this end (the node farthest from the centre) then looks like a foot. Only the pixels around a node
show whether the body really ends at the node.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import cv2
import numpy as np
from numba import njit

from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.denoise import extent
from anchorpose.surface.surface import Surface
from anchorpose.threads import each

# pixels, maximum distance of a node from the depth edge that bounds it: two grid steps plus the pixels lost at an edge
REACH_PX = 5
# pixels, maximum distance from a pixel of the patient at which another surface is searched for; the pixels between them
# may be lost (no reading) or flying (a reading between both surfaces)
SEARCH_PX = 3
SUPPORT = 3  # minimum number of edge pixels within 5x5 pixels; a single noisy reading beside the skin is not an edge
# m, minimum distance between the patient's skin and an object that counts as in front of it; the thinnest bar is this
# far in front of the skin, and the sensor's noise is smaller
IN_FRONT_M = 0.04
# m, maximum depth difference between the patient's skin and a hand that touches it: a hand's thickness
TOUCHING_M = 0.10
# pixels, minimum radius of a hole in the readings; the rim without readings around every silhouette is thinner
HOLE_RADIUS_PX = 3
MARGIN_PX = 24  # pixels, width of the examined strip around the patient; a hole of 0.15 m has this width at 2.4 m
# minimum share of a hole's rim that shows the patient; it is below 0.5, so that holes at a limb's end are included
HOLE_ENCLOSED = 0.4


class Border(IntEnum):
    """The kind of border within ``REACH_PX`` of a node; if several kinds are near, the highest value counts."""

    INSIDE = 0  # skin all around, or the patient's own silhouette in front of surfaces farther from the camera
    SELF = 1  # another part of the patient stands in front
    # equipment, another person or an object of the room stands in front, or a hole or the image's edge is near
    CUT = 2


def border(surface: Surface, views: Sequence[View]) -> np.ndarray:
    """Return (n,) uint8: the kind of border (``Border``) near each node; views: one per camera, indexed by
    ``surface.camera``.

    Cameras that saw no node are skipped. A node on hidden skin is ``INSIDE``.
    """
    kind = np.zeros(len(surface), np.uint8)
    cameras = np.unique(surface.camera[: surface.seen_count])
    for camera, of_pixels in zip(cameras, each(lambda k: _border_of_pixels(views[k]), cameras), strict=True):
        seen = surface.camera == camera
        row, column = surface.pixel[seen].T
        kind[seen] = of_pixels[row, column]
    return kind


def _border_of_pixels(view: View) -> np.ndarray:
    """Return the kind of border near each pixel (height, width) uint8 (``Border``). It is valid only on the patient's
    pixels, since only the surroundings of these pixels are examined.
    """
    whole = np.zeros(view.labels.shape, np.uint8)
    top, bottom, left, right = extent(view.patient)
    if bottom == 0:
        return whole
    part = np.s_[max(0, top - MARGIN_PX) : bottom + MARGIN_PX, max(0, left - MARGIN_PX) : right + MARGIN_PX]
    labels = np.ascontiguousarray(view.labels[part], dtype=np.uint8)
    kind = _edge_kinds(np.ascontiguousarray(view.depth_m[part], dtype=np.float32), labels)
    spots = np.flatnonzero(kind)
    near = _within_reach(_supported(kind, spots), spots, _disc(REACH_PX))
    holes = _holes(labels)
    if holes is not None:
        near[cv2.dilate(holes, _disc(REACH_PX)) > 0] = Border.CUT
    whole[part] = near
    whole[:REACH_PX], whole[-REACH_PX:], whole[:, :REACH_PX], whole[:, -REACH_PX:] = (Border.CUT,) * 4
    return whole


@njit(cache=True, nogil=True)
def _supported(kind: np.ndarray, spots: np.ndarray) -> np.ndarray:
    """Return each edge pixel's kind if at least ``SUPPORT`` of the 5x5 pixels around it have this or a higher kind.
    Otherwise return the next lower kind for which this is true, or 0. spots (k,): flat indices of all edge pixels.
    """
    height, width = kind.shape
    kept = np.zeros_like(kind)
    for spot in spots:
        row, col = spot // width, spot % width
        least = kind[row, col]
        while least > 0 and kept[row, col] == 0:
            count = 0
            for i in range(max(0, row - 2), min(height, row + 3)):
                for j in range(max(0, col - 2), min(width, col + 3)):
                    count += kind[i, j] >= least
            if count >= SUPPORT:
                kept[row, col] = least
            least -= 1
    return kept


@njit(cache=True, nogil=True)
def _within_reach(kind: np.ndarray, spots: np.ndarray, disc: np.ndarray) -> np.ndarray:
    """Return, for each pixel, the highest kind within a disc around it. disc (odd, odd): 1 inside the disc, else 0.
    Edge pixels are few, so the kind of each edge pixel is written to all pixels of its disc.
    """
    height, width = kind.shape
    reach = len(disc) // 2
    near = np.zeros_like(kind)
    for spot in spots:
        row, col = spot // width, spot % width
        for i in range(max(0, row - reach), min(height, row + reach + 1)):
            for j in range(max(0, col - reach), min(width, col + reach + 1)):
                near[i, j] = max(near[i, j], kind[row, col] * disc[i - row + reach, j - col + reach])
    return near


@njit(cache=True, nogil=True)
def _edge_kinds(depth: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Return the kind of border (``Border``) at each of the patient's pixels; it depends on the surfaces that lie up to
    ``SEARCH_PX`` away in eight directions.

    Beside a sole, the floor or the foot plate is nearer to the camera than the sole, but it does not cut the patient's
    surface. So each surface in front is extrapolated by its slope to the patient's pixel. There, the extrapolated floor
    has the same depth as the sole, so it does not count as in front; an extrapolated bar is still in front of the
    patient.
    """
    height, width = depth.shape
    kinds = np.zeros((height, width), np.uint8)
    for row in range(height):
        for col in range(width):
            if labels[row, col] != PixelLabel.PATIENT or depth[row, col] <= 0.0:
                continue
            z = depth[row, col]
            if 0 < row < height - 1 and 0 < col < width - 1 and _surrounded(depth, labels, row, col, z - TOUCHING_M):
                continue
            kind = 0
            for way in range(8):
                down, right = (0, -1, -1, -1, 0, 1, 1, 1)[way], (1, 1, 0, -1, -1, -1, 0, 1)[way]
                for walk in range(1, SEARCH_PX + 1):
                    i, j = row + walk * down, col + walk * right
                    if i < 0 or i >= height or j < 0 or j >= width:
                        break
                    if depth[i, j] <= 0.0:
                        continue
                    other, label = depth[i, j], labels[i, j]
                    if label == PixelLabel.PATIENT:
                        if other < z - TOUCHING_M:
                            kind = max(kind, 1)
                        break
                    if label >= PixelLabel.OTHER_PERSON:
                        if other < z + TOUCHING_M:
                            kind = 2
                        break
                    i, j = i + 2 * down, j + 2 * right
                    slope = 0.0
                    if 0 <= i < height and 0 <= j < width and labels[i, j] == label and depth[i, j] > 0.0:
                        slope = min((depth[i, j] - other) / 2.0, 0.0)
                    if other - walk * slope < z - IN_FRONT_M:
                        kind = 2
                        break
            kinds[row, col] = kind
    return kinds


@njit(cache=True, nogil=True)
def _surrounded(depth: np.ndarray, labels: np.ndarray, row: int, col: int, nearest: float) -> bool:
    """Return whether all pixels around a pixel show the patient and none is nearer than ``nearest``."""
    surrounded = True
    for i in range(row - 1, row + 2):
        for j in range(col - 1, col + 2):
            surrounded &= (labels[i, j] == PixelLabel.PATIENT) & (depth[i, j] > 0.0) & (depth[i, j] >= nearest)
    return surrounded


def _disc(radius: int) -> np.ndarray:
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))


def _holes(labels: np.ndarray) -> np.ndarray | None:
    """Return (height, width) uint8: 1 at pixels in holes, else 0; None if the image has no holes. A hole is a region of
    lost readings that is thick enough to hide something. At least the share ``HOLE_ENCLOSED`` of its rim must show the
    patient.

    Recordings with a removed background have no readings around the patient. That region is not a hole, since it
    reaches the edge of the examined area.
    """
    lost = (labels == np.uint8(PixelLabel.NO_READING)).astype(np.uint8)
    thick = cv2.morphologyEx(lost, cv2.MORPH_OPEN, _disc(HOLE_RADIUS_PX))
    if not thick.any():
        return None
    count, component = cv2.connectedComponents(thick, connectivity=4)
    hole = np.ones(count, bool)
    for side in (component[0], component[-1], component[:, 0], component[:, -1]):
        hole[side] = False
    hole[0] = False
    if not hole.any():
        return None
    rim = np.flatnonzero(cv2.dilate(thick, _disc(2)) > lost)
    length, enclosed = _rims(component, labels, rim, _disc(2), count)
    hole &= (length > 0) & (enclosed >= HOLE_ENCLOSED * length)
    return hole.view(np.uint8)[component] if hole.any() else None


@njit(cache=True, nogil=True)
def _rims(component: np.ndarray, labels: np.ndarray, rim: np.ndarray, disc: np.ndarray, count: int) -> tuple:
    """Return two arrays (count,), with one value for each connected component of lost readings: how many of the pixels
    ``rim`` (r,: flat indices) lie within a disc (5, 5) around a pixel of the component, and how many of these pixels
    show the patient.
    """
    height, width = component.shape
    length, enclosed = np.zeros(count, np.int64), np.zeros(count, np.int64)
    last = np.full(count, -1, np.int64)  # per component, the rim pixel that was counted last; no pixel is counted twice
    for k in range(len(rim)):
        row, col = rim[k] // width, rim[k] % width
        for i in range(max(0, row - 2), min(height, row + 3)):
            for j in range(max(0, col - 2), min(width, col + 3)):
                own = component[i, j]
                if own > 0 and disc[i - row + 2, j - col + 2] and last[own] != k:
                    last[own] = k
                    length[own] += 1
                    enclosed[own] += labels[row, col] == PixelLabel.PATIENT
    return length, enclosed
