"""What every local descriptor obeys, whoever described it first."""

from __future__ import annotations

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, rigid_motion

from anchorpose.research.features.fpfh import FpfhConfig, fpfh
from anchorpose.research.features.rops import RopsConfig, rops
from anchorpose.research.features.shape_context import ShapeContextConfig, shape_context
from anchorpose.research.features.shot import ShotConfig, shot


def of_fpfh(points, normals, triangles):
    return fpfh(points, normals, FpfhConfig(radius_m=0.1))


def of_shot(points, normals, triangles):
    return shot(points, normals, ShotConfig(radius_m=0.12))


def of_shape_context(points, normals, triangles):
    return shape_context(points, normals, ShapeContextConfig(radius_m=0.12))


def of_rops(points, normals, triangles):
    return rops(points, triangles, RopsConfig(radius_m=0.12))


@pytest.fixture(
    params=[of_fpfh, *(pytest.param(one, marks=pytest.mark.thorough) for one in (of_shot, of_shape_context, of_rops))],
    ids=["FPFH", "SHOT", "3DSC", "RoPS"],
)
def describe(request):
    """``describe(points_m, normals, triangles)``, all else fixed."""
    return request.param


@pytest.mark.parametrize("seed", [1, 2])
def test_rigid_motion_changes_nothing(describe, seed):
    points, normals, triangles = bumpy_torus()
    rotation, shift = rigid_motion(seed)
    moved = (points @ rotation.T + shift).astype(np.float32)
    turned = (normals @ rotation.T).astype(np.float32)
    found, expected = describe(moved, turned, triangles), describe(points, normals, triangles)
    assert_same_but_for_an_edge(
        found, expected, vote=1.0 if describe is of_shape_context else 0.25
    )  # the narrowest cells of it weigh most


def test_order_of_nodes_changes_nothing(describe):
    points, normals, triangles = bumpy_torus()
    order = np.random.default_rng(3).permutation(len(points))
    number = np.empty(len(points), np.int32)
    number[order] = np.arange(len(points))
    shuffled = describe(points[order], normals[order], number[triangles])
    assert_same_but_for_an_edge(shuffled, describe(points, normals, triangles)[order], rows=0.99)


def test_not_the_same_everywhere(describe):
    every = describe(*bumpy_torus())
    assert every.dtype == np.float32
    assert np.isfinite(every).all()
    assert len(np.unique(every.round(4), axis=0)) == len(every)


def test_unknown_nodes_are_left_out(describe):
    """A node whose position is NaN has a NaN row, and everybody else the row as if it were not there."""
    points, normals, triangles = bumpy_torus()
    gone = np.array([5, 100, 101, 400])
    points, normals = points.copy(), normals.copy()
    points[gone] = normals[gone] = np.nan
    stay = np.setdiff1d(np.arange(len(points)), gone)
    number = np.full(len(points), -1, np.int32)
    number[stay] = np.arange(len(stay))
    whole = number[triangles][(number[triangles] >= 0).all(axis=1)]
    found = describe(points, normals, triangles)
    assert np.isnan(found[gone]).all()
    np.testing.assert_allclose(found[stay], describe(points[stay], normals[stay], whole), rtol=1e-4, atol=1e-4)


def test_alone_is_undefined(describe):
    """A node far from all others is NaN and changes nobody; no nodes give no rows."""
    points, normals, triangles = bumpy_torus()
    more = np.concatenate([points, [[5.0, 5.0, 5.0]]]).astype(np.float32)
    upward = np.concatenate([normals, [[0.0, 0.0, 1.0]]]).astype(np.float32)
    found, without = describe(more, upward, triangles), describe(points, normals, triangles)
    assert np.isnan(found[-1]).all()
    np.testing.assert_allclose(found[:-1], without, rtol=1e-4, atol=1e-4)
    nothing = np.empty((0, 3), np.float32)
    assert describe(nothing, nothing, np.empty((0, 3), np.int32)).shape == (0, without.shape[1])


def test_nonsense_is_refused(describe):
    points, normals, triangles = bumpy_torus()
    with pytest.raises(ValueError, match=r"shape \(n, 3\)"):
        describe(points[:, :2], normals, triangles)
