"""The first pose and a first guess of the shape, from the anchors and the surface; nobody clicks anything.

``find_first_pose`` is for the patient, whose shape is estimated with it; ``find_rough_pose`` is for people of whom
nothing is known: any heading, standing, bent or squatting, on a body of given shape.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints, anchor_constraints, join, no_constraints, surface_constraints
from anchorpose.body.evidence import Evidence, evidence_cost, evidence_rows, unexplained_node_cost
from anchorpose.body.explanation import seen_past
from anchorpose.body.fit import damped_step, limited, pose_equations, solve_damped
from anchorpose.body.learning import ShapeFrame, learn_shape_step
from anchorpose.body.own_surface import poses_of_own_surface
from anchorpose.body.pose import DEGREE, Pose
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body, pose_points
from anchorpose.geodesics.anchors import Anchors, SeenGeodesics
from anchorpose.surface.surface import Nodes

_Turns = Mapping[str, tuple[float, float, float]]
"""About X, Y and Z of the rest pose in degrees, limbs' of the left side; the right side's are mirrored."""

_STARTS: Final[Mapping[str, _Turns]] = {
    "standing": {},
    "arms down": {"Arm": (-25, 0, 0)},
    "arms forward": {"Arm": (0, 0, 40)},
    "arms up": {"Arm": (80, 0, 0)},
    "sitting": {"UpLeg": (0, 0, 80), "Leg": (0, 0, -80)},
}
_ANNEALING_M: Final = (0.40, 0.40, 0.30, 0.30, 0.25, 0.25, 0.20, 0.20, 0.15, 0.15, 0.15, 0.12, 0.12, 0.12)
_TRIAL_STEPS: Final = 6  # of every start; the finalists take the others as well
_TRIAL_NODES: Final = 800  # a third of the nodes tell a good start from a bad one
_FINALISTS: Final = 3
_OWN: Final = "own surface"
_ANCHOR_STEPS: Final = 6
_RIGID_SHAPE_REACH_M: Final = 0.28  # below, the shape may change too: a wrong height would pull limbs into false places

_POSTURES: Final[tuple[_Turns, ...]] = (
    {"Arm": (-25, 0, 0)},  # upright, arms hang down
    {"LowerBack": (0, 0, -25), "Spine": (0, 0, -20), "UpLeg": (0, 0, 30), "Arm": (0, 0, 50)},  # bent forward
    {"LowerBack": (0, 0, -15), "UpLeg": (0, 0, 95), "Leg": (0, 0, -110), "Arm": (0, 0, 40)},  # squatting
    # crouching with the knees apart, as who helps with feet and knees
    {"LowerBack": (0, 0, -30), "Spine": (0, 0, -25), "UpLeg": (30, 0, 100), "Leg": (0, 0, -120), "Arm": (0, 0, 60)},
)
ALL_ROUND: Final = tuple(np.arange(8) * np.pi / 4)
"""Headings to try where it is not known which way a person faces, radians about the world's Y."""

_ROUNDS: Final = (((0.45, 0.35, 0.28, 0.25, 0.20), 9), ((0.20, 0.15, 0.15), 3), ((0.12, 0.12, 0.10, 0.08), 1))
"""The reach of each step, metres, and how many starts go on: most are given up early."""

_FEW_NODES: Final = 250  # in all rounds but the last: enough to tell a back from a front


@dataclass(frozen=True, slots=True, eq=False)
class FirstPose:
    """The best of several starts; cost is per constraint, comparable between frames."""

    pose: Pose
    belief: ShapeBelief
    start: str
    cost: float

    @property
    def shape(self) -> FittedShape:
        """The body that was fitted."""
        return self.belief.shape


@dataclass(frozen=True, slots=True, eq=False)
class FirstShape:
    """What is known of the shape before the first pose.

    tried: the patient's learnt shape, or guesses that may still change where ``may_change``, each with what is known of
    it beforehand: of an adult, or of a child.
    """

    tried: Sequence[ShapeBelief]
    may_change: bool


def find_first_pose(
    evidence: Evidence,
    anchors: Anchors,
    shape: FirstShape,
    config: RegistrationConfig,
    headings: Sequence[float] = (0.0,),
    seen: SeenGeodesics | None = None,
) -> FirstPose:
    """Register bodies from several starting poses, with the anchors and without, and keep the cheapest.

    A hole can make an anchor of the wrong limb's end, and a start constrained by it does not converge. headings: those
    to try, radians about the world's Y; 0 faces X. seen: for starts in which the body's own skin lies where it is seen
    (``own_poses``), in any heading and posture; None: without these.
    """
    trial = replace(config, node_count=min(config.node_count, _TRIAL_NODES))
    starts = [
        _settle(start, evidence, held, shape.may_change, _ANNEALING_M[:_TRIAL_STEPS], trial)
        for start, held in _starts(evidence, anchors, shape, headings, seen)
    ]
    ranked = sorted(starts, key=lambda first: first.cost)
    own = [first for first in ranked if first.start == _OWN]
    best = [first for first in ranked if first.start != _OWN][:_FINALISTS] + own[:1]  # a place each: none displaces one
    found = [
        _settle(first, evidence, no_constraints(), shape.may_change, _ANNEALING_M[_TRIAL_STEPS:], config)
        for first in best
    ]
    return min(found, key=lambda first: first.cost)


def _starts(
    evidence: Evidence, anchors: Anchors, shape: FirstShape, headings: Sequence[float], seen: SeenGeodesics | None
) -> Iterator[tuple[FirstPose, Constraints]]:
    """The poses to begin with, and what holds the tips at first."""
    points = body_points()
    rows = anchor_constraints(points, anchors)
    for tried in shape.tried:
        for heading in headings:
            for name, turns in _STARTS.items():
                start = _placed(tried.shape, _start(points.asset, heading, turns), evidence.surface)
                named = len(rows) > 0 and heading == 0.0  # left and right hand are told apart as of who faces X
                for held in (rows, no_constraints()) if named else (no_constraints(),):
                    yield FirstPose(start, tried, name, np.inf), held
        if seen is not None:
            for start in poses_of_own_surface(build_body(points, tried.shape), seen):
                yield FirstPose(start, tried, _OWN, np.inf), no_constraints()


def _settle(
    first: FirstPose,
    evidence: Evidence,
    held: Constraints,
    may_change: bool,
    reaches_m: Sequence[float],
    config: RegistrationConfig,
) -> FirstPose:
    """Anchors place the tips, then the surface draws the body in, with less and less reach."""
    pose, shape, rows_per_observation = first.pose, first.shape, config.rows_per_observation
    body = build_body(body_points(), shape)
    for _ in range(_ANCHOR_STEPS if len(held) else 0):
        pose = damped_step(body, pose, held, None, rows_per_observation)
    for reach_m in reaches_m:
        rows = join([evidence_rows(body, pose, evidence, reach_m, config), held])
        if may_change and reach_m <= _RIGID_SHAPE_REACH_M:
            frame = ShapeFrame(pose, rows)
            learned, (pose,) = learn_shape_step(body.points, shape, [frame], first.belief, rows_per_observation)
            shape = learned.shape
            body = build_body(body.points, shape)
        else:
            pose = damped_step(body, pose, rows, None, rows_per_observation)
    cost = evidence_cost(body, pose, evidence, reaches_m[-1], config) + first.belief.cost(shape)
    return FirstPose(pose, replace(first.belief, shape=shape), first.start, cost)


def _placed(shape: FittedShape, pose: Pose, surface: Nodes) -> Pose:
    """Move the root so that the middle of the body lies at the middle of what is seen."""
    posed = pose_points(build_body(body_points(), shape), pose)
    middle = (np.percentile(surface.points_m, 2, axis=0) + np.percentile(surface.points_m, 98, axis=0)) / 2.0
    own = (posed.points_m.min(axis=0) + posed.points_m.max(axis=0)) / 2.0
    return Pose(pose.rotations, pose.root_m + middle - own)


def _start(asset: BodyAsset, heading: float, turns: _Turns) -> Pose:
    """A posture in a heading, the root in the world's origin."""
    rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
    rotations[asset.bone("Hips")] = Rotation.from_euler("y", heading).as_matrix()
    for name, (x, y, z) in turns.items():
        sides = ((name, 1.0),) if name in asset.bone_names else ((f"Left{name}", 1.0), (f"Right{name}", -1.0))
        for bone, sign in sides:
            turn = np.array([sign * x, sign * y, z]) * DEGREE
            rotations[asset.bone(bone)] = Rotation.from_rotvec(turn).as_matrix()
    return Pose(rotations, np.zeros(3))


def find_rough_pose(body: Body, evidence: Evidence, config: RegistrationConfig) -> Pose:
    """The pose in which the body explains the nodes best and the cameras see least past it, of many starts.

    Nodes alone do not tell a body that reaches beside the person.
    """
    return _roughly(body, evidence, config, _ROUNDS)[0][1]


def likely_headings(body: Body, evidence: Evidence, config: RegistrationConfig, count: int) -> tuple[float, ...]:
    """The directions of ``ALL_ROUND`` in which rough bodies explain best what is seen, the best first.

    Only the rounds that are cheap: that a body is right to a decimetre tells a back from a front.
    """
    found = [heading for heading, _ in _roughly(body, evidence, config, _ROUNDS[:-1])]
    return tuple(dict.fromkeys(found))[:count]


def _roughly(
    body: Body, evidence: Evidence, config: RegistrationConfig, rounds: Sequence[tuple[Sequence[float], int]]
) -> list[tuple[float, Pose]]:
    """Rough poses that are left after some rounds, each with the heading that it began with; the best first."""
    asset, coarse = body.points.asset, replace(config, node_count=_FEW_NODES)
    tries = [
        (heading, _placed_roughly(body, _start(asset, heading, posture), evidence))
        for heading in ALL_ROUND
        for posture in _POSTURES
    ]
    for reaches_m, kept in rounds:
        settings = config if reaches_m is _ROUNDS[-1][0] else coarse
        tried = [_settle_roughly(body, pose, evidence, reaches_m, settings) for _, pose in tries]
        nodes = min(len(evidence.surface), settings.node_count) * unexplained_node_cost(reaches_m[-1], config)
        misfits = [cost / nodes + _share_seen_past(body, pose, evidence) for pose, cost in tried]
        order = np.argsort(misfits, kind="stable")[: min(kept, len(tries))]
        tries = [(tries[place][0], tried[place][0]) for place in order]
    return tries


def _share_seen_past(body: Body, pose: Pose, evidence: Evidence) -> float:
    """0 to 1, mean over the parts of the body that are in view; 0 where none is."""
    past = seen_past(body.points, pose_points(body, pose), evidence.views, evidence.cameras)
    return 0.0 if np.isnan(past).all() else float(np.nanmean(past))


def _settle_roughly(
    body: Body, pose: Pose, evidence: Evidence, reaches_m: Sequence[float], config: RegistrationConfig
) -> tuple[Pose, float]:
    """A few steps of registration, and how badly the pose then explains the nodes."""
    for reach_m in (*reaches_m, reaches_m[-1]):
        posed = pose_points(body, pose)
        rows = surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config)
        equations = pose_equations(body, pose, posed, rows, None, config.rows_per_observation)
        settled, pose = pose, pose.moved(limited(solve_damped(equations)), body.points.moving)
    missing = min(len(evidence.surface), config.node_count) - len(rows)
    return settled, equations.cost + missing * unexplained_node_cost(reaches_m[-1], config)


def _placed_roughly(body: Body, pose: Pose, evidence: Evidence) -> Pose:
    """The pose with its middle over the middle of what is seen, its top at the top: heads are seldom hidden."""
    seen, own = evidence.surface.points_m, pose_points(body, pose).points_m
    shift = np.median(seen, axis=0) - (own.min(axis=0) + own.max(axis=0)) / 2.0
    shift[1] = seen[:, 1].max() - own[:, 1].max()
    return Pose(pose.rotations, pose.root_m + shift)
