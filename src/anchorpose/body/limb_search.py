"""Limbs found again: poses proposed from the picture, registered, and compared on equal evidence.

Called where a pose leaves seen skin of the patient uncovered, or where limbs may have been taken for each other.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Final

import numpy as np

from anchorpose.body.asset import joint_bones
from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.explanation import Explanation, explain
from anchorpose.body.fit import prior_equations
from anchorpose.body.limb_proposals import anchor_poses, exchanged, limb_poses, uncovered_paths
from anchorpose.body.matched_places import LEAST_MATCHES, fit_matches, matches_of
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import Registration, descend, posterior, register
from anchorpose.body.skin_points import Body, joint_jacobian, place_variance, pose_points
from anchorpose.geodesics.anchors import SeenAnchors
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_COUNT
from anchorpose.threads import each

LOOK_AGAIN_M2: Final = 0.005  # of seen skin that nothing covers: half a hand; clothes and holds leave as much at most
ROUNDS: Final = 4  # one for each limb
TRIAL_REACHES_M: Final = (0.25, 0.20, 0.15)  # from a proposed limb to the seen one
TRIAL_NODES: Final = 800  # a third of the nodes tell a good pose from a bad one
REFINED_REACHES_M: Final = (0.10, 0.07, 0.06)
SAME_M: Final = 0.04  # poses whose joints are nowhere farther apart lead to the same registration
APART_M: Final = 0.08  # poses whose joints are nowhere farther apart are one: as much as clothes and holds move
BEST: Final = 3  # of the proposals: the present pose drawn onto the surface once more, and two others
MOST_UNUSUAL: Final = 10.0  # squared deviations of all joint ranges by which a pose may be rarer than before
MOST_LAG: Final = 3.0  # nats: a pose that is twenty times less likely is not a rival
LEAST_GAIN: Final = 3.0  # nats: another pose must be twenty times as likely


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """A pose besides the best; lag: by how much it explains the last frames worse, nats."""

    belief: PoseBelief
    lag: float


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What a search found.

    registration: of the best pose. rounds: in which another pose was taken, 0: none. rivals: poses that the frame does
    not decide against.
    """

    registration: Registration
    rounds: int
    rivals: tuple[Rival, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    pose: Pose
    log: float


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """Where the joints were expected: joints_m (21, 3), sigma_m (21,)."""

    body: Body
    joints_m: np.ndarray
    sigma_m: np.ndarray

    def log_probability(self, pose: Pose, evidence: Evidence) -> float:
        """By the images, and by how far each limb, or the trunk, has left its expected place; nats.

        Cauchy's tails: a limb that was lost may be anywhere, but one that was known does not turn round between two
        frames, and a body that does has five limbs to explain.
        """
        away = np.linalg.norm(self.body.joints(pose) - self.joints_m, axis=1) / self.sigma_m
        farthest = np.zeros(PARTS)
        np.maximum.at(farthest, LIMB_OF_JOINTS, away)
        return log_probability(self.body, pose, evidence) - float(np.log1p(farthest**2).sum())


def expected_joints(body: Body, belief: PoseBelief) -> Expected:
    """Return where a belief has the joints, and how surely; poses nearer than ``SAME_M`` are the same."""
    transforms = body.transforms(belief.pose)
    joints = body.mesh.joints(transforms)
    jacobian = joint_jacobian(body, transforms, joint_bones(body.points.asset), joints)
    variance = place_variance(jacobian, belief.covariance)
    return Expected(body, joints, np.sqrt(SAME_M**2 + variance))


def needs_search(explanation: Explanation, hidden: bool = False) -> bool:
    """Whether the picture shows that a limb is elsewhere; hidden: some limb covers nothing, so that less is enough."""
    return explanation.uncovered_m2 >= (LOOK_AGAIN_M2 / 2.0 if hidden else LOOK_AGAIN_M2)


def search_limbs(
    body: Body,
    found: Registration,
    predicted: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
    seen: SeenAnchors | None = None,
) -> Search:
    """The registration with limbs moved to where they are seen, as long as that explains the frame better.

    predicted: what was expected; a limb found elsewhere shows that it was wrong, so that it counts for as little as
    after ``UNSEEN_S`` without sight. seen: anchors of the frame, for proposals of limbs along their paths and of the
    whole body by the learnt descriptor; None: without these.
    """
    uncertain, expected = predicted.later(predicted.pose, UNSEEN_S), expected_joints(body, predicted)
    trial = replace(config, reaches_m=TRIAL_REACHES_M, node_count=min(config.node_count, TRIAL_NODES))
    pose, rounds, best = found.belief.pose, 0, list[_Tried]()
    for number in range(ROUNDS):
        proposed = _proposals(body, pose, evidence, seen, whole_body=number == 0)
        tried = _register_all(expected, _distinct(body, [pose, *proposed]), uncertain, evidence, trial)
        best = _best_few(expected, tried, uncertain, evidence, config)
        if best[0] is tried[0] or best[0].log <= tried[0].log + LEAST_GAIN:
            break
        pose, rounds = best[0].pose, rounds + 1
        if not needs_search(explain(body.points, pose_points(body, pose), evidence)):
            break
    if rounds:
        other = posterior(body, pose, replace(uncertain, pose=pose), evidence, config)
        found, rounds = (other, rounds) if other.found else (found, 0)
    return Search(found, rounds, tuple(_rivals(expected, found, best, uncertain, evidence, config)))


def farthest_joint_m(body: Body, one: Pose, other: Pose) -> float:
    """The distance of the joint that is farthest from its place in another pose."""
    return float(np.linalg.norm(body.joints(one) - body.joints(other), axis=1).max())


def _proposals(
    body: Body, pose: Pose, evidence: Evidence, seen: SeenAnchors | None, whole_body: bool
) -> Iterator[Pose]:
    """Poses that the picture suggests, but for those that are much rarer than the present one: a leg that nobody sees
    could be laid along an arm. whole_body: those of the whole body too, which the pose has little part in."""
    most = rarity(body, pose) + MOST_UNUSUAL
    explanation = explain(body.points, pose_points(body, pose), evidence)
    suggested = [limb_poses(body, pose, path) for path in uncovered_paths(evidence, explanation)]
    if seen is not None:
        suggested.append(anchor_poses(body, pose, seen))
        if whole_body:
            suggested.append(_by_matches(body, evidence))
    yield from (proposed for proposed in chain.from_iterable(suggested) if rarity(body, proposed) <= most)
    yield from exchanged(body, pose)


def _by_matches(body: Body, evidence: Evidence) -> Iterator[Pose]:
    """The pose of the whole body by the learnt descriptor alone; none where it matches too few of the pixels."""
    matches = matches_of(evidence.views, evidence.cameras, PixelLabel.PATIENT)
    if len(matches) >= LEAST_MATCHES:
        yield fit_matches(body, matches)


def _distinct(body: Body, poses: Sequence[Pose]) -> list[Pose]:
    """The poses without those that are the same as one before: registration would lead to the same place."""
    kept, joints = list[Pose](), np.empty((len(poses), JOINT_COUNT, 3))
    for pose in poses:
        at = body.joints(pose)
        if not (np.linalg.norm(joints[: len(kept)] - at, axis=2).max(axis=1, initial=0.0) < SAME_M).any():
            joints[len(kept)] = at
            kept.append(pose)
    return kept


def _register_all(
    expected: Expected, poses: Sequence[Pose], uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> list[_Tried]:
    """The first pose as it is, then all after a short registration, and how probable each is.

    The first one too: limbs that only lag behind must not make a body that is turned round the better one.
    """
    settled = each(lambda pose: _settled(expected.body, pose, uncertain, evidence, config), poses)
    return each(lambda pose: _Tried(pose, expected.log_probability(pose, evidence)), [poses[0], *settled])


def rarity(body: Body, pose: Pose) -> float:
    """How far the joints are bent: the sum of squared deviations from their usual range."""
    return prior_equations(body.points, pose, None).cost


def _settled(body: Body, pose: Pose, uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig) -> Pose:
    return descend(body, pose, replace(uncertain, pose=pose), evidence, config)


def _best_few(
    expected: Expected, tried: Sequence[_Tried], uncertain: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> list[_Tried]:
    """The first pose and the best of the others, drawn onto the surface as the first one is; the best of them first."""
    body, refining = expected.body, replace(config, reaches_m=REFINED_REACHES_M)
    others = sorted(tried[1:], key=lambda one: -one.log)[:BEST]
    refined = each(lambda one: _settled(body, one.pose, uncertain, evidence, refining), others)
    others = each(lambda pose: _Tried(pose, expected.log_probability(pose, evidence)), refined)
    return sorted([tried[0], *others], key=lambda one: -one.log)


def _rivals(
    expected: Expected,
    found: Registration,
    best: Sequence[_Tried],
    uncertain: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
) -> Iterator[Rival]:
    """Other poses among the best that the frame does not decide against."""
    body, most = expected.body, expected.log_probability(found.belief.pose, evidence)
    others = [found.belief.pose]
    for one in best:
        lag = most - one.log
        if lag > MOST_LAG or any(farthest_joint_m(body, one.pose, other) <= APART_M for other in others):
            continue
        others.append(one.pose)
        belief = posterior(body, one.pose, replace(uncertain, pose=one.pose), evidence, config).belief
        yield Rival(belief, max(lag, 0.0))


MEMORY: Final = 0.8  # share of the lag that a frame passes on: three frames later half is forgotten
DECIDED: Final = 6.0  # nats: a pose that is e^6 times less likely than the best


def follow_rivals(
    body: Body,
    best: Registration,
    rivals: Sequence[Rival],
    evidence: Evidence,
    elapsed_s: float,
    config: RegistrationConfig,
) -> tuple[Registration, tuple[Rival, ...]]:
    """The best registration of a frame and what is left of its rivals: one that explains more takes its place."""
    if not rivals:
        return best, ()
    most = log_probability(body, best.belief.pose, evidence)
    followed = [(best, 0.0)]
    for rival in rivals:
        expected = rival.belief.later(rival.belief.pose, elapsed_s)
        found = register(body, expected, evidence, no_constraints(), config)
        if found.found and _is_another(body, found, followed):
            lag = most - log_probability(body, found.belief.pose, evidence)
            followed.append((found, MEMORY * rival.lag + lag))
    followed.sort(key=lambda one: one[1])  # stable: of equals the reported one stays
    first, lead = followed[0]
    left = [Rival(one.belief, lag - lead) for one, lag in followed[1:] if lag - lead < DECIDED]
    return first, tuple(left)


def _is_another(body: Body, found: Registration, followed: Sequence[tuple[Registration, float]]) -> bool:
    """Whether a pose has not become one of the others."""
    return all(farthest_joint_m(body, found.belief.pose, one.belief.pose) > APART_M for one, _ in followed)


def with_rivals(body: Body, joints_m: np.ndarray, sigma_m: np.ndarray, rivals: Sequence[Rival]) -> np.ndarray:
    """(21,) sigma of the joints (21, 3) of the best pose, of the mixture with its rivals, per axis.

    A rival's weight is its likelihood by its lag. Its own spread is taken to be that of the best pose.
    """
    weight = np.exp(-np.array([0.0, *(rival.lag for rival in rivals)]))
    weight /= weight.sum()
    variance = sigma_m**2
    for share, rival in zip(weight[1:], rivals, strict=True):
        variance = variance + share * ((body.joints(rival.belief.pose) - joints_m) ** 2).sum(axis=1) / 3.0
    return np.asarray(np.sqrt(variance))
