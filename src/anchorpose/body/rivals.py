"""Poses that explain the images almost as well as the best one, followed until the images decide (paper, Section IV-D).

The best pose of a frame and its rivals are registered to every frame side by side. Whichever explains the last frames
clearly better is reported; until then each rival is part of sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.special import log_ndtr

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence
from anchorpose.body.pose import LIMB_OF_JOINTS, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import Registration, register
from anchorpose.body.skin_points import Body

APART_M: Final = 0.08  # poses whose joints are nowhere farther apart are one: as much as clothes and holds move
LIMB_ERROR: Final = 4.0
"""Nats by which errors of shape and clothes change a comparison of poses, for each limb, or the trunk, that differs.

Followed side by side where a body is hidden but for head and arms, the right body and the same turned round differed by
3 and 5 nats in the median, with standard deviations of 14 and 25 (``benchmarks/run.py facings``)."""

MEMORY: Final = 0.8  # share of the lag that a frame passes on: those differences are as alike from frame to frame
LEAST_GAIN: Final = 3.0  # nats: another pose must be twenty times as likely
DECIDED: Final = 6.0  # nats: a pose that is e^6 times less likely than the best
MOST: Final = 3  # rivals: each costs as much as the registration


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """A pose besides the best.

    lag: by how much it explains the last frames worse, believed nats, a mean of them; moved: what is left of the nats
    that it costs to be elsewhere than expected.
    """

    belief: PoseBelief
    lag: float
    moved: float = 0.0

    @property
    def behind(self) -> float:
        """How much less likely it is than the best pose, nats."""
        return self.lag + self.moved


def believed(lead: float, parts: int) -> float:
    """How far a lead in nats is to be believed, nats: the logarithm of how much likelier it is right than wrong.

    parts: how many limbs, or the trunk, have other places; errors of shape and clothes are alike in all of them.
    """
    deviations = abs(lead) / (LIMB_ERROR * max(parts, 1))
    odds = float(log_ndtr(deviations) - log_ndtr(-deviations))
    return float(np.copysign(min(abs(lead), odds), lead))


def parts_apart(body: Body, one: Pose, other: Pose) -> int:
    """How many limbs, or the trunk, are not in one place."""
    away_m = np.linalg.norm(body.joints(one) - body.joints(other), axis=1)
    return len(np.unique(LIMB_OF_JOINTS[away_m > APART_M]))


def follow_rivals(
    body: Body,
    best: Registration,
    rivals: Sequence[Rival],
    evidence: Evidence,
    elapsed_s: float,
    config: RegistrationConfig,
) -> tuple[Registration, tuple[Rival, ...]]:
    """The best registration of a frame and what is left of its rivals: one that is clearly likelier takes its place."""
    if not rivals:
        return best, ()
    most, followed = log_probability(body, best.belief.pose, evidence), list[tuple[Registration, Rival]]()
    for rival in rivals:
        found = register(body, rival.belief.later(rival.belief.pose, elapsed_s), evidence, no_constraints(), config)
        if not found.found:
            continue
        lead = most - log_probability(body, found.belief.pose, evidence)
        lead = believed(lead, parts_apart(body, best.belief.pose, found.belief.pose))
        lag = MEMORY * rival.lag + (1.0 - MEMORY) * lead
        followed.append((found, Rival(found.belief, lag, MEMORY * rival.moved)))
    first = min(followed, key=lambda one: one[1].behind, default=None)
    if first is None or first[1].behind >= -LEAST_GAIN:
        return best, rivals_of(body, best.belief, [rival for _, rival in followed])
    found, taken = first
    others = [replace(rival, lag=rival.lag - taken.behind) for one, rival in followed if one is not found]
    return found, rivals_of(body, found.belief, [*others, Rival(best.belief, -taken.behind)])


def rivals_of(body: Body, best: PoseBelief, others: Sequence[Rival]) -> tuple[Rival, ...]:
    """The likeliest few of others that are neither the best pose nor each other, and not decided against."""
    kept = list[Rival]()
    for rival in sorted(others, key=lambda one: one.behind):
        poses = [best.pose, *(one.belief.pose for one in kept)]
        if rival.lag < DECIDED and all(parts_apart(body, rival.belief.pose, pose) for pose in poses):
            kept.append(rival)
    return tuple(kept[:MOST])


def with_rivals(body: Body, joints_m: np.ndarray, sigma_m: np.ndarray, rivals: Sequence[Rival]) -> np.ndarray:
    """(21,) sigma of the joints (21, 3) of the best pose, of the mixture with its rivals, per axis.

    A rival's weight is its likelihood. Its own spread is taken to be that of the best pose.
    """
    weight = np.exp(-np.array([0.0, *(rival.behind for rival in rivals)]))
    weight /= weight.sum()
    variance = sigma_m**2
    for share, rival in zip(weight[1:], rivals, strict=True):
        variance = variance + share * ((body.joints(rival.belief.pose) - joints_m) ** 2).sum(axis=1) / 3.0
    return np.asarray(np.sqrt(variance))
