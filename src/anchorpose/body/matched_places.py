"""Match pixels with places on the body by the learnt descriptor, and fit the body's pose to these matches.

The paper matches nodes (points of the seen surface) of two frames if the geodesic distances of both nodes to the
anchors agree (Definition 5). The learnt descriptor, in contrast, predicts for each pixel which place on the skin the
pixel shows. So a single frame gives matches all over the body, and no initial pose is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from anchorpose.body.constraints import Constraints, thin
from anchorpose.body.fit import damped_step
from anchorpose.body.pose import LIMB_OF_BONES, TRUNK, Pose
from anchorpose.body.pose_probability import places
from anchorpose.body.shape_prior import shape_of_height
from anchorpose.body.skin_points import Body, SkinPoints, body_points, build_body, pose_points
from anchorpose.camera import Camera, transform_points
from anchorpose.descriptor.learnt import described
from anchorpose.isolation.view import View

# minimum number of matches to find a pose; at a distance of two metres, this many cover 60 cm2, as a hand does
LEAST_MATCHES: Final = 30
# maximum number of matches used; a person at two metres has 2,000 matches, but using more than 800 would only cost time
MATCHES: Final = 800
LEAST_SIGMA_M: Final = 0.03  # m, minimum error of a match, due to clothes and the spacing of skin points
# number of matches that count as one observation, since all matches of a body part have similar errors
MATCHES_PER_OBSERVATION: Final = 10.0
SCALES_M: Final = (0.5, 0.5, 0.4, 0.4, 0.3, 0.3, 0.25, 0.25, 0.2, 0.2, 0.15, 0.15, 0.15, 0.15)
"""Distance (m) at which the weight of a match has fallen to a quarter, one value per solver step. The distance is
measured between the match's place on the posed skin and its place in the image. The values decrease from a limb's
length to a limb's width.
"""

# m, mean and standard deviation of an unknown person's stature, adult or child
MEAN_STATURE_M, STATURE_SIGMA_M = 1.70, 0.20
STATURES_M: Final = (0.90, 2.15)  # m, limits of the stature; one person in a thousand is beyond these limits
# number of times that the body is scaled; the median error of the stature is 4 % after the first scaling, 3 % after the
# second and 2 % after the third
_SCALINGS: Final = 3
_AGAIN: Final = 4  # number of solver steps if the initial pose was already fitted to the matches
# m, scale of the robust kernel of each match's rows (``Constraints.scale_m``). This scale of the robust kernel is so
# large that the kernel has no effect; instead, ``_rows`` enlarges a row's sigma with the distance of its skin point
# from the target
_NO_KERNEL_M: Final = 1e3
_ALIGNING: Final = 8  # number of steps of the trunk's alignment; each step computes new weights of the matches


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Matches between pixels and places on the body."""

    # (n, 3) place on the standing mean adult, in statures (1 = this adult's height): X forward, Y up from the floor, Z
    # right
    place: np.ndarray
    target_m: np.ndarray  # (n, 3) m, place in the world that the pixel shows
    error: np.ndarray  # (n,) expected error of ``place``, in statures

    def __len__(self) -> int:
        return len(self.place)

    @property
    def turned(self) -> Matches:
        """Return the matches as if the person faced the opposite way, since a wrong facing is the network's most
        frequent error.
        """
        return replace(self, place=self.place * [-1.0, 1.0, -1.0])


def matches_of(views: Sequence[View | None], cameras: Sequence[Camera], label: int) -> Matches:
    """Return the matches of all pixels that have the given person label and, according to the descriptor, show a
    person.
    """
    found = [_matches_of(view, camera, label) for view, camera in zip(views, cameras, strict=True) if view is not None]
    if not found:
        return Matches(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    return Matches(*(np.concatenate([getattr(one, name) for one in found]) for name in Matches.__slots__))


def _matches_of(view: View, camera: Camera, label: int) -> Matches:
    said = described(view.depth_m, camera)
    own = (said.person >= 0.5) & (view.labels[said.row, said.column] == label)
    row, column = said.row[own], said.column[own]
    depth_m = view.depth_m[row, column, None]
    seen_m = np.concatenate([camera.pixel_rays()[row, column] * depth_m, depth_m], axis=1)
    return Matches(said.place[own], transform_points(camera.require_pose(), seen_m), said.error[own])


class MatchedPerson(NamedTuple):
    """Matches between a person's pixels and places on the body, and the person's stature and pose, estimated from these
    matches.
    """

    matches: Matches
    stature_m: float  # m, standing height; its error is below 3 % in half of all single frames
    pose: Pose  # pose of an average adult of this height


def match_person(matches: Matches) -> MatchedPerson:
    """Find a person's stature and pose: fit an average body to the matches, scale the body so that distances on it
    agree with distances between the places of the matched pixels, and repeat both steps.

    The distribution of statures serves as a prior, since few or uncertain matches determine a stature poorly. Raises
    ValueError for fewer matches than ``LEAST_MATCHES``.
    """
    points, stature_m, pose = body_points(), MEAN_STATURE_M, None
    for _ in range(_SCALINGS):
        body = _adult(points, round(100.0 * stature_m))
        pose = fit_matches(body, matches, pose)
        stature_m = _stature_m(body, pose, matches, round(stature_m, 2))
    assert pose is not None
    return MatchedPerson(matches, stature_m, pose)


@lru_cache(maxsize=24)  # cached, since a few statures are enough for all people in all frames
def _adult(points: SkinPoints, stature_cm: int) -> Body:
    return build_body(points, shape_of_height(points.asset, stature_cm / 100.0))


def _stature_m(body: Body, pose: Pose, matches: Matches, now_m: float) -> float:
    """Return the most probable stature, given the prior of the stature and the matches with a posed body of stature
    ``now_m``.
    """
    point, target_m, sigma_m = _chosen(body, matches)
    own_m = pose_points(body, pose).points_m[point]
    weight = (sigma_m * (1.0 + (np.linalg.norm(own_m - target_m, axis=1) / SCALES_M[-1]) ** 2)) ** -2
    per_m = (own_m - np.average(own_m, axis=0, weights=weight)) / now_m
    to_m = target_m - np.average(target_m, axis=0, weights=weight)
    seen = (weight[:, None] * per_m**2).sum() / MATCHES_PER_OBSERVATION
    scaled_m = (weight[:, None] * per_m * to_m).sum() / MATCHES_PER_OBSERVATION
    known = STATURE_SIGMA_M**-2
    return float(np.clip((scaled_m + known * MEAN_STATURE_M) / (seen + known), *STATURES_M))


def fit_matches(body: Body, matches: Matches, start: Pose | None = None) -> Pose:
    """Return the pose in which the matched skin points come closest to their matched places in the world, with robust
    weights.

    start: a pose fitted to the same matches with a body of another shape. Raises ValueError for too few matches.
    """
    if len(matches) < LEAST_MATCHES:
        raise ValueError(f"a pose needs {LEAST_MATCHES} matches, these are {len(matches)}")
    point, target_m, sigma_m = _chosen(body, matches)
    pose = _aligned(body, point, target_m, sigma_m) if start is None else start
    for scale_m in SCALES_M if start is None else SCALES_M[-_AGAIN:]:
        rows = _rows(pose_points(body, pose).points_m, point, target_m, sigma_m, scale_m)
        pose = damped_step(body, pose, rows, None, MATCHES_PER_OBSERVATION)
    return pose


def _chosen(body: Body, matches: Matches) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, for up to ``MATCHES`` matches, the skin point (n,), the place in the world (n, 3) and its standard
    deviation (n,), both in metres.
    """
    chosen = thin(len(matches), MATCHES)
    sigma_m = np.maximum(matches.error[chosen] * np.ptp(body.rest_m[:, 1]), LEAST_SIGMA_M)
    return np.asarray(_tree(body.points).query(matches.place[chosen])[1]), matches.target_m[chosen], sigma_m


def _rows(
    posed_m: np.ndarray, point: np.ndarray, target_m: np.ndarray, sigma_m: np.ndarray, scale_m: float
) -> Constraints:
    """Return three constraint rows per match with the match's robust weight (Geman and McClure): the farther the skin
    point is from its target, the lower the weight.
    """
    away_m = np.linalg.norm(posed_m[point] - target_m, axis=1)
    spread_m = np.repeat(sigma_m * (1.0 + (away_m / scale_m) ** 2), 3)
    direction = np.tile(np.eye(3), (len(point), 1))
    return Constraints(
        np.repeat(point, 3), np.repeat(target_m, 3, axis=0), direction, spread_m, np.full(len(spread_m), _NO_KERNEL_M)
    )


@cache
def _tree(points: SkinPoints) -> cKDTree:
    """Return a KD-tree of the skin points' places on the standing mean adult, in units of this adult's height, as in
    ``Matches.place``.
    """
    return cKDTree(places(points))


def _aligned(body: Body, point: np.ndarray, target_m: np.ndarray, sigma_m: np.ndarray) -> Pose:
    """Return the rest pose, turned and moved so that the trunk's skin points come closest to the places with which they
    are matched. If the trunk has too few matches, the matches of the whole body are used.
    """
    asset = body.points.asset
    rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
    trunk = np.isin(body.points.part[point], body.points.moving[LIMB_OF_BONES == TRUNK])
    used = trunk if trunk.sum() >= LEAST_MATCHES else np.ones(len(point), dtype=bool)
    own_m = pose_points(body, Pose(rotations, np.zeros(3))).points_m[point[used]]
    to_m, weight, turn = target_m[used], sigma_m[used] ** -2, Rotation.identity()
    for _ in range(_ALIGNING):
        middle, goal = np.average(own_m, axis=0, weights=weight), np.average(to_m, axis=0, weights=weight)
        turn, _ = Rotation.align_vectors(to_m - goal, own_m - middle, weights=weight)
        away_m = np.linalg.norm(turn.apply(own_m - middle) + goal - to_m, axis=1)
        weight = (sigma_m[used] * (1.0 + (away_m / SCALES_M[-1]) ** 2)) ** -2
    rotations[asset.bone("Hips")] = turn.as_matrix()
    turned_m = pose_points(body, Pose(rotations, np.zeros(3))).points_m[point[used]]
    return Pose(rotations, np.average(to_m - turned_m, axis=0, weights=weight))
