"""Full and anchor descriptors: invariance under rigid motion and isometry, straight lines on a sheet, refusals."""

from functools import partial

import numpy as np
import pytest
from bent_sheets import SPACING, bent, hill, sheet
from surface_builder import moved

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.anchors import Anchors, anchor_descriptor
from anchorpose.research.full_descriptor import full_descriptor
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import Surface


def corners(surface: Surface) -> Anchors:
    """Four anchors at the corners, the fifth missed."""
    corner = [int(np.argmin(surface.pixel @ np.array(way))) for way in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
    node = np.array([*corner, -1], np.int32)
    found = node >= 0
    position_m = np.where(found[:, None], surface.points_m[node], np.nan)
    return Anchors(node=node, position_m=position_m, sigma_m=np.where(found, 0.005, np.nan))


@pytest.mark.parametrize("solver", list(Solver))
@pytest.mark.parametrize("change", [moved, lambda surface: bent(0.35), lambda surface: bent(-0.2)])
def test_descriptors_do_not_change_under_rigid_motion_and_isometry(change, solver):
    before, after = sheet(), change(sheet())
    slack = 1e-6 if solver is not Solver.HEAT else SPACING / 3  # of equal diagonals heat may take the other one
    np.testing.assert_allclose(full_descriptor(after, solver), full_descriptor(before, solver), atol=slack)
    one, other = (
        anchor_descriptor(surface, corners(surface), partial(solve_distance, solver=solver))
        for surface in (before, after)
    )
    np.testing.assert_allclose(one, other, atol=slack)
    assert np.isnan(one[:, 4]).all()


def test_a_hill_is_no_isometry_of_a_sheet():
    assert np.abs(full_descriptor(hill(0.04)) - full_descriptor(hill(0.0))).max() > 0.01


def test_the_full_descriptor_on_a_sheet_is_the_straight_line_to_every_node():
    surface = sheet()
    straight = np.linalg.norm(surface.points_m[:, None] - surface.points_m[None], axis=2)
    np.testing.assert_allclose(full_descriptor(surface), straight, atol=1e-6)


def test_the_full_descriptor_is_refused_where_there_is_a_hole_or_a_second_piece():
    surface = sheet(9, 9)
    with pytest.raises(DegenerateGeometry, match="1 holes"):
        full_descriptor(keep_nodes(surface, (surface.pixel != [4, 4]).any(axis=1)))
    with pytest.raises(DegenerateGeometry, match="2 pieces"):
        full_descriptor(keep_nodes(surface, surface.pixel[:, 1] != 4))
    with pytest.raises(DegenerateGeometry, match="not a single sheet"):
        full_descriptor(keep_nodes(surface, np.zeros(len(surface), bool)))
