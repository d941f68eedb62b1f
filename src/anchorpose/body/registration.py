"""One frame's pose: articulated registration from the predicted pose and the tree's pairs (paper, Section IV).

Where seen skin is not covered by the body, other poses of arms and legs are tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints, join, no_constraints, surface_constraints
from anchorpose.body.evidence import Evidence, evidence_cost, evidence_rows, unexplained_node_cost
from anchorpose.body.fit import damped_step, pose_equations, range_information
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose, hinge_axes
from anchorpose.body.skin_points import Body, pose_points

SEARCH_REACHES_M: Final = (0.25, 0.20, 0.15)  # from one direction of an arm to the next
SEARCH_GAIN: Final = 0.008  # share of the nodes that a new arm must explain besides; else it stays as predicted
UNSEEN_S: Final = 4.0  # a limb that was not where it was expected is as uncertain as one unseen for so long
OFF_BODY_M: Final = 0.08  # farther from all skin points than that, a node is on a limb the body does not cover
MOST_OFF_BODY: Final = 0.012  # share of the nodes: half a forearm that one of three cameras sees
OFF_BODY_STRIDE: Final = 3  # a third of the nodes are enough to estimate a share
LEAST_EXPLAINED: Final = 0.3  # share of nodes near the body below which it is not this body that is seen

_DIRECTIONS: Final = (
    (0.2, -1.0, 0.3),
    (1.0, -0.3, 0.2),
    (0.2, -0.2, 1.0),
    (0.5, 0.7, 0.5),
    (0.2, 1.0, 0.2),
    (0.7, -0.7, -0.2),
)
"""Of the right upper arm in the trunk's axes, X forward, Y up, Z to the right: down, forward, sideways, up, across."""

_ELBOW_TURNS: Final = tuple(turn * DEGREE for turn in (-90.0, -45.0, 0.0, 45.0, 90.0, 180.0))
"""Of a bent forearm about the upper arm, from where it is."""

_ELBOWS: Final = (15.0 * DEGREE, 90.0 * DEGREE)
_SEATED: Final = 85.0 * DEGREE  # of hip and knee alike: the shank hangs down


@dataclass(frozen=True, slots=True, kw_only=True)
class Pace:
    """How fast a prediction becomes uncertain: a random walk about the predicted motion.

    turn_sigma, radians, and root_sigma_m: standard deviations after one second of each bone's turn and of the root.
    """

    turn_sigma: float
    root_sigma_m: float

    def variance(self, elapsed_s: float) -> np.ndarray:
        """(POSE_SIZE,) that a prediction gains over a time."""
        variance = np.full(POSE_SIZE, self.turn_sigma**2 * elapsed_s)
        variance[-3:] = self.root_sigma_m**2 * elapsed_s
        return variance


PATIENT_PACE: Final = Pace(turn_sigma=15.0 * DEGREE, root_sigma_m=0.08)
"""In 1/15 s a predicted limb strays by 4 degrees and a predicted trunk by 2 cm."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and its uncertainty, in the parameters of ``Pose.moved``.

    covariance (POSE_SIZE, POSE_SIZE): of the pose, all knowledge together. information (POSE_SIZE, POSE_SIZE): of what
    was seen so far, without the joint range, which every frame adds again and which must not count twice.
    """

    pose: Pose
    covariance: np.ndarray
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, pace: Pace = PATIENT_PACE) -> PoseBelief:
        """The belief in a predicted pose: what is not seen becomes more uncertain with time."""
        return self.grown(pose, pace.variance(elapsed_s))

    def grown(self, pose: Pose, variance: np.ndarray) -> PoseBelief:
        """The belief in another pose, with an additional variance (POSE_SIZE,) of each parameter."""
        growth = np.diag(variance)
        return PoseBelief(pose, self.covariance + growth, np.linalg.inv(np.linalg.inv(self.information) + growth))


def vague_belief(pose: Pose) -> PoseBelief:
    """A pose of which nothing was seen yet: half a radian and a quarter of a metre."""
    variance = np.full(POSE_SIZE, 0.5**2)
    variance[-3:] = 0.25**2
    return PoseBelief(pose, np.diag(variance), np.diag(1.0 / variance))


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """belief in the pose; explained: share of the surface's nodes that the body accounts for, 0 where nothing was seen.

    found is False where too little was seen or it is not this body: the belief is then the prediction, unchanged.
    searched: whether other poses of the limbs were tried.
    """

    belief: PoseBelief
    explained: float
    found: bool
    searched: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Frame:
    """What one registration is given; held: rows of the first steps; fixed: rows of all steps."""

    body: Body
    evidence: Evidence
    held: Constraints
    fixed: Constraints
    config: RegistrationConfig


def register(
    body: Body,
    predicted: PoseBelief,
    evidence: Evidence,
    held: Constraints,
    config: RegistrationConfig,
    may_search: bool = True,
    fixed: Constraints | None = None,
) -> Registration:
    """tau-hat = ICP(tau, phi), for all parts at once: they stay joined, and bones keep their length.

    held: rows of the tree and the anchors; they start the registration, the surface itself ends it. may_search: whether
    other poses of the limbs may be tried where seen skin is not covered. fixed: rows of every step, which make no pose
    more certain: they were not seen.
    """
    if len(evidence.surface) < config.least_nodes:
        return Registration(predicted, 0.0, False)
    frame = _Frame(body, evidence, held, no_constraints() if fixed is None else fixed, config)
    pose, judged_by = _descend(frame, predicted.pose, predicted, config.reaches_m), predicted
    search = may_search and _share_off_body(body, pose, evidence) > MOST_OFF_BODY
    if search:
        pose, judged_by = _search_limbs(frame, pose, predicted)
    found = posterior(body, pose, judged_by, evidence, config)
    return replace(found if found.found else replace(found, belief=predicted), searched=search)


def posterior(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> Registration:
    """The belief in a pose that was found, given the evidence, and whether it is this body that is seen.

    Only skin that is seen makes a pose more certain. That a limb is not where the room is seen is one-sided, so it is
    left out of the covariance.
    """
    posed = pose_points(body, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], config)
    share = len(rows) / max(1, min(len(evidence.surface), config.node_count))
    if share < LEAST_EXPLAINED:
        return Registration(predicted, share, False)
    expected = (predicted.pose, predicted.information)
    hessian = pose_equations(body, pose, posed, rows, expected, config.rows_per_observation).hessian
    seen = hessian - range_information(body.points, pose)
    return Registration(PoseBelief(pose, np.linalg.inv(hessian), seen), share, True)


def node_parts(body: Body, pose: Pose, nodes_m: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Nearest skin point of each node (n,), -1 beyond reach, and the bone (n,) that moves it, -1 likewise."""
    point = nearest_point(pose_points(body, pose).points_m, nodes_m, reach_m)
    return point, np.where(point >= 0, body.points.part[point], -1)


def _descend(frame: _Frame, pose: Pose, predicted: PoseBelief, reaches_m: Sequence[float]) -> Pose:
    """Gauss-Newton from one pose, with less and less reach."""
    body, config, expected = frame.body, frame.config, (predicted.pose, predicted.information)
    for number, reach_m in enumerate(reaches_m):
        rows = [evidence_rows(body, pose, frame.evidence, reach_m, config), frame.fixed]
        if number < config.held_steps:
            rows.append(frame.held)
        pose = damped_step(body, pose, join(rows), expected, config.rows_per_observation)
    return pose


def _search_limbs(frame: _Frame, pose: Pose, predicted: PoseBelief) -> tuple[Pose, PoseBelief]:
    """Other poses of arms and legs, of which the one is kept that explains the frame best.

    Returns the pose and the belief it is to be judged by: where a limb was found elsewhere, the prediction was wrong.
    """
    body, evidence, config = frame.body, frame.evidence, frame.config
    uncertain = predicted.later(predicted.pose, UNSEEN_S)
    reach_m = SEARCH_REACHES_M[-1]
    nodes = min(len(evidence.surface), config.node_count)
    worth = SEARCH_GAIN * nodes * unexplained_node_cost(reach_m, config)
    best = evidence_cost(body, pose, evidence, reach_m, config) - worth
    found = pose
    for candidates in (partial(arm_candidates, side="Left"), partial(arm_candidates, side="Right"), leg_candidates):
        for start in candidates(body.points.asset, found):
            tried = _descend(frame, start, replace(uncertain, pose=start), SEARCH_REACHES_M)
            cost = evidence_cost(body, tried, evidence, reach_m, config)
            if cost < best:
                found, best = tried, cost
    if found is pose:
        return pose, predicted
    settled = replace(uncertain, pose=found)
    return _descend(frame, found, settled, config.reaches_m[2:]), settled


def _share_off_body(body: Body, pose: Pose, evidence: Evidence) -> float:
    """Share of the nodes that lie off the body by more than a limb's thickness."""
    nodes = evidence.surface.points_m[::OFF_BODY_STRIDE].astype(np.float64)
    return float(np.mean(nearest_point(pose_points(body, pose).points_m, nodes, OFF_BODY_M) < 0))


def arm_candidates(asset: BodyAsset, pose: Pose, side: str) -> Iterator[Pose]:
    """The pose with one arm, ``Left`` or ``Right``, elsewhere: the forearm alone, then the whole arm.

    The elbow is nearly straight or bent; a bent forearm is turned about the upper arm, the whole arm points in each of
    some directions.
    """
    arm, forearm, hand = (asset.bone(f"{side}{bone}") for bone in ("Arm", "ForeArm", "Hand"))
    rest = asset.bone_heads[forearm] - asset.bone_heads[arm]
    axes, bend = hinge_axes(asset, f"{side}ForeArm")
    along = rest / np.linalg.norm(rest)
    for turn in _ELBOW_TURNS:
        rotations = pose.rotations.copy()
        rotations[arm] = pose.rotations[arm] @ Rotation.from_rotvec(along * turn).as_matrix()
        rotations[forearm] = Rotation.from_rotvec(axes[0] * (_ELBOWS[1] - bend)).as_matrix()
        rotations[hand] = np.eye(3)
        yield Pose(rotations, pose.root_m)
    for direction in _DIRECTIONS:
        wanted = np.array(direction) * (1.0, 1.0, 1.0 if side == "Right" else -1.0)
        for elbow in _ELBOWS:
            rotations = pose.rotations.copy()
            rotations[arm] = _shortest_turn(rest, wanted)
            rotations[forearm] = Rotation.from_rotvec(axes[0] * (elbow - bend)).as_matrix()
            rotations[hand] = np.eye(3)
            yield Pose(rotations, pose.root_m)


def leg_candidates(asset: BodyAsset, pose: Pose) -> Iterator[Pose]:
    """The pose with both legs, or one, standing straight or sitting."""
    for sides in (("Left", "Right"), ("Left",), ("Right",)):
        for flexed in (0.0, _SEATED):
            rotations = pose.rotations.copy()
            for side in sides:
                thigh, shank, *foot = (asset.bone(f"{side}{bone}") for bone in ("UpLeg", "Leg", "Foot", "ToeBase"))
                axes, bend = hinge_axes(asset, f"{side}Leg")
                rotations[thigh] = Rotation.from_rotvec(-axes[0] * flexed).as_matrix()
                rotations[shank] = Rotation.from_rotvec(axes[0] * (flexed - bend)).as_matrix()
                rotations[foot] = np.eye(3)
            yield Pose(rotations, pose.root_m)


def _shortest_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(3, 3) rotation that takes one direction to another by the shortest way."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    axis = np.cross(start, end)
    sine, cosine = np.linalg.norm(axis), start @ end
    turn = axis / max(float(sine), 1e-9) * np.arctan2(sine, cosine)
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())
