"""The match by psi: brute force, limbs whose outline clips psi, and pieces behind a cut."""

import numpy as np
import pytest

from anchorpose.research.features.psi import NONE, match_by_psi, subsets_with_pieces
from anchorpose.track_tree.hypotheses import GateConfig

pytestmark = pytest.mark.thorough

GATE = GateConfig(anchor_bound_m=0.05, surface_bound_per_m=0.0, search_radius_m=10.0)
ALL = np.ones(5, bool)


def strip(count: int = 40, rows: int = 7) -> tuple[np.ndarray, np.ndarray]:
    """Nodes of a flat limb 8 cm wide, and their distances to five anchors around it."""
    along, across = np.meshgrid(np.linspace(0, 0.5, count), np.linspace(-0.04, 0.04, rows), indexing="ij")
    places = np.stack([along.ravel(), across.ravel(), np.zeros(along.size)], axis=1)
    anchors = np.array([[-0.3, 0, 0], [0.8, 0.1, 0], [0.2, 0.5, 0], [0.3, -0.6, 0], [-0.2, -0.4, 0]])
    return places, np.linalg.norm(places[:, None] - anchors, axis=2)


def test_the_average_of_psi_is_that_of_brute_force() -> None:
    places, distance = strip()
    subsets = subsets_with_pieces(distance, distance, ALL, 3)
    assert subsets.shape == (10, 3)
    match = match_by_psi(distance[:30], distance, places, subsets, GATE, unclipped=False)
    for node in range(30):
        for s, subset in enumerate(subsets):
            psi = np.flatnonzero(np.linalg.norm(distance[:, subset] - distance[node, subset], axis=1) < 0.05)
            away = np.linalg.norm(places[psi] - places[psi].mean(axis=0), axis=1)
            assert np.isclose(away[psi.tolist().index(match[node, s])], away.min(), atol=1e-9)


def test_the_inequality_as_printed_is_a_gate_of_the_root_of_its_bound() -> None:
    places, distance = strip()
    subsets = subsets_with_pieces(distance, distance, ALL, 3)
    printed = match_by_psi(distance[:30], distance, places, subsets, GATE, False, squared=True)
    wide = GateConfig(anchor_bound_m=float(np.sqrt(0.05)), surface_bound_per_m=0.0, search_radius_m=10.0)
    np.testing.assert_array_equal(printed, match_by_psi(distance[:30], distance, places, subsets, wide, False))
    assert (printed != match_by_psi(distance[:30], distance, places, subsets, GATE, False)).any()


def test_no_node_of_an_outline_is_the_average_but_it_is_the_unclipped_middle() -> None:
    places, distance = strip()
    subsets = subsets_with_pieces(distance, distance, ALL, 3)
    rim = np.flatnonzero(np.abs(places[:, 1]) > 0.039)
    clipped, free = (match_by_psi(distance[rim], distance, places, subsets, GATE, way) for way in (False, True))
    off = [np.linalg.norm(places[m] - places[rim][:, None], axis=2) for m in (clipped, free)]
    assert np.median(off[0]) > 0.012  # the next row of nodes, and often the one after
    assert np.median(off[1]) < 0.003


def test_behind_a_cut_the_anchors_that_are_left_are_the_only_subset() -> None:
    places, distance = strip()
    target = distance.copy()
    far = places[:, 0] > 0.25
    target[far, :3] = np.inf
    target[~far, 3:] = np.inf
    subsets = subsets_with_pieces(distance, target, ALL, 3)
    assert (subsets[:10] != NONE).all()
    assert subsets[10:].tolist() == [[3, 4, NONE]]
    match = match_by_psi(distance, target, places, subsets, GATE, unclipped=True)
    assert (match[places[:, 0] > 0.35, :10] == -1).all()  # no three anchors have a distance there
    assert (match[far, 10] >= 0).all()
    reached = match[~far, 10]
    assert far[reached[reached >= 0]].all()  # and it applies to the piece behind the cut only


def test_nothing_matches_where_nothing_is_alike_and_where_nothing_was_found() -> None:
    places, distance = strip(5, 3)
    subsets = subsets_with_pieces(distance, distance, ALL, 3)
    assert (match_by_psi(distance + 1.0, distance, places, subsets, GATE, True) == -1).all()
    assert subsets_with_pieces(distance, distance, np.zeros(5, bool), 3).shape == (0, 3)
