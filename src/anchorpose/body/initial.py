"""Find a person's first pose, and a first estimate of the patient's shape, without a predicted pose.

The learnt descriptor matches pixels to places on the body. Poses are fitted to these matches and then registered to the
surface, and the most probable pose is kept. ``find_first_pose`` also fits the patient's shape. ``find_rough_pose``
serves for other people and does not change the shape of the given body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import surface_constraints
from anchorpose.body.evidence import Evidence, evidence_rows, rows_alike
from anchorpose.body.fit import damped_step
from anchorpose.body.learning import ShapeFrame, learn_shape_step
from anchorpose.body.matched_places import MatchedPerson, Matches, fit_matches
from anchorpose.body.pose import PARTS, Pose
from anchorpose.body.pose_probability import facing_nats, log_probability
from anchorpose.body.rivals import believed
from anchorpose.body.shape_prior import ShapeBelief
from anchorpose.body.skin_points import Body, FittedShape, body_points, build_body, pose_points

_REACHES_M: Final = (0.20, 0.20, 0.15, 0.15, 0.15, 0.12, 0.12, 0.12)
"""Maximum distance (m) at which a node pulls the skin, one value per registration step. The steps begin at the pose
fitted to the descriptor's matches. Matches on hands have errors of up to 0.2 m."""

# number of registration steps, counted from the first, that fit the pose but not the shape; while the pose is still
# inaccurate, a wrong shape would be fitted
_RIGID_STEPS: Final = 2
# m, maximum distance at which a node (point of the seen surface) pulls the skin, one value per registration step of
# ``find_rough_pose``, which takes fewer steps than ``find_first_pose``
_ROUGH_REACHES_M: Final = (0.15, 0.12, 0.10, 0.08)


@dataclass(frozen=True, slots=True, eq=False)
class FirstPose:
    """A first pose and the belief in the shape of the body that was fitted."""

    pose: Pose
    belief: ShapeBelief
    log: float  # nats, log probability of pose and shape, given the images and the prior knowledge of bodies
    facing: float  # nats, prior log probability that the patient faces this way (``facing_nats``)
    # poses in which the patient faces the opposite way. If the patient's shape was known before, two poses with the
    # opposite facing are listed, the first with this shape, the second with a newly fitted shape; otherwise only one
    # pose is listed, and its shape was fitted together with the pose
    others: tuple[FirstPose, ...] = ()

    @property
    def shape(self) -> FittedShape:
        """Return the shape of the fitted body."""
        return self.belief.shape

    def ahead_of(self, turned: FirstPose) -> float:
        """Return by how many nats this pose is likelier than a pose with the opposite facing. The difference between
        the log probabilities (``log``) of both poses is reduced by ``believed``, since errors of shape and clothes
        contribute to this difference.
        """
        return believed(self.log - turned.log, PARTS) + self.facing - turned.facing


@dataclass(frozen=True, slots=True, eq=False)
class FirstShape:
    """The knowledge of the patient's shape before the first pose is found."""

    # shapes to try: the patient's learnt shape, or else shapes of adults and children, whose stature is the stated
    # stature or is derived from the images
    tried: Sequence[ShapeBelief]
    may_change: bool  # whether the fit of the first pose may change these shapes


def find_first_pose(
    evidence: Evidence, person: MatchedPerson, shape: FirstShape, config: RegistrationConfig
) -> FirstPose:
    """Fit a body of each shape in ``shape.tried`` to the person's matches (pixels matched with places on the body) and
    to the seen surface, and keep the most probable body. Then fit this body with the opposite facing, too. Return the
    pose with the likelier facing; its field ``others`` holds the poses with the opposite facing.

    A learnt shape is valid only for the facing with which it was learnt, so a new shape is also fitted for the opposite
    facing.
    """
    found = [_fitted(evidence, person.matches, tried, person.pose, shape, config) for tried in shape.tried]
    number = max(range(len(found)), key=lambda k: found[k].log)
    right, tried = found[number], shape.tried[number]
    turned = _fitted(evidence, person.matches.turned, tried, None, shape, config)
    best, other = (turned, right) if right.ahead_of(turned) < 0.0 else (right, turned)
    if shape.may_change:
        return replace(best, others=(other,))
    matches = person.matches.turned if best is right else person.matches
    free = _fitted(evidence, matches, tried, None, replace(shape, may_change=True), config)
    return replace(best, others=(other, free))


def _fitted(
    evidence: Evidence,
    matches: Matches,
    belief: ShapeBelief,
    start: Pose | None,
    shape: FirstShape,
    config: RegistrationConfig,
) -> FirstPose:
    pose = fit_matches(build_body(body_points(), belief.shape), matches, start)
    return _settle(pose, belief, evidence, shape.may_change, config)


def _settle(
    pose: Pose, belief: ShapeBelief, evidence: Evidence, may_change: bool, config: RegistrationConfig
) -> FirstPose:
    """Register the body to the seen surface, starting from ``pose``, which was fitted to matches between pixels and
    places on the body. may_change: whether the body's shape is fitted, too.
    """
    shape = belief.shape
    body = build_body(body_points(), shape)
    for number, reach_m in enumerate(_REACHES_M):
        rows = evidence_rows(body, pose, evidence, reach_m, config)
        if may_change and number >= _RIGID_STEPS:
            frame = ShapeFrame(pose, rows, rows_alike(evidence, config))
            learned, (pose,) = learn_shape_step(body.points, shape, [frame], belief)
            shape = learned.shape
            body = build_body(body.points, shape)
        else:
            pose = damped_step(body, pose, rows, None, config.rows_per_observation)
    log = log_probability(body, pose, evidence) - 0.5 * belief.cost(shape)
    return FirstPose(pose, replace(belief, shape=shape), log, facing_nats(body, pose, evidence.cameras))


def find_rough_pose(
    body: Body, evidence: Evidence, matches: Matches, start: Pose | None, config: RegistrationConfig
) -> Pose:
    """Return the pose of a person whose body is given: the body is fitted to the matches (between pixels and places on
    the body), then registered to the seen surface. start: a pose that was already fitted to the matches; None if no
    such pose is known.
    """
    pose = fit_matches(body, matches, start)
    for reach_m in _ROUGH_REACHES_M:
        rows = surface_constraints(pose_points(body, pose), evidence.surface, evidence.cameras, reach_m, config)
        pose = damped_step(body, pose, rows, None, config.rows_per_observation)
    return pose
