"""3D shape contexts against PCL's numbers, their definition in plain numpy, and what a mirror must give."""

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, pcl_reference

from anchorpose.research.features.neighbours import find_neighbours
from anchorpose.research.features.shape_context import ShapeContextConfig, shape_context, tangent_frames

pytestmark = pytest.mark.thorough

CONFIG = ShapeContextConfig(radius_m=0.12)


def describe(points, normals, triangles):
    return shape_context(points, normals, CONFIG)


def plain_context(points, own, frame, config):
    """The paper's weighed counts of one point in double precision."""
    points = points.astype(np.float64)
    away = np.linalg.norm(points - points[own], axis=1)
    near = (away <= config.radius_m) & (away > 0)
    x, y, z = frame.astype(np.float64) @ (points[near] - points[own]).T
    density = [(np.linalg.norm(points - q, axis=1) <= config.density * config.radius_m).sum() for q in points[near]]
    azimuth = np.linspace(0, 2 * np.pi, config.azimuths + 1)
    elevation = np.linspace(0, np.pi, config.elevations + 1)
    shell = np.geomspace(config.innermost * config.radius_m, config.radius_m, config.shells + 1)
    where = np.stack([np.arctan2(y, x) % (2 * np.pi), np.arccos(z / away[near]), np.maximum(away[near], shell[0])], 1)
    count = np.histogramdd(where, (azimuth, elevation, shell), weights=1 / np.array(density))[0]
    volume = (2 * np.pi / config.azimuths) * -np.diff(np.cos(elevation))[:, None] * np.diff(shell**3) / 3
    return (count / np.cbrt(volume)).ravel()


def in_frames(reference, name, config):
    """Contexts of the chosen nodes in frames of PCL; all others have none."""
    frames = np.full((len(reference["points_m"]), 3, 3), np.nan)
    frames[reference["chosen"]] = reference[name].reshape(-1, 3, 3)
    return shape_context(reference["points_m"], reference["normals"], config, frames)[reference["chosen"]]


def test_equal_to_pcl_in_its_frames():
    reference = pcl_reference()
    config = ShapeContextConfig(radius_m=float(reference["radius_m"]))
    found = in_frames(reference, "turn", config)
    np.testing.assert_allclose(found, reference["context"], rtol=1e-4, atol=1e-3)


def test_equal_to_pcls_unique_shape_context():
    reference = pcl_reference()
    config = ShapeContextConfig(radius_m=float(reference["radius_m"]), azimuths=14, elevations=14, shells=10)
    found = in_frames(reference, "frame", config)
    np.testing.assert_allclose(found, reference["unique"], rtol=1e-4, atol=1e-3)


def test_equal_to_its_definition():
    points, normals, _ = bumpy_torus()
    config = ShapeContextConfig(radius_m=0.12, innermost=0.2, density=0.3, azimuths=5, elevations=4, shells=3)
    frames = tangent_frames(points, normals, find_neighbours(points, 0.12))
    found = shape_context(points, normals, config)
    assert found.shape == (720, config.cells)
    expected = np.stack([plain_context(points, own, frames[own], config) for own in range(0, 720, 9)])
    assert_same_but_for_an_edge(found[::9], expected)


def test_an_axis_along_the_normal_has_no_direction():
    """Points on a line whose normals follow it: their widest spread is the normal."""
    points = np.stack([np.zeros(9), np.zeros(9), np.linspace(0, 1, 9)], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (9, 1))
    assert np.isnan(shape_context(points, normals, ShapeContextConfig(radius_m=5.0))).all()


def test_a_node_without_normal_is_undefined_and_still_counts():
    points, normals, triangles = bumpy_torus()
    without = normals.copy()
    without[33] = np.nan
    found, whole = describe(points, without, triangles), describe(points, normals, triangles)
    assert np.isnan(found[33]).all()
    np.testing.assert_array_equal(np.delete(found, 33, axis=0), np.delete(whole, 33, axis=0))


def test_a_mirror_turns_the_azimuths_around():
    points, normals, triangles = bumpy_torus()
    mirror = np.array([-1, 1, 1], np.float32)
    found = describe(points * mirror, normals * mirror, triangles).reshape(-1, 12, 165)
    assert_same_but_for_an_edge(found[:, ::-1].reshape(-1, 1980), describe(points, normals, triangles))


def test_frames_that_are_not_one_a_node_are_refused():
    points, normals, _ = bumpy_torus()
    with pytest.raises(ValueError, match=r"\(720, 3, 3\)"):
        shape_context(points, normals, frames=np.zeros((2, 3, 3)))
