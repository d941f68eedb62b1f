"""From two frames to hypotheses with few anchors or none, and what a run says of its matches."""

from dataclasses import replace
from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from surface_builder import flat_grid

from anchorpose.results.run_record import MatchedShares
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis, link
from anchorpose.track_tree.hypotheses import Feature, GateConfig, HypothesisConfig
from anchorpose.track_tree.tree import TreeConfig, best_branches

PLACES_M = np.array([[0, 0.3, 0], [0, 0, 0.4], [0, 0, -0.5], [0, -0.5, 0.1], [0, -0.6, -0.3]])


def seen(found: list[int]):
    """A frame that shows a flat sheet and some of its five anchors, as far as ``link`` looks at it."""
    surface = flat_grid(12, 10, 0.013)
    descriptor = np.linalg.norm(surface.points_m[:, None] - PLACES_M, axis=2).astype(np.float32)
    known = np.isin(np.arange(5), found)
    descriptor[:, ~known] = np.nan
    return SimpleNamespace(surface=surface, descriptor=descriptor, anchors=SimpleNamespace(found=known))


@pytest.mark.parametrize("common", [[0, 1, 2, 3, 4], [0, 2, 3, 4], [1, 3, 4], [2, 4], [3], []])
@pytest.mark.parametrize("size", [3, 5])
def test_there_is_one_hypothesis_for_each_subset_of_the_anchors_that_both_frames_show(common, size):
    config = HypothesisConfig(subset_size=size)
    only_now = [anchor for anchor in range(5) if anchor not in common][:1]
    links = link(seen(common + only_now), seen(common), config, GateConfig())
    expected = list(combinations(common, min(size, len(common)))) if common else []
    assert [tuple(subset) for subset in links.subsets.tolist()] == expected
    assert links.all().match.shape == (120, len(expected))
    assert (links.all().match >= 0).all()


def test_without_the_descriptor_no_anchor_is_needed():
    config = HypothesisConfig(feature=Feature.POSITION)
    links = link(seen([]), seen([]), config, GateConfig())
    np.testing.assert_array_equal(links.all().match[:, 0], np.arange(120))


def test_a_hypothesis_that_no_anchor_supports_says_so_and_the_run_counts_it():
    now = seen([0, 1, 2, 3, 4])
    nodes = now.surface.points_m.astype(np.float64)
    shares = []
    for common in ([0, 1, 2, 3, 4], []):
        links = link(now, seen(common), HypothesisConfig(), GateConfig())
        tree = best_branches([links.all().match], [now.surface.points_m], nodes[:, None], TreeConfig())
        where = np.arange(len(nodes))
        hypothesis = GlobalHypothesis(where, where, where, np.full_like(nodes, np.nan), tree)
        shares.append(hypothesis.matched_share)
    assert shares[0] > 0.9
    assert shares[1] == 0.0
    nobody = replace(hypothesis, node=where[:0])
    assert nobody.matched_share == 0.0
    (sentence,) = MatchedShares((None, 0.5, 0.0, 1.0)).sentences
    assert sentence.startswith("50 % of the followed points were found again")
    assert "in 1 of 3 frames no point was" in sentence
    assert MatchedShares((0.5,)).sentences == ["50 % of the followed points were found again in the next frame"]
    assert MatchedShares((None,)).sentences == []
