"""Distance from the centre on a surface in pieces, and the paths back along it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist
from spectral_builder import shuffled
from surface_builder import flat_grid, grid_surface, star, with_links

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.center import center_field, limb_path
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import geodesic_extrema, surface_center
from anchorpose.surface.mesh import keep_nodes
from anchorpose.surface.surface import HIDDEN_SKIN

ENDS = {"head": (0.03, 0.6), "l": (0.7, 0.2), "r": (-0.7, 0.25), "fl": (0.2, -0.9), "fr": (-0.2, -0.95)}


def edges_of(surface):
    """(e, 2) every edge, both ways."""
    node, place = np.nonzero(surface.ring >= 0)
    linked = np.repeat(np.arange(len(surface)), np.diff(surface.link_start))
    grid = np.stack([node, surface.ring[node, place]], axis=1)
    return np.concatenate([grid, np.stack([linked, surface.link_node], axis=1)])


def pieces_by_scipy(surface):
    pairs = edges_of(surface)
    graph = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(surface), len(surface)))
    return connected_components(graph, directed=False)[1]


def field_by_definition(surface, least):
    """Pieces joined over the narrowest gaps, each measured from its side of the gap."""
    piece = pieces_by_scipy(surface)
    size = np.bincount(piece)
    main = size.argmax()
    mean = surface.points_m.mean(axis=0, dtype=np.float64)
    away = np.where(piece == main, ((surface.points_m - mean) ** 2).sum(axis=1), np.inf)
    field = geodesic_distance(surface, [away.argmin()])[0].astype(np.float64)
    done, waiting = piece == main, {k for k in range(len(size)) if k != main and size[k] >= least}
    while waiting:
        from_node = np.flatnonzero(done)
        found = []
        for number in sorted(waiting):
            own = np.flatnonzero(piece == number)
            gap = cdist(surface.points_m[own].astype(float), surface.points_m[from_node].astype(float))
            i, j = np.unravel_index(gap.argmin(), gap.shape)
            found.append((gap.min(), number, own[i], from_node[j]))
        gap_m, number, root, before = min(found)
        own = piece == number
        field[own] = geodesic_distance(surface, [root])[0][own] + gap_m + field[before]
        done |= own
        waiting.remove(number)
    return field, piece


def scattered(seed):
    """A sheet of irregular shape, cut by random strips and turned by chance, so that no two gaps are equal."""
    rng = np.random.default_rng(seed)
    present = np.ones((40, 50), bool)
    for cut in rng.integers(4, 36, 3):
        present[cut : cut + rng.integers(1, 3)] = False
    present[:, rng.integers(10, 40)] = False
    row, col = np.mgrid[:40, :50] * 0.013
    points = np.stack([0.05 * np.sin(5 * row + 3 * col), -row, -col], axis=2) + rng.normal(0, 0.0015, (40, 50, 3))
    return grid_surface(points, present)


@pytest.mark.parametrize("seed", range(8))
def test_the_field_is_that_of_the_definition(seed):
    surface = scattered(seed)
    field = center_field(surface)
    expected, piece = field_by_definition(surface, least=12)
    finite = np.isfinite(expected)
    np.testing.assert_array_equal(np.isfinite(field.distance_m), finite)
    np.testing.assert_allclose(field.distance_m[finite], expected[finite], atol=1e-4)
    assert len(np.unique(piece)) == len(field.root)
    assert ((piece[:, None] == piece) == (field.piece[:, None] == field.piece)).all()


def test_a_surface_in_one_piece_has_the_paper_s_field():
    surface = star(ENDS)
    field = center_field(surface)
    np.testing.assert_array_equal(field.distance_m, geodesic_distance(surface, [surface_center(surface)])[0])
    assert field.center == surface_center(surface)


def test_a_strip_cut_twice_is_as_long_as_it_was():
    strip = flat_grid(2, 101, 0.01)
    across = np.round(-strip.points_m[:, 2] / 0.01).astype(int)
    whole = center_field(strip)
    keep = ~np.isin(across, [60, 61, 62, 80, 81])
    cut = center_field(keep_nodes(strip, keep))
    assert len(cut.root) == 3
    middle = strip.points_m[keep][cut.center]
    expected = np.linalg.norm(strip.points_m[keep] - middle, axis=1)
    np.testing.assert_allclose(cut.distance_m, expected, atol=0.015)  # through a corner of either edge
    assert abs(cut.distance_m.max() - (whole.distance_m.max() + (50 - 47) * 0.01)) < 0.02


def test_the_extremum_of_a_limb_that_is_cut_off_is_its_end_not_its_cut_edge():
    surface = star(ENDS, width_m=0.06)
    cut = keep_nodes(surface, np.linalg.norm(surface.points_m[:, 1:] - [0.1, -0.35], axis=1) > 0.06)
    field = center_field(cut)
    extrema = geodesic_extrema(cut, field.distance_m, 0.3)
    apart = extrema[field.piece[extrema] != field.piece[field.center]]
    assert (len(field.root), len(apart)) == (2, 1)
    whole = geodesic_distance(surface, [surface_center(surface)])[0]
    end = np.linalg.norm(surface.points_m - cut.points_m[apart[0]], axis=1).argmin()
    assert np.linalg.norm(cut.points_m[apart[0], 1:] - [0.2, -0.7]) < 0.03
    assert abs(field.distance_m[apart[0]] - whole[end]) < 0.03


def test_the_order_of_the_nodes_does_not_matter():
    surface = scattered(3)
    order = np.random.default_rng(0).permutation(len(surface))
    found = center_field(shuffled(surface, order)).distance_m
    np.testing.assert_allclose(found, center_field(surface).distance_m[order], atol=1e-6)


def test_moving_the_surface_changes_nothing():
    surface = scattered(5)
    angle = 0.7
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    moved = replace(surface, points_m=(surface.points_m @ turn.T + [1.0, 0.5, -2.0]).astype(np.float32))
    one, other = center_field(surface), center_field(moved)
    np.testing.assert_array_equal(other.root, one.root)
    np.testing.assert_allclose(other.distance_m, one.distance_m, atol=2e-5)


def test_hidden_skin_joins_pieces_and_alone_is_none():
    sheet = flat_grid(12, 40, 0.013, np.arange(40)[None].repeat(12, 0) != 20)
    apart = center_field(sheet)
    assert len(apart.root) == 2
    count = len(sheet)
    hidden = replace(
        sheet,
        points_m=np.concatenate([sheet.points_m, [[0, -0.07, -0.26], [0.5, 0.5, 0.5]]]).astype(np.float32),
        normals=np.concatenate([sheet.normals, sheet.normals[:2]]),
        ring=np.concatenate([sheet.ring, np.full((2, 8), -1, np.int32)]),
        camera=np.concatenate([sheet.camera, np.full(2, HIDDEN_SKIN, np.uint8)]),
        pixel=np.concatenate([sheet.pixel, np.full((2, 2), -1, np.int16)]),
        skin=np.concatenate([sheet.skin, [0, 1]]).astype(np.int32),
    )
    near = np.linalg.norm(hidden.points_m[:count] - hidden.points_m[count], axis=1).argsort()
    sides = [next(n for n in near if apart.piece[n] == k) for k in (0, 1)]
    field = center_field(with_links(hidden, [[sides[0], count], [sides[1], count]]))
    assert (field.root >= 0).sum() == 1
    assert np.isfinite(field.distance_m[:-1]).all()
    assert np.isinf(field.distance_m[-1])


def test_small_pieces_have_no_distance():
    surface = flat_grid(10, 20, 0.013, (np.arange(20) != 17)[None].repeat(10, 0))
    kept = keep_nodes(surface, (surface.pixel[:, 1] < 17) | (surface.pixel[:, 0] < 5))
    field = center_field(kept)  # 2 x 5 nodes of 13 mm: 17 square centimetres
    np.testing.assert_array_equal(np.isinf(field.distance_m), kept.pixel[:, 1] > 17)
    assert sorted(field.root < 0) == [False, True]


def test_the_centre_lies_on_the_largest_piece_and_nobody_has_one():
    ring = star(ENDS)
    middle = np.linalg.norm(ring.points_m, axis=1)
    surface = keep_nodes(ring, (middle < 0.07) | (middle > 0.12) | (ring.points_m[:, 1] < 0))
    field = center_field(surface)
    assert field.piece[field.center] == np.bincount(field.piece).argmax()
    with pytest.raises(DegenerateGeometry):
        center_field(keep_nodes(flat_grid(3, 3, 0.01), np.zeros(9, bool)))


def test_a_path_descends_to_the_centre_over_edges_and_gaps():
    surface = star(ENDS, width_m=0.06)
    surface = keep_nodes(surface, np.linalg.norm(surface.points_m[:, 1:] - [0.1, -0.35], axis=1) > 0.06)
    field = center_field(surface)
    edges = {tuple(edge) for edge in edges_of(surface).tolist()}
    for end in geodesic_extrema(surface, field.distance_m, 0.3):
        path = limb_path(surface, field, int(end))
        assert (path[0], path[-1]) == (end, field.center)
        assert (np.diff(field.distance_m[path]) < 0).all()
        jumps = [step for step in zip(path.tolist(), path[1:].tolist(), strict=False) if step not in edges]
        assert len(jumps) == (field.piece[end] != field.piece[field.center])
        length = np.linalg.norm(np.diff(surface.points_m[path], axis=0), axis=1).sum()
        assert field.distance_m[end] - 1e-3 < length < 1.09 * field.distance_m[end]


def test_a_path_inside_a_cylinder_is_its_axis():
    radius_m, angle = 0.04, np.linspace(-1.2, 1.2, 13)
    along = np.arange(80) * 0.01
    out = np.stack([np.cos(angle), np.zeros(13), np.sin(angle)], axis=1)
    grid = radius_m * out[None] + along[:, None, None] * [0.0, 1.0, 0.0]
    surface = replace(grid_surface(grid), normals=np.tile(out, (80, 1)).astype(np.float32))
    field = center_field(surface)
    path = limb_path(surface, field, int(field.distance_m.argmax()))
    inside = surface.points_m[path] - radius_m * surface.normals[path]
    assert np.abs(inside[:, [0, 2]]).max() < 1e-6
    assert abs(np.ptp(inside[:, 1]) - 0.4) < 0.02


@pytest.mark.parametrize("end", [-1, 10_000, "unreached"])
def test_a_node_without_distance_has_no_path(end):
    surface = flat_grid(10, 20, 0.013, (np.arange(20) != 17)[None].repeat(10, 0))
    surface = keep_nodes(surface, (surface.pixel[:, 1] < 17) | (surface.pixel[:, 0] < 5))
    end = int(surface.pixel[:, 1].argmax()) if end == "unreached" else end
    with pytest.raises(ValueError, match="no distance"):
        limb_path(surface, center_field(surface), end)
