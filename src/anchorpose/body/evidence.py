"""What one frame offers to the registration of the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from anchorpose.body.constraints import ConstraintConfig, Constraints, join, surface_constraints
from anchorpose.body.fit import FitConfig, pose_equations
from anchorpose.body.outline import Outline, find_outline, outline_constraints
from anchorpose.body.pose import Pose
from anchorpose.body.separation import separation_rows
from anchorpose.body.skin_points import RestPoints, SkinPoints, pose_points
from anchorpose.camera import Camera
from anchorpose.isolation.view import View
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """The patient's surface, and every camera's labelled picture with his outline in it (None: no picture)."""

    surface: Surface
    views: tuple[View | None, ...]
    outlines: tuple[Outline | None, ...]
    cameras: tuple[Camera, ...]


def gather_evidence(surface: Surface, views: Sequence[View | None], cameras: Sequence[Camera]) -> Evidence:
    """Evidence of one frame; outlines are found once."""
    outlines = tuple(None if view is None else find_outline(view) for view in views)
    return Evidence(surface, tuple(views), outlines, tuple(cameras))


def evidence_rows(
    points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence, reach_m: float, config: ConstraintConfig
) -> Constraints:
    """Every node to the skin, skin that should be seen to the outline, and limbs out of the trunk."""
    posed = pose_points(points, rest, pose)
    rows = [surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config)]
    rows.append(separation_rows(points, posed))
    for view, outline, camera in zip(evidence.views, evidence.outlines, evidence.cameras, strict=True):
        if view is not None and outline is not None:
            rows.append(outline_constraints(posed, view, outline, camera, reach_m, config))
    return join(rows)


def evidence_cost(
    points: SkinPoints, rest: RestPoints, pose: Pose, evidence: Evidence, reach_m: float, config: ConstraintConfig,
    fit: FitConfig,
) -> float:  # fmt: skip
    """How badly a pose explains a frame, comparable between poses: rows, joint range, and nodes that nothing explains.

    A node beyond the reach of all skin costs as much as a row that the robust kernel fully doubts.
    """
    rows = evidence_rows(points, rest, pose, evidence, reach_m, config)
    cost = pose_equations(points, rest, pose, pose_points(points, rest, pose), rows, None, fit).cost
    posed = pose_points(points, rest, pose)
    explained = len(surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config))
    missing = min(len(evidence.surface), config.node_count) - explained
    return cost + missing * doubted_node_cost(reach_m, config, fit)


def doubted_node_cost(reach_m: float, config: ConstraintConfig, fit: FitConfig) -> float:
    """What a node costs that nothing explains: a row at the plateau of the robust kernel."""
    return (reach_m / 3.0 / config.surface_sigma_m) ** 2 / fit.rows_per_observation
