"""Radius neighbours against all distances; the angle and the axes that kernels compute, against numpy's."""

import numpy as np
import pytest
from feature_shapes import bumpy_torus, pcl_reference

from anchorpose.research.features.circle import angle_of
from anchorpose.research.features.local_frame import principal_axes
from anchorpose.research.features.neighbours import count_within, find_neighbours


def cloud(seed: int, count: int = 600) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 3)).astype(np.float32)


@pytest.mark.parametrize("along", [None, 1], ids=["in any order", "row after row, as on a mesh"])
@pytest.mark.parametrize("radius_m", [0.05, 0.3, 10.0])
def test_neighbours_are_those_of_all_distances_written_out(radius_m, along):
    points = cloud(1)
    points = points if along is None else points[np.argsort(points[:, along])]
    found = find_neighbours(points, radius_m)
    apart = np.linalg.norm(points[:, None].astype(float) - points[None], axis=2)
    expected = [np.flatnonzero(row <= radius_m) for row in apart]
    for c in range(len(points)):
        row = slice(found.start[c], found.start[c + 1])
        np.testing.assert_array_equal(found.node[row], expected[c][expected[c] != c])
        away2 = ((points[found.node[row]] - points[c]) ** 2).sum(axis=1)
        np.testing.assert_allclose(found.distance2_m2[row], away2, rtol=1e-5, atol=1e-10)
    np.testing.assert_array_equal(count_within(points, radius_m), [len(row) for row in expected])


def test_a_node_on_the_sphere_is_within():
    points = np.array([[0, 0, 0], [0.25, 0, 0], [0.5, 0, 0]])
    assert find_neighbours(points, 0.25).node.tolist() == [1, 0, 2, 1]


def test_unknown_places_have_no_neighbours_and_are_never_neighbours():
    points = cloud(3)
    points[[4, 90]] = np.nan
    found = find_neighbours(points, 0.4)
    assert found.start[5] == found.start[4]
    assert not np.isin(found.node, [4, 90]).any()
    assert (count_within(points, 0.4)[[4, 90]] == 0).all()
    stay = np.delete(np.arange(len(points)), [4, 90])
    assert len(found.node) == len(find_neighbours(points[stay], 0.4).node)


@pytest.mark.parametrize("radius_m", [0.0, -1.0, np.nan, np.inf])
def test_an_impossible_radius_is_refused(radius_m):
    with pytest.raises(ValueError, match="radius"):
        find_neighbours(cloud(4), radius_m)


def test_the_cloud_that_pcl_was_asked_about_is_ours():
    reference, (points, normals, triangles) = pcl_reference(), bumpy_torus()
    np.testing.assert_allclose(reference["points_m"], points, atol=1e-6)
    np.testing.assert_allclose(reference["normals"], normals, atol=1e-5)
    np.testing.assert_array_equal(reference["triangles"], triangles)


def test_angle_is_that_of_arctan2():
    random = np.random.default_rng(6)
    vectors = random.normal(size=(5000, 2)) * 10.0 ** random.uniform(-6, 3, (5000, 1))
    vectors[:8] = [[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1], [-1, -1], [1, -1]]
    for x, y in vectors.astype(np.float32):
        assert angle_of(y, x) == pytest.approx(np.arctan2(np.float64(y), np.float64(x)), abs=4e-7)
    assert angle_of(np.float32(0), np.float32(0)) == 0.0


@pytest.mark.parametrize("sizes", [(3.0, 2.0, 1.0), (1.0, 1e-3, 1e-9), (1.0, 1.0, 0.5), (2.0, 0.0, 0.0), (0, 0, 0)])
def test_principal_axes_are_eigenvectors_largest_first(sizes):
    turn = np.linalg.qr(np.random.default_rng(7).normal(size=(3, 3)))[0]
    matrix, axes = turn @ np.diag(sizes) @ turn.T, np.empty((3, 3))
    matrix = (matrix + matrix.T) / 2
    spread = matrix.copy()
    principal_axes(matrix, axes)
    np.testing.assert_allclose(np.diag(matrix), sizes, atol=1e-14)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(axes @ spread @ axes.T, np.diag(sizes), atol=1e-14)
