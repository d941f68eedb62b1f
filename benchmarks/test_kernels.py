"""Time each step from depth image to hypotheses: pytest benchmarks/test_kernels.py --benchmark-only.

The steps are run on one frame of a standing figure as a Kinect v2 sees it at 2.4 m, about 12,000 pixels, meshed on
every pixel (full) and on every second pixel (half). Other libraries are timed on the same steps in the same run; a
library that is not installed is skipped (open3d, pygeodesic, potpourri3d). The paper's own method in C++ is in
paper_way.py. On one core: OMP_NUM_THREADS=1 taskset -c 0 pytest ...
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, dijkstra

from anchorpose.body.kinematics import shape_body
from anchorpose.body.segments import load_body_asset
from anchorpose.body.skin_map import map_body
from anchorpose.body.skin_points import FittedShape, build_body, even_clothes, skin_points
from anchorpose.camera import Camera
from anchorpose.geodesics.anchors import Anchors, anchor_descriptor, find_anchors
from anchorpose.geodesics.center import center_field
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import Cap, find_caps, geodesic_extrema, surface_center
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.lens import Intrinsics
from anchorpose.research.geodesic_solvers import edge_distance, edge_graph
from anchorpose.surface.border import Border, border
from anchorpose.surface.denoise import denoise, drop_flying_pixels, estimate_noise
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import build_surface, estimate_normals, faces
from anchorpose.surface.patient_surface import fuse, patient_surface
from anchorpose.surface.surface import ExpectedSkin, Surface, SurfaceConfig
from anchorpose.track_tree.hypotheses import anchor_subsets, match_hypotheses

UP, FACING = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
HEIGHT_M = 1.7


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A depth frame of the figure, and what the stages compute from it."""

    camera: Camera
    depth_m: np.ndarray
    mask: np.ndarray
    surface: Surface
    anchors: Anchors
    descriptor: np.ndarray
    step: int


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """vertices (v, 3) float64 metres, faces (f, 3) int32, sources (5,) int32."""

    vertices: np.ndarray
    faces: np.ndarray
    sources: np.ndarray


def camera_at(angle_rad: float) -> Camera:
    """Return a Kinect v2 at 2.4 m from the origin, turned about the vertical."""
    turn = np.array([[np.cos(angle_rad), 0, np.sin(angle_rad)], [0, 1, 0], [-np.sin(angle_rad), 0, np.cos(angle_rad)]])
    pose = np.eye(4)
    pose[:3, :3] = turn @ [[0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [-1.0, 0.0, 0.0]]
    pose[:3, 3] = turn @ [2.4, 0.0, 0.0] + [0.0, 0.9, 0.0]
    return Camera(
        name="front",
        width=512,
        height=424,
        depth_scale=0.001,
        intrinsics=Intrinsics(fx=365.0, fy=365.0, cx=256.0, cy=212.0),
        T_world_camera=pose,
    )


def render(camera: Camera, seed: int) -> np.ndarray:
    """Return (height, width) depth of the mean adult in rest pose, 0 beside the body, with 3 mm of noise and 1 mm
    steps.
    """
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    body = shape_body(load_body_asset(), np.zeros(0))
    skin = (body.vertices - [0.0, body.vertices[:, 1].min(), 0.0]).astype(np.float32)
    scene = EmbreeScene()
    TriangleMesh(scene, skin, body.asset.faces.astype(np.int32))
    rays = np.concatenate([camera.pixel_rays(), np.ones((camera.height, camera.width, 1))], axis=2).reshape(-1, 3)
    rotation = camera.require_pose()[:3, :3]
    origin = np.tile(camera.position_m.astype(np.float32), (len(rays), 1))
    hit = scene.run(origin, (rays @ rotation.T).astype(np.float32), output=True)
    depth = np.where(hit["geomID"] == 0, hit["tfar"], 0.0).reshape(camera.height, camera.width)
    noisy = depth + np.random.default_rng(seed).normal(0, 0.003, depth.shape)
    return np.where(depth > 0, np.round(noisy, 3), 0.0).astype(np.float32)


def make_frame(seed: int, angle_rad: float = 0.0, step: int = 2) -> Frame:
    camera = camera_at(angle_rad)
    depth = render(camera, seed)
    surface = build_surface(depth, depth > 0, camera, SurfaceConfig(step=step))
    anchors = find_anchors(surface, UP, FACING, HEIGHT_M)
    return Frame(camera, depth, depth > 0, surface, anchors, anchor_descriptor(surface, anchors), step)


@pytest.fixture(scope="module", params=[1, 2], ids=["full", "half"])
def frames(request) -> tuple[Frame, Frame]:
    """Return two frames of one pose with different noise."""
    one, two = make_frame(0, step=request.param), make_frame(1, step=request.param)
    assert one.anchors.found.sum() >= 4, "the figure should show its limbs"
    return one, two


@pytest.fixture(scope="module")
def mesh(frames) -> Mesh:
    """Return the largest piece of the first frame's mesh as libraries take it, with five vertices to measure from."""
    surface = frames[0].surface
    triangles = largest_piece(manifold(faces(surface)), len(surface))
    used, corners = np.unique(triangles, return_inverse=True)
    sources = np.linspace(0, len(used) - 1, 5).astype(np.int32)
    return Mesh(surface.points_m[used].astype(np.float64), corners.reshape(-1, 3).astype(np.int32), sources)


def manifold(triangles: np.ndarray) -> np.ndarray:
    """Return the triangles without those that libraries refuse: at edges of more than two triangles, or at nodes where
    several fans of triangles meet.
    """
    while True:
        sides = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, number, counts = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
        open_ends = np.bincount(ends[counts == 1].ravel(), minlength=triangles.max() + 1)
        crowded = (counts[number.reshape(-1, 3)] > 2).any(axis=1) | (open_ends[triangles] > 2).any(axis=1)
        if not crowded.any():
            return triangles
        triangles = triangles[~crowded]


def largest_piece(triangles: np.ndarray, count: int) -> np.ndarray:
    """Return the triangles of the largest connected piece; the exact method gives no distances on other pieces."""
    sides = triangles[:, [0, 1, 1, 2]].reshape(-1, 2)
    graph = coo_array((np.ones(len(sides), np.int8), sides.T), shape=(count, count))
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return triangles[piece == np.bincount(piece).argmax()]


def test_estimate_noise(benchmark, frames):
    benchmark(estimate_noise, frames[0].depth_m, frames[0].mask)


def test_denoise(benchmark, frames):
    one = frames[0]
    benchmark(denoise, one.depth_m, one.mask, estimate_noise(one.depth_m, one.mask))


def test_drop_flying_pixels(benchmark, frames):
    benchmark(drop_flying_pixels, denoise(frames[0].depth_m, frames[0].mask), 0.01, 0.001, 3)


def test_estimate_normals(benchmark, frames):
    one = frames[0]
    clean = denoise(one.depth_m, one.mask)
    benchmark(estimate_normals, clean, one.camera.pixel_rays(), one.surface.pixel, 3, 0.01, 0.001)


def test_pieces(benchmark, frames):
    benchmark(pieces, frames[0].surface)


def test_build_surface(benchmark, frames):
    one = frames[0]
    surface = benchmark(build_surface, one.depth_m, one.mask, one.camera, SurfaceConfig(step=one.step))
    benchmark.extra_info["nodes"] = len(surface)


def test_fuse_three_cameras(benchmark, frames):
    parts = [make_frame(0, angle, frames[0].step) for angle in (0.0, 0.8, -0.8)]
    benchmark(fuse, [part.surface for part in parts], [part.camera for part in parts])


def test_border(benchmark, frames):
    one = frames[0]
    labels = np.where(one.mask, PixelLabel.PATIENT, PixelLabel.NO_READING).astype(np.uint8)
    benchmark(border, one.surface, [View(one.depth_m, labels)])


def test_five_geodesic_fields(benchmark, frames):
    surface = frames[0].surface
    benchmark(geodesic_distance, surface, np.linspace(0, len(surface) - 1, 5).astype(np.int32))


def test_one_geodesic_field(benchmark, frames):
    benchmark(geodesic_distance, frames[0].surface, [surface_center(frames[0].surface)])


def test_one_geodesic_field_within_7_cm(benchmark, frames):
    benchmark(geodesic_distance, frames[0].surface, [surface_center(frames[0].surface)], 0.07)


def test_five_geodesic_fields_along_edges(benchmark, frames):
    surface = frames[0].surface
    benchmark(edge_distance, surface, np.linspace(0, len(surface) - 1, 5).astype(np.int32))


def test_geodesic_extrema(benchmark, frames):
    surface = frames[0].surface
    field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
    benchmark(geodesic_extrema, surface, field, 0.5)


def test_caps_of_the_extrema(benchmark, frames):
    """Time the field from V_c, extrema and caps: ``find_anchors`` without joining pieces and naming anchors."""
    surface = frames[0].surface

    def caps() -> list[Cap]:
        field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
        return find_caps(surface, field, geodesic_extrema(surface, field, 0.5), 0.06)

    benchmark(caps)


def test_center_field(benchmark, frames):
    benchmark(center_field, frames[0].surface)


def test_find_anchors(benchmark, frames):
    benchmark(find_anchors, frames[0].surface, UP, FACING, HEIGHT_M)


def expected_skin() -> ExpectedSkin:
    """Return the skin of the figure as a tracker would predict it."""
    points, shape = skin_points(load_body_asset()), FittedShape(np.zeros(0), even_clothes(0.0))
    body = build_body(points, shape)
    place = body.rest_m - [0.0, body.mesh.vertices[:, 1].min(), 0.0]
    return ExpectedSkin(place.astype(np.float32), body.rest_normals.astype(np.float32), map_body(body))


@pytest.mark.parametrize("angles", [(0.0,), (0.0, 0.8, -0.8)], ids=["one", "three"])
def test_depth_to_anchors(benchmark, angles):
    """Time the surface with hidden skin, its border and the anchors of a tracked person, on every second pixel."""
    cameras = [camera_at(angle) for angle in angles]
    views, expected = [], expected_skin()
    for camera in cameras:
        depth = render(camera, 0)
        labels = np.where(depth > 0, PixelLabel.PATIENT, PixelLabel.NO_READING).astype(np.uint8)
        views.append(View(depth, labels))

    def depth_to_anchors() -> Anchors:
        surface = patient_surface(views, cameras, expected)
        return find_anchors(surface, UP, FACING, HEIGHT_M, border(surface, views) == Border.CUT)

    anchors = benchmark(depth_to_anchors)
    benchmark.extra_info["found"] = int(anchors.found.sum())


def test_match_hypotheses(benchmark, frames):
    one, two = frames
    subsets = anchor_subsets(one.anchors.found & two.anchors.found)
    found = benchmark(match_hypotheses, one.descriptor, two.surface, two.descriptor, subsets, one.surface.points_m)
    benchmark.extra_info["matched"] = float((found.match >= 0).mean())


def test_reference_five_fields_dijkstra_scipy(benchmark, frames):
    """Time Dijkstra's algorithm of scipy, without building the graph."""
    surface = frames[0].surface
    graph, sources = edge_graph(surface), np.linspace(0, len(surface) - 1, 5).astype(np.int32)
    benchmark(dijkstra, graph, directed=False, indices=sources)


def test_reference_five_fields_heat_potpourri3d(benchmark, mesh):
    potpourri3d = pytest.importorskip("potpourri3d", reason="potpourri3d is not installed")

    def five_fields():
        solver = potpourri3d.MeshHeatMethodDistanceSolver(mesh.vertices, mesh.faces)
        return [solver.compute_distance(int(source)) for source in mesh.sources]

    benchmark(five_fields)


def test_reference_five_fields_fast_marching_potpourri3d(benchmark, mesh):
    potpourri3d = pytest.importorskip("potpourri3d", reason="potpourri3d is not installed")
    if not hasattr(potpourri3d, "MeshFastMarchingDistanceSolver"):
        pytest.skip("this potpourri3d has no fast marching")

    def five_fields():
        solver = potpourri3d.MeshFastMarchingDistanceSolver(mesh.vertices, mesh.faces)
        return [solver.compute_distance([[(int(source), [])]]) for source in mesh.sources]

    benchmark(five_fields)


def test_reference_five_fields_exact_pygeodesic(benchmark, mesh):
    geodesic = pytest.importorskip("pygeodesic.geodesic", reason="pygeodesic is not installed")

    def five_fields():
        solver = geodesic.PyGeodesicAlgorithmExact(mesh.vertices, mesh.faces)
        return [solver.geodesicDistances(np.array([source], np.int32), None)[0] for source in mesh.sources]

    benchmark.pedantic(five_fields, rounds=3)


def point_cloud(open3d, frame: Frame):
    """Return the raw readings as Open3D takes them, in the camera's frame."""
    seen = frame.mask.copy()
    seen[np.arange(len(seen)) % frame.step != 0] = False
    seen[:, np.arange(seen.shape[1]) % frame.step != 0] = False
    points = frame.camera.back_project(frame.depth_m)[seen].astype(np.float64)
    return open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))


def test_reference_normals_open3d(benchmark, frames):
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    cloud = point_cloud(open3d, frames[0])
    search = open3d.geometry.KDTreeSearchParamHybrid(radius=0.03, max_nn=49)
    benchmark(cloud.estimate_normals, search)


def test_reference_mesh_ball_pivoting_open3d(benchmark, frames):
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    cloud = point_cloud(open3d, frames[0])
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=0.03, max_nn=49))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    radii = open3d.utility.DoubleVector([0.008 * frames[0].step, 0.016 * frames[0].step])
    make = open3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting
    found = benchmark.pedantic(make, (cloud, radii), rounds=5)
    benchmark.extra_info["triangles"] = len(found.triangles)


def test_reference_mesh_poisson_open3d(benchmark, frames):
    open3d = pytest.importorskip("open3d", reason="Open3D is not installed")
    cloud = point_cloud(open3d, frames[0])
    cloud.estimate_normals(open3d.geometry.KDTreeSearchParamHybrid(radius=0.03, max_nn=49))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    make = open3d.geometry.TriangleMesh.create_from_point_cloud_poisson
    found, _ = benchmark.pedantic(make, (cloud,), {"depth": 8, "n_threads": 1}, rounds=3)
    benchmark.extra_info["triangles"] = len(found.triangles)
