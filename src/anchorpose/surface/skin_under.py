"""Which skin a node shows: the expected skin point under it, and on which side of a crease it is.

Near each other in space is not near each other on the body: a hand lies on the trunk, a thigh against the other. Where
two parts that are far apart on the body both come near a node, both are its candidates until the crease decides.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from anchorpose.camera import Camera, invert_rigid
from anchorpose.surface.expected_skin import ExpectedSkin, way_over_skin
from anchorpose.surface.surface import Surface

CELL_PX = 6  # skin points hang on a grid of so many pixels: 4 cm at 2.4 m, a little more than they are apart
LEAST_FACING = np.float32(-0.5)  # skin turned farther from the optical axis than 120 degrees is on the other side
MOST_CANDIDATES = 128  # skin points looked at for one node; there are about ten within reach


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
    """(k,) bool: skin points with skin beside them that is far away on the body; only there a node can be in doubt."""
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
    lens = camera.intrinsics
    candidates = _candidates(
        surface.points_m, surface.normals, surface.pixel, expected.points_m, expected.normals,
        expected.map.landmarks_m, contested, invert_rigid(camera.require_pose()).astype(np.float32),
        np.array([lens.fx, lens.fy, lens.cx, lens.cy], np.float32), camera.height // CELL_PX + 1,
        camera.width // CELL_PX + 1, np.float32(config.reach_m), np.float32(np.cos(np.radians(config.max_turn_deg))),
        np.float32(config.off_sheet), np.float32(config.doubt_m), np.float32(config.far_m),
    )  # fmt: skip
    skin = _settle(
        surface.points_m, surface.normals, surface.ring, candidates, expected.map.landmarks_m,
        np.float32(config.crease_cost),
    )  # fmt: skip
    return replace(surface, skin=skin)


@njit(cache=True, fastmath=True)
def _candidates(
    points: np.ndarray, normals: np.ndarray, pixel: np.ndarray, skin: np.ndarray, skin_normals: np.ndarray,
    landmarks: np.ndarray, contested: np.ndarray, T_camera_world: np.ndarray, lens: np.ndarray, rows: int, cols: int,
    reach: np.float32, min_cosine: np.float32, off_sheet: np.float32, doubt: np.float32, far: np.float32,
) -> np.ndarray:  # fmt: skip
    """(n, 2): the nearest skin point of each node, and the nearest of those far from that one on the body, if in doubt.

    Skin points hang in lists on a grid of pixels; a node looks around its own cell, ring after ring.
    """
    head = np.full((rows, cols), -1, np.int32)
    following = np.full(len(skin), -1, np.int32)
    finest = np.float32(np.inf)  # metres that a cell spans where the skin is nearest
    for k in range(len(skin)):
        x, y, z = T_camera_world[0, 3], T_camera_world[1, 3], T_camera_world[2, 3]
        for axis in range(3):
            x += T_camera_world[0, axis] * skin[k, axis]
            y += T_camera_world[1, axis] * skin[k, axis]
            z += T_camera_world[2, axis] * skin[k, axis]
        facing = np.float32(0.0)
        for axis in range(3):
            facing -= T_camera_world[2, axis] * skin_normals[k, axis]
        if z <= 0.0 or facing < LEAST_FACING:
            continue
        row, col = int((lens[1] * y / z + lens[3]) // CELL_PX), int((lens[0] * x / z + lens[2]) // CELL_PX)
        if 0 <= row < rows and 0 <= col < cols:
            following[k] = head[row, col]
            head[row, col] = k
            finest = min(finest, z * CELL_PX / max(lens[0], lens[1]))
    found = np.full((len(points), 2), -1, np.int32)
    if not finest < np.inf:
        return found
    widest = int(np.ceil((reach + doubt) / finest))
    near, away = np.empty(MOST_CANDIDATES, np.int32), np.empty(MOST_CANDIDATES, np.float32)
    steep = off_sheet * off_sheet - np.float32(1.0)
    for n in range(len(points)):
        row, col = pixel[n, 0] // CELL_PX, pixel[n, 1] // CELL_PX
        limit, count = reach, 0
        for again in range(2):  # first the nearest, then, where it is contested, what is hardly farther off
            for ring in range(widest + 1):
                if max(ring - 1, 0) * finest > limit:
                    break
                for i in range(max(0, row - ring), min(rows, row + ring + 1)):
                    stride = 1 if i == row - ring or i == row + ring else max(2 * ring, 1)
                    for j in range(col - ring, col + ring + 1, stride):
                        k = head[i, j] if 0 <= j < cols else -1
                        while k >= 0:
                            x, y, z = points[n, 0] - skin[k, 0], points[n, 1] - skin[k, 1], points[n, 2] - skin[k, 2]
                            squared = x * x + y * y + z * z
                            if squared < limit * limit:
                                off = x * skin_normals[k, 0] + y * skin_normals[k, 1] + z * skin_normals[k, 2]
                                squared += steep * off * off
                            if squared < limit * limit:
                                cosine = (normals[n, 0] * skin_normals[k, 0] + normals[n, 1] * skin_normals[k, 1]
                                          + normals[n, 2] * skin_normals[k, 2])  # fmt: skip
                                if cosine > min_cosine and again == 0:
                                    limit, found[n, 0] = np.sqrt(squared), k
                                elif cosine > min_cosine and count < MOST_CANDIDATES:
                                    near[count], away[count] = k, np.sqrt(squared)
                                    count += 1
                            k = following[k]
            if found[n, 0] < 0 or not contested[found[n, 0]]:
                break
            if again == 0:
                limit += doubt
        for c in range(count):
            if away[c] < limit and way_over_skin(landmarks, near[c], found[n, 0]) > far:
                limit, found[n, 1] = away[c], near[c]
    return found


@njit(cache=True, fastmath=True)
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
            count += np.int64(squared < radius * radius)
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
