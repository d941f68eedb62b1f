"""One frame's pose: articulated registration from the predicted pose and the tree's pairs (paper, Section IV).

Other poses worth trying when a limb is not where it was expected: arms as they are held, legs that stand or sit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from anchorpose.body.asset import BodyAsset
from anchorpose.body.constraints import ConstraintConfig, Constraints, join, no_constraints, surface_constraints
from anchorpose.body.evidence import Evidence, doubted_node_cost, evidence_cost, evidence_rows
from anchorpose.body.fit import FitConfig, NormalEquations, limited, pose_equations, range_information, solve_damped
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose, hinge_axes
from anchorpose.body.skin_points import Body, pose_points

_DIRECTIONS = (
    (0.2, -1.0, 0.3),
    (1.0, -0.3, 0.2),
    (0.2, -0.2, 1.0),
    (0.5, 0.7, 0.5),
    (0.2, 1.0, 0.2),
    (0.7, -0.7, -0.2),
)
"""Of the right upper arm in the trunk's axes, X forward, Y up, Z to the right: down, forward, sideways, up, across."""

_ELBOW_TURNS = tuple(turn * DEGREE for turn in (-90.0, -45.0, 0.0, 45.0, 90.0, 180.0))
"""Of a bent forearm about the upper arm, from where it is."""

_ELBOWS = (15.0 * DEGREE, 90.0 * DEGREE)
_SEATED = 85.0 * DEGREE  # of hip and knee alike: the shank hangs down


def arm_restarts(asset: BodyAsset, pose: Pose, side: str) -> Iterator[Pose]:
    """The pose with one arm, ``Left`` or ``Right``, laid elsewhere: the forearm alone, then the whole arm.

    The elbow is nearly straight or bent; a bent forearm is turned about the upper arm, the whole arm is laid in each of
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


def leg_restarts(asset: BodyAsset, pose: Pose) -> Iterator[Pose]:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class RegistrationConfig:
    """How one frame is registered."""

    reaches_m: tuple[float, ...] = (0.12, 0.10, 0.07, 0.06)  # from a fast arm's surprise to clothes
    held_steps: int = 2  # pairs and anchors are centimetres off: they start the registration and do not end it
    restart_reaches_m: tuple[float, ...] = (0.25, 0.20, 0.15)  # from one direction of an arm to the next
    restart_gain: float = 0.008  # of the nodes that a new arm must explain besides; else it stays as predicted
    restart_doubt_s: float = 4.0  # a limb that was not where it was expected may be anywhere
    uncovered_m: float = 0.08  # farther from all skin points than that, a node is on a limb the body does not cover
    most_uncovered: float = 0.012  # of the nodes: half a forearm that one of three cameras sees
    uncovered_stride: int = 3  # a third of the nodes tell a share
    least_explained: float = 0.3  # share of nodes near the body below which it is not this body that is seen
    least_nodes: int = 150  # of about 3,500: less is a hand in the picture, not a patient
    constraints: ConstraintConfig = field(default_factory=ConstraintConfig)
    fit: FitConfig = field(default_factory=FitConfig)

    def __post_init__(self) -> None:
        if not self.reaches_m or min(self.reaches_m) <= 0:
            raise ValueError("reaches_m needs at least one positive distance")


@dataclass(frozen=True, slots=True, eq=False)
class PoseBelief:
    """A pose and how sure it is, in the parameters of ``Pose.moved``.

    covariance (POSE_SIZE, POSE_SIZE): of the pose, all knowledge together. information (POSE_SIZE, POSE_SIZE): of what
    was seen so far, without the joint range, which every frame adds anew and which must not count twice.
    """

    pose: Pose
    covariance: np.ndarray
    information: np.ndarray

    def later(self, pose: Pose, elapsed_s: float, config: FitConfig) -> PoseBelief:
        """The belief in a predicted pose: what is not seen grows less sure with time."""
        growth = np.diag(config.process_variance(elapsed_s))
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
    searched: whether the arms were looked for anew.
    """

    belief: PoseBelief
    explained: float
    found: bool
    searched: bool = False


def register(
    body: Body, predicted: PoseBelief, evidence: Evidence, held: Constraints,
    config: RegistrationConfig, may_search: bool = True, lasting: Constraints | None = None,
) -> Registration:  # fmt: skip
    """tau-hat = ICP(tau, phi), for all parts at once: they stay joined, and bones keep their length.

    held: what the tree and the anchors say; it starts the registration, the surface itself ends it. may_search: whether
    the arms may be looked for anew where seen skin is not covered. lasting: what holds from beginning to end, but makes
    no pose surer: it is not seen.
    """
    if len(evidence.surface) < config.least_nodes:
        return Registration(predicted, 0.0, False)
    lasting = no_constraints() if lasting is None else lasting
    pose = _descend(body, predicted.pose, predicted, evidence, held, config.reaches_m, config, lasting)
    expected = predicted
    search = may_search and _uncovered(body, pose, evidence, config) > config.most_uncovered
    if search:
        pose, predicted = _restart(body, pose, predicted, evidence, held, config, lasting)
    found = posterior(body, pose, predicted, evidence, config)
    return replace(found if found.found else replace(found, belief=expected), searched=search)


def _descend(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence, held: Constraints,
    reaches_m: Sequence[float], config: RegistrationConfig, lasting: Constraints,
) -> Pose:  # fmt: skip
    """Gauss-Newton from one pose, with less and less reach."""
    for number, reach_m in enumerate(reaches_m):
        rows = [evidence_rows(body, pose, evidence, reach_m, config.constraints), lasting]
        if number < config.held_steps:
            rows.append(held)
        equations = _equations(body, pose, predicted, join(rows), config)
        pose = pose.moved(limited(solve_damped(equations), config.fit), body.points.moving)
    return pose


def _restart(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence, held: Constraints,
    config: RegistrationConfig, lasting: Constraints,
) -> tuple[Pose, PoseBelief]:  # fmt: skip
    """Seen skin that the body does not cover: look for arms and legs elsewhere, keep what explains the frame best.

    Returns the pose and the belief it is to be judged by: where a limb was found anew, the prediction was wrong.
    """
    doubted = predicted.later(predicted.pose, config.restart_doubt_s, config.fit)
    reach_m, constraints = config.restart_reaches_m[-1], config.constraints
    nodes = min(len(evidence.surface), constraints.node_count)
    worth = config.restart_gain * nodes * doubted_node_cost(reach_m, constraints, config.fit)
    best = evidence_cost(body, pose, evidence, reach_m, constraints, config.fit) - worth
    found = pose
    for starts in (partial(arm_restarts, side="Left"), partial(arm_restarts, side="Right"), leg_restarts):
        for start in starts(body.points.asset, found):
            belief = PoseBelief(start, doubted.covariance, doubted.information)
            tried = _descend(body, start, belief, evidence, held, config.restart_reaches_m, config, lasting)
            cost = evidence_cost(body, tried, evidence, reach_m, constraints, config.fit)
            if cost < best:
                found, best = tried, cost
    if found is pose:
        return pose, predicted
    settled = PoseBelief(found, doubted.covariance, doubted.information)
    return _descend(body, found, settled, evidence, held, config.reaches_m[2:], config, lasting), settled


def _uncovered(body: Body, pose: Pose, evidence: Evidence, config: RegistrationConfig) -> float:
    """Share of the nodes that lie off the body by more than a limb's thickness."""
    posed = pose_points(body, pose)
    nodes = evidence.surface.points_m[:: config.uncovered_stride].astype(np.float64)
    return float(np.mean(nearest_point(posed.points_m, nodes, config.uncovered_m) < 0))


def posterior(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence,
    config: RegistrationConfig,
) -> Registration:  # fmt: skip
    """What the evidence says of a pose that was found: how sure it is, and whether it is this body that is seen.

    Only skin that is seen makes a pose surer. That a limb is not where the room is seen tells a side, not a place.
    """
    posed = pose_points(body, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], config.constraints)
    share = len(rows) / max(1, min(len(evidence.surface), config.constraints.node_count))
    if share < config.least_explained:
        return Registration(predicted, share, False)
    hessian = _equations(body, pose, predicted, rows, config).hessian
    seen = hessian - range_information(body.points, pose, config.fit)
    return Registration(PoseBelief(pose, np.linalg.inv(hessian), seen), share, True)


def _equations(
    body: Body, pose: Pose, predicted: PoseBelief, rows: Constraints,
    config: RegistrationConfig,
) -> NormalEquations:  # fmt: skip
    posed = pose_points(body, pose)
    return pose_equations(body, pose, posed, rows, (predicted.pose, predicted.information), config.fit)


def node_parts(body: Body, pose: Pose, nodes_m: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Nearest skin point of each node (n,), -1 beyond reach, and the bone (n,) that moves it, -1 likewise."""
    posed = pose_points(body, pose)
    point = nearest_point(posed.points_m, nodes_m, reach_m)
    return point, np.where(point >= 0, body.points.part[point], -1)
