"""Which skin a node shows: the expected skin point under it, and on which side of a crease it is.

Near each other in space is not near each other on the body: a hand lies on the trunk, a thigh against the other. Where
two parts that are far apart on the body both come near a node, both are its candidates until the crease decides.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.contacts import decide_candidates
from anchorpose.surface.pinhole import Pinhole, into_camera, pinhole
from anchorpose.surface.surface import ExpectedSkin, MeshArrays, SkinArrays, Surface, geodesic_lower_bound

REACH_M: Any = np.float32(0.12)  # from a node to the skin point it shows: so far off is a fast hand's prediction
MAX_TURN_DEG: Final = 70.0  # between their normals; the far side of a wrist looks the other way
MIN_COSINE: Any = np.float32(np.cos(np.radians(MAX_TURN_DEG)))
OFF_PLANE_WEIGHT: Any = np.float32(3.0)  # of a distance along the normal: skin points are samples of a surface
AMBIGUOUS_M: Any = np.float32(0.04)  # skin that is nearer by less may be the wrong one
FAR_ON_BODY_M: Any = np.float32(0.12)  # two candidates farther apart leave open what a node shows

CELL_PX: Final = 6  # skin points are sorted into cells of so many pixels: 4 cm at 2.4 m, a little over their spacing
LEAST_FACING: Any = np.float32(-0.5)  # skin turned more than 120 degrees off the optical axis is on the other side
NARROWEST: Any = np.float32(0.75)  # of a pixel's span at the axis: rays slant, and nodes lie before the nearest skin
MOST_CANDIDATES: Final = 128  # skin points kept for one node; there are about fifty within reach


def find_ambiguous_skin(expected: ExpectedSkin) -> np.ndarray:
    """(k,) bool: skin points with skin beside them that is far away on the body; what nodes near them show is unclear.

    Beside is within twice ``AMBIGUOUS_M``: where the prediction is off by more than half of that, some are not found.
    """
    skin = expected.arrays
    order = np.argsort(skin.points_m[:, 1])
    ambiguous = np.empty(len(order), bool)
    ambiguous[order] = _beside_far_skin(np.ascontiguousarray(skin.points_m[order].T), skin.landmarks_m[order])
    return ambiguous


def assign_skin(surface: Surface, camera: Camera, expected: ExpectedSkin, ambiguous: np.ndarray) -> Surface:
    """One camera's surface with the skin point that each node shows, -1 where none is near.

    ambiguous (k,) of ``find_ambiguous_skin``.
    """
    if len(surface) == 0:
        return surface
    mesh, skin = surface.arrays, expected.arrays
    shape = camera.height // CELL_PX + 1, camera.width // CELL_PX + 1
    grid = _sort_into_cells(skin, pinhole(camera), *shape)
    candidates = _candidates(mesh, surface.pixel, skin, ambiguous, grid)
    return replace(surface, skin=decide_candidates(mesh, candidates, skin.landmarks_m))


class SkinGrid(NamedTuple):
    """Skin that faces the camera, sorted by the cell of pixels that it falls into.

    start (rows * cols + 1,) int32: where each cell begins; which (m,) int32: the skin points; place (6, m) float32:
    their positions and normals; rows, cols: of the cells; span_m: least span of a pixel, inf without skin.
    """

    start: np.ndarray
    which: np.ndarray
    place: np.ndarray
    rows: int
    cols: int
    span_m: float


@njit(cache=True, nogil=True)
def _candidates(
    mesh: MeshArrays, pixel: np.ndarray, skin: SkinArrays, ambiguous: np.ndarray, grid: SkinGrid
) -> np.ndarray:
    """(n, 2) int32: the nearest skin point of each node, and if that is ambiguous the nearest far from it on the body.

    A node first looks around its own pixel, and then at all pixels that may be as near as what it found.
    """
    points, landmarks, cols = mesh.points_m, skin.landmarks_m, grid.cols
    found = np.full((len(points), 2), -1, np.int32)
    start, which, span = grid.start, grid.which, grid.span_m
    if not span < np.inf:
        return found
    squared = np.empty(len(which), np.float32)
    near, away = np.empty(MOST_CANDIDATES, np.int32), np.empty(MOST_CANDIDATES, np.float32)
    for n in range(len(points)):
        limit2 = REACH_M * REACH_M
        for again in range(2):
            reached = np.sqrt(limit2) / span if again else np.float32(CELL_PX // 2)
            top, bottom, left, right = _window(pixel, n, reached, grid)
            for row in range(top, bottom):
                first, last = start[row * cols + left], start[row * cols + right]
                _measure(mesh, n, grid.place, np.uint64(first), np.uint64(last), squared)
                for spot in range(first, last):
                    if squared[spot] < limit2:
                        limit2, found[n, 0] = squared[spot], which[spot]
        if found[n, 0] < 0 or not ambiguous[found[n, 0]]:
            continue
        limit = np.sqrt(limit2) + AMBIGUOUS_M
        count = 0
        top, bottom, left, right = _window(pixel, n, limit / span, grid)
        for row in range(top, bottom):
            first, last = start[row * cols + left], start[row * cols + right]
            _measure(mesh, n, grid.place, np.uint64(first), np.uint64(last), squared)
            for spot in range(first, last):
                if squared[spot] < limit * limit and count < MOST_CANDIDATES:
                    near[count], away[count] = which[spot], np.sqrt(squared[spot])
                    count += 1
        for c in range(count):
            if away[c] < limit and geodesic_lower_bound(landmarks, near[c], found[n, 0]) > FAR_ON_BODY_M:
                limit, found[n, 1] = away[c], near[c]
    return found


@njit(cache=True, nogil=True)
def _measure(mesh: MeshArrays, n: int, place: np.ndarray, first: Any, last: Any, squared: np.ndarray) -> None:
    """How far a node is off some skin points, squared, along their normals counting more; inf if turned too far.

    First and last unsigned, so that no index can mean one from the end and this becomes vector instructions.
    """
    points, normals = mesh.points_m, mesh.normals
    steep = OFF_PLANE_WEIGHT * OFF_PLANE_WEIGHT - np.float32(1.0)
    at_x, at_y, at_z = points[n, 0], points[n, 1], points[n, 2]
    up_x, up_y, up_z = normals[n, 0], normals[n, 1], normals[n, 2]
    for spot in range(first, last):
        x, y, z = at_x - place[0, spot], at_y - place[1, spot], at_z - place[2, spot]
        off = x * place[3, spot] + y * place[4, spot] + z * place[5, spot]
        cosine = up_x * place[3, spot] + up_y * place[4, spot] + up_z * place[5, spot]
        away = x * x + y * y + z * z + steep * off * off
        squared[spot] = away if cosine > MIN_COSINE else np.float32(np.inf)


@njit(cache=True, nogil=True)
def _window(pixel: np.ndarray, n: int, reach_px: Any, grid: SkinGrid) -> tuple[int, int, int, int]:
    """(top, bottom, left, right), past the last, of the cells within some pixels of a node."""
    row, col, away = int(pixel[n, 0]), int(pixel[n, 1]), int(reach_px) + 1
    top, bottom = max(row - away, 0) // CELL_PX, (row + away) // CELL_PX + 1
    left, right = max(col - away, 0) // CELL_PX, (col + away) // CELL_PX + 1
    return top, min(bottom, grid.rows), left, min(right, grid.cols)


@njit(cache=True, nogil=True)
def _sort_into_cells(skin: SkinArrays, camera: Pinhole, rows: int, cols: int) -> SkinGrid:
    """The skin points that face the camera and fall into its depth frame."""
    points, normals = skin.points_m, skin.normals
    T_camera_world, lens = camera
    cell, start = np.full(len(points), -1, np.int32), np.zeros(rows * cols + 1, np.int32)
    nearest = np.float32(np.inf)
    for k in range(len(points)):
        high, left, z = into_camera(camera, points, k)
        facing = np.float32(0.0)
        for axis in range(3):
            facing -= T_camera_world[2, axis] * normals[k, axis]
        if z <= 0.0 or facing < LEAST_FACING:
            continue
        row, col = int(np.floor(high / CELL_PX)), int(np.floor(left / CELL_PX))
        if 0 <= row < rows and 0 <= col < cols:
            cell[k] = row * cols + col
            start[cell[k] + 1] += 1
            nearest = min(nearest, z)
    for c in range(rows * cols):
        start[c + 1] += start[c]
    which, place = np.empty(start[-1], np.int32), np.empty((6, start[-1]), np.float32)
    filled = start.copy()
    for k in range(len(points)):
        if cell[k] >= 0:
            spot = filled[cell[k]]
            filled[cell[k]] += 1
            which[spot] = k
            for axis in range(3):
                place[axis, spot], place[3 + axis, spot] = points[k, axis], normals[k, axis]
    return SkinGrid(start, which, place, rows, cols, NARROWEST * nearest / max(lens[0], lens[1]))


@njit(cache=True, nogil=True)
def _beside_far_skin(place: np.ndarray, landmarks: np.ndarray) -> np.ndarray:
    """(k,) bool: ``find_ambiguous_skin`` for skin points sorted by their second coordinate.

    place (3, k), landmarks (k, l) float32. Points within the radius of one follow each other.
    """
    x, y, z = place[0], place[1], place[2]
    radius = np.float32(2.0) * AMBIGUOUS_M
    marked, near = np.zeros(len(x), np.bool_), np.empty(len(x) + 1, np.int32)
    end = 0
    for a in range(len(x)):
        while end < len(x) and y[end] - y[a] <= radius:
            end += 1
        count = 0
        for b in range(a + 1, end):  # no branch: every tenth would be guessed wrong
            squared = (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2 + (z[b] - z[a]) ** 2
            near[count] = b
            count += int(squared < radius * radius)
        for c in range(count):
            b = near[c]
            if not (marked[a] and marked[b]) and geodesic_lower_bound(landmarks, np.int32(a), b) > FAR_ON_BODY_M:
                marked[a] = True
                marked[b] = True
    return marked
