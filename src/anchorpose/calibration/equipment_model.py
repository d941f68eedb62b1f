"""Prepare the equipment model (the paper's chi_0) for all cameras, and render it as a camera would see it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.recording.equipment import EquipmentModel, Mesh
from anchorpose.rotations import rigid, rotation_about_y

# pixels, width of the rim around the equipment that is rendered too, so that readings beside the equipment are compared
MARGIN_PX: Final = 6
# number of rays cast between two pixels to find the outline, which is then precise to a sixteenth of a pixel
SUBPIXEL: Final = 8
# m, minimum step of depth between neighbouring pixels that shows that one part ends in front of another
JUMP_M: Final = 0.08


@dataclass(frozen=True, slots=True, eq=False)
class Rendering:
    """The equipment in a window (h, w) of one camera's depth image, which begins at row ``top`` and column ``left``.

    depth_m float32, inf without equipment; normal (h, w, 3): in the camera frame, towards the camera; part int: index
    of the part, -1 without equipment.
    """

    top: int
    left: int
    depth_m: np.ndarray
    normal: np.ndarray
    part: np.ndarray

    @property
    def window(self) -> tuple[slice, slice]:
        """Return the slices of rows and columns that cut the window out of the whole image."""
        height, width = self.depth_m.shape
        return slice(self.top, self.top + height), slice(self.left, self.left + width)


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Points of the equipment's silhouette, one per row of the arrays, found along rows or columns of the window.

    row, column (n,) int: the last pixel on the equipment, in the whole image; step (n, 2) int: the direction outward
    (rows, columns); beyond_px (n,) float: distance of the outline beyond that pixel's centre; across (n, 2): outward
    unit normal of the outline in the image (rows, columns); depth_m, part (n,): depth and part of that pixel.
    """

    row: np.ndarray
    column: np.ndarray
    step: np.ndarray
    beyond_px: np.ndarray
    across: np.ndarray
    depth_m: np.ndarray
    part: np.ndarray


class EquipmentCaster:
    """A ray caster for the equipment; the search tree over its triangles is built once."""

    def __init__(self, model: EquipmentModel) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        corners = [vertices[faces] for vertices, faces in (part.triangles() for part in model.parts)]
        triangles = np.concatenate(corners)
        self._scene: Any = EmbreeScene()
        TriangleMesh(self._scene, triangles.astype(np.float32))
        normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self._normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        self._part = np.repeat(np.arange(len(corners)), [len(part) for part in corners])
        self.vertices_m = triangles.reshape(-1, 3)
        self.part_count = len(corners)

    def render(self, camera: Camera, T_camera_model: np.ndarray) -> Rendering | None:
        """Render the equipment as the camera would see it; None if the equipment is not in the image."""
        points = transform_points(T_camera_model, self.vertices_m)
        window = _window(camera, points)
        if window is None:
            return None
        top, bottom, left, right = window
        rays = camera.pixel_rays()[top:bottom, left:right]
        hit, depth = self._cast(rays.reshape(-1, 2), T_camera_model)
        found = hit >= 0
        normal = np.where(found[:, None], self._normal[hit] @ T_camera_model[:3, :3].T, 0.0)
        ahead = np.concatenate([rays.reshape(-1, 2), np.ones((len(hit), 1))], axis=1)
        normal *= -np.sign(np.sum(normal * ahead, axis=1, keepdims=True))
        shape = rays.shape[:2]
        part = np.where(found, self._part[hit], -1).reshape(shape)
        return Rendering(top, left, depth.reshape(shape), normal.reshape(*shape, 3), part)

    def outline(self, camera: Camera, T_camera_model: np.ndarray, rendering: Rendering) -> Outline:
        """Find the silhouette with subpixel accuracy, by rays between each pixel on the equipment and its neighbours
        that are not on the equipment.
        """
        depth = rendering.depth_m
        smooth = cv2.GaussianBlur(np.isfinite(depth).astype(np.float32), (0, 0), 1.5)
        slope = np.stack([cv2.Sobel(smooth, cv2.CV_32F, 0, 1), cv2.Sobel(smooth, cv2.CV_32F, 1, 0)], axis=-1)
        inner = np.isfinite(depth)
        inner[:3], inner[-3:], inner[:, :3], inner[:, -3:] = False, False, False, False
        found = []
        for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            beyond = np.roll(depth, (-step[0], -step[1]), (0, 1))
            edge = inner & ~(beyond < depth + JUMP_M)
            across = slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-9)
            edge &= -(across @ np.array(step)) > 0.65  # the outline must run across this direction, not along it
            row, column = np.nonzero(edge)
            found.append((row, column, np.broadcast_to(step, (len(row), 2))))
        row, column, step_of = (np.concatenate(part) for part in zip(*found, strict=True))
        normal = -slope[row, column]
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
        at, part = depth[row, column], rendering.part[row, column]
        row, column = row + rendering.top, column + rendering.left
        rays = camera.pixel_rays()
        here, there = rays[row, column], rays[row + step_of[:, 0], column + step_of[:, 1]]
        beyond_px = self._share_on_equipment(here, there, at, T_camera_model)
        return Outline(row, column, step_of, beyond_px, normal, at, part)

    def _share_on_equipment(
        self, here: np.ndarray, there: np.ndarray, depth_m: np.ndarray, T_camera_model: np.ndarray
    ) -> np.ndarray:
        """Return (n,): the share of the rays between ray ``here`` and ray ``there`` (n, 2) that hit the equipment at
        about ``depth_m``, the depth at ``here``.
        """
        share = (np.arange(SUBPIXEL) + 0.5) / SUBPIXEL
        between = here[:, None] + (there - here)[:, None] * share[:, None]
        hit, distance = self._cast(between.reshape(-1, 2).astype(np.float32), T_camera_model)
        on = (hit >= 0).reshape(-1, SUBPIXEL) & (distance.reshape(-1, SUBPIXEL) < depth_m[:, None] + JUMP_M)
        return np.asarray(on.mean(axis=1))

    def _cast(self, rays: np.ndarray, T_camera_model: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the index of the triangle that each ray (n, 2) hits, and the depth there; -1 and inf for a ray that
        hits none.
        """
        T_model_camera = invert_rigid(T_camera_model)
        ahead = np.concatenate([rays, np.ones((len(rays), 1), rays.dtype)], axis=1)
        directions = (ahead @ T_model_camera[:3, :3].T).astype(np.float32)
        origins = np.broadcast_to(T_model_camera[:3, 3].astype(np.float32), directions.shape).copy()
        found = self._scene.run(origins, directions, query="INTERSECT", output=True)
        hit = found["primID"].astype(np.int64)
        return hit, np.where(hit >= 0, found["tfar"], np.inf).astype(np.float32)


def _window(camera: Camera, points_m: np.ndarray) -> tuple[int, int, int, int] | None:
    """Return the window (top, bottom, left, right) that contains the equipment, with a margin: the whole image if some
    points are behind the lens, None if the equipment is not in the image.
    """
    if points_m[:, 2].max() < 0.1:
        return None
    pixels = camera.project(points_m)
    if points_m[:, 2].min() < 0.1 or not np.isfinite(pixels).all():
        return 0, camera.height, 0, camera.width
    left, top = np.floor(pixels.min(axis=0)).astype(int) - MARGIN_PX
    right, bottom = np.ceil(pixels.max(axis=0)).astype(int) + MARGIN_PX + 1
    top, bottom = max(top, 0), min(bottom, camera.height)
    left, right = max(left, 0), min(right, camera.width)
    return (top, bottom, left, right) if bottom - top > 8 and right - left > 8 else None


SURFACE_POINTS: Final = 2000  # number of surface points; a standing frame has 2 m^2, so there is one point per 10 cm^2
# minimum number of points of a part. Sometimes only a small part distinguishes the front of the equipment from its
# back, so small parts need points, too
LEAST_PER_PART: Final = 24
OUTSIDE_POINTS: Final = 1000
# m, minimum and maximum distance of the points beside the equipment from its surface. Points beside the equipment lie
# beyond the flying pixels (readings between an edge and its background), but so near to the surface that, if the
# equipment is tried inside a wall, they lie in the wall, too
OUTSIDE_M: Final = (0.05, 0.09)

STEP_DEG: Final = 5
# m, maximum deviation of a real part from its place in equipment.json, where lengths are measured by tape. The standing
# frames of two clinics differ by more than this, so a model of another clinic's standing frame is rejected
SAME_M: Final = 0.012
# m; if the equipment coincides with itself within this distance after a rotation, the search may confuse the two
# directions
ALIKE_M: Final = 0.10
TRIED_POINTS: Final = 400
ROUND_SHARE: Final = 0.9  # minimum share of all tested rotations after which round equipment coincides with itself


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentSamples:
    """Points on and beside the equipment, all in the equipment's own frame Gamma_0.

    surface_m (n, 3) float64: points spread evenly over the surface of all parts, except where one part is inside
    another. normal (n, 3): outward unit normals. two_sided (n,) bool: True at points of a mesh, since the triangles of
    a mesh may face inward, so the normal may point inward. outside_m (m, 3): points outside the equipment, within
    ``OUTSIDE_M`` of its surface. centre_m (3,), radius_m: a sphere around the equipment.
    """

    surface_m: np.ndarray
    normal: np.ndarray
    two_sided: np.ndarray
    outside_m: np.ndarray
    centre_m: np.ndarray
    radius_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Symmetry:
    """Rotations about a vertical axis after which the equipment looks the same, each T_model_model (4, 4), without the
    identity.

    same: rotations after which the equipment coincides with itself within ``SAME_M``; alike: further rotations after
    which it coincides within ``ALIKE_M``; round: whether the equipment coincides with itself within ``SAME_M`` after
    more than ``ROUND_SHARE`` of the tested rotations, so that its direction is undetermined.
    """

    same: tuple[np.ndarray, ...]
    alike: tuple[np.ndarray, ...]
    round: bool


@dataclass(frozen=True, slots=True, eq=False)
class Equipment:
    """The equipment, prepared once for all cameras."""

    model: EquipmentModel
    samples: EquipmentSamples
    caster: EquipmentCaster
    symmetry: Symmetry

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parts."""
        return tuple(part.name for part in self.model.parts)


def prepare_equipment(model: EquipmentModel) -> Equipment:
    """Compute everything that depends on the equipment model alone."""
    samples = sample_equipment(model)
    return Equipment(model, samples, EquipmentCaster(model), find_symmetry(model, samples))


def sample_equipment(model: EquipmentModel) -> EquipmentSamples:
    """Draw points on and beside the model's surface; the same model always gives the same points."""
    rng = np.random.default_rng(0)
    corners = [vertices[faces] for vertices, faces in (part.triangles() for part in model.parts)]
    areas = [_areas(part_corners).sum() for part_corners in corners]
    surface, normal, two_sided = [], [], []
    for part, part_corners, area in zip(model.parts, corners, areas, strict=True):
        count = max(LEAST_PER_PART, round(SURFACE_POINTS * area / sum(areas)))
        points, normals = _on_triangles(part_corners, count, rng)
        others = [other for other in model.parts if other is not part and not isinstance(other, Mesh)]
        free = np.all([other.distance_m(points) > -1e-3 for other in others], axis=0) if others else np.ones(1, bool)
        free = np.broadcast_to(free, len(points))
        surface.append(points[free])
        normal.append(normals[free])
        two_sided.append(np.full(int(free.sum()), isinstance(part, Mesh)))
    points = np.concatenate(surface)
    low, high = points.min(axis=0), points.max(axis=0)
    return EquipmentSamples(
        surface_m=points,
        normal=np.concatenate(normal),
        two_sided=np.concatenate(two_sided),
        outside_m=_outside(model, points, rng),
        centre_m=(low + high) / 2.0,
        radius_m=float(np.linalg.norm(high - low) / 2.0),
    )


def _areas(corners_m: np.ndarray) -> np.ndarray:
    edges = corners_m[:, 1:] - corners_m[:, :1]
    area: np.ndarray = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2.0
    return area


def _on_triangles(corners_m: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return points (count, 3) spread evenly over triangles (f, 3, 3), and the normals there."""
    area = _areas(corners_m)
    place = (np.arange(count) + rng.random(count)) / count  # stratified sampling: no part lacks points by chance
    chosen = np.minimum(np.searchsorted(np.cumsum(area) / area.sum(), place), len(area) - 1)
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    a, b, c = corners_m[chosen].transpose(1, 0, 2)
    points = (1 - u)[:, None] * a + (u * (1 - v))[:, None] * b + (u * v)[:, None] * c
    normal = np.cross(b - a, c - a)
    return points, normal / np.linalg.norm(normal, axis=1, keepdims=True)


def _outside(model: EquipmentModel, surface_m: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    near, far = OUTSIDE_M
    offset = rng.normal(size=(4 * OUTSIDE_POINTS, 3))
    offset *= rng.uniform(near, far, (len(offset), 1)) / np.linalg.norm(offset, axis=1, keepdims=True)
    points = surface_m[rng.integers(0, len(surface_m), len(offset))] + offset
    return points[model.distance_m(points) > near][:OUTSIDE_POINTS]


def find_symmetry(model: EquipmentModel, samples: EquipmentSamples) -> Symmetry:
    """Test rotations of the equipment, in steps of ``STEP_DEG``, about two vertical axes: one through the centre of the
    bounding box, one through the centre of the surface.

    For each angle, the centre with the smaller deviation counts. A rotation that is a symmetry keeps both centres in
    place. But in a model that mixes round and square tubes, the centre of the surface, which is computed from sampled
    points, is shifted.
    """
    points = samples.surface_m[:: max(1, len(samples.surface_m) // TRIED_POINTS)]
    same, alike, apart = list[np.ndarray](), list[np.ndarray](), list[float]()
    turns = []
    for degrees in range(STEP_DEG, 360, STEP_DEG):
        tried = [
            _turn_about(centre, np.radians(degrees)) for centre in (samples.centre_m, samples.surface_m.mean(axis=0))
        ]
        off = [float(np.quantile(np.abs(model.distance_m(transform_points(T, points))), 0.95)) for T in tried]
        turns.append(tried[int(np.argmin(off))])
        apart.append(min(off))
    around = np.array([np.inf, *apart, np.inf])
    for index in range(1, len(turns) - 1):  # skips the first and the last turn, which hardly differ from the identity
        if around[index + 1] > min(around[index], around[index + 2]):
            continue
        if apart[index] < SAME_M:
            same.append(turns[index])
        elif apart[index] < ALIKE_M:
            alike.append(turns[index])
    is_round = np.mean(np.array(apart) < SAME_M) > ROUND_SHARE
    return Symmetry(tuple(same), tuple(alike), bool(is_round))


def _turn_about(centre_m: np.ndarray, angle_rad: float) -> np.ndarray:
    """Return the rotation (4, 4) about the vertical (Y) through a point."""
    turn = rotation_about_y(angle_rad)
    return rigid(turn, centre_m - turn @ centre_m)
