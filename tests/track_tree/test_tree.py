"""The track tree against brute force over all branches."""

from itertools import product

import numpy as np
import pytest

from anchorpose.track_tree.tree import Support, TreeConfig, best_branches


def small_tree(seed: int, nodes: int = 6, subsets: int = 4, depth: int = 3):
    rng = np.random.default_rng(seed)
    matches = [rng.integers(-1, nodes, (nodes, subsets)).astype(np.int32) for _ in range(depth)]
    positions = [rng.uniform(0, 0.3, (nodes, 3)).astype(np.float32) for _ in range(depth)]
    return matches, positions, rng.uniform(0, 0.3, (nodes, depth, 3)).astype(np.float32)


def brute_force(matches, positions, predicted, missed_cost, costs=None):
    """Every branch, spelled out: (score, first subset or -1) of the best of each source node."""
    depth, subsets = len(matches), matches[0].shape[1]
    best = []
    for source in range(len(matches[0])):
        options = [(depth * missed_cost, -1)]
        for length in range(1, depth + 1):
            for branch in product(range(subsets), repeat=length):
                node, score = source, 0.0
                for level, subset in enumerate(branch):
                    score += 0.0 if costs is None else float(costs[level][node, subset])
                    node = matches[level][node, subset]
                    if node < 0:
                        break
                    score += float(np.linalg.norm(positions[level][node] - predicted[source, level]))
                else:
                    options.append((score + (depth - length) * missed_cost, branch[0]))
        best.append(min(options, key=lambda option: option[0]))
    return best


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("depth", [1, 2, 3])
def test_the_best_branch_is_that_of_brute_force(seed, depth):
    matches, positions, predicted = small_tree(seed, depth=depth)
    result = best_branches(matches, positions, predicted, TreeConfig(missed_cost_m=0.1, max_branches=10**6))
    expected = brute_force(matches, positions, predicted, 0.1)
    assert result.score == pytest.approx([score for score, _ in expected], abs=1e-5)
    for source, (_, subset) in enumerate(expected):
        found = matches[0][source, subset] if subset >= 0 else -1
        assert result.match[source] == found
        assert (result.subset[source] < 0) == (subset < 0)


@pytest.mark.parametrize("seed", range(12))
def test_what_a_match_costs_beside_its_distance_counts(seed):
    matches, positions, predicted = small_tree(seed)
    costs = [np.random.default_rng(seed).uniform(0, 0.1, level.shape).astype(np.float32) for level in matches]
    config = TreeConfig(missed_cost_m=0.15, max_branches=10**6)
    result = best_branches(matches, positions, predicted, config, costs)
    expected = brute_force(matches, positions, predicted, 0.15, costs)
    assert result.score == pytest.approx([score for score, _ in expected], abs=1e-5)
    assert result.subset.tolist() == [subset for _, subset in expected]
    assert (result.score >= best_branches(matches, positions, predicted, config).score - 1e-6).all()


def test_a_node_none_of_whose_matches_is_near_the_prediction_is_missed():
    result = best_branches([np.array([[0, 0]], np.int32)], [np.array([[1.0, 0, 0]])], np.zeros((1, 1, 3)), TreeConfig())
    assert (result.match[0], result.subset[0], result.support[0]) == (-1, -1, Support.TOO_FAR)
    assert result.score[0] == pytest.approx(TreeConfig().missed_cost_m)


def test_every_node_says_what_its_place_rests_on():
    matches = np.array([[0, -1], [1, 0], [-1, -1], [0, 0]], np.int32)
    predicted = np.zeros((4, 1, 3))
    predicted[1], predicted[3] = 5.0, np.nan
    result = best_branches([matches], [np.array([[0.01, 0, 0], [0.02, 0, 0]])], predicted, TreeConfig())
    assert result.support.tolist() == [Support.MATCHED, Support.TOO_FAR, Support.NO_HYPOTHESIS, Support.UNKNOWN]
    np.testing.assert_array_equal(result.support == Support.MATCHED, result.match >= 0)


@pytest.mark.parametrize("seed", range(6))
def test_levels_that_know_other_numbers_of_subsets_make_one_tree(seed):
    """Fewer anchors in one frame: as if the subsets that it lacks had found nothing."""
    matches, positions, predicted = small_tree(seed)
    narrow = [matches[0][:, :1], matches[1][:, :3], matches[2][:, :0]]
    wide = [np.full_like(level, -1) for level in matches]
    for level, known in zip(wide, narrow, strict=True):
        level[:, : known.shape[1]] = known
    config = TreeConfig(missed_cost_m=0.2, max_branches=10**6)
    found, expected = best_branches(narrow, positions, predicted, config), brute_force(wide, positions, predicted, 0.2)
    assert found.score == pytest.approx([score for score, _ in expected], abs=1e-5)
    np.testing.assert_array_equal(found.match, best_branches(wide, positions, predicted, config).match)


def test_without_any_subset_every_node_is_left_to_its_prediction():
    none = best_branches([np.empty((3, 0), np.int32)], [np.zeros((5, 3))], np.zeros((3, 1, 3)), TreeConfig())
    assert none.support.tolist() == [Support.NO_HYPOTHESIS] * 3
    assert none.score == pytest.approx(TreeConfig().missed_cost_m)


def test_looking_ahead_overrules_the_nearest_match():
    matches = [np.array([[0, 1]], np.int32), np.array([[0], [1]], np.int32).repeat(2, axis=1)]
    positions = [np.array([[0.01, 0, 0], [0.02, 0, 0]]), np.array([[0.09, 0, 0], [0.0, 0, 0]])]
    result = best_branches(matches, positions, np.zeros((1, 2, 3)), TreeConfig())
    assert (result.match[0], result.score[0]) == (1, pytest.approx(0.02))


def test_an_unknown_prediction_gives_no_match_and_no_score():
    matches, positions, predicted = small_tree(3)
    predicted[2, 1, 0] = np.nan
    result = best_branches(matches, positions, predicted, TreeConfig())
    assert result.match[2] == -1
    assert np.isnan(result.score[2])
    assert np.isfinite(np.delete(result.score, 2)).all()


def test_a_pruned_tree_is_never_better_than_the_optimum():
    matches, positions, predicted = small_tree(5, nodes=40, subsets=10)
    exact = best_branches(matches, positions, predicted, TreeConfig(missed_cost_m=1.0, max_branches=10**6))
    pruned = best_branches(matches, positions, predicted, TreeConfig(missed_cost_m=1.0, max_branches=5))
    assert (pruned.score >= exact.score - 1e-6).all()
    assert (pruned.score > exact.score + 1e-6).any()


def test_shapes_that_do_not_fit_are_refused():
    matches, positions, predicted = small_tree(1)
    with pytest.raises(ValueError, match="as many surfaces as levels"):
        best_branches(matches, positions[:2], predicted, TreeConfig())
    with pytest.raises(ValueError, match="predictions must be"):
        best_branches(matches, positions, predicted[:, :2], TreeConfig())
    matches[1][0, 0] = 99
    with pytest.raises(ValueError, match="level 1 points at node 99 of 6"):
        best_branches(matches, positions, predicted, TreeConfig())


def test_a_config_without_sense_is_refused():
    with pytest.raises(ValueError, match="missed_cost_m"):
        TreeConfig(missed_cost_m=0.0)
    with pytest.raises(ValueError, match="max_branches"):
        TreeConfig(max_branches=0)
