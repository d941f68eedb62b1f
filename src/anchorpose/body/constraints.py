"""What the depth says about the body: where points of its skin should lie, along which direction, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.body.skin_points import PosedPoints
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """Rows ``direction . (skin point - target) = 0``.

    point (n,) index into the skin points; target_m (n, 3); direction (n, 3) unit; sigma_m (n,) standard deviation;
    scale_m (n,) where the robust kernel starts to doubt.
    """

    point: np.ndarray
    target_m: np.ndarray
    direction: np.ndarray
    sigma_m: np.ndarray
    scale_m: np.ndarray

    def __len__(self) -> int:
        return len(self.point)

    def residuals(self, posed: PosedPoints) -> np.ndarray:
        """(n,) metres."""
        return ((posed.points_m[self.point] - self.target_m) * self.direction).sum(axis=1)

    def weights(self, residual_m: np.ndarray) -> np.ndarray:
        """(n,) information of each row under Geman and McClure's kernel (doi:10.1007/978-1-4612-3732-0)."""
        return 1.0 / (self.sigma_m * (1.0 + (residual_m / self.scale_m) ** 2)) ** 2


def join(parts: Sequence[Constraints]) -> Constraints:
    """All rows of several sets."""
    return Constraints(*(np.concatenate([getattr(p, name) for p in parts]) for name in Constraints.__slots__))


THICK_PX = 5  # what hides a limb is wider; a silhouette's rim of lost readings is thinner


@dataclass(frozen=True, slots=True, kw_only=True)
class ConstraintConfig:
    """Noise and reach of the constraints; reach shrinks as the pose settles."""

    surface_sigma_m: float = 0.010  # clothes and sensor together
    outline_sigma_m: float = 0.020  # one to two pixels at 2.5 m, edges flicker
    node_count: int = 2500  # enough for 60 parameters; more only costs time
    normal_weight_m: float = 0.10  # 60 degrees between normals count like 10 cm
    uncovered_m: float = 0.03  # the spacing of the skin points: a node farther from all of them lies off the body

    def __post_init__(self) -> None:
        for name in self.__slots__:
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")


def surface_constraints(
    posed: PosedPoints, surface: Surface, cameras: Sequence[Camera], reach_m: float, config: ConstraintConfig
) -> Constraints:
    """Each node of the surface pulls the nearest skin point that faces its camera: data to model.

    The plane's normal is the mean of both normals, which cancels the curvature (Rusinkiewicz 2019,
    doi:10.1145/3306346.3323037). A node that no skin covers pulls straight: planes alone let limbs slide along
    themselves.
    """
    chosen = _thin(len(surface), config.node_count)
    nodes = surface.points_m[chosen].astype(np.float64)
    normals = surface.normals[chosen].astype(np.float64)
    seen_from = surface.camera[chosen]
    point = np.full(len(chosen), -1)
    distance = np.full(len(chosen), np.inf)
    for number, camera in enumerate(cameras):
        mine = np.flatnonzero(seen_from == number)
        facing = np.flatnonzero(_facing(posed, camera) > 0.0)
        if not len(mine) or not len(facing):
            continue
        features = np.hstack([posed.points_m[facing], config.normal_weight_m * posed.normals[facing]])
        wanted = np.hstack([nodes[mine], config.normal_weight_m * normals[mine]])
        distance[mine], nearest = cKDTree(features).query(wanted, distance_upper_bound=reach_m)
        found = np.isfinite(distance[mine])
        point[mine[found]] = facing[nearest[found]]
    kept = point >= 0
    offset = posed.points_m[point[kept]] - nodes[kept]
    uncovered = np.linalg.norm(offset, axis=1) > config.uncovered_m
    direction = np.where(uncovered[:, None], offset, normals[kept] + posed.normals[point[kept]])
    count = int(kept.sum())
    return Constraints(
        point[kept],
        nodes[kept],
        direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9),
        np.full(count, config.surface_sigma_m),
        np.full(count, reach_m / 3.0),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """For every pixel of a view the nearest one where the patient may be: (height, width) int32 rows and columns."""

    row: np.ndarray
    column: np.ndarray


def find_outline(view: View) -> Outline | None:
    """Where the patient is in a view, or may be unseen; None where he is not in the picture.

    He may be where he is seen, behind equipment, where nothing was read, and behind another person before him. Only
    background, and another person behind him, say that he is not there; and the thin rim of lost and flying readings
    along every silhouette says nothing else than the background beside it.
    """
    import cv2

    patient = view.patient
    if not patient.any():
        return None
    other = view.labels >= PixelLabel.OTHER_PERSON
    behind = other & (view.depth_m > np.median(view.depth_m[patient]))
    unseen = (view.labels != PixelLabel.BACKGROUND) & ~behind & ~patient
    thick = cv2.morphologyEx(unseen.astype(np.uint8), cv2.MORPH_OPEN, np.ones((THICK_PX, THICK_PX), np.uint8))
    possible = patient | (thick > 0)
    _, nearest = cv2.distanceTransformWithLabels(
        (~possible).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    rows, columns = np.nonzero(possible)
    place = np.zeros((int(nearest.max()) + 1, 2), dtype=np.int32)
    place[nearest[rows, columns]] = np.stack([rows, columns], axis=1)
    return Outline(place[nearest, 0], place[nearest, 1])


def outline_constraints(
    posed: PosedPoints, view: View, outline: Outline, camera: Camera, reach_m: float, config: ConstraintConfig
) -> Constraints:
    """Skin that should be seen but is not is pulled to the patient's outline: model to data.

    A skin point before background (without a reading where the room was removed) or before another person cannot be
    there; it is moved across the ray to the nearest pixel where the patient is or may be. Pixels without reading, and
    what equipment hides, say nothing.
    """
    in_camera = transform_points(invert_rigid(camera.require_pose()), posed.points_m)
    column, row, inside = camera.pixel_of(in_camera)
    label = view.labels[row, column]
    depth = view.depth_m[row, column].astype(np.float64)
    before = in_camera[:, 2] < np.where(depth > 0, depth, np.inf) - reach_m
    empty = (label == PixelLabel.BACKGROUND) | (label >= PixelLabel.OTHER_PERSON)
    stray = np.flatnonzero(inside & empty & before)
    goal_row, goal_column = outline.row[row[stray], column[stray]], outline.column[row[stray], column[stray]]
    rays = camera.pixel_rays()[goal_row, goal_column]
    target = np.column_stack([rays, np.ones(len(rays))]) * in_camera[stray, 2:]
    target = transform_points(camera.require_pose(), target)
    offset = posed.points_m[stray] - target
    length = np.linalg.norm(offset, axis=1)
    kept = (length > 1e-4) & (length < 3.0 * reach_m)
    count = int(kept.sum())
    return Constraints(
        stray[kept],
        target[kept],
        offset[kept] / length[kept, None],
        np.full(count, config.outline_sigma_m),
        np.full(count, reach_m),
    )


def place_constraints(point: np.ndarray, target_m: np.ndarray, sigma_m: float, scale_m: float) -> Constraints:
    """Skin points (n,) that belong at known places (n, 3): three rows each."""
    count = len(point)
    return Constraints(
        np.repeat(point, 3),
        np.repeat(target_m, 3, axis=0),
        np.tile(np.eye(3), (count, 1)),
        np.full(3 * count, sigma_m),
        np.full(3 * count, scale_m),
    )


def _facing(posed: PosedPoints, camera: Camera) -> np.ndarray:
    """(p,) cosine between the skin's normal and the way to the camera."""
    ray = camera.position_m - posed.points_m
    return (ray * posed.normals).sum(axis=1) / np.linalg.norm(ray, axis=1)


def _thin(count: int, wanted: int) -> np.ndarray:
    """Every so-many-th index, spread evenly and the same each time."""
    if count <= wanted:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).astype(np.int64)
