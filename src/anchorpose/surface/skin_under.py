"""Which skin a node shows: the expected skin point under it, and on which side of a crease it is.

Near each other in space is not near each other on the body: a hand lies on the trunk, a thigh against the other. Where
two parts that are far apart on the body both come near a node, both are its candidates until the crease decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit

from anchorpose.camera import Camera
from anchorpose.surface.links import into_camera, pinhole
from anchorpose.surface.surface import ExpectedSkin, Surface, way_over_skin

CELL_PX = 6  # skin points hang on a grid of so many pixels: 4 cm at 2.4 m, a little more than they are apart
LEAST_FACING = np.float32(-0.5)  # skin turned farther from the optical axis than 120 degrees is on the other side
NARROWEST = np.float32(0.75)  # of a pixel's span at the axis: rays slant, and nodes are nearer than the nearest skin
MOST_CANDIDATES = 128  # skin points kept for one node; there are about fifty within reach


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinUnderConfig:
    """Which skin a node may show."""

    reach_m: float = 0.12  # to the skin point it is taken for: a fast hand's prediction is so far off
    max_turn_deg: float = 70.0  # between their normals; the far side of a wrist looks the other way
    off_sheet: float = 3.0  # a distance along the normal counts so many times: skin points are samples of a sheet
    doubt_m: float = 0.04  # skin that is nearer by less may be the wrong one
    far_m: float = 0.12  # on the body: farther apart, two candidates leave it open what a node shows
    crease_cost: float = 20.0  # to go over a fold of 3 degrees a node is twice as far as over flat skin

    def __post_init__(self) -> None:
        for name in ("reach_m", "max_turn_deg", "off_sheet", "far_m"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        for name in ("doubt_m", "crease_cost"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} must not be negative, got {getattr(self, name)}")


def find_contested(expected: ExpectedSkin, config: SkinUnderConfig | None = None) -> np.ndarray:
    """(k,) bool: skin points with skin beside them that is far away on the body; nodes that show these can be in doubt.

    Beside is within twice ``doubt_m``: where the prediction is off by more than half of that, some nodes go undoubted.
    """
    config = config or SkinUnderConfig()
    return _contested(
        expected.points_m, expected.map.landmarks_m, np.float32(2.0 * config.doubt_m), np.float32(config.far_m)
    )


def show_skin(
    surface: Surface, camera: Camera, expected: ExpectedSkin, contested: np.ndarray,
    config: SkinUnderConfig | None = None,
) -> Surface:  # fmt: skip
    """One camera's surface with the skin point that each node shows, -1 where none is near.

    contested (k,) of ``find_contested``.
    """
    config = config or SkinUnderConfig()
    if len(surface) == 0:
        return surface
    candidates = _candidates(
        surface.points_m, surface.normals, surface.pixel, expected.points_m, expected.normals,
        expected.map.landmarks_m, contested, *pinhole(camera), camera.height // CELL_PX + 1,
        camera.width // CELL_PX + 1, np.float32(config.reach_m), np.float32(np.cos(np.radians(config.max_turn_deg))),
        np.float32(config.off_sheet), np.float32(config.doubt_m), np.float32(config.far_m),
    )  # fmt: skip
    skin = _settle(
        surface.points_m, surface.normals, surface.ring, candidates, expected.map.landmarks_m,
        np.float32(config.crease_cost),
    )  # fmt: skip
    return replace(surface, skin=skin)


@njit(cache=True)
def _candidates(
    points: np.ndarray, normals: np.ndarray, pixel: np.ndarray, skin: np.ndarray, skin_normals: np.ndarray,
    landmarks: np.ndarray, contested: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray, rows: int, cols: int,
    reach: np.float32, min_cosine: np.float32, off_sheet: np.float32, doubt: np.float32, far: np.float32,
) -> np.ndarray:  # fmt: skip
    """(n, 2): the nearest skin point of each node, and the nearest of those far from that one on the body, if in doubt.

    A node first looks around its own pixel, and then at all pixels that may be as near as what it found.
    """
    found = np.full((len(points), 2), -1, np.int32)
    start, which, place, span = _hang_on_grid(skin, skin_normals, T_camera_world, lens, rows, cols)
    if not span < np.inf:
        return found
    squared = np.empty(len(which), np.float32)
    near, away = np.empty(MOST_CANDIDATES, np.int32), np.empty(MOST_CANDIDATES, np.float32)
    steep = off_sheet * off_sheet - np.float32(1.0)
    for n in range(len(points)):
        limit2 = reach * reach
        for again in range(2):
            reached = np.sqrt(limit2) / span if again else np.float32(CELL_PX // 2)
            top, bottom, left, right = _window(pixel, n, reached, rows, cols)
            for row in range(top, bottom):
                first, last = start[row * cols + left], start[row * cols + right]
                _measure(points, normals, n, place, np.uint64(first), np.uint64(last), min_cosine, steep, squared)
                for spot in range(first, last):
                    if squared[spot] < limit2:
                        limit2, found[n, 0] = squared[spot], which[spot]
        if found[n, 0] < 0 or not contested[found[n, 0]]:
            continue
        limit = np.sqrt(limit2) + doubt
        count = 0
        top, bottom, left, right = _window(pixel, n, limit / span, rows, cols)
        for row in range(top, bottom):
            first, last = start[row * cols + left], start[row * cols + right]
            _measure(points, normals, n, place, np.uint64(first), np.uint64(last), min_cosine, steep, squared)
            for spot in range(first, last):
                if squared[spot] < limit * limit and count < MOST_CANDIDATES:
                    near[count], away[count] = which[spot], np.sqrt(squared[spot])
                    count += 1
        for c in range(count):
            if away[c] < limit and way_over_skin(landmarks, near[c], found[n, 0]) > far:
                limit, found[n, 1] = away[c], near[c]
    return found


@njit(cache=True)
def _measure(
    points: np.ndarray, normals: np.ndarray, n: int, place: np.ndarray, first: Any, last: Any, min_cosine: np.float32,
    steep: np.float32, squared: np.ndarray,
) -> None:  # fmt: skip
    """How far a node is off some skin points, squared, what is off their sheet counting more; inf if turned too far.

    First and last unsigned, so that no index can mean one from the end and this becomes vector instructions.
    """
    at_x, at_y, at_z = points[n, 0], points[n, 1], points[n, 2]
    up_x, up_y, up_z = normals[n, 0], normals[n, 1], normals[n, 2]
    for spot in range(first, last):
        x, y, z = at_x - place[0, spot], at_y - place[1, spot], at_z - place[2, spot]
        off = x * place[3, spot] + y * place[4, spot] + z * place[5, spot]
        cosine = up_x * place[3, spot] + up_y * place[4, spot] + up_z * place[5, spot]
        away = x * x + y * y + z * z + steep * off * off
        squared[spot] = away if cosine > min_cosine else np.float32(np.inf)


@njit(cache=True)
def _window(pixel: np.ndarray, n: int, reach_px: Any, rows: int, cols: int) -> tuple[int, int, int, int]:
    """(top, bottom, left, right), past the last, of the cells within some pixels of a node."""
    row, col, away = int(pixel[n, 0]), int(pixel[n, 1]), int(reach_px) + 1
    top, bottom = max(row - away, 0) // CELL_PX, (row + away) // CELL_PX + 1
    left, right = max(col - away, 0) // CELL_PX, (col + away) // CELL_PX + 1
    return top, min(bottom, rows), left, min(right, cols)


@njit(cache=True)
def _hang_on_grid(
    skin: np.ndarray, skin_normals: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray, rows: int, cols: int
) -> tuple:
    """Skin that faces the camera, sorted by the cell of pixels that it falls into.

    start (rows * cols + 1,): where each cell's begin; which (m,): the skin points; place (6, m): their positions
    and normals; and the metres that a pixel spans at least, inf without any skin.
    """
    cell, start = np.full(len(skin), -1, np.int32), np.zeros(rows * cols + 1, np.int32)
    nearest = np.float32(np.inf)
    for k in range(len(skin)):
        high, left, z = into_camera(T_camera_world, lens, skin, k)
        facing = np.float32(0.0)
        for axis in range(3):
            facing -= T_camera_world[2, axis] * skin_normals[k, axis]
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
    for k in range(len(skin)):
        if cell[k] >= 0:
            spot = filled[cell[k]]
            filled[cell[k]] += 1
            which[spot] = k
            for axis in range(3):
                place[axis, spot], place[3 + axis, spot] = skin[k, axis], skin_normals[k, axis]
    return start, which, place, NARROWEST * nearest / max(lens[0], lens[1])


@njit(cache=True)
def _contested(skin: np.ndarray, landmarks: np.ndarray, radius: np.float32, far: np.float32) -> np.ndarray:
    """Skin points sorted by height: those within the radius of one follow each other."""
    order = np.argsort(skin[:, 1])
    known = landmarks[order]
    x, y, z = skin[order, 0], skin[order, 1], skin[order, 2]
    marked, near = np.zeros(len(skin), np.bool_), np.empty(len(skin) + 1, np.int32)
    end = 0
    for a in range(len(order)):
        while end < len(order) and y[end] - y[a] <= radius:
            end += 1
        count = 0
        for b in range(a + 1, end):  # no branch: every tenth would be guessed wrong
            squared = (x[b] - x[a]) ** 2 + (y[b] - y[a]) ** 2 + (z[b] - z[a]) ** 2
            near[count] = b
            count += int(squared < radius * radius)
        for c in range(count):
            b = near[c]
            if not (marked[a] and marked[b]) and way_over_skin(known, a, b) > far:
                marked[a] = True
                marked[b] = True
    contested = np.zeros(len(skin), np.bool_)
    contested[order] = marked
    return contested


@njit(cache=True)
def crease(points: np.ndarray, normals: np.ndarray, p: int, q: int) -> np.float32:
    """By how much the skin folds inwards from p to q: the turn of the normal, radians, positive if concave."""
    apart2, turn = np.float32(0.0), np.float32(0.0)
    for axis in range(3):
        gap = points[q, axis] - points[p, axis]
        apart2 += gap * gap
        turn -= gap * (normals[q, axis] - normals[p, axis])
    return turn / np.sqrt(max(apart2, np.float32(1e-12)))


@njit(cache=True)
def _settle(
    points: np.ndarray, normals: np.ndarray, ring: np.ndarray, candidates: np.ndarray, landmarks: np.ndarray,
    crease_cost: np.float32,
) -> np.ndarray:  # fmt: skip
    """Grow from nodes with one candidate into those with two, which take the one nearer on the body to where they
    were reached from; a way over creases is longer. Label correcting, so the order of the nodes does not matter.
    """
    count = len(points)
    skin = candidates[:, 0].copy()
    cost = np.full(count, np.inf, np.float32)
    queue = np.empty(count + 1, np.int32)
    waiting = np.zeros(count, np.bool_)
    first, last = 0, 0
    for p in range(count):
        if candidates[p, 1] >= 0 or skin[p] < 0:
            continue
        cost[p] = 0.0
        for k in range(8):
            if ring[p, k] >= 0 and candidates[ring[p, k], 1] >= 0:
                queue[last] = p
                last += 1
                waiting[p] = True
                break
    while first != last:
        p = queue[first]
        first = (first + 1) % (count + 1)
        waiting[p] = False
        for k in range(8):
            q = ring[p, k]
            if q < 0 or candidates[q, 1] < 0:
                continue
            apart2 = np.float32(0.0)
            for axis in range(3):
                apart2 += (points[p, axis] - points[q, axis]) ** 2
            fold = max(crease(points, normals, p, q), np.float32(0.0))
            reached = cost[p] + np.sqrt(apart2) * (np.float32(1.0) + crease_cost * fold)
            if reached < cost[q]:
                one, two = candidates[q, 0], candidates[q, 1]
                nearer = way_over_skin(landmarks, skin[p], one) <= way_over_skin(landmarks, skin[p], two)
                cost[q], skin[q] = reached, one if nearer else two
                if not waiting[q]:
                    queue[last] = q
                    last = (last + 1) % (count + 1)
                    waiting[q] = True
    return skin
