"""SHOT and its frame against PCL's numbers, the frame against its definition, and what a mirror must give."""

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, pcl_reference

from anchorpose.research.features.local_frame import local_frames
from anchorpose.research.features.neighbours import find_neighbours
from anchorpose.research.features.shot import ShotConfig, shot

CONFIG = ShotConfig(radius_m=0.12)


def describe(points, normals, triangles):
    return shot(points, normals, CONFIG)


def plain_frame(points, own, radius_m):
    """The paper's axes of one point in double precision."""
    arms = np.delete(points, own, axis=0).astype(np.float64) - points[own]
    away = np.linalg.norm(arms, axis=1)
    arms, away = arms[away <= radius_m], away[away <= radius_m]
    _, axes = np.linalg.eigh(np.einsum("m,mi,mj->ij", radius_m - away, arms, arms))
    x, z = axes[:, 2], axes[:, 0]
    ties = [(arms @ axis >= 0).sum() * 2 == len(arms) for axis in (x, z)]
    x, z = (axis if (arms @ axis >= 0).sum() * 2 > len(arms) else -axis for axis in (x, z))
    return np.stack([x, np.cross(z, x), z]), any(ties)


@pytest.mark.thorough
def test_frames_equal_pcls():
    reference = pcl_reference()
    near = find_neighbours(reference["points_m"], float(reference["radius_m"]))
    found = local_frames(reference["points_m"], near)[reference["chosen"]].reshape(-1, 9)
    np.testing.assert_allclose(found, reference["frame"], atol=2e-5)


def test_equal_to_pcl():
    reference = pcl_reference()
    config = ShotConfig(radius_m=float(reference["radius_m"]))
    found = shot(reference["points_m"], reference["normals"], config)[reference["chosen"]]
    np.testing.assert_allclose(found, reference["shot"], atol=2e-5)


def test_frames_equal_their_definition():
    points, _, _ = bumpy_torus()
    near = find_neighbours(points, 0.12)
    found, compared = local_frames(points, near), 0
    for own in range(0, len(points), 7):
        expected, tie = plain_frame(points, own, 0.12)
        if not tie:
            np.testing.assert_allclose(found[own], expected, atol=1e-5)
            compared += 1
    assert compared > 80


def test_z_by_normal_points_outwards_and_changes_no_axis():
    points, normals, _ = bumpy_torus()
    near = find_neighbours(points, 0.12)
    plain, outward = local_frames(points, near), local_frames(points, near, normals)
    assert ((outward[:, 2] * normals).sum(axis=1) > 0).all()
    np.testing.assert_array_equal(np.abs(outward), np.abs(plain))
    np.testing.assert_array_equal(outward[:, 0], plain[:, 0])
    assert 0.05 < (outward[:, 2] != plain[:, 2]).any(axis=1).mean() < 0.95
    config = ShotConfig(radius_m=0.12, z_by_normal=True)
    np.testing.assert_array_equal(shot(points, normals, config), shot(points, normals, config, frames=outward))


def test_fewer_than_five_neighbours_have_no_frame():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [9, 9, 9]], np.float32)
    assert np.isnan(local_frames(points, find_neighbours(points, 3.0))).all()
    points[5] = [0, 1, 1]
    assert np.isfinite(local_frames(points, find_neighbours(points, 3.0))).all()


def test_a_plane_leans_nowhere():
    """All normals along z: only the bins at a cosine of 1 hold votes, of which none is beside them but by wrapping."""
    points = np.concatenate([np.random.default_rng(1).uniform(0, 1, (300, 2)), np.zeros((300, 1))], axis=1)
    normals = np.tile([0.0, 0.0, 1.0], (300, 1))
    frames = np.tile(np.eye(3), (300, 1, 1))
    found = shot(points, normals, ShotConfig(radius_m=0.2), frames=frames).reshape(300, 32, 11)
    assert (found[:, :, :10] == 0).all()
    assert (found[:, :, 10] > 0).any(axis=1).all()


def test_a_mirror_turns_the_sectors_around():
    """y is the axis that a mirror turns round, and with it the order of the eighths of a turn."""
    points, normals, triangles = bumpy_torus()
    mirror = np.array([-1, 1, 1], np.float32)
    found = describe(points * mirror, normals * mirror, triangles).reshape(-1, 8, 44)
    assert_same_but_for_an_edge(found[:, ::-1].reshape(-1, 352), describe(points, normals, triangles))


def test_a_node_without_normal_casts_no_vote_but_is_described():
    points, normals, triangles = bumpy_torus()
    without = normals.copy()
    without[33] = np.nan
    found, whole = describe(points, without, triangles), describe(points, normals, triangles)
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(found[33], whole[33])
    assert (found != whole).any()
    assert np.isnan(describe(points, np.full_like(normals, np.nan), triangles)).all()


def test_frames_that_are_not_one_a_node_are_refused():
    points, normals, _ = bumpy_torus()
    with pytest.raises(ValueError, match=r"\(720, 3, 3\)"):
        shot(points, normals, frames=np.zeros((720, 9)))
