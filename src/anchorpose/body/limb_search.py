"""Find the true places of misplaced limbs: propose poses from the images and from usual postures of hidden limbs,
register these poses, and compare all poses by the same evidence.

The search runs if a registered pose is in doubt, for example because it leaves seen skin uncovered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.config import RegistrationConfig, Source
from anchorpose.body.evidence import Evidence
from anchorpose.body.expected_joints import SAME_M, Expected, expected_joints
from anchorpose.body.explanation import Explanation, explain
from anchorpose.body.pose import Pose
from anchorpose.body.pose_probability import facing_nats, log_probability
from anchorpose.body.proposals import Doubted, proposals
from anchorpose.body.registration import Registration, descend, posterior
from anchorpose.body.rivals import LEAST_GAIN, MOST, Rival, believed, parts_apart, rivals_of
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.geodesics.anchors import SeenAnchors
from anchorpose.joints import JOINT_COUNT
from anchorpose.threads import each

# m2; a search starts if the body leaves at least this area of seen skin uncovered: half a hand, which is more than
# clothes and gripping hands leave uncovered
LOOK_AGAIN_M2: Final = 0.005
ROUNDS: Final = 4  # maximum number of rounds of a search, one for each of the four limbs
# m, maximum distance at which a node (point of the seen surface) pulls the skin, one value per step of the short
# registration of every proposed pose
TRIAL_REACHES_M: Final = (0.25, 0.20, 0.15)
# maximum number of nodes (points of the seen surface) in the short registration of proposed poses; about a third of the
# nodes of a full registration is enough to distinguish good poses from bad poses
TRIAL_NODES: Final = 800
# m, maximum distance at which a node (point of the seen surface) pulls the skin, one value per step of the finer
# registration of the ``BEST`` likeliest poses
REFINED_REACHES_M: Final = (0.10, 0.07, 0.06)
BEST: Final = 3  # number of poses per round that are registered more finely; the present pose may be among these poses


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """The result of a search for misplaced limbs."""

    registration: Registration  # registration of the best pose
    taken: bool  # whether the best pose replaces the pose before the search
    rivals: tuple[Rival, ...] = ()  # other poses that the images of this frame cannot exclude


@dataclass(frozen=True, slots=True, eq=False)
class Tried:
    """A pose that the search compares with other poses, and its log probability."""

    pose: Pose
    images: float  # nats, log probability given the images and the body priors
    moved: float  # nats, cost of the pose's distance from the expected pose (``Expected.moved``)

    @property
    def log(self) -> float:
        """Return the log probability of the pose, nats."""
        return self.images - self.moved


def tried_pose(expected: Expected, pose: Pose, evidence: Evidence) -> Tried:
    """Compute a pose's log probability from the images and the body priors, and its cost from the distances of the
    limbs and the trunk from their expected places.
    """
    body = expected.body
    return Tried(pose, log_probability(body, pose, evidence), expected.moved(body.joints(pose)))


def needs_search(explanation: Explanation, hidden: bool = False) -> bool:
    """Return whether so much seen skin is uncovered that a limb may be misplaced. The uncovered area must be at least
    ``LOOK_AGAIN_M2``. hidden: whether, for some limb, hardly any of the skin beyond the elbow or knee covers nodes
    (points of the seen surface); the uncovered skin may then belong to this limb, so half of the area is enough.
    """
    return explanation.uncovered_m2 >= (LOOK_AGAIN_M2 / 2.0 if hidden else LOOK_AGAIN_M2)


def search_limbs(
    body: Body,
    found: Registration,
    predicted: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
    anchors: SeenAnchors | None = None,
) -> Search:
    """Move limbs to the places where the images show them, or hidden limbs to usual places, as long as such a move
    makes the pose clearly likelier. Return the best registration.

    predicted: the expected pose; if a limb is found in another place, this pose was wrong. So the search gives the
    expected pose a low weight, namely the weight that it would have after ``UNSEEN_S`` seconds without a view of the
    patient. anchors: the frame's anchors, None for a first pose.
    """
    uncertain, expected = predicted.later(predicted.pose, UNSEEN_S), expected_joints(body, predicted)
    trial = replace(config, reaches_m=TRIAL_REACHES_M, node_count=min(config.node_count, TRIAL_NODES))
    now, best = tried_pose(expected, found.belief.pose, evidence), list[Tried]()
    pose = now.pose
    for number in range(ROUNDS):
        # the descriptor's proposals do not depend on the pose in doubt, so they are tried in the first round only
        sources = [source for source in config.sources if number == 0 or source is not Source.DESCRIPTOR]
        proposed = proposals(Doubted(body, pose, evidence, anchors), sources)
        tried = _register_all(expected, _distinct(body, [pose, *proposed]), uncertain, evidence, trial)
        best += _best_few(expected, tried, uncertain, evidence, config)
        most = max(best, key=lambda one: one.log)
        if most.log <= tried[0].log + LEAST_GAIN:
            break
        pose = most.pose
        if not needs_search(explain(body.points, pose_points(body, pose), evidence)):
            break
    return _decided(body, found, now, best, uncertain, evidence, config)


def _decided(
    body: Body,
    found: Registration,
    now: Tried,
    others: Sequence[Tried],
    uncertain: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
) -> Search:
    """Decide, by the evidence of one frame, between ``now`` (the pose before the search) and the other poses."""
    ways, places_m = list[tuple[Registration, Rival]](), list[np.ndarray]()
    for one, lag in sorted(_compared(body, now, others, evidence), key=lambda way: way[1] + way[0].moved):
        joints_m = body.joints(one.pose)
        if len(ways) > MOST or not all(parts_apart(joints_m, other_m) for other_m in places_m):
            continue
        way = posterior(body, one.pose, replace(uncertain, pose=one.pose), evidence, config)
        if way.found:
            ways.append((way, Rival(way.belief, lag, one.moved - now.moved)))
            places_m.append(joints_m)
    rivals = [rival for _, rival in ways]
    if not ways or rivals[0].behind >= -LEAST_GAIN:
        return Search(found, False, rivals_of(body, found.belief, rivals))
    taken, left = ways[0][0], [rival.beside(rivals[0]) for rival in (*rivals[1:], Rival(found.belief, 0.0))]
    return Search(taken, True, rivals_of(body, taken.belief, left))


def _compared(body: Body, now: Tried, others: Sequence[Tried], evidence: Evidence) -> Iterator[tuple[Tried, float]]:
    """Yield each pose of ``others`` except ``now``, and by how many nats the pose ``now`` is likelier than this pose.

    The number of nats is the sum of two differences between both poses: the difference of the log probabilities from
    images and body priors, reduced by ``believed``, and the difference of the prior log probabilities of the directions
    that the patient faces (``facing_nats``).
    """
    for one in others:
        if one.pose is not now.pose:
            parts = parts_apart(body.joints(one.pose), body.joints(now.pose))
            turned = facing_nats(body, one.pose, evidence.cameras) - facing_nats(body, now.pose, evidence.cameras)
            yield one, -believed(one.images - now.images, parts) - turned


def _distinct(body: Body, poses: Sequence[Pose]) -> list[Pose]:
    """Return the poses, except poses so close to an earlier pose in the list that registration would make the two poses
    equal.
    """
    kept, joints = list[Pose](), np.empty((len(poses), JOINT_COUNT, 3))
    for pose in poses:
        at = body.joints(pose)
        if not (np.linalg.norm(joints[: len(kept)] - at, axis=2).max(axis=1, initial=0.0) < SAME_M).any():
            joints[len(kept)] = at
            kept.append(pose)
    return kept


def _register_all(
    expected: Expected, poses: Sequence[Pose], uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> list[Tried]:
    """Return the present pose unchanged, then all poses after a short registration, with their probabilities.

    The present pose, which the other poses may replace, is the first of ``poses``. The present pose is also registered.
    Otherwise its limbs could lag behind the images, and the pose of a turned body could win for this reason alone.
    """
    settled = each(lambda pose: _settled(expected.body, pose, uncertain, evidence, config), poses)
    return each(lambda pose: tried_pose(expected, pose, evidence), [poses[0], *settled])


def _settled(body: Body, pose: Pose, uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig) -> Pose:
    return descend(body, pose, replace(uncertain, pose=pose), evidence, config)


def _best_few(
    expected: Expected, tried: Sequence[Tried], uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> list[Tried]:
    """Return, from likeliest to least likely: the pose ``tried[0]`` unchanged, and the best other poses after a finer
    registration.
    """
    body, refining = expected.body, replace(config, reaches_m=REFINED_REACHES_M)
    others = sorted(tried[1:], key=lambda one: -one.log)[:BEST]
    refined = each(lambda one: _settled(body, one.pose, uncertain, evidence, refining), others)
    others = each(lambda pose: tried_pose(expected, pose, evidence), refined)
    return sorted([tried[0], *others], key=lambda one: -one.log)
