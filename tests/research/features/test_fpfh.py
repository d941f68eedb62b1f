"""FPFH against PCL's numbers, Open3D, its definition in plain numpy, and what a plane and a mirror must give."""

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, pcl_reference

from anchorpose.research.features.fpfh import FpfhConfig, fpfh

CONFIG = FpfhConfig(radius_m=0.1)


def describe(points, normals, triangles):
    return fpfh(points, normals, CONFIG)


def plain_pair(p, n, q, m):
    """The paper's three angles of two points with their normals."""
    d = (q - p) / np.linalg.norm(q - p)
    if abs(n @ d) < abs(m @ d):
        n, m, d = m, n, -d
    v = np.cross(d, n) / np.linalg.norm(np.cross(d, n))
    return np.arctan2(np.cross(n, v) @ m, n @ m), v @ m, n @ d


def plain_fpfh(points, normals, radius_m, own):
    """The definition, in double precision."""
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    away = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = (away <= radius_m) & (away > 0)
    simple = np.zeros((len(points), 3, 11))
    for p in range(len(points)):
        angles = [plain_pair(points[p], normals[p], points[q], normals[q]) for q in np.flatnonzero(near[p])]
        for k, (low, high) in enumerate(((-np.pi, np.pi), (-1, 1), (-1, 1))):
            simple[p, k] = np.histogram([angle[k] for angle in angles], 11, (low, high))[0] * 100 / near[p].sum()
    weights = np.where(near, 1 / np.where(near, away, 1) ** 2, 0)
    mixed = np.einsum("pq,qkb->pkb", weights, simple)
    return (100 * mixed / mixed.sum(axis=2, keepdims=True) + (simple if own else 0)).reshape(-1, 33)


def test_equal_to_pcl():
    reference = pcl_reference()
    config = FpfhConfig(radius_m=float(reference["radius_m"]))
    found = fpfh(reference["points_m"], reference["normals"], config)[reference["chosen"]]
    np.testing.assert_allclose(found, reference["fpfh"], atol=2e-3)


def test_equal_to_open3d():
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    points, normals, _ = bumpy_torus()
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points.astype(np.float64)))
    cloud.normals = open3d.utility.Vector3dVector(normals.astype(np.float64))
    search = open3d.geometry.KDTreeSearchParamRadius(CONFIG.radius_m)
    expected = open3d.pipelines.registration.compute_fpfh_feature(cloud, search).data.T
    found = fpfh(points, normals, FpfhConfig(radius_m=CONFIG.radius_m, own_histogram=True))
    assert_same_but_for_an_edge(found, expected)


@pytest.mark.parametrize("own", [False, True])
def test_equal_to_its_definition(own):
    points, normals, _ = bumpy_torus(20, 12)
    found = fpfh(points, normals, FpfhConfig(radius_m=0.15, own_histogram=own))
    assert_same_but_for_an_edge(found, plain_fpfh(points, normals, 0.15, own))


def test_a_plane_has_all_its_angles_at_zero():
    points = np.concatenate([np.random.default_rng(1).uniform(0, 1, (300, 2)), np.zeros((300, 1))], axis=1)
    found = fpfh(points, np.tile([0.0, 0.0, 1.0], (300, 1)), FpfhConfig(radius_m=0.2)).reshape(-1, 3, 11)
    np.testing.assert_allclose(found[:, :, 5], 100, rtol=1e-5)


def test_a_mirror_turns_the_second_histogram_around_only():
    points, normals, triangles = bumpy_torus()
    mirror = np.array([-1, 1, 1], np.float32)
    found = describe(points * mirror, normals * mirror, triangles).reshape(-1, 3, 11)
    found[:, 1] = found[:, 1, ::-1]
    assert_same_but_for_an_edge(found.reshape(-1, 33), describe(points, normals, triangles))


def test_a_node_without_normal_is_undefined_and_counts_for_no_other():
    points, normals, triangles = bumpy_torus()
    without, stay = normals.copy(), np.delete(np.arange(len(points)), 33)
    without[33] = np.nan
    found = describe(points, without, triangles)
    assert np.isnan(found[33]).all()
    np.testing.assert_allclose(found[stay], describe(points[stay], normals[stay], triangles), rtol=1e-4, atol=1e-4)
