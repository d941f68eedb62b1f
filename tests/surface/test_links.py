"""Links are kept once a side with the shorter length, and all seen pieces are connected in the end."""

import numpy as np
import pytest
from surface_builder import flat_grid, with_links

from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.joins import join_rest
from anchorpose.surface.links import compress_links, links, pieces
from anchorpose.surface.mesh import edges, grid_edges, keep_nodes


@pytest.mark.parametrize("seed", range(4))
def test_compressed_links_are_those_of_a_dictionary(seed):
    rng = np.random.default_rng(seed)
    pairs = rng.integers(0, 12, (40, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    length = rng.uniform(0.01, 1.0, len(pairs)).astype(np.float32)
    wanted: dict[tuple[int, int], float] = {}
    for (one, other), metres in zip(pairs.tolist(), length.tolist(), strict=True):
        for way in ((one, other), (other, one)):
            wanted[way] = min(metres, wanted.get(way, np.inf))
    start, node, metres = compress_links(pairs, length, 12)
    row = np.repeat(np.arange(12), np.diff(start))
    assert dict(zip(zip(row.tolist(), node.tolist(), strict=True), metres.tolist(), strict=True)) == wanted


def test_links_come_back_once_and_go_with_their_nodes():
    surface = with_links(flat_grid(4, 5, 0.01), [[0, 19], [3, 12]], [0.3, 0.2])
    pair, length = links(surface)
    found = dict(zip(map(tuple, pair.tolist()), length.tolist(), strict=True))
    assert found == pytest.approx({(0, 19): 0.3, (3, 12): 0.2})
    assert len(edges(surface)) == len(grid_edges(surface)) + 2
    part = keep_nodes(surface, np.arange(20) != 19)
    np.testing.assert_array_equal(links(part)[0], [[3, 12]])


def test_every_seen_piece_is_joined_to_the_largest_where_it_is_nearest():
    present = np.ones((20, 30), bool)
    present[:, [9, 20]] = False
    surface = flat_grid(20, 30, 0.01, present)
    assert pieces(surface).max() == 2
    joined = join_rest(surface, 0.05)
    assert pieces(joined).max() == 0
    np.testing.assert_allclose(links(joined)[1], [0.02, 0.02], atol=1e-6)
    assert np.isfinite(geodesic_distance(joined, [0])).all()
    assert join_rest(joined, 0.05) is joined
    assert pieces(join_rest(surface, 0.015)).max() == 2
