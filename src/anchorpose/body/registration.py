"""One frame's pose: articulated registration from the predicted pose and the tree's pairs (paper, Section IV)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints, join, no_constraints, surface_constraints
from anchorpose.body.evidence import Evidence, evidence_rows
from anchorpose.body.fit import damped_step, hidden_bones, pose_equations, prior_equations, range_information
from anchorpose.body.likelihood import likelihood
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import Body, pose_points

LEAST_EXPLAINED: Final = 0.3  # share of nodes near the body below which it is not this body that is seen


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """belief in the pose; explained: share of the surface's nodes that the body accounts for, 0 where nothing was seen.

    found is False where too little was seen or it is not this body: the belief is then the prediction, unchanged.
    """

    belief: PoseBelief
    explained: float
    found: bool


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Rows besides what is seen; first: of the first steps; always: of all steps."""

    first: Constraints
    always: Constraints


def register(
    body: Body,
    predicted: PoseBelief,
    evidence: Evidence,
    held: Constraints,
    config: RegistrationConfig,
    fixed: Constraints | None = None,
) -> Registration:
    """tau-hat = ICP(tau, phi), for all parts at once: they stay joined, and bones keep their length.

    held: rows of the tree and the anchors; they start the registration, the surface itself ends it. fixed: rows of
    every step, which make no pose more certain: they were not seen.
    """
    if len(evidence.surface) < config.least_nodes:
        return Registration(predicted, 0.0, False)
    rows = Held(held, no_constraints() if fixed is None else fixed)
    pose = descend(body, predicted.pose, predicted, evidence, config, rows)
    return posterior(body, pose, predicted, evidence, config)


def posterior(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> Registration:
    """Return the belief in a pose that was found, given the evidence, and whether it is this body that is seen.

    Only skin that is seen makes a pose more certain. That a limb is not where the room is seen is one-sided, so it is
    left out of the covariance.
    """
    posed = pose_points(body, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], config)
    share = len(rows) / max(1, min(len(evidence.surface), config.node_count))
    if share < LEAST_EXPLAINED or likelihood(body, pose, evidence).total < 0.0:  # likelier without this body
        return Registration(predicted, share, False)
    expected = (predicted.pose, predicted.information)
    hidden = hidden_bones(body.points, rows, config.rows_per_observation)
    prior = prior_equations(body.points, pose, expected, hidden)
    hessian = pose_equations(body, pose, posed, rows, prior, config.rows_per_observation).hessian
    seen = hessian - range_information(body.points, pose, hidden)
    return Registration(PoseBelief(pose, np.linalg.inv(hessian), seen), share, True)


def node_parts(body: Body, pose: Pose, nodes_m: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest skin point of each node (n,), -1 beyond reach, and the bone (n,) that moves it, -1
    likewise.
    """
    point = nearest_point(pose_points(body, pose).points_m, nodes_m, reach_m)
    return point, np.where(point >= 0, body.points.part[point], -1)


def descend(
    body: Body,
    pose: Pose,
    predicted: PoseBelief,
    evidence: Evidence,
    config: RegistrationConfig,
    held: Held | None = None,
) -> Pose:
    """Gauss-Newton from one pose, with less and less reach (``config.reaches_m``)."""
    expected = (predicted.pose, predicted.information)
    for number, reach_m in enumerate(config.reaches_m):
        rows = [evidence_rows(body, pose, evidence, reach_m, config)]
        if held is not None:
            rows += [held.always, held.first] if number < config.held_steps else [held.always]
        pose = damped_step(body, pose, join(rows), expected, config.rows_per_observation)
    return pose
