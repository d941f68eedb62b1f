"""Decide which way a person faces in a first frame, by the whole body and after searching for its limbs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.evidence import Evidence
from anchorpose.body.initial import FirstPose
from anchorpose.body.limb_search import search_limbs
from anchorpose.body.pose_probability import facing_nats, log_probability
from anchorpose.body.registration import Registration, posterior
from anchorpose.body.rivals import Rival, rivals_of
from anchorpose.body.skin_points import Body, body_points, build_body


class Facing(NamedTuple):
    """A first pose after a search for its limbs. first: the first pose, with the pose and the log probability after the
    search; rivals: poses with the same facing that the frame cannot exclude.
    """

    first: FirstPose
    body: Body
    found: Registration
    rivals: tuple[Rival, ...] = ()


def search_facings(
    facings: Sequence[FirstPose],
    others: Sequence[FirstPose],
    expected: PoseBelief | None,
    evidence: Evidence,
    config: RegistrationConfig,
) -> tuple[Facing, tuple[Rival, ...]]:
    """Search for the limbs of each facing; return the likeliest one, and its rivals.

    A body that is turned round explains a trunk as well as the correct body does; only its limbs show which is correct.
    facings: first poses of one person, the likelier first; others: bodies fitted to the other facing, which remain
    rivals; expected: the pose before the patient was lost, None when the patient is searched for the first time.
    ``found.found`` of the result is False where no facing explains the surface.
    """
    searched = [_searched(first, expected, evidence, config) for first in facings]
    best, *turned = [one for one in searched if one.found.found] or searched[:1]
    if turned and best.first.ahead_of(turned[0].first) < 0.0:
        best, turned = turned[0], [best]
    away = [_rival(best.first, one) for one in (*(one.first for one in turned), *others)]
    return best, rivals_of(best.body, best.found.belief, [*best.rivals, *away])


def _searched(first: FirstPose, expected: PoseBelief | None, evidence: Evidence, config: RegistrationConfig) -> Facing:
    body = build_body(body_points(), first.shape)
    found = posterior(body, first.pose, vague_belief(first.pose), evidence, config)
    if not found.found:
        return Facing(first, body, found)
    search = search_limbs(body, found, expected or vague_belief(found.belief.pose), evidence, config)
    pose = search.registration.belief.pose
    log = log_probability(body, pose, evidence) - 0.5 * first.belief.cost(first.shape)
    now = replace(first, pose=pose, log=log, facing=facing_nats(body, pose, evidence.cameras))
    return Facing(now, body, search.registration, search.rivals)


def _rival(best: FirstPose, turned: FirstPose) -> Rival:
    """Return the pose of the person facing the other way, as a rival of the likeliest first pose."""
    own = None if turned.shape is best.shape else build_body(body_points(), turned.shape)
    return Rival(vague_belief(turned.pose), best.ahead_of(turned), body=own)
