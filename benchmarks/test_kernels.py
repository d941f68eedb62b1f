"""How long each step from depth picture to hypotheses takes: pytest benchmarks/test_kernels.py --benchmark-only.

One frame of a standing figure as a Kinect v2 sees it at 2.4 m, about 15,000 pixels, meshed on every second pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from anchorpose.association.hypotheses import anchor_subsets, match_hypotheses
from anchorpose.body.asset import load_body_asset
from anchorpose.body.shaped import shape_body
from anchorpose.camera import Camera, Intrinsics
from anchorpose.geodesics.anchors import Anchors, find_anchors
from anchorpose.geodesics.descriptor import anchor_descriptor
from anchorpose.geodesics.dijkstra import edge_distance
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.extrema import geodesic_extrema, surface_center
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.border import border
from anchorpose.surface.denoise import denoise
from anchorpose.surface.fusion import fuse
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.surface import Surface

UP, FACING = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
HEIGHT_M = 1.7


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A figure and everything the stages make of it."""

    camera: Camera
    depth_m: np.ndarray
    mask: np.ndarray
    surface: Surface
    anchors: Anchors
    descriptor: np.ndarray


def camera_at(angle_rad: float) -> Camera:
    """A Kinect v2 2.4 m from the origin, turned about the vertical."""
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
    """(height, width) depth of the mean adult in rest pose, 0 beside it, with 3 mm of noise and 1 mm steps."""
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


def make_frame(seed: int, angle_rad: float = 0.0) -> Frame:
    camera = camera_at(angle_rad)
    depth = render(camera, seed)
    surface = build_surface(depth, depth > 0, camera)
    anchors = find_anchors(surface, UP, FACING, HEIGHT_M)
    return Frame(camera, depth, depth > 0, surface, anchors, anchor_descriptor(surface, anchors))


@pytest.fixture(scope="module")
def frames() -> tuple[Frame, Frame]:
    """Two frames of one pose under other noise."""
    one, two = make_frame(0), make_frame(1)
    assert one.anchors.found.sum() >= 4, "the figure should show its limbs"
    return one, two


def test_denoise(benchmark, frames):
    benchmark(denoise, frames[0].depth_m, frames[0].mask)


def test_build_surface(benchmark, frames):
    one = frames[0]
    surface = benchmark(build_surface, one.depth_m, one.mask, one.camera)
    benchmark.extra_info["nodes"] = len(surface)


def test_fuse_three_cameras(benchmark):
    parts = [make_frame(0, angle) for angle in (0.0, 0.8, -0.8)]
    benchmark(fuse, [part.surface for part in parts], [part.camera for part in parts])


def test_border(benchmark, frames):
    one = frames[0]
    labels = np.where(one.mask, PixelLabel.PATIENT, PixelLabel.NO_READING).astype(np.uint8)
    benchmark(border, one.surface, [View(one.depth_m, labels)])


def test_five_geodesic_fields(benchmark, frames):
    surface = frames[0].surface
    benchmark(geodesic_distance, surface, np.linspace(0, len(surface) - 1, 5).astype(np.int32))


def test_five_geodesic_fields_along_edges(benchmark, frames):
    surface = frames[0].surface
    benchmark(edge_distance, surface, np.linspace(0, len(surface) - 1, 5).astype(np.int32))


def test_geodesic_extrema(benchmark, frames):
    surface = frames[0].surface
    field = geodesic_distance(surface, np.array([surface_center(surface)]))[0]
    benchmark(geodesic_extrema, surface, field, 0.5)


def test_find_anchors(benchmark, frames):
    benchmark(find_anchors, frames[0].surface, UP, FACING, HEIGHT_M)


def test_match_hypotheses(benchmark, frames):
    one, two = frames
    subsets = anchor_subsets(one.anchors.found & two.anchors.found)
    found = benchmark(match_hypotheses, one.descriptor, two.surface, two.descriptor, subsets, one.surface.points_m)
    benchmark.extra_info["matched"] = float((found.match >= 0).mean())
