"""Everybody but the patient, each followed with a rough body of his own, so that predicted skins compete for a pixel.

Remembered skin alone cannot tell a therapist's forearm from the patient's that it passes or holds, and what was once
mistaken claims itself again; a body can, for an arm hangs on one of them only (Section III, transient occlusion).

Nodes without edges: what somebody's skin looks like where no geodesic is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit

from anchorpose.body.constraints import ConstraintConfig, no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.fit import FitConfig
from anchorpose.body.initial import find_rough_pose, shape_of_height
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose
from anchorpose.body.registration import PoseBelief, RegistrationConfig, posterior, register, vague_belief
from anchorpose.body.skin_points import Body, SkinPoints, build_body, pose_points
from anchorpose.camera import Camera
from anchorpose.isolation.ownership import OwnershipLikelihood, join_likelihoods
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import Surface, SurfaceConfig


def loose_surface(
    depths_m: Sequence[np.ndarray | None], masks: Sequence[np.ndarray | None], cameras: Sequence[Camera],
    config: SurfaceConfig,
) -> Surface:  # fmt: skip
    """The masked pixels of all cameras as nodes with normals, without ring and links; None: no picture."""
    sheets = [
        (number, build_surface(depth, mask, camera, config))
        for number, (depth, mask, camera) in enumerate(zip(depths_m, masks, cameras, strict=True))
        if depth is not None and mask is not None and mask.any()
    ]
    points = [sheet.points_m for _, sheet in sheets]
    count = sum(len(sheet) for _, sheet in sheets)
    return Surface(
        points_m=np.concatenate([np.zeros((0, 3), np.float32), *points]),
        normals=np.concatenate([np.zeros((0, 3), np.float32), *(sheet.normals for _, sheet in sheets)]),
        ring=np.full((count, 8), -1, np.int32),
        link_start=np.zeros(count + 1, np.int32),
        link_node=np.zeros(0, np.int32),
        link_length_m=np.zeros(0, np.float32),
        camera=np.concatenate([np.zeros(0, np.uint8), *(np.full(len(s), n, np.uint8) for n, s in sheets)]),
        pixel=np.concatenate([np.zeros((0, 2), np.int16), *(sheet.pixel for _, sheet in sheets)]),
        skin=np.full(count, -1, np.int32),
    )


ROUGHLY = RegistrationConfig(
    reaches_m=(0.20, 0.12, 0.08),
    held_steps=0,
    least_nodes=60,
    constraints=ConstraintConfig(node_count=700),
    fit=FitConfig(turn_rate_sigma=40.0 * DEGREE, root_rate_sigma_m=0.3, rows_per_observation=2.0),
)
"""A third of the patient's nodes and steps, and the pace of somebody who walks."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BystanderConfig:
    """How the others are followed."""

    followed: bool = True  # False: they claim where they were seen last, as the patient's rivals do elsewhere
    sheet: SurfaceConfig = field(default_factory=lambda: SurfaceConfig(step=4))  # a rough body needs no finer nodes
    registration: RegistrationConfig = field(default_factory=lambda: ROUGHLY)
    height_m: float = 1.72  # of an adult of whom nothing else is known
    least_explained: float = 0.75  # share of somebody's nodes that his body must account for, else he has none
    least_nodes: int = 150  # to begin with: a third of a front four metres away
    skin_sigma_m: float = 0.03  # clothes, hair, and a body of ordinary shape
    growth_m_s: float = 0.4  # by which a hand outruns its prediction
    damping: float = 0.8  # of the movement from frame to frame
    first_pause: int = 15  # frames between searches for a body that fail, doubled each time
    longest_pause: int = 240

    def __post_init__(self) -> None:
        for name in set(self.__slots__) - {"followed", "sheet", "registration"}:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


@dataclass(frozen=True, slots=True, eq=False)
class Bystander:
    """Somebody with a body: his label, shape and pose; change (POSE_SIZE,) of the pose in the last ``elapsed_s``."""

    label: int
    body: Body
    belief: PoseBelief
    change: np.ndarray
    elapsed_s: float


@dataclass(frozen=True, slots=True)
class Search:
    """Somebody for whom no body was found: frames to wait, and how many after the next failure."""

    label: int
    wait: int
    pause: int


@dataclass(frozen=True, slots=True, eq=False)
class Bystanders:
    """Everybody but the patient in one frame."""

    followed: tuple[Bystander, ...] = ()
    searched: tuple[Search, ...] = ()


def bystander_likelihood(
    bystanders: Bystanders, points: SkinPoints, elapsed_s: float, config: BystanderConfig
) -> OwnershipLikelihood:
    """What their bodies claim ``elapsed_s`` after the frame they were fitted to; 0: in that frame itself."""
    spread = config.skin_sigma_m + config.growth_m_s * abs(elapsed_s)
    found = []
    for one in bystanders.followed:
        skin = pose_points(one.body, _ahead(one, points, elapsed_s, config)).points_m.astype(np.float32)
        owner, sigma = np.full(len(skin), one.label, np.uint8), np.full(len(skin), spread, np.float32)
        found.append(OwnershipLikelihood(skin, owner, sigma))
    return join_likelihoods(found)


def follow_bystanders(
    before: Bystanders, views: Sequence[View | None], cameras: Sequence[Camera], points: SkinPoints, elapsed_s: float,
    config: BystanderConfig,
) -> Bystanders:  # fmt: skip
    """Everybody's body in the next frame, from the pixels that are labelled his.

    A body that no longer accounts for what is seen of him is given up, and searched for anew.
    """
    if not config.followed:
        return before
    known = {one.label: one for one in before.followed}
    searched = {search.label: search for search in before.searched}
    followed, waiting = list[Bystander](), list[Search]()
    for label in _labels(views):
        last = searched.get(label, Search(label, 0, config.first_pause))
        if last.wait > 0:
            waiting.append(replace(last, wait=last.wait - 1))
            continue
        evidence = _evidence(views, cameras, label, config)
        found = _follow(known[label], evidence, points, elapsed_s, config) if label in known else None
        found = found or _find(label, evidence, points, config)
        if found:
            followed.append(found)
        else:
            waiting.append(Search(label, last.pause, min(2 * last.pause, config.longest_pause)))
    return Bystanders(tuple(followed), tuple(waiting))


def _labels(views: Sequence[View | None]) -> list[int]:
    there = np.zeros(256, dtype=bool)
    for view in views:
        if view is not None:
            _note_labels(view.labels, there)
    return [label for label in np.flatnonzero(there).tolist() if label >= PixelLabel.OTHER_PERSON]


@njit(cache=True)
def _note_labels(labels: np.ndarray, there: np.ndarray) -> None:
    for label in labels.ravel():
        there[label] = True


def _evidence(views: Sequence[View | None], cameras: Sequence[Camera], label: int, config: BystanderConfig) -> Evidence:
    """His nodes; his outline is left out, since half of it is where something hides him."""
    masks = [None if view is None else view.labels == label for view in views]
    depths = [None if view is None else view.depth_m for view in views]
    surface = loose_surface(depths, masks, cameras, config.sheet)
    return Evidence(surface, tuple(views), (None,) * len(views), tuple(cameras))


def _follow(
    one: Bystander, evidence: Evidence, points: SkinPoints, elapsed_s: float, config: BystanderConfig
) -> Bystander | None:
    pose, settings = _ahead(one, points, elapsed_s, config), config.registration
    predicted = one.belief.later(pose, abs(elapsed_s), settings.fit)
    found = register(one.body, predicted, evidence, no_constraints(), settings, may_search=False)
    if not found.found or found.explained < config.least_explained:
        return None
    change = one.belief.pose.change_to(found.belief.pose, points.moving)
    return replace(one, belief=found.belief, change=change, elapsed_s=elapsed_s)


def _find(label: int, evidence: Evidence, points: SkinPoints, config: BystanderConfig) -> Bystander | None:
    if len(evidence.surface) < config.least_nodes:
        return None
    body = build_body(points, shape_of_height(points.asset, config.height_m))
    pose = find_rough_pose(body, evidence, config.registration)
    found = posterior(body, pose, vague_belief(pose), evidence, config.registration)
    if not found.found or found.explained < config.least_explained:
        return None
    return Bystander(label, body, found.belief, np.zeros(POSE_SIZE), 1.0)


def _ahead(one: Bystander, points: SkinPoints, elapsed_s: float, config: BystanderConfig) -> Pose:
    """His pose some time after the frame he was fitted in: he goes on as he moved, a little slower."""
    return one.belief.pose.moved(config.damping * elapsed_s / one.elapsed_s * one.change, points.moving)
