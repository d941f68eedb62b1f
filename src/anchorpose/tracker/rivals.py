"""Other poses that explain the pictures almost as well, kept until the pictures decide.

A search for limbs may end in a tie: a hand that holds the other elbow, two shanks side by side. The best pose is
reported, the others are registered to every frame beside it, and what they would mean is part of sigma meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import no_constraints
from anchorpose.body.evidence import Evidence, evidence_cost
from anchorpose.body.limb_search import APART_M, farthest_joint_m
from anchorpose.body.pose import PoseBelief
from anchorpose.body.registration import Registration, register
from anchorpose.body.skin_points import Body

MEMORY: Final = 0.8  # share of the lag that a frame passes on: three frames later half is forgotten
DECIDED: Final = 12.0  # a lag so large makes a pose e^6 times less likely than the best


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """A pose besides the best; lag: by how much it explains the last frames worse, as ``evidence_cost``."""

    belief: PoseBelief
    lag: float


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
    least = evidence_cost(body, best.belief.pose, evidence, config.reaches_m[-1], config)
    followed = [(best, 0.0)]
    for rival in rivals:
        expected = rival.belief.later(rival.belief.pose, elapsed_s)
        found = register(body, expected, evidence, no_constraints(), config)
        if found.found and _is_another(body, found, followed):
            cost = evidence_cost(body, found.belief.pose, evidence, config.reaches_m[-1], config)
            followed.append((found, MEMORY * rival.lag + cost - least))
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
    weight = np.exp(-0.5 * np.array([0.0, *(rival.lag for rival in rivals)]))
    weight /= weight.sum()
    variance = sigma_m**2
    for share, rival in zip(weight[1:], rivals, strict=True):
        variance = variance + share * ((body.joints(rival.belief.pose) - joints_m) ** 2).sum(axis=1) / 3.0
    return np.asarray(np.sqrt(variance))
