"""All solvers of geodesic distance behind the one interface: known shapes, the exact one as oracle, refusals."""

import sys
from dataclasses import replace
from pathlib import Path

import body_builder
import cv2
import numpy as np
import pytest
from surface_builder import flat_grid, grid_surface, kinect, sphere_depth, with_links

from anchorpose.camera import Camera
from anchorpose.errors import MissingPackage
from anchorpose.geodesics.distance import geodesic_distance_to_set
from anchorpose.geodesics.extrema import surface_center
from anchorpose.recording.reader import open_recording
from anchorpose.research.geodesic_solvers import Solver, solve_distance, triangle_mesh
from anchorpose.surface.mesh import build_surface, faces, keep_nodes
from anchorpose.surface.surface import Surface, SurfaceConfig

SPACING = 0.013  # every second pixel of a Kinect v2 at 2.4 m

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"

WITHIN = {
    # mean and greatest error on smooth shapes of 0.5 to 0.8 m, as measured and rounded up: the solver's own property
    Solver.FAST_MARCHING: (0.002, 0.006),
    Solver.DIJKSTRA: (0.030, 0.075),
    Solver.HEAT: (0.006, 0.030),
    Solver.EXACT: (0.0006, 0.004),  # of the shape, whose curve the mesh cuts short; exact on the mesh itself
}


def plane():
    surface = flat_grid(40, 50, SPACING)
    return surface, 1010, np.linalg.norm(surface.points_m - surface.points_m[1010], axis=1)


def cylinder():
    along, angle = np.meshgrid(np.linspace(0, 0.8, 62), np.linspace(0, np.pi, 37), indexing="ij")
    surface = grid_surface(np.stack([0.15 * np.sin(angle), -along, 0.15 * np.cos(angle)], axis=2))
    flat, source = np.stack([along, 0.15 * angle], axis=2).reshape(-1, 2), 5 * 37 + 3
    return surface, source, np.linalg.norm(flat - flat[source], axis=1)


def cone():
    """Unrolled, a straight line of a sector; the steep top lies between source and far side."""
    row, col = np.mgrid[-25:26, -25:26] * SPACING
    radius, slope = np.hypot(row, col), 1.2
    surface = grid_surface(np.stack([-slope * radius, -row, -col], axis=2))
    source = 25 * 51 + 12
    slant = np.sqrt(1 + slope**2) * radius.ravel()
    turn = np.abs(np.angle(np.exp(1j * (np.arctan2(row, col).ravel() - np.arctan2(row, col).ravel()[source]))))
    opened = turn / np.sqrt(1 + slope**2)
    known = np.sqrt(slant**2 + slant[source] ** 2 - 2 * slant * slant[source] * np.cos(opened))
    return surface, source, np.where(radius.ravel() <= 25 * SPACING, known, np.nan)  # the corners' lines leave the mesh


def sphere():
    camera, centre, radius = kinect(), np.array([0, 0, 2.4]), 0.3
    depth = sphere_depth(camera, centre, radius)
    surface = build_surface(depth, depth > 0, camera)
    middle = camera.require_pose()[:3, :3] @ centre + camera.position_m
    bearing = surface.points_m - middle
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    source = int(np.argmax(bearing[:, 0]))
    arc = radius * np.arccos(np.clip(bearing @ bearing[source], -1, 1))
    return surface, source, np.where(arc < radius * np.radians(65), arc, np.nan)  # at the rim a pixel is 3 cm of skin


@pytest.mark.parametrize("shape", [plane, cylinder, cone, sphere])
@pytest.mark.parametrize("solver", list(Solver))
def test_every_solver_knows_the_distances_of_shapes_that_are_known(shape, solver):
    surface, source, known = shape()
    field = solve_distance(surface, [source], solver=solver)[0]
    error = np.abs(field - known)[np.isfinite(known)]
    mean, most = WITHIN[solver]
    assert error.mean() < mean
    assert error.max() < most


@pytest.fixture(scope="module")
def body() -> Surface:
    """The simulator's body as a Kinect v2 would see it, without bridges and joins: one piece of triangles."""
    camera = body_builder.FRONT
    skin = body_builder.skin_in(body_builder.standing(), body_builder.adult_body())
    return one_piece(body_builder.photograph(skin, camera).depth_m, camera)


def one_piece(depth_m: np.ndarray, camera: Camera, step: int = 2) -> Surface:
    """The largest patch of triangles, and no edge or corner beside them that is a passage for some solvers only."""
    surface = build_surface(depth_m, depth_m > 0, camera, SurfaceConfig(step=step, max_join_m=0))
    while True:
        mesh = triangle_mesh(surface)
        largest = mesh.node[mesh.patch == np.bincount(mesh.patch).argmax()]
        keep = np.bincount(largest, minlength=len(surface)) == 1
        trimmed = on_triangles(keep_nodes(surface, keep))
        if keep.all() and (trimmed.ring == surface.ring).all():
            return trimmed
        surface = trimmed


def on_triangles(surface: Surface) -> Surface:
    """Ring edges that are no triangle's side go, but for the other diagonal of a cell of two triangles."""
    count = np.int64(len(surface))
    triangle = faces(surface).astype(np.int64)
    key = np.sort(np.stack([triangle, np.roll(triangle, 1, axis=1)], axis=2), axis=2) @ [count, 1]  # (f, 3)
    order = np.argsort(key.ravel(), kind="stable")
    twice = np.flatnonzero(np.diff(key.ravel()[order]) == 0)
    opposite = np.roll(triangle, -1, axis=1).ravel()[order]  # the corner that is not on the side
    across = np.sort(np.stack([opposite[twice], opposite[twice + 1]], axis=1), axis=1) @ [count, 1]
    node = np.arange(count)[:, None]
    ring = surface.ring.astype(np.int64)
    own = np.sort(np.stack([np.broadcast_to(node, ring.shape), ring], axis=2), axis=2) @ [count, 1]
    return replace(surface, ring=np.where(np.isin(own, np.append(key, across)), surface.ring, -1))


def spread_sources(surface: Surface, count: int = 4) -> np.ndarray:
    """Nodes far from one another, the topmost first."""
    chosen = [int(np.argmax(surface.points_m[:, 1]))]
    while len(chosen) < count:
        chosen.append(int(np.argmax(geodesic_distance_to_set(surface, chosen))))
    return np.array(chosen)


def test_on_a_body_fast_marching_and_heat_agree_with_the_exact_distance(body):
    """From the centre to the millimetre; from a tip over 2 m of narrow limbs less well, and no better than this."""
    centre, tips = [surface_center(body)], spread_sources(body)
    assert_close(body, centre, Solver.FAST_MARCHING, mean_m=0.004, most_m=0.020)
    assert_close(body, tips, Solver.FAST_MARCHING, mean_m=0.010, most_m=0.035)
    assert_close(body, centre, Solver.HEAT, mean_m=0.012, most_m=0.060)
    assert_close(body, tips, Solver.HEAT, mean_m=0.015, most_m=0.060)


def assert_close(surface, sources, solver, mean_m, most_m):
    exact = solve_distance(surface, sources, solver=Solver.EXACT)
    error = np.abs(solve_distance(surface, sources, solver=solver) - exact)
    assert error.mean() < mean_m
    assert error.max() < most_m


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize(("sequence", "frame"), [("a01_s01_e02", 5), ("a13_s01_e02", 20)])
def test_on_real_depth_fast_marching_agrees_with_the_exact_distance(sequence, frame, step):
    folder = DATA / "msr_action3d" / sequence
    if not (folder / "recording.json").is_file():
        pytest.skip(f"{folder.relative_to(DATA.parent)} is absent: real depth is not part of the project")
    camera = replace(open_recording(folder).cameras[0], T_world_camera=np.eye(4))
    picture = sorted((folder / camera.name / "depth").glob("*.png"))[frame]
    depth_m = cv2.imread(str(picture), cv2.IMREAD_UNCHANGED).astype(np.float32) * camera.depth_scale
    surface = one_piece(depth_m, camera, step)
    assert len(surface) > 600
    assert_close(surface, [surface_center(surface)], Solver.FAST_MARCHING, mean_m=0.004, most_m=0.015)
    assert_close(surface, spread_sources(surface), Solver.FAST_MARCHING, mean_m=0.005, most_m=0.017)


@pytest.mark.parametrize("solver", list(Solver))
def test_distances_beyond_the_limit_are_infinite(solver):
    surface = cylinder()[0]
    whole, near = (solve_distance(surface, [50, 300], limit, solver=solver) for limit in (np.inf, 0.1))
    np.testing.assert_array_equal(np.isfinite(near), whole <= np.float32(0.1))
    np.testing.assert_allclose(near[np.isfinite(near)], whole[np.isfinite(near)], atol=1e-6)


@pytest.mark.parametrize("solver", list(Solver))
def test_another_piece_of_surface_is_infinitely_far(solver):
    present = np.ones((20, 30), bool)
    present[:, 14] = False
    surface = flat_grid(20, 30, SPACING, present)
    beyond = surface.pixel[:, 1] > 14
    np.testing.assert_array_equal(np.isinf(solve_distance(surface, [0], solver=solver)[0]), beyond)


@pytest.mark.parametrize("solver", list(Solver))
def test_one_triangle_has_its_sides_for_distances(solver):
    present = np.array([[True, True], [True, False]])
    surface = flat_grid(2, 2, SPACING, present)
    field = solve_distance(surface, [0], solver=solver)[0]
    slack = SPACING / 2 if solver is Solver.HEAT else 1e-6  # heat is right to half an edge at best
    np.testing.assert_allclose(field, [0, SPACING, SPACING], atol=slack)


@pytest.mark.parametrize("solver", list(Solver))
def test_a_source_beside_nothing_reaches_itself_only(solver):
    present = np.zeros((5, 9), bool)
    present[:, :4], present[2, 7] = True, True
    surface = flat_grid(5, 9, SPACING, present)
    alone = int(np.argmax(surface.pixel[:, 1]))
    field = solve_distance(surface, [alone, 0], solver=solver)
    assert field[0, alone] == 0
    assert np.isinf(np.delete(field[0], alone)).all()
    assert np.isinf(field[1, alone])
    assert np.isfinite(np.delete(field[1], alone)).all()


@pytest.mark.parametrize("solver", list(Solver))
def test_what_is_no_source_or_no_surface_is_refused(solver):
    surface = flat_grid(8, 8, SPACING)
    points = surface.points_m.copy()
    points[7] = np.nan
    nothing = keep_nodes(surface, np.zeros(len(surface), bool))
    with pytest.raises(ValueError, match="finite"):
        solve_distance(replace(surface, points_m=points), [0], solver=solver)
    for source in (-1, len(surface)):
        with pytest.raises(ValueError, match="nodes of a surface"):
            solve_distance(surface, [source], solver=solver)
    with pytest.raises(ValueError, match="nodes of a surface of 0"):
        solve_distance(nothing, [0], solver=solver)
    for sources in ([0.5], np.zeros(len(surface), bool), [[0, 1]]):
        with pytest.raises(ValueError, match="node numbers"):
            solve_distance(surface, sources, solver=solver)
    for limit in (-0.1, np.nan):
        with pytest.raises(ValueError, match="max_distance_m"):
            solve_distance(surface, [0], limit, solver=solver)


@pytest.mark.parametrize("solver", [Solver.HEAT, Solver.EXACT])
def test_solvers_of_triangles_refuse_links_and_say_nothing_about_what_hangs_on_by_an_edge(solver):
    present = np.zeros((6, 8), bool)
    present[:, :4], present[3, 4:7] = True, True  # a sheet with a tail of single nodes
    surface = flat_grid(6, 8, SPACING, present)
    bare = surface.pixel[:, 1] >= 5
    field = solve_distance(surface, [0], solver=solver)[0]
    np.testing.assert_array_equal(np.isnan(field), bare)
    with pytest.raises(ValueError, match="belong to no triangle"):
        solve_distance(surface, [int(np.argmax(surface.pixel[:, 1]))], solver=solver)
    with pytest.raises(ValueError, match="links between cameras"):
        solve_distance(with_links(surface, [[0, 5]]), [0], solver=solver)


@pytest.mark.parametrize("solver", [Solver.HEAT, Solver.EXACT])
def test_a_single_common_corner_is_no_passage_between_triangles(solver):
    present = np.zeros((7, 7), bool)
    present[:4, :4], present[3:, 3:] = True, True  # two sheets that share one node
    surface = flat_grid(7, 7, SPACING, present)
    first, last = (surface.pixel <= 3).all(axis=1), (surface.pixel >= 3).all(axis=1)
    other = last & ~first
    ends = surface.ring.copy()
    ends[(first & ~last)[:, None] & np.append(other, False)[surface.ring]] = -1  # no edge beside the corner
    ends[other[:, None] & np.append(first & ~last, False)[surface.ring]] = -1
    surface = replace(surface, ring=ends)
    field, both = solve_distance(surface, [0, 15], solver=solver)
    np.testing.assert_array_equal(np.isnan(field), other)
    assert surface.pixel[15].tolist() == [3, 3]
    assert np.isfinite(both).all()  # from the corner itself both sheets are reached


@pytest.mark.parametrize("solver", [Solver.FAST_MARCHING, Solver.DIJKSTRA])
def test_links_are_paths_for_solvers_of_edges(solver):
    surface = flat_grid(2, 20, SPACING)
    bent = surface.points_m.copy()
    bent[:, 0] = 0.1 * np.sin(np.arange(20) / 19 * np.pi).repeat(2).reshape(20, 2).T.ravel()  # an arch over its chord
    arch = replace(surface, points_m=bent)
    over = solve_distance(arch, [0], solver=solver)[0, 19]
    across = solve_distance(with_links(arch, [[0, 19]]), [0], solver=solver)[0, 19]
    assert across == pytest.approx(19 * SPACING, abs=1e-5)
    assert over > 1.2 * across


@pytest.mark.parametrize(("solver", "package"), [(Solver.HEAT, "potpourri3d"), (Solver.EXACT, "pygeodesic")])
def test_without_its_package_a_reference_says_how_to_get_it(solver, package, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.setitem(sys.modules, f"{package}.geodesic", None)
    with pytest.raises(
        MissingPackage, match=rf"needs the package {package}; install it with: pip install .*references"
    ):
        solve_distance(flat_grid(4, 4, SPACING), [0], solver=solver)
