"""Subset hypotheses: psi and its average, against the definition written out."""

from dataclasses import replace
from math import comb

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surface_builder import flat_grid

from anchorpose.surface.mesh import keep_nodes
from anchorpose.track_tree.hypotheses import (
    GateConfig,
    HypothesisConfig,
    anchor_subsets,
    error_bound,
    match_hypotheses,
    nearest_hypotheses,
)

ALL = anchor_subsets(np.ones(5, bool))


def sheet(rows=18, cols=15, spacing=0.013):
    """A flat sheet and its distances to five places around it."""
    surface = flat_grid(rows, cols, spacing)
    anchors = np.array([[0, 0.3, 0], [0, 0, 0.4], [0, 0, -0.5], [0, -0.5, 0.1], [0, -0.6, -0.3]])
    return surface, np.linalg.norm(surface.points_m[:, None] - anchors, axis=2).astype(np.float32)


def is_match_by_definition(match, source, surface, target, subsets, predicted_m, config):
    """Whether each match is a member of psi(v) as close to its average as any; one node and one subset at a time."""
    bound = error_bound(source, subsets, config)
    points = surface.points_m.astype(np.float64)
    right = np.zeros(match.shape, bool)
    for i in range(len(source)):
        near = np.ones(len(points), bool)
        if predicted_m is not None:
            near = np.linalg.norm(points - predicted_m[i], axis=1) <= config.search_radius_m
        for s, subset in enumerate(subsets):
            with np.errstate(invalid="ignore"):
                apart = np.linalg.norm((target - source[i]).astype(np.float64)[:, subset], axis=1)
            psi = near & (apart < bound[i, s])
            if not psi.any():
                right[i, s] = match[i, s] == -1
                continue
            away = np.linalg.norm(points - points[psi].mean(axis=0), axis=1)
            right[i, s] = match[i, s] >= 0 and psi[match[i, s]] and away[match[i, s]] <= away[psi].min() + 1e-7
    return right


@pytest.mark.parametrize("size", [1, 2, 3, 5])
@pytest.mark.parametrize("guided", [True, False])
def test_matches_are_those_of_the_definition(size, guided):
    rng = np.random.default_rng(size)
    surface, target = sheet()
    surface = replace(surface, points_m=surface.points_m + rng.normal(0, 0.002, (len(surface), 3)).astype(np.float32))
    source = (target + rng.normal(0, 0.008, target.shape)).astype(np.float32)[::3]
    source[4, 1], target[7, 3], target[9, 0] = np.nan, np.inf, np.nan
    predicted = (surface.points_m + rng.normal(0, 0.02, (len(surface), 3)))[::3] if guided else None
    subsets, config = anchor_subsets(np.ones(5, bool), size), GateConfig(search_radius_m=0.06)
    found = match_hypotheses(source, surface, target, subsets, predicted, config)
    assert is_match_by_definition(found.match, source, surface, target, subsets, predicted, config).all()
    assert found.match.shape == (len(source), len(subsets))
    assert (found.match >= 0).mean() > 0.5


def test_a_frame_matches_itself_to_within_a_cell():
    surface, descriptor = sheet()
    match = match_hypotheses(descriptor, surface, descriptor, ALL, surface.points_m).match
    inner = (np.abs(surface.pixel - [9, 7]) < 5).all(axis=1)
    apart = np.linalg.norm(surface.points_m[match] - surface.points_m[:, None], axis=2)[inner]
    assert (match >= 0).all()
    assert apart.max() < 0.02


def test_subsets_without_the_falsified_anchor_are_not_touched_by_it():
    surface, descriptor = sheet()
    false = descriptor.copy()
    false[:, 2] += 0.3  # the way to the third anchor leads around a hole
    match = match_hypotheses(descriptor, surface, false, ALL, surface.points_m)
    spared = ~(match.subsets == 2).any(axis=1)
    np.testing.assert_array_equal(match.match[:, ~spared], -1)
    honest = match_hypotheses(descriptor, surface, descriptor, ALL, surface.points_m)
    np.testing.assert_array_equal(match.match[:, spared], honest.match[:, spared])


def test_missing_and_unreachable_distances_never_match():
    surface, descriptor = sheet()
    for unknown in (np.nan, np.inf):
        lost = descriptor.copy()
        lost[:, 0] = unknown
        for source, target in ((lost, descriptor), (descriptor, lost), (lost, lost)):
            match = match_hypotheses(source, surface, target, ALL, surface.points_m).match
            assert (match[:, (ALL == 0).any(axis=1)] == -1).all()
            assert (match[:, ~(ALL == 0).any(axis=1)] >= 0).all()


def test_a_node_expected_elsewhere_or_nowhere_has_no_match():
    surface, descriptor = sheet()
    predicted = surface.points_m.astype(np.float64)
    predicted[3], predicted[4] = np.nan, predicted[4] + [5.0, 0, 0]
    match = match_hypotheses(descriptor, surface, descriptor, ALL, predicted).match
    assert (match[[3, 4]] == -1).all()
    assert (match[5:] >= 0).all()


def test_no_match_lies_beyond_the_search_radius():
    surface, descriptor = sheet()
    rng = np.random.default_rng(2)
    predicted = surface.points_m + rng.normal(0, 0.05, (len(surface), 3))
    match = match_hypotheses(descriptor, surface, descriptor, ALL, predicted, GateConfig(search_radius_m=0.04)).match
    row, column = np.nonzero(match >= 0)
    away = np.linalg.norm(surface.points_m[match[row, column]] - predicted[row], axis=1)
    assert away.max() <= 0.04 + 1e-6


@settings(max_examples=40, deadline=None)
@given(st.lists(st.booleans(), min_size=5, max_size=5), st.integers(1, 5))
def test_subsets_are_all_combinations_of_the_found_anchors(found, size):
    found = np.array(found)
    subsets = anchor_subsets(found, size)
    count, used = int(found.sum()), min(size, int(found.sum()))
    if count == 0:
        assert subsets.shape == (0, size)
        return
    assert subsets.shape == (comb(count, used), used)
    assert found[subsets].all()
    assert len({tuple(row) for row in subsets.tolist()}) == len(subsets)
    assert (np.diff(subsets, axis=1) > 0).all()


def test_without_anchors_or_without_a_surface_there_are_no_matches():
    surface, descriptor = sheet()
    none = match_hypotheses(descriptor, surface, descriptor, anchor_subsets(np.zeros(5, bool)))
    assert none.match.shape == (len(surface), 0)
    empty = keep_nodes(surface, np.zeros(len(surface), bool))
    lost = match_hypotheses(descriptor, empty, np.empty((0, 5), np.float32), ALL)
    assert (lost.match == -1).all()


def test_without_a_descriptor_the_match_is_the_nearest_node_within_reach():
    surface, _ = sheet()
    rng = np.random.default_rng(3)
    moved = replace(surface, points_m=surface.points_m + rng.normal(0, 0.02, (len(surface), 3)).astype(np.float32))
    found = nearest_hypotheses(surface, moved, GateConfig(search_radius_m=0.02))
    away = np.linalg.norm(surface.points_m[:, None] - moved.points_m, axis=2)
    expected = np.where(away.min(axis=1) < 0.02, away.argmin(axis=1), -1)
    np.testing.assert_array_equal(found.match[:, 0], expected)
    assert 0.01 < (expected < 0).mean() < 0.5
    empty = keep_nodes(surface, np.zeros(len(surface), bool))
    assert (nearest_hypotheses(surface, empty, GateConfig()).match == -1).all()
    with pytest.raises(ValueError, match="subset_size"):
        HypothesisConfig(subset_size=0)


def test_the_bound_grows_linearly_with_the_distance():
    config = GateConfig(anchor_bound_m=0.01, surface_bound_per_m=0.02)
    bound = error_bound(np.array([[1.0, 2.0, np.inf, np.nan, 0.0]]), np.array([[0, 1], [1, 4], [0, 2], [0, 3]]), config)
    np.testing.assert_allclose(bound[0], [0.04, 0.03, np.inf, np.nan], rtol=1e-5)


def test_what_does_not_fit_together_is_refused():
    surface, descriptor = sheet()
    with pytest.raises(ValueError, match="descriptors"):
        match_hypotheses(descriptor, surface, descriptor[1:], ALL)
    with pytest.raises(ValueError, match="predicted_m"):
        match_hypotheses(descriptor, surface, descriptor, ALL, surface.points_m[1:])
    with pytest.raises(ValueError, match="subsets"):
        match_hypotheses(descriptor, surface, descriptor, np.array([[0, 5]]))
    with pytest.raises(ValueError, match="size"):
        anchor_subsets(np.ones(5, bool), 0)
    for wrong in ({"anchor_bound_m": -1.0}, {"surface_bound_per_m": -1.0}, {"search_radius_m": 0.0}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            GateConfig(**wrong)
