"""Find one frame's pose: register the articulated body, from its predicted pose, to the frame's surface and to the
nodes that the track tree matched with nodes of the frame tracked before (paper, Section V).
"""

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

# minimum share of the surface's nodes that must lie near the body; with a smaller share, the surface is assumed to
# belong to another person
LEAST_EXPLAINED: Final = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Registration:
    """The result of registering the body to one frame."""

    belief: PoseBelief  # belief in the pose; the unchanged prediction if the body was not found
    explained: float  # share of the surface's nodes near the body; 0 if nothing was seen
    found: bool  # False if too little was seen or the surface does not belong to this body


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """Constraint rows that are added to the rows from the frame's evidence."""

    first: Constraints  # rows that are used in the first ``held_steps`` solver steps
    always: Constraints  # rows that are used in all solver steps


def register(
    body: Body,
    predicted: PoseBelief,
    evidence: Evidence,
    held: Constraints,
    config: RegistrationConfig,
    fixed: Constraints | None = None,
) -> Registration:
    """Register all parts of the body to a frame together; the parts stay joined, and bones keep their length. (The
    paper registers each part alone, by ICP: iterative closest point.)

    held: rows from the anchors and from the nodes that the track tree matched with nodes of the frame tracked before;
    used only in the first solver steps. fixed: rows used in all steps; these rows do not reduce the uncertainty of the
    pose, since they are not observations.
    """
    if len(evidence.surface) < config.least_nodes:
        return Registration(predicted, 0.0, False)
    rows = Held(held, no_constraints() if fixed is None else fixed)
    pose = descend(body, predicted.pose, predicted, evidence, config, rows)
    return posterior(body, pose, predicted, evidence, config)


def posterior(
    body: Body, pose: Pose, predicted: PoseBelief, evidence: Evidence, config: RegistrationConfig
) -> Registration:
    """Return the belief in a pose, given the evidence of one frame, and whether the seen surface belongs to this body.

    Only seen skin makes a pose more certain. Visible background shows where no limb is. This constraint is one-sided,
    so it is left out of the covariance.
    """
    posed = pose_points(body, pose)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, config.reaches_m[-1], config)
    share = len(rows) / max(1, min(len(evidence.surface), config.node_count))
    # if the total is below 0, the readings are more probable without this body
    if share < LEAST_EXPLAINED or likelihood(body, pose, evidence).total < 0.0:
        return Registration(predicted, share, False)
    expected = (predicted.pose, predicted.information)
    hidden = hidden_bones(body.points, rows, config.rows_per_observation)
    prior = prior_equations(body.points, pose, expected, hidden)
    hessian = pose_equations(body, pose, posed, rows, prior, config.rows_per_observation).hessian
    seen = hessian - range_information(body.points, pose, hidden)
    return Registration(PoseBelief(pose, np.linalg.inv(hessian), seen), share, True)


def node_parts(body: Body, pose: Pose, nodes_m: np.ndarray, reach_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the skin point (n,) nearest to each node (point of the seen surface), and the bone (n,) that moves this
    point; -1 if no point is within reach_m.
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
    """Return the pose that is reached from ``pose`` by one Gauss-Newton step per distance in ``config.reaches_m``."""
    expected = (predicted.pose, predicted.information)
    for number, reach_m in enumerate(config.reaches_m):
        rows = [evidence_rows(body, pose, evidence, reach_m, config)]
        if held is not None:
            rows += [held.always, held.first] if number < config.held_steps else [held.always]
        pose = damped_step(body, pose, join(rows), expected, config.rows_per_observation)
    return pose
