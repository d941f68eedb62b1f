"""Laplace-Beltrami operator and spectrum: known spectra, other implementations, laws, pieces, what is not defined."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay, Voronoi
from spectral_builder import ball, flag, rough_sheet, scaled, shuffled
from surface_builder import flat_grid, moved

from anchorpose.research.features.laplacian import mesh_laplacian, surface_laplacian
from anchorpose.research.features.spectral_signatures import spectrum, spectrum_of
from anchorpose.surface.mesh import faces, keep_nodes

pytestmark = pytest.mark.thorough


def cotangent_matrix(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The textbook's loop: no flips, one triangle after another."""
    matrix = np.zeros((len(points), len(points)))
    for triangle in triangles:
        for corner in range(3):
            k, i, j = np.roll(triangle, -corner)
            one, other = points[i] - points[k], points[j] - points[k]
            half = 0.5 * (one @ other) / np.linalg.norm(np.cross(one, other))
            matrix[[i, j], [j, i]] -= half
            matrix[[i, j], [i, j]] += half
    return matrix


def test_a_rectangle_has_the_waves_that_neumann_s_condition_allows():
    surface = flat_grid(31, 46, 0.02)
    i, j = np.mgrid[:12, :12]
    known = np.sort((np.pi**2 * ((i / 0.6) ** 2 + (j / 0.9) ** 2)).ravel())[:20]
    found = spectrum(surface, 20)
    np.testing.assert_allclose(found.eigenvalues, known, rtol=0.012)
    assert found.eigenvalues[0] == 0.0
    first = found.eigenfunctions[:, 1]
    wave = np.cos(np.pi * surface.pixel[:, 1] / 45) * np.sqrt(2 / 0.54)
    np.testing.assert_allclose(first * np.sign(first[0]), wave, atol=0.02)


def test_a_sphere_has_its_harmonics_with_their_multiplicities():
    points, triangles = ball(radius_m=0.3)
    found = spectrum_of(mesh_laplacian(points, triangles), len(points), 36)
    degree = np.repeat(np.arange(6), 2 * np.arange(6) + 1)
    np.testing.assert_allclose(found.eigenvalues, degree * (degree + 1) / 0.3**2, rtol=0.02)  # short waves the worse
    assert found.mass_m2.sum() == pytest.approx(4 * np.pi * 0.3**2, rel=0.01)


def test_where_a_mesh_is_delaunay_the_weights_are_the_cotangents():
    points, triangles = ball(300)
    operator = mesh_laplacian(points, triangles)
    np.testing.assert_allclose(operator.stiffness.toarray(), cotangent_matrix(points, triangles), atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_flips_lead_from_any_triangles_of_a_plane_to_those_of_delaunay(seed):
    random = np.random.default_rng(seed)
    row, col = np.mgrid[:12, :12].astype(float)
    row[1:-1, 1:-1] += random.uniform(-0.25, 0.25, (10, 10))
    col[1:-1, 1:-1] += random.uniform(-0.25, 0.25, (10, 10))
    points = np.stack([row.ravel(), col.ravel(), np.zeros(144)], axis=1)
    corner = (np.arange(11)[:, None] * 12 + np.arange(11)).ravel()
    grid = np.concatenate(
        [np.stack([corner, corner + 12, corner + 13], 1), np.stack([corner, corner + 13, corner + 1], 1)]
    )
    deep = ((points[:, :2] > 1.9) & (points[:, :2] < 9.1)).all(axis=1)  # flips across the outline do not reach there
    known = cotangent_matrix(points, Delaunay(points[:, :2]).simplices)
    operator = mesh_laplacian(points, grid)
    np.testing.assert_allclose(operator.stiffness.toarray()[deep], known[deep], atol=1e-6)
    cells = Voronoi(points[:, :2])
    areas = [ConvexHull(cells.vertices[cells.regions[cells.point_region[k]]]).volume for k in np.flatnonzero(deep)]
    np.testing.assert_allclose(operator.mass_m2[deep], areas, rtol=1e-4)
    assert np.abs(cotangent_matrix(points, grid)[deep] - known[deep]).max() > 0.1
    np.testing.assert_allclose((operator.stiffness @ points)[deep], 0.0, atol=1e-6)  # straight is harmonic


@pytest.mark.parametrize("seed", range(4))
def test_whatever_the_triangles_no_weight_is_negative_and_all_heat_stays(seed):
    surface = rough_sheet(seed)
    operator = surface_laplacian(surface)
    matrix = operator.stiffness.toarray()
    largest = np.abs(matrix).max()
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-14 * largest)
    np.testing.assert_allclose(matrix.sum(axis=1), 0.0, atol=1e-13 * largest)
    assert (matrix - np.diag(np.diag(matrix))).max() < 1e-8
    plain = cotangent_matrix(surface.points_m.astype(float), faces(surface))
    assert (plain - np.diag(np.diag(plain))).max() > 0.5  # as the triangles are, heat would flow from cold to warm
    corners = surface.points_m.astype(float)[faces(surface)]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert operator.mass_m2.min() > 0
    assert len(operator.node) == len(np.unique(faces(surface)))
    assert operator.mass_m2.sum() == pytest.approx(area.sum(), rel=1e-3)  # but for what the trifle adds to slivers


def test_potpourri3d_has_the_same_cotangents():
    pp3d = pytest.importorskip("potpourri3d", reason="potpourri3d is not installed: pip install '.[references]'")
    points, triangles = ball(500)
    operator = mesh_laplacian(points, triangles)
    theirs = pp3d.cotan_laplacian(points, triangles)
    np.testing.assert_allclose(operator.stiffness.toarray(), theirs.toarray(), atol=1e-9)
    assert operator.mass_m2.sum() == pytest.approx(pp3d.vertex_areas(points, triangles).sum(), rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_robust_laplacian_has_the_same_operator_on_shreds(seed):
    theirs = pytest.importorskip("robust_laplacian", reason="robust-laplacian (1.1.0 was compared) is not installed")
    surface = rough_sheet(seed)
    operator = surface_laplacian(surface)
    stiffness, mass = theirs.mesh_laplacian(
        surface.points_m[operator.node].astype(float), np.searchsorted(operator.node, faces(surface))
    )
    np.testing.assert_allclose(operator.stiffness.toarray(), stiffness.toarray(), atol=1e-6)
    assert operator.mass_m2.sum() == pytest.approx(mass.diagonal().sum(), rel=1e-6)  # theirs are thirds of triangles


def test_three_triangles_on_one_edge_share_it_alike():
    turn = 2 * np.pi * np.arange(3) / 3
    points = np.concatenate([[[0, 0, 0], [0, 0, 1]], np.stack([np.cos(turn), np.sin(turn), 0 * turn + 0.5], axis=1)])
    operator = mesh_laplacian(points, np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]]))
    matrix = operator.stiffness.toarray()
    np.testing.assert_allclose(operator.mass_m2[2:], operator.mass_m2[2])
    np.testing.assert_allclose(matrix[2:, :2], matrix[2, 0])
    assert matrix[2, 0] < 0
    np.testing.assert_allclose(matrix.sum(axis=1), 0.0, atol=1e-12)


@pytest.mark.parametrize("pairs", [40, 400])
def test_eigenpairs_solve_the_equation_and_are_orthonormal(pairs):
    surface = rough_sheet(1)
    operator, found = surface_laplacian(surface), spectrum(surface, pairs)
    waves = found.eigenfunctions[operator.node]
    pieces = operator.piece.max() + 1
    assert pieces > 1
    np.testing.assert_array_equal(found.eigenvalues[:pieces], 0.0)
    assert found.eigenvalues[pieces] > 0.1
    assert (np.diff(found.eigenvalues) >= 0).all()
    np.testing.assert_allclose(waves.T @ (operator.mass_m2[:, None] * waves), np.eye(waves.shape[1]), atol=1e-9)
    left = (operator.stiffness @ waves) / operator.mass_m2[:, None] - waves * found.eigenvalues
    assert np.abs(left).max() < 1e-7 * found.eigenvalues[-1] * np.abs(waves).max()


def test_the_spectrum_does_not_see_motion_numbering_or_bending_and_scales_with_the_area():
    surface, config = flag(), 60
    known = spectrum(surface, config).eigenvalues
    order = np.random.default_rng(3).permutation(len(surface))
    for other, slack in ((moved(surface), 1e-4), (shuffled(surface, order), 1e-9), (flag(turn_rad=0.15), 1e-4)):
        np.testing.assert_allclose(spectrum(other, config).eigenvalues, known, rtol=slack)
    np.testing.assert_allclose(spectrum(scaled(surface, 2.0), config).eigenvalues, known / 4.0, rtol=1e-9)


def test_pieces_share_one_spectrum_which_is_that_of_each():
    both = flat_grid(20, 41, 0.02)
    apart = keep_nodes(both, both.pixel[:, 1] != 24)
    left, right = (keep_nodes(both, keep) for keep in (both.pixel[:, 1] < 24, both.pixel[:, 1] > 24))
    found = spectrum(apart, 30)
    own = [spectrum(part, 30).eigenvalues for part in (left, right)]
    np.testing.assert_allclose(found.eigenvalues, np.sort(np.concatenate(own))[:30], rtol=1e-8, atol=1e-12)
    assert found.piece_count == 2
    np.testing.assert_array_equal(np.bincount(found.piece), [len(left), len(right)])


def test_what_has_no_triangle_is_not_known():
    sheet = flat_grid(12, 12, 0.02)
    lonely = keep_nodes(sheet, ((sheet.pixel < 9).all(axis=1)) | (sheet.pixel == [11, 11]).all(axis=1))
    found = spectrum(lonely, 10)
    assert np.isnan(found.eigenfunctions[-1]).all()
    assert (found.piece[-1], found.mass_m2[-1]) == (-1, 0.0)
    assert np.isfinite(found.eigenfunctions[:-1]).all()

    points = sheet.points_m.copy()
    points[50] = np.nan
    found = spectrum(replace(sheet, points_m=points), 10)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.eigenfunctions).any(axis=1)), [50])

    empty = spectrum(keep_nodes(sheet, np.zeros(len(sheet), bool)))
    assert empty.eigenfunctions.shape == (0, 0)
    assert empty.piece_count == 0


def test_small_surfaces_have_as_many_pairs_as_nodes():
    found = spectrum(flat_grid(2, 2, 0.02))
    assert found.eigenfunctions.shape == (4, 4)
    with pytest.raises(ValueError, match="pairs"):
        spectrum(flat_grid(2, 2, 0.02), 0)
