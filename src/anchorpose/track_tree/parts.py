"""Register every body part separately, by ICP (iterative closest point) from the predicted pose, as in the paper
(Section V).

In all arrays of points, the rows of a body part are contiguous. Part k has the rows start[k] to start[k + 1]; start is
(parts + 1,) int64.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from anchorpose.body.asset import BodyAsset, joint_bones
from anchorpose.body.kinematics import BodyMesh
from anchorpose.body.nearest_skin import Oriented
from anchorpose.camera import transform_points
from anchorpose.rotations import COLLINEAR_RATIO, ONE_PLACE_M2, rotate, rotation_matrices
from anchorpose.surface.surface import Nodes

# minimum number of pairs (a skin point and its place in the next frame) to fit a part's motion; with fewer pairs, the
# motion would follow the noise of single nodes
LEAST_PAIRS: Final = 6
PAIR_ROUNDS: Final = 8  # number of fits; pairs are reweighted before each fit; after five fits, little changes
# m; a pair's weight is halved at the median residual of the part's pairs (residual: distance between a pair's two
# places after the part's motion), but never at a residual smaller than this constant. The constant is the spacing of
# surface nodes, since pairs with smaller residuals fit equally well
LEAST_SCALE_M: Final = 0.01
# m, sigma of a node's distance from its part's skin, due to clothes, sensor, and errors that neighbouring nodes share
SURFACE_SIGMA_M: Final = 0.02
# rad and m, standard deviations that are assumed for a part's rotation and shift in one ICP step; they keep the part
# from sliding where no node constrains it
TURN_SIGMA: Final = 0.15
SHIFT_SIGMA_M: Final = 0.02
# minimum cosine (60 degrees) between the normals of skin point and node; it excludes the far side of a limb
ALIKE: Final = 0.5


@njit(cache=True)
def fit_pairs(
    skin_m: np.ndarray, matched_m: np.ndarray, start: np.ndarray, transforms: np.ndarray, robust: bool
) -> None:
    """Fit a motion to the pairs (skin point, place in the next frame) of each body part that has enough pairs; this
    motion replaces the predicted motion in transforms (k, 4, 4).

    skin_m, matched_m (n, 3) float64, metres: the skin point of each pair, and its place in the next frame. robust:
    whether pairs are weighted by their residuals (first by the residuals after the predicted motion), so that
    mismatches have little influence (``_weigh``).
    """
    for k in range(len(transforms)):
        source, target = skin_m[start[k] : start[k + 1]], matched_m[start[k] : start[k + 1]]
        if len(source) < LEAST_PAIRS:
            continue
        T, weight, known = transforms[k].copy(), np.ones(len(source)), True
        for _ in range(PAIR_ROUNDS if robust else 1):
            if robust:
                _weigh(source, target, T, weight)
            known = known and _fit_rigid(source, target, weight / weight.sum(), T)
        if known:
            transforms[k] = T


@njit(cache=True)
def _weigh(source: np.ndarray, target: np.ndarray, T: np.ndarray, weight: np.ndarray) -> None:
    """Fill weight (n,) with each pair's weight after a motion T: Cauchy's function 1 / (1 + r^2), where r is the pair's
    residual (distance from the moved ``source`` point to the ``target`` point) divided by the median residual of all
    pairs, or by ``LEAST_SCALE_M`` if that is larger.
    """
    for row in range(len(source)):
        squared = 0.0
        for axis in range(3):
            moved = T[axis, 3]
            for other in range(3):
                moved += T[axis, other] * source[row, other]
            squared += (moved - target[row, axis]) ** 2
        weight[row] = np.sqrt(squared)
    scale = max(np.median(weight), LEAST_SCALE_M)
    for row in range(len(source)):
        weight[row] = 1.0 / (1.0 + (weight[row] / scale) ** 2)


@njit(cache=True)
def _fit_rigid(source: np.ndarray, target: np.ndarray, share: np.ndarray, T: np.ndarray) -> bool:
    """Fill T (4, 4) with the rigid motion that best maps ``source`` onto ``target``, as ``fit_rigid_transform`` does;
    share: each pair's weight, sum 1. Return False, with T unchanged, if the points are collinear.
    """
    source_mean, target_mean, spread = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for row in range(len(source)):
        for axis in range(3):
            source_mean[axis] += share[row] * source[row, axis]
            target_mean[axis] += share[row] * target[row, axis]
    for row in range(len(source)):
        for axis in range(3):
            away = share[row] * (target[row, axis] - target_mean[axis])
            for other in range(3):
                spread[axis, other] += away * (source[row, other] - source_mean[other])
    u, size, vt = np.linalg.svd(spread)
    if size[1] <= max(COLLINEAR_RATIO * size[0], ONE_PLACE_M2):
        return False
    if np.linalg.det(u @ vt) < 0.0:
        u[:, 2] = -u[:, 2]
    turn = u @ vt
    T[:3, :3], T[:3, 3] = turn, target_mean - turn @ source_mean
    return True


@njit(cache=True)
def carry(skin: Oriented, start: np.ndarray, transforms: np.ndarray) -> Oriented:
    """Return the skin after the motions (k, 4, 4) of its parts were applied."""
    places, normals = np.empty_like(skin.places_m), np.empty_like(skin.normals)
    for k in range(len(transforms)):
        T = transforms[k]
        for row in range(start[k], start[k + 1]):
            for axis in range(3):
                place, normal = T[axis, 3], 0.0
                for other in range(3):
                    place += T[axis, other] * skin.places_m[row, other]
                    normal += T[axis, other] * skin.normals[row, other]
                places[row, axis], normals[row, axis] = place, normal
    return Oriented(places, normals)


@njit(cache=True)
def plane_steps(
    moved: Oriented, start: np.ndarray, nodes: Oriented, nearest: np.ndarray, near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Take one step of point-to-plane ICP for each part.

    Return each part's step (k, 6), a rotation about the part's centre and a translation, NaN if too few nodes are near;
    and the part's centre (k, 3). nearest (n,): the node nearest to each point of the skin; near (n,) bool: whether this
    node is within reach. Each skin point is pulled to the plane through its node; the plane's normal is the mean of the
    normals of skin point and node, as in ``surface_constraints``. Parts do not move in directions that no node
    constrains.
    """
    steps, centres = np.full((len(start) - 1, 6), np.nan), np.zeros((len(start) - 1, 3))
    planes, rows = np.empty((len(near), 4)), np.empty(len(near), np.int64)
    for k in range(len(steps)):
        count = 0
        for row in range(start[k], start[k + 1]):
            if near[row] and _plane(moved, row, nodes, nearest[row], planes[count]):
                rows[count] = row
                count += 1
        if count >= LEAST_PAIRS:
            _solve(moved.places_m, rows[:count], planes, centres[k], steps[k])
    return steps, centres


@njit(cache=True)
def _plane(moved: Oriented, row: int, nodes: Oriented, node: int, plane: np.ndarray) -> bool:
    """Fill plane (4,) with a unit normal and the distance of skin point ``row`` from the plane through the node; return
    False if the normals of point and node differ too much.
    """
    alike, squared = 0.0, 0.0
    for axis in range(3):
        alike += nodes.normals[node, axis] * moved.normals[row, axis]
        plane[axis] = nodes.normals[node, axis] + moved.normals[row, axis]
        squared += plane[axis] ** 2
    if not alike > ALIKE:
        return False
    plane[3] = 0.0
    for axis in range(3):
        plane[axis] /= np.sqrt(squared)
        plane[3] += (moved.places_m[row, axis] - nodes.places_m[node, axis]) * plane[axis]
    return True


@njit(cache=True)
def _solve(places: np.ndarray, rows: np.ndarray, planes: np.ndarray, centre: np.ndarray, step: np.ndarray) -> None:
    """Fill ``centre`` (3,) with the mean of the skin points in ``rows``, and ``step`` (6,) with the rotation and
    translation of the part that bring these points closer to their planes, by weighted least squares.
    """
    for row in rows:
        for axis in range(3):
            centre[axis] += places[row, axis] / len(rows)
    matrix, right, arm = np.zeros((6, 6)), np.zeros(6), np.empty(6)
    for number in range(len(rows)):
        place, plane = places[rows[number]], planes[number]
        x, y, z = place[0] - centre[0], place[1] - centre[1], place[2] - centre[2]
        a, b, c, off = plane[0], plane[1], plane[2], plane[3]
        arm[0], arm[1], arm[2] = y * c - z * b, z * a - x * c, x * b - y * a
        arm[3], arm[4], arm[5] = a, b, c
        weight = 1.0 / (SURFACE_SIGMA_M * (1.0 + (off / SURFACE_SIGMA_M) ** 2)) ** 2
        for one in range(6):
            right[one] -= weight * off * arm[one]
            for other in range(6):
                matrix[one, other] += weight * arm[one] * arm[other]
    for axis in range(3):
        matrix[axis, axis] += 1.0 / TURN_SIGMA**2
        matrix[3 + axis, 3 + axis] += 1.0 / SHIFT_SIGMA_M**2
    step[:] = np.linalg.solve(matrix, right)


ITERATIONS: Final = 5  # number of iterations of ICP, after the parts were fitted to the matches
REACH_M: Final = 0.06  # m, maximum distance of a node from its part's skin: a limb's radius, to exclude other limbs


def register_parts(
    skin: Oriented,
    part: np.ndarray,
    matched_m: np.ndarray,
    surface: Nodes,
    T_predicted: np.ndarray,
    iterations: int = ITERATIONS,
    robust: bool = True,
) -> np.ndarray:
    """Register each part, first by the matches of the global hypothesis, then to the nearest nodes by ICP. In the
    paper's equation tau-hat = ICP(tau, phi), tau is the predicted motion of a part, phi are the matches, and tau-hat is
    the registered motion. Return T_next_now (b, 4, 4): the motion of each bone's part.

    skin: n points of the body's skin in frame t; part (n,): number of each point's bone; matched_m (n, 3): each point's
    place in frame t + 1 by the track tree, NaN without a match; surface: surface of frame t + 1; T_predicted (b, 4, 4):
    predicted motion of each part; iterations: number of ICP iterations; robust: whether matches that do not fit lose
    their influence. The skin is registered instead of the last frame's nodes, whose errors would accumulate. A part
    that is hardly seen keeps its prediction.
    """
    order = np.argsort(part, kind="stable")
    bones, first = np.unique(part[order], return_index=True)
    start, matched_m = np.append(first, len(part)), matched_m[order]
    own_skin = Oriented(*(np.ascontiguousarray(one[order], np.float64) for one in skin))
    paired = np.flatnonzero(np.isfinite(matched_m).all(axis=1))
    transforms, own = T_predicted.copy(), T_predicted[bones]
    fit_pairs(own_skin.places_m[paired], matched_m[paired], np.searchsorted(paired, start), own, robust)
    _refine(own_skin, start, surface, own, iterations)
    transforms[bones] = own
    return transforms


def _refine(skin: Oriented, start: np.ndarray, surface: Nodes, transforms: np.ndarray, iterations: int) -> None:
    """Refine the parts' transforms (k, 4, 4) by ICP, in place. start (k + 1,): first row of each part.

    A part stops moving at the first step with too few nodes near it.
    """
    tree, nodes = cKDTree(surface.points_m), Oriented(surface.points_m, surface.normals)
    active = np.ones(len(transforms), bool)
    for _ in range(iterations):
        moved = carry(skin, start, transforms)
        distance, nearest = tree.query(moved.places_m, distance_upper_bound=REACH_M)
        change, centre = plane_steps(moved, start, nodes, nearest, np.isfinite(distance))
        active &= np.isfinite(change).all(axis=1)
        step = np.tile(np.eye(4), (active.sum(), 1, 1))
        step[:, :3, :3] = rotation_matrices(change[active, :3])
        step[:, :3, 3] = centre[active] - rotate(step[:, :3, :3], centre[active]) + change[active, 3:]
        transforms[active] = step @ transforms[active]


def joints_of_parts(asset: BodyAsset, body: BodyMesh, T_world_rest: np.ndarray) -> np.ndarray:
    """Return the joints (21, 3), metres, by the rule J: a joint is the mean of its places on the two parts that it
    joins. The joints of the root bone and of the head have a single part.
    """
    bones = joint_bones(asset)
    rest = body.rest_joints()
    places = []
    for joint, bone in enumerate(bones):
        parent = asset.bone_parents[bone]
        adjacent = [bone] if parent < 0 or asset.bone_names[bone] == "Head" else [bone, parent]
        places.append(np.mean([transform_points(T_world_rest[b], rest[joint]) for b in adjacent], axis=0))
    return np.array(places)
