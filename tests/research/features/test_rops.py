"""RoPS against PCL's numbers, and its definition in plain numpy: the surface's integral, the turns, the moments."""

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, pcl_reference

from anchorpose.research.features.neighbours import find_neighbours
from anchorpose.research.features.rops import RopsConfig, prepare_triangles, rops, triangle_frames

pytestmark = pytest.mark.thorough

CONFIG = RopsConfig(radius_m=0.12)


def describe(points, normals, triangles):
    return rops(points, triangles, CONFIG)


def plain_frame(points, triangles, own, radius_m):
    """The paper's axes in double precision, each triangle's integral by its corners."""
    arms = points.astype(np.float64) - points[own].astype(np.float64)
    near = np.linalg.norm(arms, axis=1) <= radius_m
    corners = arms[triangles[near[triangles].any(axis=1)]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    weight = area * (radius_m - np.linalg.norm(corners.mean(axis=1), axis=1)) ** 2
    every = np.einsum("fci,fdj->fij", corners, corners) + np.einsum("fci,fcj->fij", corners, corners)
    _, axes = np.linalg.eigh(np.einsum("f,fij->ij", weight, every))
    lean = np.einsum("f,fci->i", weight, corners)
    x, z = (axis * np.sign(axis @ lean) for axis in (axes[:, 2], axes[:, 0]))
    return np.stack([x, np.cross(z, x), z]), arms[near]


def plain_rops(points, triangles, own, config):
    frame, arms = plain_frame(points, triangles, own, config.radius_m)
    local, rows = arms @ frame.T, []
    for axis in range(3):
        for turn in range(1, config.turns + 1):
            angle, one, two = np.radians(90 * turn / (config.turns + 1)), (axis + 1) % 3, (axis + 2) % 3
            turned = local.copy()
            turned[:, one] = np.cos(angle) * local[:, one] - np.sin(angle) * local[:, two]
            turned[:, two] = np.sin(angle) * local[:, one] + np.cos(angle) * local[:, two]
            for u, v in ((0, 1), (0, 2), (1, 2)):
                part = np.histogram2d(turned[:, u], turned[:, v], config.bins)[0] / len(local)
                i, j = np.mgrid[: config.bins, : config.bins]
                i, j = i - (i * part).sum(), j - (j * part).sum()
                some = part[part > 0]
                moments = [(i**a * j**b * part).sum() for a, b in ((1, 1), (2, 1), (1, 2), (2, 2))]
                rows += [*moments, -(some * np.log(some)).sum()]
    return np.array(rows) / np.abs(rows).sum()


def test_equal_to_pcl():
    reference = pcl_reference()
    config = RopsConfig(radius_m=float(reference["radius_m"]))
    found = rops(reference["points_m"], reference["triangles"].astype(np.int32), config)[reference["chosen"]]
    np.testing.assert_allclose(found, reference["rops"], atol=2e-6)


def test_frames_equal_their_definition():
    points, _, triangles = bumpy_torus()
    near, chosen = find_neighbours(points, 0.12), np.arange(0, 720, 7)
    found = triangle_frames(points, prepare_triangles(points, triangles), near)[chosen]
    expected = np.stack([plain_frame(points, triangles, own, 0.12)[0] for own in chosen])
    np.testing.assert_allclose(found, expected, atol=1e-4)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-5)


@pytest.mark.parametrize("config", [CONFIG, RopsConfig(radius_m=0.2, turns=2, bins=7)])
def test_equal_to_its_definition(config):
    points, _, triangles = bumpy_torus()
    chosen = np.arange(0, 720, 9)
    found = rops(points, triangles, config)[chosen]
    assert found.shape == (80, config.columns)
    expected = np.stack([plain_rops(points, triangles, own, config) for own in chosen])
    assert_same_but_for_an_edge(found, expected, rows=0.9)


def test_triangles_may_be_cut_the_other_way():
    """The frame is the surface's, hardly that of its mesh."""
    points = np.concatenate([np.mgrid[:27, :3].reshape(2, -1).T * [0.01, 0.015], np.zeros((81, 1))], axis=1)
    points[:, 2] = 3 * points[:, 0] ** 2 + points[:, 1]
    index = np.arange(81).reshape(27, 3)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    falling = np.stack([a, c, d, a, d, b], axis=2).reshape(-1, 3)
    rising = np.stack([b, a, c, b, c, d], axis=2).reshape(-1, 3)
    points = points.astype(np.float32)
    near, chosen = find_neighbours(points, 0.07), [31, 52]
    one, other = (triangle_frames(points, prepare_triangles(points, cut), near)[chosen] for cut in (falling, rising))
    assert np.abs((one * other).sum(axis=2)).min() > 0.97


def test_a_mirror_is_another_surface():
    points, normals, triangles = bumpy_torus()
    mirrored = describe(points * np.array([-1, 1, 1], np.float32), normals, triangles[:, ::-1])
    off = np.abs(mirrored - describe(points, normals, triangles)).max(axis=1)
    assert (off > 1e-3).mean() > 0.95


def test_a_node_without_triangles_or_neighbours_is_undefined():
    points, _, triangles = bumpy_torus()
    assert np.isnan(rops(points, np.empty((0, 3), np.int32), CONFIG)).all()
    near = find_neighbours(points, 0.02)  # no neighbours: only the triangles at the node itself
    assert len(near.node) < 720
    assert np.isfinite(triangle_frames(points, prepare_triangles(points, triangles), near)).all()
    alone = np.diff(near.start) == 0
    found = rops(points, triangles, RopsConfig(radius_m=0.02))
    assert alone.sum() > 100
    np.testing.assert_array_equal(np.isnan(found), np.repeat(alone[:, None], 135, axis=1))


def test_triangles_that_are_none_are_refused():
    points, _, triangles = bumpy_torus()
    for wrong in (triangles + 1, triangles - 1):
        with pytest.raises(ValueError, match="not among the 720"):
            rops(points, wrong)
    with pytest.raises(ValueError, match=r"\(f, 3\)"):
        rops(points, triangles.astype(np.float32))
