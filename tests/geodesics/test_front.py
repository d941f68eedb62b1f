"""The marching front against its plain form, behind corners, and against the exact method."""

import heapq

import numpy as np
import pytest
from body_builder import FRONT, adult_body, photograph, skin_in, standing
from surface_builder import flat_grid, grid_surface, with_links

from anchorpose.geodesics.distance import geodesic_distance, geodesic_distance_to_set
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import build_surface, faces

SPACING = 0.013


def bumpy(seed=0, rows=20, cols=24, keep=1.0):
    rng = np.random.default_rng(seed)
    row, col = np.mgrid[:rows, :cols] * SPACING
    height = 0.03 * np.sin(12 * row) * np.cos(9 * col) + rng.normal(0, 0.001, row.shape)
    return grid_surface(np.stack([height, -row, -col], axis=2), rng.random((rows, cols)) < keep)


def linked(surface, seed, count=6):
    pairs = np.random.default_rng(seed).integers(0, len(surface), (count, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    return with_links(surface, pairs, np.random.default_rng(seed).uniform(0.01, 0.1, len(pairs)))


def plain_march(surface, source, turns):
    """One node after another, in the order of distance, each triangle written out; turns: whether rims bend fronts."""
    points = surface.points_m.astype(np.float64)
    count = len(points)
    distance, bend, fixed = np.full(count, np.inf), np.zeros(count), np.zeros(count, bool)
    distance[source] = 0.0
    rim = (surface.ring < 0).any(axis=1)
    waiting = [(0.0, source)]

    def offer(node, value, turned):
        if value < distance[node] and not fixed[node]:
            distance[node], bend[node] = value, turned
            heapq.heappush(waiting, (value, node))

    while waiting:
        value, node = heapq.heappop(waiting)
        if fixed[node]:
            continue
        fixed[node] = True
        for spot in range(surface.link_start[node], surface.link_start[node + 1]):
            other = surface.link_node[spot]
            offer(other, value + surface.link_length_m[spot], bend[node])
        for place in range(8):
            other = surface.ring[node, place]
            if other < 0 or fixed[other]:
                continue
            turn = 1.0
            arm = points[other] - points[node]
            for way in (-1, 1):
                third = surface.ring[node, (place + way * (1 + (place % 2 == 0))) % 8]
                if third < 0 or third not in surface.ring[other] or not np.isfinite(distance[third]):
                    continue
                side = points[third] - points[node]
                c = np.linalg.norm(side)
                since = min(bend[node], bend[third])
                a, b = value - since, distance[third] - since
                x = (a * a - b * b + c * c) / (2 * c)
                y = np.sqrt(max(a * a - x * x, 0.0))
                px = arm @ side / c
                py = np.sqrt(max(arm @ arm - px * px, 0.0))
                if a > 0:
                    straight = (py * y - px * x) / (a * np.linalg.norm(arm))  # cosine of the turn at the node
                    turn = min(turn, max((1.0 - straight) / (1.0 - np.cos(np.radians(4.0))), 0.0))
                crossing = x + (px - x) * y / (y + py)
                if 0 <= crossing <= c:
                    part = crossing / c
                    offer(other, since + np.hypot(px - x, py + y), bend[node] + part * (bend[third] - bend[node]))
            turned = bend[node] + (value - bend[node]) * turn * (rim[node] and turns)
            offer(other, value + np.linalg.norm(arm), turned)
    return distance


@pytest.mark.parametrize("seed", range(4))
def test_in_rounds_it_is_the_plain_march_of_one_node_after_the_other(seed):
    surface = linked(bumpy(seed, keep=1.0 if seed < 2 else 0.9), seed)
    source = 37 * (seed + 1)
    found, plain = geodesic_distance(surface, [source])[0], plain_march(surface, source, turns=True)
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(plain))
    off = np.abs(found - plain)[np.isfinite(plain)]
    assert off.mean() < 0.0002  # a node that has a second turn may keep the better of two offers
    assert off.max() < 0.003


def test_behind_a_corner_the_front_starts_anew():
    present = np.ones((61, 61), bool)
    present[30, :45] = False
    surface = flat_grid(61, 61, SPACING, present)
    row, col = surface.pixel.astype(np.float64).T
    source = int(np.flatnonzero((row == 10) & (col == 10))[0])
    # the mesh ends at the slanting edges beside the wall's last node: the way bends at (30, 45), and again at (31, 44)
    hidden = (row > 30) & ((col - 10) * 20 < (row - 10) * 35)
    once = np.hypot(row - 30, col - 45)
    behind = np.hypot(20, 35) + np.where(row - 30 >= 45 - col, once, np.sqrt(2) + np.hypot(row - 31, col - 44))
    straight = np.hypot(row - 10, col - 10)
    error = geodesic_distance(surface, [source])[0] - SPACING * np.where(hidden, behind, straight)
    assert np.abs(error).mean() < 0.0005
    assert np.abs(error).max() < 0.0025
    assert plain_march(surface, source, turns=False)[hidden].mean() - SPACING * behind[hidden].mean() > 0.002


def test_fields_of_many_sources_are_those_of_each_alone_and_no_source_gives_no_field():
    surface = linked(bumpy(3, keep=0.95), 3)
    sources = np.array([0, 100, 300, 100])
    together = geodesic_distance(surface, sources)
    for k, source in enumerate(sources):
        np.testing.assert_array_equal(together[k], geodesic_distance(surface, [source])[0])
        np.testing.assert_array_equal(together[k], geodesic_distance_to_set(surface, [source, source]))
    assert geodesic_distance(surface, np.empty(0, np.int32)).shape == (0, len(surface))


def test_on_a_body_it_is_within_millimetres_of_the_exact_distance():
    geodesic = pytest.importorskip("pygeodesic.geodesic", reason="the exact method, pygeodesic, is not installed")
    depth = photograph(skin_in(standing(), adult_body()), FRONT).depth_m
    noisy = depth + np.random.default_rng(0).normal(0, 0.003, depth.shape).astype(np.float32)
    surface = build_surface(np.where(depth > 0, noisy, 0), depth > 0, FRONT)
    triangles, piece = faces(surface), pieces(surface)
    triangles = triangles[piece[triangles[:, 0]] == np.bincount(piece).argmax()]
    used, corners = np.unique(triangles, return_inverse=True)
    corners = corners.reshape(-1, 3).astype(np.int32)
    solver = geodesic.PyGeodesicAlgorithmExact(surface.points_m[used].astype(np.float64), corners)
    off = []
    for source in used[:: len(used) // 5]:
        exact = solver.geodesicDistances(np.array([np.searchsorted(used, source)], np.int32), None)[0]
        off.append(np.abs(geodesic_distance(surface, [source])[0][used] - exact)[np.isfinite(exact)])
    assert np.concatenate(off).mean() < 0.005
