"""Limbs found again: poses proposed from the picture, registered, and compared on equal evidence.

Called where a pose leaves seen skin of the patient uncovered, or where limbs may have been taken for each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.body.belief import UNSEEN_S, PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.evidence import Evidence, evidence_cost, unexplained_node_cost
from anchorpose.body.explained import Explanation, explain
from anchorpose.body.limb_proposals import exchanged, limb_poses, uncovered_paths
from anchorpose.body.pose import Pose
from anchorpose.body.registration import Registration, descend, posterior
from anchorpose.body.skin_points import Body, pose_points

LOOK_AGAIN_M2: Final = 0.008  # of seen skin that nothing covers: a hand; clothes and holds leave half of that
ROUNDS: Final = 4  # one for each limb
TRIAL_REACHES_M: Final = (0.25, 0.20, 0.15)  # from a proposed limb to the seen one
TRIAL_NODES: Final = 800  # a third of the nodes tell a good pose from a bad one
REFINED_REACHES_M: Final = (0.10, 0.07, 0.06)
LEAST_GAIN: Final = 0.008  # share of the nodes that another pose must explain besides


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """What a search found: registration, of the best pose; rounds in which another pose was taken (0: none)."""

    registration: Registration
    rounds: int


def needs_search(explanation: Explanation) -> bool:
    """Whether the picture shows that a limb is elsewhere."""
    return explanation.uncovered_m2 >= LOOK_AGAIN_M2


def search_limbs(
    body: Body, found: Registration, predicted: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> Search:
    """The registration with limbs moved to where they are seen, as long as that explains the frame better.

    predicted: what was expected; a limb found elsewhere shows that it was wrong, so that it counts for as little as
    after ``UNSEEN_S`` without sight.
    """
    uncertain = predicted.later(predicted.pose, UNSEEN_S)
    trial = replace(config, reaches_m=TRIAL_REACHES_M, node_count=min(config.node_count, TRIAL_NODES))
    pose, rounds = found.belief.pose, 0
    for _ in range(ROUNDS):
        better = _best(body, pose, _proposals(body, pose, evidence), uncertain, evidence, trial)
        if better is None:
            break
        refined = replace(config, reaches_m=REFINED_REACHES_M)
        pose, rounds = descend(body, better, replace(uncertain, pose=better), evidence, refined), rounds + 1
        if not needs_search(explain(body.points, pose_points(body, pose), evidence)):
            break
    if rounds == 0:
        return Search(found, 0)
    other = posterior(body, pose, replace(uncertain, pose=pose), evidence, config)
    return Search(other if other.found else found, rounds)


def _proposals(body: Body, pose: Pose, evidence: Evidence) -> Iterator[Pose]:
    explanation = explain(body.points, pose_points(body, pose), evidence)
    for path in uncovered_paths(evidence, explanation):
        yield from limb_poses(body, pose, path)
    yield from exchanged(body, pose)


def _best(
    body: Body,
    pose: Pose,
    proposals: Iterable[Pose],
    uncertain: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
) -> Pose | None:
    """The proposal that explains the frame best after a short registration; None if none is clearly better."""
    reach_m = config.reaches_m[-1]
    nodes = min(len(evidence.surface), config.node_count)
    least = evidence_cost(body, pose, evidence, reach_m, config)
    least -= LEAST_GAIN * nodes * unexplained_node_cost(reach_m, config)
    best: Pose | None = None
    for proposal in proposals:
        tried = descend(body, proposal, replace(uncertain, pose=proposal), evidence, config)
        cost = evidence_cost(body, tried, evidence, reach_m, config)
        if cost < least:
            best, least = tried, cost
    return best
