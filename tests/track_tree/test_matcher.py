"""Matches on demand: the same as all at once, and none worked out twice."""

import numpy as np
from surface_builder import flat_grid

from anchorpose.track_tree.hypotheses import Matcher, anchor_subsets, match_hypotheses

ALL = anchor_subsets(np.ones(5, bool))
PLACES_M = np.array([[0, 0.3, 0], [0, 0, 0.4], [0, 0, -0.5], [0, -0.5, 0.1], [0, -0.6, -0.3]])


def test_whatever_is_asked_for_first_the_matches_are_those_of_all_nodes_together():
    surface = flat_grid(18, 15, 0.013)
    target = np.linalg.norm(surface.points_m[:, None] - PLACES_M, axis=2).astype(np.float32)
    rng = np.random.default_rng(3)
    source = (target + rng.normal(0, 0.008, target.shape)).astype(np.float32)
    wanted = match_hypotheses(source, surface, target, ALL, surface.points_m).match
    counted = np.zeros(len(source), np.int64)

    def find(nodes: np.ndarray) -> np.ndarray:
        counted[nodes] += 1
        return match_hypotheses(source[nodes], surface, target, ALL, surface.points_m[nodes]).match

    matcher = Matcher(find, len(source), ALL)
    for _ in range(4):
        nodes = rng.integers(0, len(source), 60)  # unordered and repeated
        np.testing.assert_array_equal(matcher.ask(nodes), wanted[nodes])
    assert counted.max() == 1
    assert (matcher.match[counted == 0] == -1).all()
    np.testing.assert_array_equal(matcher.all().match, wanted)
    assert (counted == 1).all()


def test_nobody_asked_for_is_no_match():
    matcher = Matcher(lambda nodes: np.full((len(nodes), 2), 7, np.int32), 5, np.zeros((2, 3), np.int64))
    assert matcher.ask(np.zeros(0, np.int64)).shape == (0, 2)
    assert (matcher.match == -1).all()
