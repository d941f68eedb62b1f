"""MeshHOG against a plain reading of the paper, and under everything that must not change it."""

from dataclasses import replace

import numpy as np
import pytest
from features_builder import height_field, lump, moved, rough, saddle, somewhere
from features_plain import plain_mesh_hog

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
