"""What every local descriptor obeys, whoever described it first."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from feature_laws import assert_same_but_for_an_edge
from feature_shapes import bumpy_torus, rigid_motion
from features_builder import height_field, lump, renumbered, rough, somewhere
from features_builder import moved as placed
from surface_builder import flat_grid

from anchorpose.research.features.fpfh import FpfhConfig, fpfh
from anchorpose.research.features.gmds import GmdsConfig
from anchorpose.research.features.ld_sift import LdSiftConfig, ld_sift
from anchorpose.research.features.mesh_hog import MeshHogConfig, mesh_hog
from anchorpose.research.features.rops import RopsConfig, rops
from anchorpose.research.features.shape_context import ShapeContextConfig, shape_context
from anchorpose.research.features.shot import ShotConfig, shot
from anchorpose.research.features.spectral_signatures import HksConfig, SiHksConfig, WksConfig


def thorough(*values):
    return pytest.param(*values, marks=pytest.mark.thorough)


def of_fpfh(points, normals, triangles):
    return fpfh(points, normals, FpfhConfig(radius_m=0.1))


def of_shot(points, normals, triangles):
    return shot(points, normals, ShotConfig(radius_m=0.12))


def of_shape_context(points, normals, triangles):
    return shape_context(points, normals, ShapeContextConfig(radius_m=0.12))


def of_rops(points, normals, triangles):
    return rops(points, triangles, RopsConfig(radius_m=0.12))


@pytest.fixture(
    params=[of_fpfh, *map(thorough, (of_shot, of_shape_context, of_rops))], ids=["FPFH", "SHOT", "3DSC", "RoPS"]
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
    if describe is not of_rops:  # it takes no normals
        with pytest.raises(ValueError, match="719 normals"):
            describe(points, normals[1:], triangles)


LD_SIFT = partial(ld_sift, config=LdSiftConfig(radius_m=0.10, samples=4))
MESH_HOG = partial(mesh_hog, config=MeshHogConfig(radius_m=0.10, curvature_radius_m=0.05))


@pytest.mark.parametrize(
    ("of_mesh", "share", "most"), [(LD_SIFT, 0.97, (0.001, 0.1)), thorough(MESH_HOG, 0.98, (0.002, 0.05))]
)
def test_a_mesh_that_is_moved_and_renumbered_has_the_same_rows(of_mesh, share, most):
    """But for a pixel at the rim, the other end of an axis, or one of two peaks that are equally high."""
    surface = rough(height_field(lump, side=31), 5)
    order = np.random.default_rng(7).permutation(len(surface))
    found = of_mesh(renumbered(placed(surface, *somewhere(6)), order))
    distance = np.linalg.norm(found - of_mesh(surface)[order], axis=1)
    assert np.median(distance) < most[0]
    assert np.quantile(distance, share) < most[1]


@pytest.mark.parametrize(("of_mesh", "width"), [(LD_SIFT, 128), thorough(MESH_HOG, 96)])
def test_a_flat_mesh_and_a_node_without_position_or_normal_have_no_descriptor(of_mesh, width):
    for sides in ((1, 1), (1, 9), (9, 9)):
        assert np.isnan(of_mesh(flat_grid(*sides, 0.02))).all()
    assert of_mesh(flat_grid(2, 2, 0.02, np.zeros((2, 2), bool))).shape == (0, width)
    surface = rough(height_field(lump, side=21), 10)
    points, normals = surface.points_m.copy(), surface.normals.copy()
    points[100], normals[200] = np.nan, np.nan
    found = np.isnan(of_mesh(replace(surface, points_m=points, normals=normals)))
    np.testing.assert_array_equal(np.flatnonzero(found.any(axis=1)), [100, 200])
    assert found[[100, 200]].all()


@pytest.mark.parametrize(
    ("config", "problem", "wrong"),
    [
        (FpfhConfig, "radius", {"radius_m": -0.1}),
        (ShotConfig, "radius", {"radius_m": float("nan")}),
        (RopsConfig, "turns", {"turns": 0}),
        (RopsConfig, "bins", {"bins": 0}),
        (RopsConfig, "radius", {"radius_m": 0.0}),
        (ShapeContextConfig, "innermost", {"innermost": 1.0}),
        (ShapeContextConfig, "innermost", {"innermost": 0.0}),
        (ShapeContextConfig, "density", {"density": 0.0}),
        (ShapeContextConfig, "shells", {"shells": 0}),
        (ShapeContextConfig, "azimuths", {"azimuths": 0}),
        (LdSiftConfig, "radius_m", {"radius_m": 0.0}),
        (LdSiftConfig, "floor_m", {"floor_m": np.nan}),
        (LdSiftConfig, "samples", {"samples": 0}),
        (LdSiftConfig, "beyond", {"beyond": "up"}),
        (MeshHogConfig, "radius_m", {"radius_m": 0.0}),
        (MeshHogConfig, "curvature_radius_m", {"curvature_radius_m": np.nan}),
        (MeshHogConfig, "spread", {"spread": -1.0}),
        (MeshHogConfig, "slices", {"slices": 1}),
        (MeshHogConfig, "function", {"function": "colour"}),
        (GmdsConfig, "samples", {"samples": 0}),
        (GmdsConfig, "first_samples", {"first_samples": 1}),
        (GmdsConfig, "first_candidates", {"first_candidates": 300}),
        (GmdsConfig, "cap_m", {"cap_m": 0.0}),
        (GmdsConfig, "min_piece", {"min_piece": 2.0}),
        (GmdsConfig, "max_branches", {"max_branches": 3}),
        (HksConfig, "times", {"times": 0}),
        (HksConfig, "range_m2", {"range_m2": (1.0, 0.1)}),
        (HksConfig, "range_m2", {"range_m2": (0.0, 0.1)}),
        (WksConfig, "range_per_m2", {"range_per_m2": (5.0, np.inf)}),
        (WksConfig, "width_steps", {"width_steps": 0.0}),
        (WksConfig, "nothing between", {"energies": 20}),
        (SiHksConfig, "octaves", {"octaves": 0.0}),
        (SiHksConfig, "steps_per_octave", {"steps_per_octave": 0}),
        (SiHksConfig, "frequencies", {"frequencies": 500}),
        (SiHksConfig, "first_octave", {"first_octave": np.nan}),
    ],
)
def test_settings_without_a_meaning_are_refused(config, problem, wrong):
    with pytest.raises(ValueError, match=problem):
        config(**wrong)
