"""GMDS and d_PE: their searches against all maps tried out, isometries, mirror images, the paper's two criteria."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from bent_sheets import hill, sheet
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_builder import moved

from anchorpose.research.features.distortion import distortion_m, least_distortion, surface_distance
from anchorpose.research.features.gmds import GmdsConfig, gmds_maps, match_by_gmds
from anchorpose.research.features.map_search import branch_and_bound, stress_m
from anchorpose.surface.mesh import keep_nodes

pytestmark = pytest.mark.thorough

EVERY_NODE = GmdsConfig(samples=63, candidates=63)


def some_distances(seed: int, count: int) -> np.ndarray:
    """Distances between random places."""
    places = np.random.default_rng(seed).normal(size=(count, 3))
    return np.linalg.norm(places[:, None] - places[None], axis=2).astype(np.float32)


def change(a: np.ndarray, b: np.ndarray, match: np.ndarray) -> np.ndarray:
    """(n, n) change of every distance under a map."""
    return np.abs(a.astype(np.float64) - b[np.ix_(match, match)])


def descriptor_cost(a: np.ndarray, b: np.ndarray, match: np.ndarray) -> float:
    """Sum over nodes of the Euclidean distance between full descriptors (paper, Eq. euclidean)."""
    return float(np.sqrt((change(a, b, match) ** 2).sum(axis=1)).sum())


def pair_costs(a: np.ndarray, b: np.ndarray, maps: np.ndarray, cap: float) -> np.ndarray:
    """(m,) of maps (m, n): the sum of capped squared changes, each pair counted once."""
    changes = np.abs(a.astype(np.float64) - b[maps[:, :, None], maps[:, None, :]])
    return (np.minimum(changes, cap) ** 2).sum(axis=(1, 2)) / 2.0


def all_maps(count_a: int, count_b: int) -> np.ndarray:
    return np.array(list(product(range(count_b), repeat=count_a)))


def search(
    a: np.ndarray, b: np.ndarray, cap: float, kept: int, steps: int = 10**6, same: float = 0.0
) -> tuple[np.ndarray, np.ndarray, int]:
    return branch_and_bound(a, b, cap, np.inf, kept, same, steps)


@settings(max_examples=40)
@given(st.integers(2, 5), st.integers(1, 5), st.integers(0, 10_000), st.sampled_from([0.3, 1.0, 100.0]))
def test_branch_and_bound_finds_what_trying_all_maps_finds(count_a, count_b, seed, cap):
    a, b = some_distances(seed, count_a), some_distances(seed + 1, count_b)
    maps, costs, _ = search(a, b, cap, kept=3)
    every = np.sort(pair_costs(a, b, all_maps(count_a, count_b), cap))
    np.testing.assert_allclose(costs[: len(every)], every[:3], atol=1e-5)
    np.testing.assert_allclose(pair_costs(a, b, maps[: len(every)], cap), costs[: len(every)], atol=1e-5)


def test_alternatives_differ_in_at_least_one_place():
    a, b = some_distances(1, 4), some_distances(2, 6)
    maps, costs, _ = search(a, b, 100.0, kept=5, same=1.0)
    assert (np.diff(costs) >= 0).all()
    for first in range(5):
        for second in range(first):
            assert b[maps[first], maps[second]].max() > 1.0


def test_a_search_that_must_stop_early_reports_it():
    a, b = some_distances(3, 6), some_distances(4, 30)
    hurried, patient = search(a, b, 100.0, 1, steps=40), search(a, b, 100.0, 1)
    assert hurried[2] == 40 < patient[2]
    assert hurried[1][0] >= patient[1][0]
    surface = hill(0.04)
    assert not gmds_maps(surface, surface, GmdsConfig(max_branches=10)).proven
    assert gmds_maps(surface, surface).proven


def test_a_mesh_is_matched_with_itself_after_it_was_moved():
    whole = hill(0.04)
    np.testing.assert_array_equal(match_by_gmds(whole, moved(whole), EVERY_NODE), np.arange(len(whole)))
    maps = gmds_maps(whole, moved(whole), EVERY_NODE)
    assert maps.stress_m[0] < 1e-6
    np.testing.assert_array_equal(maps.places[0], maps.samples)


def test_a_part_of_a_mesh_is_found_on_the_whole():
    whole = hill(0.04)
    part = np.flatnonzero(whole.pixel[:, 1] >= 2)
    match = match_by_gmds(keep_nodes(whole, np.isin(np.arange(len(whole)), part)), whole, EVERY_NODE)
    away = np.linalg.norm(whole.points_m[match] - whole.points_m[part], axis=1)
    assert np.median(away) == 0.0
    assert away.max() < 0.05


def test_distances_say_how_much_a_hill_differs_from_a_sheet():
    flat, low, high = hill(0.0), hill(0.03), hill(0.06)
    stress = [gmds_maps(flat, other, EVERY_NODE).stress_m[0] for other in (flat, low, high)]
    assert stress[0] < 1e-6
    assert 0.001 < stress[1] < stress[2]


def test_the_mirror_image_is_an_alternative():
    maps = gmds_maps(sheet(), sheet(), GmdsConfig(samples=63, candidates=63, finalists=4))
    assert len(maps.places) == 4  # a rectangle has four isometries
    assert (maps.stress_m < 1e-3).all()


def test_nodes_without_a_position_and_on_small_pieces_have_no_match():
    whole = hill(0.04)
    points = whole.points_m.copy()
    points[5] = np.nan
    rest = keep_nodes(replace(whole, points_m=points), whole.pixel[:, 1] != 1)  # the first column by itself
    match = match_by_gmds(rest, whole, GmdsConfig(min_piece=0.2))
    np.testing.assert_array_equal(match < 0, (rest.pixel[:, 1] == 0) | ~np.isfinite(rest.points_m[:, 0]))
    nothing = keep_nodes(whole, np.zeros(len(whole), bool))
    assert (match_by_gmds(whole, nothing) == -1).all()
    assert len(match_by_gmds(nothing, whole)) == 0


@given(st.integers(2, 12), st.integers(1, 12), st.integers(0, 10_000))
def test_the_cost_of_a_map_lies_between_twice_its_distortion_and_the_bound_of_the_paper(count_a, count_b, seed):
    """Zero distortion and zero cost mean the same, an isometry; this is why the paper calls both equivalent."""
    a, b = some_distances(seed, count_a), some_distances(seed + 1, count_b)
    match = np.random.default_rng(seed).integers(0, count_b, count_a)
    worst, cost = distortion_m(a, b, match), descriptor_cost(a, b, match)
    assert 2 * worst - 1e-9 <= cost <= count_a * np.sqrt(count_a - 1) * worst + 1e-9
    assert cost <= count_a * np.sqrt(count_a) * worst + 1e-9  # as the paper has it


def test_the_two_criteria_of_the_paper_and_the_stress_may_choose_different_maps():
    """So "essentially equivalent" holds for isometries, not for what is best otherwise."""
    differ = set()
    for seed in range(20):
        a, b = some_distances(seed, 4), some_distances(seed + 100, 4)
        maps = all_maps(4, 4)
        by_worst = least_distortion(a, b).match
        by_all = min(maps, key=lambda match: descriptor_cost(a, b, match))
        by_stress = search(a, b, 100.0, 1)[0][0]
        assert stress_m(a, b[np.ix_(by_stress, by_stress)], 100.0) <= distortion_m(a, b, by_worst) + 1e-6
        differ |= {name for name, other in (("sum", by_all), ("stress", by_stress)) if (other != by_worst).any()}
    assert differ == {"sum", "stress"}


@settings(max_examples=60)
@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 10_000))
def test_no_map_distorts_less(count_a, count_b, seed):
    a, b = some_distances(seed, count_a), some_distances(seed + 1, count_b)
    found = least_distortion(a, b)
    every = [distortion_m(a, b, match) for match in all_maps(count_a, count_b)]
    assert found.proven
    assert found.distortion_m == pytest.approx(min(every), abs=1e-6)
    assert found.distortion_m == pytest.approx(distortion_m(a, b, found.match), abs=1e-6)
    assert found.d_pe_m == found.distortion_m / 2.0


def test_it_is_zero_for_isometric_surfaces_and_grows_with_what_is_bent_out_of_its_plane():
    flat = hill(0.0)
    apart = [surface_distance(flat, other, 6, len(other)) for other in (moved(flat), hill(0.03), hill(0.06))]
    assert all(found.proven for found in apart)
    assert apart[0].d_pe_m < 1e-4
    assert 1e-4 < apart[1].d_pe_m < apart[2].d_pe_m


def test_a_search_for_the_least_distortion_that_must_stop_early_reports_it():
    a, b = some_distances(3, 6), some_distances(4, 30)
    hurried, patient = least_distortion(a, b, max_branches=20), least_distortion(a, b)
    assert not hurried.proven
    assert patient.proven
    assert hurried.distortion_m >= patient.distortion_m


def test_what_is_no_matrix_of_distances_is_refused():
    square = some_distances(1, 3)
    for wrong in (square[:2], square + 1.0, np.where(square > 0.0, np.inf, square), np.triu(square)):
        with pytest.raises(ValueError, match="distances"):
            least_distortion(square, wrong)
    with pytest.raises(ValueError, match="empty"):
        least_distortion(square, np.zeros((0, 0)))
    assert least_distortion(np.zeros((0, 0)), square).distortion_m == 0.0
