"""MeshHOG against a plain reading of the paper, and under everything that must not change it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from features_builder import height_field, lump, moved, renumbered, rough, saddle, somewhere
from features_plain import plain_mesh_hog
from surface_builder import flat_grid

from anchorpose.research.features.mesh_gradient import mesh_gradient
from anchorpose.research.features.mesh_hog import MeshHogConfig, ScalarFunction, mesh_hog, scalar_function

pytestmark = pytest.mark.thorough

MIDDLE = 41 * 41 // 2
SMALL = MeshHogConfig(radius_m=0.10, curvature_radius_m=0.05)


@pytest.mark.parametrize("function", list(ScalarFunction))
def test_each_row_is_what_the_paper_says_written_out(function: ScalarFunction) -> None:
    surface = rough(height_field(lump), 1)
    rotation, shift = somewhere(2)
    surface = moved(surface, rotation, shift)
    config = replace(SMALL, function=function, slices=5, orientations=7, directions=24)
    chosen = np.array([MIDDLE, 3, 700, 1200])
    found = mesh_hog(surface, config)[chosen]
    assert found.shape == (4, config.width)
    assert found.dtype == np.float32
    gradients = mesh_gradient(surface, scalar_function(surface, config))
    expected = np.stack([plain_mesh_hog(surface, config, gradients, node) for node in chosen])
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_moving_the_surface_and_renumbering_its_nodes_changes_no_row() -> None:
    surface, config = rough(height_field(lump, side=31), 4), SMALL
    rotation, shift = somewhere(5)
    order = np.random.default_rng(6).permutation(len(surface))
    found = mesh_hog(renumbered(moved(surface, rotation, shift), order), config)
    distance = np.linalg.norm(found - mesh_hog(surface, config)[order], axis=1)
    # positions are float32 and curvature is their difference; a peak may be one of two that are equally high
    assert np.median(distance) < 0.002
    assert np.quantile(distance, 0.98) < 0.05


@pytest.mark.parametrize("turn", [0.4, 1.1, 2.5, 4.0])
def test_a_lump_turned_on_its_sheet_has_nearly_the_same_descriptor(turn: float) -> None:
    """The nodes lie elsewhere on it, which shows more in where gradients are than in whither they point."""
    config = MeshHogConfig(radius_m=0.12, curvature_radius_m=0.05)
    own = mesh_hog(height_field(lump), config)[MIDDLE]
    turned = mesh_hog(height_field(lump, turn_rad=turn), config)[MIDDLE]
    other = mesh_hog(height_field(saddle), config)[MIDDLE]
    assert np.linalg.norm(own - turned) < 0.35
    assert np.linalg.norm(own - other) > 0.5


def test_a_mirrored_shape_is_distinguished_from_the_shape() -> None:
    config = MeshHogConfig(radius_m=0.12, curvature_radius_m=0.05)
    own = mesh_hog(height_field(lump), config)[MIDDLE]
    mirrored = mesh_hog(height_field(lambda left, up: lump(-left, up)), config)[MIDDLE]
    assert np.linalg.norm(own - mirrored) > 0.5


def test_where_nothing_changes_there_is_no_descriptor() -> None:
    flat = flat_grid(9, 9, 0.02)
    assert np.isnan(mesh_hog(flat, SMALL)).all()
    assert np.isnan(mesh_hog(flat_grid(1, 1, 0.02), SMALL)).all()
    assert mesh_hog(flat_grid(2, 2, 0.02, np.zeros((2, 2), bool)), SMALL).shape == (0, 96)


def test_a_node_without_position_or_normal_has_no_descriptor_and_spoils_no_other() -> None:
    surface = rough(height_field(lump, side=21), 9)
    points, normals = surface.points_m.copy(), surface.normals.copy()
    points[100], normals[200] = np.nan, np.nan
    found = mesh_hog(replace(surface, points_m=points, normals=normals), SMALL)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found).any(axis=1)), [100, 200])
    assert np.isnan(found[[100, 200]]).all()


@pytest.mark.parametrize(
    "wrong",
    [{"radius_m": 0.0}, {"curvature_radius_m": np.nan}, {"spread": -1.0}, {"slices": 1}, {"function": "colour"}],
)
def test_settings_without_a_meaning_are_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="validation error"):
        MeshHogConfig(**wrong)
