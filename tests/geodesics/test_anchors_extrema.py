"""Geodesic extrema by the paper's rule, word for word."""

import numpy as np
import pytest
from surface_builder import flat_grid, star

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import geodesic_extrema, surface_center
from anchorpose.surface.mesh import keep_nodes


def extrema_by_definition(surface, field, radius_m):
    """All v with field(v) > field(v_n) for every other v_n nearer than the radius, node by node."""
    found = []
    for node in range(len(surface)):
        near = geodesic_distance(surface, [node])[0] < radius_m
        near[node] = False
        if np.isfinite(field[node]) and (field[near] < field[node]).all():
            found.append(node)
    return found


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius_m", [0.02, 0.06, 0.15, 1.0])
def test_extrema_are_those_of_the_definition(seed, radius_m):
    rng = np.random.default_rng(seed)
    surface = flat_grid(14, 17, 0.013, rng.random((14, 17)) < 0.8)
    field = rng.normal(size=len(surface)).astype(np.float32)
    field[rng.random(len(surface)) < 0.05] = np.inf
    found = geodesic_extrema(surface, field, radius_m)
    # an unreachable node within the radius is farther than any: the definition leaves no extremum beside it
    assert sorted(found) == extrema_by_definition(surface, field, radius_m)
    assert (np.diff(field[found]) <= 0).all()


def test_of_two_equally_far_nodes_neither_is_an_extremum_and_a_foreign_field_is_refused():
    surface = flat_grid(5, 9, 0.013)
    field = np.zeros(len(surface), np.float32)
    field[[10, 16]] = 1.0
    assert len(geodesic_extrema(surface, field, 0.2)) == 0
    assert sorted(geodesic_extrema(surface, field, 0.05)) == [10, 16]
    surface = flat_grid(3, 3, 0.01)
    with pytest.raises(ValueError, match="field"):
        geodesic_extrema(surface, np.zeros(8, np.float32), 0.1)
    with pytest.raises(ValueError, match="radius_m"):
        geodesic_extrema(surface, np.zeros(9, np.float32), 0.0)


def test_a_figure_of_five_strips_has_five_extrema_at_their_ends():
    ends = {"head": (0.03, 0.6), "l": (0.7, 0.2), "r": (-0.7, 0.25), "fl": (0.2, -0.9), "fr": (-0.2, -0.95)}
    surface = star(ends)
    field = geodesic_distance(surface, [surface_center(surface)])[0]
    found = surface.points_m[geodesic_extrema(surface, field, 0.5)]
    assert len(found) == 5
    for left, up in ends.values():
        assert np.linalg.norm(found[:, 1:] - [up, -left], axis=1).min() < 0.06


def test_the_centre_is_the_node_next_to_the_mean_even_where_a_hole_is_and_nowhere_without_nodes():
    surface = flat_grid(21, 21, 0.01)
    assert surface_center(surface) == 10 * 21 + 10
    middle = np.linalg.norm(surface.points_m - surface.points_m.mean(axis=0), axis=1)
    rim = keep_nodes(surface, middle > 0.045)
    assert np.linalg.norm(rim.points_m[surface_center(rim)] - surface.points_m.mean(axis=0)) < 0.06
    empty = keep_nodes(flat_grid(3, 3, 0.01), np.zeros(9, bool))
    with pytest.raises(DegenerateGeometry):
        surface_center(empty)
