"""Bright and shadow regions, and what of the paper's two propositions holds; docs/occlusion.md has the proofs."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from occlusion_builder import Pierced, cylinder, elliptic_hole, lattice_hole
from surface_builder import flat_grid, grid_surface

from anchorpose.research.geodesic_solvers import Solver
from anchorpose.research.occlusion import Light, Occlusion, border_is_covered, light_from, occlude

ROUNDING_M = 2e-6
"""Tolerance for the propositions on flat sheets: there the exact solver leaves nothing but rounding."""

GRAZING_M = 2e-4
"""What such a tolerance lets through: an edge of 10 mm counts as lit where the way bends by 0.02 rad, which two nodes
0.4 m away on both sides may do twice: 0.2 * 0.04**2 / 2."""

HOLES = st.builds(
    elliptic_hole, half=st.just(12), hole=st.integers(3, 6), stretch=st.floats(0.7, 1.4), turn_rad=st.floats(0.0, np.pi)
)


def at(pierced: Pierced, x: float, y: float) -> int:
    """The seen node nearest to a place of the flat sheet, in metres from its middle."""
    away = np.linalg.norm(pierced.flat_m - [x, y], axis=1)
    return int(np.argmin(np.where(pierced.hidden, np.inf, away)))


def lights(pierced: Pierced, nodes, **how) -> list[Light]:
    occlusion = occlude(pierced.whole, pierced.hidden, **how)
    return [light_from(occlusion, node) for node in nodes]


def some_nodes(pierced: Pierced, seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).choice(np.flatnonzero(~pierced.hidden), count, replace=False)


def shared(one: Light, other: Light) -> set[tuple[int, int]]:
    return {tuple(edge) for edge in one.bright.edges.tolist()} & {tuple(edge) for edge in other.bright.edges.tolist()}


def test_the_boundary_of_a_hole_is_the_ring_around_it_and_not_the_sheet_s_rim():
    pierced = elliptic_hole(hole=5)
    boundary = occlude(pierced.whole, pierced.hidden).boundary
    assert len(boundary.nodes) == len(boundary.edges) == 36  # of 40, the grid's corners are cut off by a triangle each
    np.testing.assert_allclose(np.linalg.norm(pierced.flat_m[boundary.nodes], axis=1), 5 * 0.013, rtol=1e-9)
    np.testing.assert_array_equal(np.bincount(boundary.edges.ravel())[boundary.nodes], 2)  # a closed ring


def test_an_occlusion_at_the_sheet_s_rim_has_a_boundary_where_it_was_whole_only():
    pierced = lattice_hole(15, 15, lambda row, col: (row < -4) & (np.abs(col) < 3))
    boundary = occlude(pierced.whole, pierced.hidden).boundary
    row, col = pierced.whole.pixel[boundary.nodes].T
    assert set(zip(row.tolist(), col.tolist(), strict=True)) == (
        {(3, col) for col in range(5, 10)} | {(row, col) for row in range(3) for col in (4, 10)}
    )


def test_light_falls_in_straight_lines():
    """From 0.15 m beside a round hole of 0.065 m: bright between the two tangents, shadow between and behind them."""
    pierced = elliptic_hole(hole=5)
    source = at(pierced, -0.15, 0.0)
    (light,) = lights(pierced, [source])
    x, y = (pierced.flat_m - pierced.flat_m[source]).T
    centre = np.linalg.norm(pierced.flat_m[source])
    away, off = np.hypot(x, y), np.abs(np.arctan2(y, x))
    half, tangent = np.arcsin(0.065 / centre), np.sqrt(centre**2 - 0.065**2)
    behind = (off < half) & (away > tangent)
    shadow = np.zeros(len(x), bool)
    shadow[light.shadow.nodes] = True
    assert not shadow[(off > half) & ~pierced.hidden].any()
    assert shadow[behind & (off < half - 0.15) & ~pierced.hidden].all()  # deep in; at its edge little is distorted
    bright = np.zeros(len(x), bool)
    bright[light.bright.nodes] = True
    facing = np.zeros(len(x), bool)
    facing[light.occlusion.boundary.nodes] = True
    np.testing.assert_array_equal(bright[facing & (away < tangent - 0.005)], True)
    np.testing.assert_array_equal(bright[facing & (away > tangent + 0.02)], False)


@settings(max_examples=15)
@given(HOLES, st.integers(0, 1000))
def test_bright_and_shadowed_make_up_the_boundary(pierced, seed):
    (light,) = lights(pierced, some_nodes(pierced, seed, 1))
    boundary = light.occlusion.boundary
    both = np.concatenate([light.bright.nodes, light.shadowed_boundary.nodes])
    np.testing.assert_array_equal(np.sort(both), boundary.nodes)
    assert set(light.shadowed_boundary.nodes) <= set(light.shadow.nodes)
    dark = np.isin(light.shadow.edges, light.shadow.nodes)
    assert dark.all()


@settings(max_examples=15)
@given(HOLES, st.integers(0, 1000))
def test_shadow_is_mutual_and_distances_only_grow(pierced, seed):
    nodes = some_nodes(pierced, seed, 6)
    seen = np.array([light.distortion_m[nodes] for light in lights(pierced, nodes)])
    np.testing.assert_allclose(seen, seen.T, atol=1e-5)
    assert seen.min() > -1e-5


@pytest.mark.thorough
@settings(max_examples=25)
@given(HOLES, st.integers(0, 1000))
def test_proposition_1_on_a_sheet_with_a_smooth_convex_hole(pierced, seed):
    """Bright regions that share an edge of the rim; what a shared corner is worth comes below."""
    _assert_proposition_1(pierced, some_nodes(pierced, seed, 6), GRAZING_M)


@settings(max_examples=10)
@given(st.integers(4, 6), st.integers(0, 1000))
def test_proposition_1_on_a_ball(hole, seed):
    """Less than a hemisphere: two great circles meet there once. The mesh is a polyhedron, and only nearly a ball."""
    pierced = elliptic_hole(hole=hole, ball_m=0.22)
    inner = np.flatnonzero(~pierced.hidden & (np.linalg.norm(pierced.flat_m, axis=1) < 0.19))  # ways stay on the sheet
    _assert_proposition_1(pierced, np.random.default_rng(seed).choice(inner, 6, replace=False), 0.002)


def _assert_proposition_1(pierced, nodes, most_m):
    seen = lights(pierced, nodes, tolerance_m=ROUNDING_M)
    for one, light in enumerate(seen):
        for other in range(one):
            if shared(light, seen[other]):
                assert light.distortion_m[nodes[other]] < most_m


def test_proposition_1_fails_where_the_bright_regions_share_a_corner_only():
    """Both sides of a wedge see its tip, and the straight way between them goes through the wedge."""
    pierced = lattice_hole(31, 31, lambda row, col: (row >= 0) & (row < 10) & (np.abs(col) <= row))
    left, right, tip = (int(np.ravel_multi_index(place, (31, 31))) for place in ((19, 6), (19, 24), (14, 15)))
    one, other = lights(pierced, [left, right])
    assert set(one.bright.nodes) & set(other.bright.nodes) == {tip}
    assert not shared(one, other)
    assert one.distortion_m[right] > 0.03


def test_proposition_1_fails_around_a_cylinder():
    """A tube of 1 m around, a diamond on it: both nodes see a whole part of one side, one from half around the tube.

    They are nearer to each other the other way around, and there the diamond is.
    """
    around, middle = 40, 20
    whole = cylinder(around, 40, 0.025)
    row, col = np.divmod(np.arange(len(whole)), around)
    right, up = (col + around // 2) % around - around // 2, middle - row
    occlusion = occlude(whole, np.abs(right) + np.abs(up) < 8)
    one, other = (int((middle - y) * around + x % around) for x, y in ((2, 6), (24, -16)))
    near, far = light_from(occlusion, one), light_from(occlusion, other)
    assert len(shared(near, far)) >= 3
    assert near.distortion_m[other] > 0.05


ROUND_ABOUT = [(0.17 * np.cos(angle), 0.17 * np.sin(angle)) for angle in np.radians([90, 210, 330])]


def test_proposition_2_holds_for_the_union_of_bright_regions_and_the_intersection_is_never_met():
    """Three anchors around a hole light its border together. No two of them light it all, and none does alone."""
    pierced = elliptic_hole(half=17, hole=3)
    anchors = [at(pierced, *place) for place in ROUND_ABOUT]
    seen = lights(pierced, anchors, tolerance_m=ROUNDING_M)
    boundary = seen[0].occlusion.boundary
    assert border_is_covered(seen)
    assert not set.intersection(*(set(light.bright.nodes.tolist()) for light in seen))
    least = np.min([light.distortion_m for light in seen], axis=0)
    assert np.nanmax(least) < GRAZING_M
    for light in seen:
        assert len(light.bright.edges) < len(boundary.edges) / 2


@settings(max_examples=25)
@given(HOLES, st.floats(0.0, 2 * np.pi), st.integers(3, 5))
def test_proposition_2_whenever_the_union_covers_the_border(pierced, first_rad, count):
    """With anchors around the hole, which mostly cover its border."""
    angles = first_rad + 2 * np.pi * np.arange(count) / count
    nodes = [at(pierced, 0.15 * np.cos(angle), 0.15 * np.sin(angle)) for angle in angles]
    seen = lights(pierced, nodes, tolerance_m=ROUNDING_M)
    least = np.min([light.distortion_m for light in seen], axis=0)
    if border_is_covered(seen):
        assert np.nanmax(least) < GRAZING_M


def test_without_cover_a_node_beside_the_dark_border_has_no_anchor_though_bright_regions_intersect():
    """So it is not enough either that the intersection is not empty."""
    pierced = elliptic_hole(hole=5)
    anchors = [at(pierced, -0.17, 0.05), at(pierced, -0.17, -0.05)]
    one, other = lights(pierced, anchors)
    assert shared(one, other)
    assert not border_is_covered([one, other])
    behind = at(pierced, 0.09, 0.0)
    assert min(one.distortion_m[behind], other.distortion_m[behind]) > 0.005


def test_definition_4_calls_an_edge_bright_that_is_dark_where_a_hole_s_far_side_has_no_node_between_its_ends():
    """From before the narrow end of a trapezium both ends of its far side are seen, but no point between them."""
    inner = np.array([[(-3, 0), (-1, 0.3), (-0.5, 2.5)], [(-1, -0.3), (0, 0), (1, 1)], [(-0.5, -2.5), (1, -1), (3, 0)]])
    flat = np.array(
        [[(-6, 4), (-4, 5), (-2, 6), (1, 6), (4, 5)]]
        + [[(-6, y), *row, (6, y + 1)] for y, row in zip((0, -1, -3), inner.tolist(), strict=True)]
        + [[(-6, -6), (-3, -6), (0, -6), (3, -6), (6, -6)]]
    )
    sheet = grid_surface(np.concatenate([np.zeros((5, 5, 1)), flat[..., ::-1] * 0.01], axis=2))
    source, (near, far) = 6, ((7, 11), (13, 17))  # NW of the middle; its N and W, E and S
    light = light_from(occlude(sheet, np.arange(25) == 12, tolerance_m=1e-6), source)
    assert {tuple(edge) for edge in light.occlusion.boundary.edges.tolist()} == {near, far, (7, 13), (11, 17)}
    assert far in {tuple(edge) for edge in light.bright.edges.tolist()}
    assert light.distortion_m[18] > 1e-4  # the node straight behind that side
    assert border_is_covered([light])  # so the nodes of a side must be close together


@pytest.mark.parametrize("solver", [Solver.FAST_MARCHING, Solver.DIJKSTRA])
def test_faster_solvers_see_the_same_shadow_but_for_its_edge(solver):
    pierced = elliptic_hole(hole=5)
    source = at(pierced, -0.15, 0.03)
    (exact,) = lights(pierced, [source])
    (other,) = lights(pierced, [source], solver=solver, tolerance_m=0.004)
    deep = np.flatnonzero(exact.distortion_m > 0.012)
    lit = np.flatnonzero(exact.distortion_m < 1e-4)
    if solver is Solver.FAST_MARCHING:
        assert np.isin(deep, other.shadow.nodes).all()
    assert not np.isin(lit, other.shadow.nodes).any()


def test_a_cut_through_the_sheet_puts_the_other_side_into_endless_shadow():
    pierced = lattice_hole(9, 15, lambda row, col: (row > -9) & (col == 0))
    (light,) = lights(pierced, [0])
    beyond = pierced.flat_m[:, 0] > 7 * 0.013 + 1e-6
    np.testing.assert_array_equal(np.isinf(light.distortion_m), beyond)
    assert np.isnan(light.distortion_m[pierced.hidden]).all()
    assert set(np.flatnonzero(beyond)) == set(light.shadow.nodes)


def test_what_is_no_occlusion_is_refused():
    whole = flat_grid(5, 5, 0.013)
    for hidden in (np.zeros(25, bool), np.ones(25, bool)):
        with pytest.raises(ValueError, match="hides some"):
            occlude(whole, hidden)
    for hidden in (np.zeros(24, bool), np.zeros(25, int)):
        with pytest.raises(ValueError, match="hidden must be"):
            occlude(whole, hidden)
    one = np.arange(25) == 12
    with pytest.raises(ValueError, match="tolerance_m"):
        occlude(whole, one, tolerance_m=-1.0)
    occlusion: Occlusion = occlude(whole, one)
    for node in (12, -1, 25):
        with pytest.raises(ValueError, match="not on the seen surface"):
            light_from(occlusion, node)
    assert not border_is_covered([])
