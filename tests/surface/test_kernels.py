"""The compiled kernels of the surface against the plain way to write the same thing."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from surface_builder import flat_grid, kinect, plane_depth, sphere_depth, with_links

from anchorpose.surface.denoise import denoise, drop_flying_pixels, estimate_noise, extent, jump_coefficients
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import build_surface, edges, estimate_normals, keep_nodes
from anchorpose.surface.surface import SurfaceConfig

CAMERA = kinect(90, 70)


def ragged(seed):
    """A noisy slanted wall with a ball before it, holes, and readings up to the edges of the picture."""
    rng = np.random.default_rng(seed)
    depth = plane_depth(CAMERA, np.array([0.3, 0.2, 0.93]), 2.2)
    ball = sphere_depth(CAMERA, np.array([0.02, 0.0, 1.9]), 0.12)
    depth = np.where(ball > 0, ball, depth) + rng.normal(0, 0.003, depth.shape)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    mask = rng.random(depth.shape) < 0.95
    mask[40:50, 20:60] = False
    return depth.astype(np.float32), mask


def neighbours(shape, row, col, radius):
    for i in range(max(0, row - radius), min(shape[0], row + radius + 1)):
        for j in range(max(0, col - radius), min(shape[1], col + radius + 1)):
            yield i, j


@pytest.mark.parametrize("radius", [1, 2, 3])
def test_smoothing_is_the_bilateral_filter_written_out(radius):
    depth, mask = ragged(1)
    reach = 0.0006 * 6.0
    masked = np.where(mask, depth, 0.0).astype(np.float64)
    smooth = np.zeros(depth.shape)
    for row, col in np.argwhere(masked > 0):
        z, total, weights = masked[row, col], 0.0, 0.0
        for i, j in neighbours(depth.shape, row, col, radius):
            closeness = 1.0 - ((masked[i, j] - z) / (reach * z * z)) ** 2
            if masked[i, j] > 0 and closeness > 0:
                apart2 = (i - row) ** 2 + (j - col) ** 2
                weight = closeness**2 * np.exp(-0.5 * apart2 / (radius + 0.5) ** 2)
                total, weights = total + weight * masked[i, j], weights + weight
        smooth[row, col] = total / weights
    found = denoise(depth, mask, 0.0006, radius)
    np.testing.assert_allclose(found, smooth, atol=1e-6)


@pytest.mark.parametrize("step_m", [0.0, 0.02])
def test_the_noise_is_the_median_of_all_second_differences_or_steps(step_m):
    depth, mask = ragged(2)
    if step_m > 0:
        depth = (np.round(depth / step_m) * step_m).astype(np.float32)
    z = np.where(mask, depth, 0.0).astype(np.float64)
    left, middle, right = z[:, :-2], z[:, 1:-1], z[:, 2:]
    usable = (left > 0) & (middle > 0) & (right > 0)
    left, middle, right = left[usable], middle[usable], right[usable]
    noise = 1.4826 * np.median(np.abs(left - 2 * middle + right) / middle**2) / np.sqrt(6.0)
    step = np.abs(right - middle)
    if (step == 0).mean() > 0.3:
        noise = max(noise, np.median((step / middle**2)[(step > 0) & (step <= 0.02 * middle)]) / 2)
    assert estimate_noise(depth, mask) == pytest.approx(noise, rel=1e-9)


@pytest.mark.parametrize("support", [0, 3, 6])
def test_flying_pixels_are_those_with_too_few_neighbours(support):
    depth = np.where(ragged(3)[1], ragged(3)[0], 0.0)
    slope, spread = jump_coefficients(365.0, 0.0005)
    kept = np.zeros_like(depth)
    for row, col in np.argwhere(depth > 0):
        z = float(depth[row, col])
        close = [
            depth[i, j] > 0 and abs(float(depth[i, j]) - z) <= slope * z + spread * z * z
            for i, j in neighbours(depth.shape, row, col, 1)
        ]
        kept[row, col] = z if sum(close) - 1 >= support else 0.0
    np.testing.assert_array_equal(drop_flying_pixels(depth, slope, spread, support), kept)


@pytest.mark.parametrize(("radius", "order"), [(1, "raster"), (3, "raster"), (3, "shuffled")])
def test_normals_are_those_of_the_weighted_plane_fitted_to_each_window(radius, order):
    depth = np.where(ragged(4)[1], ragged(4)[0], 0.0).astype(np.float32)
    rays, pixel = CAMERA.pixel_rays().astype(np.float64), np.argwhere(depth > 0).astype(np.int16)
    if order == "shuffled":
        pixel = np.random.default_rng(0).permutation(pixel)[:400]
    slope, spread = jump_coefficients(365.0, 0.0005)
    found = estimate_normals(depth, CAMERA.pixel_rays(), pixel, radius, slope, spread)
    for node in range(0, len(pixel), 7):
        row, col = pixel[node].astype(int)
        z, rows = float(depth[row, col]), []
        for i, j in neighbours(depth.shape, row, col, radius):
            apart = max(abs(i - row), abs(j - col), 1)
            if depth[i, j] > 0 and abs(float(depth[i, j]) - z) <= (slope * z + spread * z * z) * apart:
                weight = 1.0 - ((i - row) ** 2 + (j - col) ** 2) / (2.0 * (radius + 1) ** 2)
                rows.append(np.sqrt(weight) * np.array([*rays[i, j], 1.0, 1.0 / depth[i, j]]))
        system = np.array(rows)
        if np.linalg.matrix_rank(system[:, :3], tol=1e-4) < 3:
            assert np.isnan(found[node]).all()
            continue
        plane = np.linalg.lstsq(system[:, :3], system[:, 3], rcond=None)[0]
        np.testing.assert_allclose(found[node], -plane / np.linalg.norm(plane), atol=2e-4)


def test_a_normal_where_there_is_no_reading_is_refused():
    depth = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    with pytest.raises(ValueError, match="no reading"):
        estimate_normals(depth, CAMERA.pixel_rays(), np.array([[3, 3]], np.int16), 3, 0.01, 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_pieces_are_those_of_the_graph_of_all_edges(seed):
    rng = np.random.default_rng(seed)
    surface = flat_grid(30, 40, 0.01, rng.random((30, 40)) < 0.45)
    linked = with_links(surface, rng.integers(0, len(surface), (20, 2)))
    start, node = linked.link_start, linked.link_node
    piece = pieces(linked)
    linked_to = np.stack([np.repeat(np.arange(len(surface)), np.diff(start)), node], axis=1)
    pair = np.concatenate([edges(surface), linked_to])
    graph = coo_array((np.ones(len(pair)), pair.T), shape=(len(surface), len(surface)))
    count, label = connected_components(graph, directed=False)
    assert piece.max() + 1 == count
    assert len(np.unique(np.stack([piece, label], axis=1), axis=0)) == count


@pytest.mark.parametrize("seed", range(3))
def test_the_extent_is_the_smallest_box_that_holds_everything(seed):
    mask = np.random.default_rng(seed).random((40, 50)) < (0.002, 0.02, 0.5)[seed]
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    assert extent(mask) == (rows[0], rows[-1] + 1, columns[0], columns[-1] + 1)
    assert extent(np.zeros((4, 5), bool)) == (0, 0, 0, 0)


@pytest.mark.parametrize("step", [1, 2, 3])
def test_nodes_lie_on_every_step_th_pixel_and_are_joined_where_no_pixel_between_jumps(step):
    depth, mask = ragged(5)
    config = SurfaceConfig(step=step, min_piece_m2=0.0, max_join_m=0.0)
    surface = build_surface(depth, mask, CAMERA, config)
    assert (surface.pixel % step == 0).all()
    noise = estimate_noise(depth, mask)
    slope, spread = jump_coefficients(365.0, noise)
    clean = drop_flying_pixels(denoise(depth, mask, noise), slope, spread, config.min_support)
    index = {tuple(pixel): node for node, pixel in enumerate(surface.pixel.tolist())}
    ways = ((0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0), (1, 1))
    for (row, col), node in index.items():
        for place, (down, right) in enumerate(ways):
            other = index.get((row + step * down, col + step * right), -1)
            if other >= 0:
                line = [float(clean[row + k * down, col + k * right]) for k in range(step + 1)]
                line = [z for z in line if z > 0]
                far = max(line[0], line[-1])
                other = other if np.abs(np.diff(line)).max() <= slope * far + spread * far * far else -1
            assert surface.ring[node, place] == other


def test_what_is_left_out_leaves_with_its_links():
    rng = np.random.default_rng(7)
    surface = flat_grid(12, 15, 0.01)
    keep = rng.random(len(surface)) < 0.6
    assert len(pieces(keep_nodes(surface, keep))) == np.count_nonzero(keep)
    assert keep_nodes(surface, np.ones(len(surface), bool)) is surface
