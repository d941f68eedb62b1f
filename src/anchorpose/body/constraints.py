"""What the depth says about the body: where points of its skin should lie, along which direction, and how surely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anchorpose.body.nearest_skin import facing_rows
from anchorpose.body.skin_points import PosedPoints
from anchorpose.camera import Camera
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


def no_constraints() -> Constraints:
    """No row."""
    return Constraints(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def join(parts: Sequence[Constraints]) -> Constraints:
    """All rows of several sets."""
    return Constraints(*(np.concatenate([getattr(p, name) for p in parts]) for name in Constraints.__slots__))


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
    point, target, direction = facing_rows(
        posed.points_m,
        posed.normals,
        surface.points_m[chosen].astype(np.float64),
        surface.normals[chosen].astype(np.float64),
        surface.camera[chosen].astype(np.int64),
        np.array([camera.position_m for camera in cameras]),
        reach_m,
        config.normal_weight_m,
        config.uncovered_m,
    )
    count = len(point)
    return Constraints(point, target, direction, np.full(count, config.surface_sigma_m), np.full(count, reach_m / 3.0))


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


def _thin(count: int, wanted: int) -> np.ndarray:
    """Every so-many-th index, spread evenly and the same each time."""
    if count <= wanted:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).astype(np.int64)
