"""Everybody but the patient, each followed with a rough body of his own, so that predicted skins compete for a pixel.

A therapist's arm that passes the patient's is told from it by whose body it hangs on; skin remembered from the last
frame alone cannot tell (Section III, transient occlusion).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.constraints import ConstraintConfig, Constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.fit import FitConfig
from anchorpose.body.initial import shape_of_height
from anchorpose.body.pose import DEGREE, Pose
from anchorpose.body.registration import PoseBelief, RegistrationConfig, posterior, register, vague_belief
from anchorpose.body.rough_start import find_rough_pose
from anchorpose.body.skin_points import RestPoints, SkinPoints, pose_points, rest_points
from anchorpose.camera import Camera
from anchorpose.isolation.claims import Claims, join_claims
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.loose import loose_surface
from anchorpose.surface.mesh import SheetConfig

_REGISTRATION = RegistrationConfig(
    reaches_m=(0.20, 0.12, 0.08),
    held_steps=0,
    least_nodes=60,
    constraints=ConstraintConfig(node_count=700),
    fit=FitConfig(turn_rate_sigma=40.0 * DEGREE, root_rate_sigma_m=0.3, rows_per_observation=2.0),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class BystanderConfig:
    """How the others are followed."""

    sheet: SheetConfig = field(default_factory=lambda: SheetConfig(step=4))  # a rough body needs no finer nodes
    registration: RegistrationConfig = field(default_factory=lambda: _REGISTRATION)
    height_m: float = 1.72  # of an adult of whom nothing else is known
    least_explained: float = 0.75  # share of somebody's nodes that his body must account for, else he has none
    least_nodes: int = 150  # to begin with: half of a front that three metres away
    skin_sigma_m: float = 0.03  # clothes, hair, and a body of ordinary shape
    growth_m_s: float = 0.4  # that a prediction loses in a second
    damping: float = 0.8  # of the velocity from frame to frame
    pause: int = 15  # frames between searches that fail
    enabled: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Bystander:
    """Somebody's label, body and pose, and how he moved since the frame before: change (POSE_SIZE,), elapsed_s."""

    label: int
    rest: RestPoints
    belief: PoseBelief
    change: np.ndarray
    elapsed_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Bystanders:
    """Those who have a body in a frame; pause: (label, frames) of those of whom none was found."""

    followed: tuple[Bystander, ...] = ()
    pause: tuple[tuple[int, int], ...] = ()


def claims_of(bystanders: Bystanders, points: SkinPoints, elapsed_s: float, config: BystanderConfig) -> Claims:
    """What their bodies claim ``elapsed_s`` after the frame they were fitted to; 0: in that frame."""
    found = []
    for one in bystanders.followed:
        pose = one.belief.pose if elapsed_s == 0.0 else _ahead(one, points, elapsed_s, config)
        posed = pose_points(points, one.rest, pose)
        spread = config.skin_sigma_m + config.growth_m_s * abs(elapsed_s)
        count = len(posed.points_m)
        found.append(
            Claims(
                posed.points_m.astype(np.float32),
                np.full(count, one.label, np.uint8),
                np.full(count, spread, np.float32),
            )
        )
    return join_claims(found)


def follow_bystanders(
    before: Bystanders, views: Sequence[View | None], cameras: Sequence[Camera], points: SkinPoints, elapsed_s: float,
    config: BystanderConfig,
) -> Bystanders:  # fmt: skip
    """Everybody's body in the next frame."""
    if not config.enabled:
        return before
    known = {one.label: one for one in before.followed}
    pause = dict(before.pause)
    followed, waiting = [], []
    for label in _labels(views):
        evidence = _evidence(views, cameras, label, config)
        one = None
        if label in known:
            one = _follow(known[label], evidence, points, elapsed_s, config)
        elif pause.get(label, 0) > 0:
            waiting.append((label, pause[label] - 1))
            continue
        if one is None and len(evidence.surface) >= config.least_nodes:
            one = _find(label, evidence, points, config)
        if one is None:
            waiting.append((label, config.pause))
        else:
            followed.append(one)
    return Bystanders(tuple(followed), tuple(waiting))


def _labels(views: Sequence[View | None]) -> list[int]:
    seen = np.zeros(256, dtype=bool)
    for view in views:
        if view is not None:
            seen[np.unique(view.labels)] = True
    return [int(label) for label in np.flatnonzero(seen) if label >= PixelLabel.OTHER_PERSON]


def _evidence(views: Sequence[View | None], cameras: Sequence[Camera], label: int, config: BystanderConfig) -> Evidence:
    surface = loose_surface(
        [None if view is None else view.depth_m for view in views],
        [None if view is None else view.labels == label for view in views],
        cameras,
        config.sheet,
    )
    return Evidence(surface, tuple(views), (None,) * len(views), tuple(cameras))


def _nothing() -> Constraints:
    return Constraints(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def _follow(
    one: Bystander, evidence: Evidence, points: SkinPoints, elapsed_s: float, config: BystanderConfig
) -> Bystander | None:
    pose = _ahead(one, points, elapsed_s, config)
    predicted = one.belief.later(pose, abs(elapsed_s), config.registration.fit)
    if len(evidence.surface) < config.registration.least_nodes:
        return None
    found = register(points, one.rest, predicted, evidence, _nothing(), config.registration, may_search=False)
    if not found.found or found.explained < config.least_explained:
        return None
    return replace(
        one, belief=found.belief, change=_change(one.belief.pose, found.belief.pose, points), elapsed_s=elapsed_s
    )


def _find(label: int, evidence: Evidence, points: SkinPoints, config: BystanderConfig) -> Bystander | None:
    rest = rest_points(points, shape_of_height(points.asset, config.height_m))
    pose = find_rough_pose(points, rest, evidence, config.registration)
    found = posterior(points, rest, pose, vague_belief(pose), evidence, config.registration)
    if not found.found or found.explained < config.least_explained:
        return None
    return Bystander(label, rest, found.belief, np.zeros(len(found.belief.covariance)), 1.0)


def _ahead(one: Bystander, points: SkinPoints, elapsed_s: float, config: BystanderConfig) -> Pose:
    step = config.damping * one.change * (elapsed_s / one.elapsed_s)
    return one.belief.pose.moved(step, points.moving)


def _change(before: Pose, after: Pose, points: SkinPoints) -> np.ndarray:
    """(POSE_SIZE,) what leads from one pose to the other."""
    turned = after.rotations[points.moving] @ before.rotations[points.moving].transpose(0, 2, 1)
    return np.append(Rotation.from_matrix(turned).as_rotvec().ravel(), after.root_m - before.root_m)
