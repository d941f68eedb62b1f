"""Render noise-free depth images: the room once, by rays, and the people in every frame, by a depth buffer.

A depth buffer draws the 27,000 triangles of a body in a few milliseconds. Rays would need a search tree over the
triangles, which takes tens of milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numba as nb
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.lens import NOWHERE, lens_array, pixel_of_ray, rays_of_pixels

NOTHING, EQUIPMENT, PATIENT = 0, 1, 2  # labels of pixels (room: NOTHING); therapists have the labels from 3 on
NEAREST_M = 0.15  # m; triangles nearer to the camera than this are not drawn


class TrueImage(NamedTuple):
    """The image of one camera without sensor errors. All arrays are (height, width)."""

    depth_m: np.ndarray  # float32, depth along the optical axis, 0 = nothing is seen
    cosine: np.ndarray  # float32, cosine of the angle between ray and surface normal
    label: np.ndarray  # uint8, NOTHING, EQUIPMENT, PATIENT or a therapist
    part: np.ndarray  # uint8, 1 + index of the bone that moves the seen skin, 0 = no person


@dataclass(frozen=True, slots=True, eq=False)
class Figure:
    """A person, or a piece of moved furniture, to be drawn into an image."""

    skin_m: np.ndarray  # (v, 3) float32, world metres; of a person: the dressed skin
    faces: np.ndarray  # (f, 3) indices of the vertices of each triangle
    # (f,) uint8, for each face, 1 + index of the bone that moves it; 0 for furniture and mirror images
    face_part: np.ndarray
    label: int


def render_still(camera: Camera, room: np.ndarray, equipment: np.ndarray) -> TrueImage:
    """Render room and equipment, (n, 3, 3) triangles each, by rays through pixel centres."""
    shape = (camera.height, camera.width)
    empty = TrueImage(
        np.zeros(shape, np.float32), np.ones(shape, np.float32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    )
    triangles = np.concatenate([room, equipment]).astype(np.float32)
    if len(triangles) == 0:
        return empty
    directions = ray_directions(camera)
    origins = np.tile(camera.position_m.astype(np.float32), (len(directions), 1))
    hit, distance, normal = first_hits(origins, directions, triangles)
    found = (hit >= 0) & camera.valid_pixels().ravel()
    length = np.linalg.norm(normal, axis=1) * np.linalg.norm(directions, axis=1)
    cosine = np.abs((normal * directions).sum(axis=1)) / np.where(found, length, 1.0)
    return TrueImage(
        depth_m=np.where(found, distance, 0.0).astype(np.float32).reshape(shape),
        cosine=np.where(found, cosine, 1.0).astype(np.float32).reshape(shape),
        label=np.where(found & (hit >= len(room)), EQUIPMENT, NOTHING).astype(np.uint8).reshape(shape),
        part=empty.part,
    )


class Lens(NamedTuple):
    """A camera's lens as arrays that compiled kernels can use."""

    array: np.ndarray  # ``lens_array`` as float32
    # (height, width, 2) x / z and y / z of each pixel's ray (``rays_of_pixels``); NaN for a pixel without a ray
    rays: np.ndarray


def draw_figures(camera: Camera, still: TrueImage, figures: tuple[Figure, ...]) -> TrueImage:
    """Return a copy of ``still`` into which the figures are drawn wherever they are the nearest surface."""
    image = TrueImage(*(layer.copy() for layer in still))
    T_camera_world = invert_rigid(camera.require_pose())
    rays = rays_of_pixels(camera.intrinsics, camera.width, camera.height)
    lens = Lens(lens_array(camera.intrinsics).astype(np.float32), rays)
    for figure in figures:
        points = transform_points(T_camera_world, figure.skin_m).astype(np.float32)
        _draw(points, figure.faces, figure.face_part, figure.label, lens, image)
    return image


def ray_directions(camera: Camera) -> np.ndarray:
    """Return a direction per pixel, (height * width, 3) float32 world; its component along the optical axis is 1.

    A pixel outside the lens's valid radius has no ray and gets the direction of the optical axis.
    """
    rays = np.nan_to_num(camera.pixel_rays()).reshape(-1, 2)
    rays = np.column_stack([rays, np.ones(len(rays), np.float32)])
    return np.asarray((rays @ camera.require_pose()[:3, :3].T).astype(np.float32))


def first_hits(
    origins_m: np.ndarray, directions: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for each ray the first triangle that it hits, the distance (unit: the direction's length) and the normal.

    The triangle is an index, -1 = no triangle. The normal (n, 3) of the triangle does not have unit length; 0 = no
    triangle. origins_m, directions (n, 3), triangles (m, 3, 3): float32 world metres.
    """
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, triangles)
    found = scene.run(origins_m, directions, query="INTERSECT", output=True)
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    hit = found["primID"].astype(np.int64)
    return hit, found["tfar"], np.where(hit[:, None] >= 0, normals[hit], 0.0)


@nb.njit(cache=True)
def _draw(
    points: np.ndarray, faces: np.ndarray, face_part: np.ndarray, label: int, lens: Lens, image: TrueImage
) -> None:
    """Draw faces into a depth buffer; points (v, 3): in the camera's frame. Edges are drawn straight although the lens
    bends them, since triangles are small.
    """
    for f in range(len(faces)):
        _draw_face(points, faces[f], face_part[f], label, lens, image)


@nb.njit(cache=True)
def _draw_face(points: np.ndarray, face: np.ndarray, part: int, label: int, lens: Lens, image: TrueImage) -> None:
    """Draw one triangle into the pixels whose centre it covers, where it is nearer than the pixel's present depth."""
    height, width = image.depth_m.shape
    i, j, k = face
    z0, z1, z2 = points[i, 2], points[j, 2], points[k, 2]
    if min(z0, z1, z2) < NEAREST_M:
        return
    x0, y0 = pixel_of_ray(points[i, 0] / z0, points[i, 1] / z0, lens.array)
    x1, y1 = pixel_of_ray(points[j, 0] / z1, points[j, 1] / z1, lens.array)
    x2, y2 = pixel_of_ray(points[k, 0] / z2, points[k, 1] / z2, lens.array)
    if min(x0, x1, x2) <= NOWHERE:
        return
    left, right = max(int(np.ceil(min(x0, x1, x2))), 0), min(int(np.floor(max(x0, x1, x2))), width - 1)
    top, bottom = max(int(np.ceil(min(y0, y1, y2))), 0), min(int(np.floor(max(y0, y1, y2))), height - 1)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if left > right or top > bottom or abs(area) < 1e-9:
        return
    nx, ny, nz = _normal(points, i, j, k)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            w1 = ((column - x0) * (y2 - y0) - (x2 - x0) * (row - y0)) / area
            w2 = ((x1 - x0) * (row - y0) - (column - x0) * (y1 - y0)) / area
            w0 = 1.0 - w1 - w2
            if w0 < 0.0 or w1 < 0.0 or w2 < 0.0:
                continue
            z = 1.0 / (w0 / z0 + w1 / z1 + w2 / z2)
            if image.depth_m[row, column] > 0.0 and z >= image.depth_m[row, column]:
                continue
            u, v = lens.rays[row, column, 0], lens.rays[row, column, 1]
            if np.isnan(u):
                continue
            image.depth_m[row, column] = z
            image.cosine[row, column] = abs(nx * u + ny * v + nz) / (length * np.sqrt(u * u + v * v + 1.0))
            image.label[row, column] = label
            image.part[row, column] = part


@nb.njit(cache=True)
def _normal(points: np.ndarray, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Return the normal of a triangle; its length is twice the triangle's area."""
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
