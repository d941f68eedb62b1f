"""Compute the likelihood of depth readings given a body's pose, and how well the pose explains the readings at each
limb.

The skin is rendered into each camera at reduced resolution. A pixel shows the skin, something in front of it, or
something behind it. The score is the log likelihood ratio of the readings with and without the body. Skin that explains
a reading raises the score, skin lowers the score if its pixel shows something behind the skin, and hidden skin does not
change the score. Pixels with the person's label beside the rendered skin show clothes, and these pixels raise the score
as well. Otherwise a taller body, which fills the outline of loose clothes, would be more probable than the correct
body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import segment_of_points
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.skin_points import Body, SkinPoints, pose_points
from anchorpose.body.visibility import Projection, projection_of
from anchorpose.camera import Camera
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.lens import pixel_of_ray

# m, width on the body that a pixel of the reduced resolution covers; a wrist is two of these pixels wide
FOOTPRINT_M: Final = 0.02
# m, typical depth difference between rendered skin and reading, due to clothes and the coarse sampling of the skin
SKIN_SIGMA_M: Final = 0.02
ALIKE_M: Final = 0.05  # m, side of a patch of skin whose readings share one error, which is due to clothes and folds
RANGE_M: Final = 4.0  # m, range of a depth camera; an unknown object may be anywhere within it
CLUTTER: Final = 0.1  # assumed share of the person's pixels that show an unknown object instead of the person's skin
PAST: Final = 0.05  # share of skin that cameras see past even in a correct pose, since the body model is inexact
# minimum number of one camera's observations that must show the skin of the upper or lower part of a limb, for this
# part to count as seen; an observation is 25 cm2 of skin, the area of three fingers
LEAST_SEEN: Final = 1.0
# minimum share of one camera's observations at the upper or lower part of a limb that must show the skin of this part,
# for the part to count as seen; for example, a visible strip of the thigh does not show the knee
LEAST_SHARE: Final = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """The likelihood of the readings at each limb (``LIMB_OF_BONES``). All arrays are (PARTS, 2). Their columns are the
    part of a limb above the elbow or knee and the part below; for the trunk, the columns are the lower trunk, and the
    chest with neck and head.

    The arrays ``explained``, ``past`` and ``hidden`` count independent observations; one observation is a patch of skin
    of side ``ALIKE_M``.
    """

    log: np.ndarray  # nats, log likelihood ratio of the readings with and without the body
    explained: np.ndarray  # number of observations that show the skin
    past: np.ndarray  # number of observations that show something behind the skin
    hidden: np.ndarray  # number of observations that show something in front of the skin
    seen: np.ndarray  # bool, whether some camera sees this part of the limb at the place where the pose puts the part

    @property
    def total(self) -> float:
        """Return the log likelihood ratio of the whole body, nats."""
        return float(self.log.sum())


@lru_cache(maxsize=4)  # cached, since registration, rivals and the frame's estimate need the same results
def likelihood(body: Body, pose: Pose, evidence: Evidence) -> Likelihood:
    """Compute the likelihood of all cameras' readings of the person, given a body in a pose."""
    skin_m = pose_points(body, pose).points_m
    sums, seen = np.zeros((4, 2 * PARTS)), np.zeros(2 * PARTS, dtype=bool)
    for view, camera in zip(evidence.views, evidence.cameras, strict=True):
        if view is not None:
            own = _of_camera(body.points, skin_m, view, camera, evidence.label)
            sums += own
            # a part counts as seen if a single camera sees it, even if the views of all other cameras are blocked
            seen |= (own[1] >= LEAST_SEEN) & (own[1] >= LEAST_SHARE * own[1:].sum(axis=0))
    log, explained, past, hidden = sums.reshape(4, PARTS, 2)
    return Likelihood(log, explained, past, hidden, seen.reshape(PARTS, 2))


def most_nats(area_m2: float) -> float:
    """Return the maximum contribution, in nats, of a surface of this area to the log likelihood ratio. The surface
    contributes this much if one camera sees the surface and the body's skin lies exactly on it.
    """
    skin = (1.0 - CLUTTER) / (np.pi * SKIN_SIGMA_M) + PAST / RANGE_M
    return float(np.log(skin * RANGE_M / CLUTTER)) * area_m2 / ALIKE_M**2


class RenderedSkin(NamedTuple):
    """The skin rendered at every ``step``-th row and column of an image."""

    step: int
    depth_m: np.ndarray  # (h, w) float64, depth of the nearest skin; inf without skin
    point: np.ndarray  # (h, w) int64, the skin point at each rendered pixel; -1 without skin
    # area of a rendered pixel on the body, divided by the area of a patch of side ``ALIKE_M``; at most 1
    patches: float


def render_skin(
    points: SkinPoints, skin_m: np.ndarray, camera: Camera, footprint_m: float = FOOTPRINT_M
) -> RenderedSkin | None:
    """Render the skin as a camera sees it, in pixels that cover about ``footprint_m`` on the body; None if all skin is
    behind the camera.

    skin_m (p, 3): the skin points in the world.
    """
    projection = projection_of(camera)
    placed = _placed(skin_m, projection)
    ahead = placed[placed[:, 2] > 0.0, 2]
    if not len(ahead):
        return None
    pixel_m = float(np.median(ahead)) / max(projection.lens[0], projection.lens[1])
    step = max(1, round(footprint_m / pixel_m))
    depth_m, point = _rendered(placed, skin_faces(points), step, camera.height, camera.width)
    return RenderedSkin(step, depth_m, point, min((step * pixel_m / ALIKE_M) ** 2, 1.0))


def _of_camera(points: SkinPoints, skin_m: np.ndarray, view: View, camera: Camera, label: int) -> np.ndarray:
    """Return the likelihood of one camera's readings (4, 2 PARTS). The rows are the log likelihood ratio and the
    numbers of observations that show the skin, something behind the skin, and something in front of the skin; the
    columns are the segments of the body, numbered as in ``SEGMENT_OF_BONES``.
    """
    skin = render_skin(points, skin_m, camera)
    if skin is None:
        return np.zeros((4, 2 * PARTS))
    sums = _scored(skin.depth_m, skin.point, segment_of_points(points), view.depth_m, view.labels, label, skin.step)
    return sums * skin.patches


@cache
def skin_faces(points: SkinPoints) -> np.ndarray:
    """Return triangles (f, 3) between skin points, made from the asset's faces: each vertex is replaced by its nearest
    skin point.
    """
    from scipy.spatial import cKDTree

    asset = points.asset
    nearest = cKDTree(asset.vertices[points.vertex]).query(asset.vertices)[1]
    faces = nearest[asset.faces]
    corners = np.sort(faces, axis=1)
    whole = (corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2])
    _, first = np.unique(corners[whole], axis=0, return_index=True)
    return np.ascontiguousarray(faces[whole][np.sort(first)])


@njit(cache=True, nogil=True)
def _placed(skin_m: np.ndarray, projection: Projection) -> np.ndarray:
    """Return column, row and depth (p, 3) of each skin point; depth is 0 behind the camera."""
    T, lens = projection.T_camera_world, projection.lens
    placed, at = np.zeros((len(skin_m), 3)), np.empty(3)
    for p in range(len(skin_m)):
        for i in range(3):
            at[i] = T[i, 3]
            for j in range(3):
                at[i] += T[i, j] * skin_m[p, j]
        if at[2] > 1e-3:
            placed[p, 0], placed[p, 1] = pixel_of_ray(at[0] / at[2], at[1] / at[2], lens)
            placed[p, 2] = at[2]
    return placed


@njit(cache=True, nogil=True)
def _rendered(
    placed: np.ndarray, faces: np.ndarray, step: int, height: int, width: int
) -> tuple[np.ndarray, np.ndarray]:
    """Render the skin's triangles. Return the depth and the skin point (h, w) at each pixel, as in ``RenderedSkin``."""
    rows, columns = (height + step - 1) // step, (width + step - 1) // step
    depth, point = np.full((rows, columns), np.inf), np.full((rows, columns), np.int64(-1))
    for f in range(len(faces)):
        a, b, c = placed[faces[f, 0]], placed[faces[f, 1]], placed[faces[f, 2]]
        if a[2] == 0.0 or b[2] == 0.0 or c[2] == 0.0:
            continue
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if abs(area) < 1e-9:
            continue
        left, right = min(a[0], b[0], c[0]) / step, max(a[0], b[0], c[0]) / step
        top, bottom = min(a[1], b[1], c[1]) / step, max(a[1], b[1], c[1]) / step
        for r in range(max(0, int(np.ceil(top))), min(rows - 1, int(np.floor(bottom))) + 1):
            for k in range(max(0, int(np.ceil(left))), min(columns - 1, int(np.floor(right))) + 1):
                x, y = k * step, r * step
                u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                if u < 0.0 or v < 0.0 or u + v > 1.0:
                    continue
                z = u * a[2] + v * b[2] + (1.0 - u - v) * c[2]
                if z < depth[r, k]:
                    depth[r, k], point[r, k] = z, faces[f, 0]
    return depth, point


@njit(cache=True, nogil=True)
def _scored(
    skin_m: np.ndarray,
    point: np.ndarray,
    segment: np.ndarray,
    depth_m: np.ndarray,
    labels: np.ndarray,
    own: int,
    step: int,
) -> np.ndarray:
    """Return (4, 2 PARTS): for each part of a limb, the log likelihood ratio, then the numbers of pixels that show the
    skin, something behind the skin, and something in front of the skin.
    """
    sums = np.zeros((4, 2 * PARTS))
    past = np.log(PAST)
    for r in range(skin_m.shape[0]):
        for k in range(skin_m.shape[1]):
            label, z = labels[r * step, k * step], np.float64(depth_m[r * step, k * step])
            if point[r, k] < 0:
                if label == own:
                    row, column = _beside(skin_m, r, k, z)
                    if point[row, column] >= 0:
                        limb = segment[point[row, column]]
                        sums[0, limb] += _gain(z - skin_m[row, column], CLUTTER / RANGE_M)
                continue
            limb = segment[point[r, k]]
            beyond = z - skin_m[r, k]
            if label == PixelLabel.NO_READING:
                sums[3, limb] += 1.0
            elif label == own:
                sums[0, limb] += _gain(beyond, (CLUTTER if beyond < 0.0 else PAST) / RANGE_M)
                near = abs(beyond) < 3.0 * SKIN_SIGMA_M
                sums[1 if near else (3 if beyond < 0.0 else 2), limb] += 1.0
            elif (label == PixelLabel.BACKGROUND and z <= 0.0) or beyond > 3.0 * SKIN_SIGMA_M:
                sums[0, limb] += past
                sums[2, limb] += 1.0
            else:
                sums[3, limb] += 1.0
    return sums


@njit(cache=True, nogil=True)
def _gain(beyond_m: float, other: float) -> float:
    """Return the log likelihood ratio, in nats, of a reading with the person's label that lies ``beyond_m`` metres
    behind the skin.

    other: probability density (1/m) of a reading at this depth that does not show the skin.
    """
    off = beyond_m / SKIN_SIGMA_M
    skin = 1.0 / (np.pi * SKIN_SIGMA_M * (1.0 + off * off))
    return float(np.log(((1.0 - CLUTTER) * skin + other) * RANGE_M / CLUTTER))


@njit(cache=True, nogil=True)
def _beside(skin_m: np.ndarray, r: int, k: int, z: float) -> tuple[int, int]:
    """Return the row and column of the neighbouring pixel whose skin is nearest in depth to the reading ``z``. If no
    neighbour shows skin, return the pixel itself.
    """
    row, column = r, k
    for i, j in ((r - 1, k), (r + 1, k), (r, k - 1), (r, k + 1)):
        inside = 0 <= i < skin_m.shape[0] and 0 <= j < skin_m.shape[1]
        if inside and abs(z - skin_m[i, j]) < abs(z - skin_m[row, column]):
            row, column = i, j
    return row, column
