"""Build constraints that pull points of the posed skin to places or surfaces, for example the tips of hands and feet to
the anchors (head, hands and feet found in a frame).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cache, lru_cache
from typing import Final

import numpy as np

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.nearest_skin import Oriented, facing_rows
from anchorpose.body.skin_points import PosedPoints, SkinPoints
from anchorpose.camera import Camera
from anchorpose.geodesics.anchors import Anchors
from anchorpose.surface.surface import Nodes

# m; in the search for the skin point nearest to a node, an angle of 60 degrees between the normals of node and skin
# point counts as much as this distance
NORMAL_WEIGHT_M: Final = 0.10
# m, spacing of skin points; a node farther than this from all skin points counts as not covered by the body
UNCOVERED_M: Final = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class Constraints:
    """Linear equations on the places of posed skin points. Each row demands that the vector from the target to the skin
    point has no component along ``direction``, up to an error of ``sigma_m``.
    """

    point: np.ndarray  # (n,) index into the skin points
    target_m: np.ndarray  # (n, 3) m, place in the world to which the skin point is pulled
    direction: np.ndarray  # (n, 3) unit vectors
    sigma_m: np.ndarray  # (n,) standard deviation
    scale_m: np.ndarray  # (n,) m, residual of a row at which the robust kernel reduces the row's weight to a quarter

    def where(self, chosen: np.ndarray) -> Constraints:
        """Return the rows where ``chosen`` (n,) bool is True."""
        return Constraints(*(getattr(self, each.name)[chosen] for each in fields(self)))

    @staticmethod
    def alike(
        point: np.ndarray, target_m: np.ndarray, direction: np.ndarray, sigma_m: float, scale_m: float
    ) -> Constraints:
        """Return constraint rows that all have the same standard deviation and the same scale of the robust kernel."""
        count = len(point)
        return Constraints(point, target_m, direction, np.full(count, sigma_m), np.full(count, scale_m))

    def __len__(self) -> int:
        return len(self.point)

    def residuals(self, posed: PosedPoints) -> np.ndarray:
        """Return the residual (n,) of each row for the posed skin, metres."""
        return np.einsum("ij,ij->i", posed.points_m[self.point] - self.target_m, self.direction)

    def weights(self, residual_m: np.ndarray) -> np.ndarray:
        """Return the weight (n,), 1/m2, of each row; large residuals reduce the weight, by the robust kernel of Geman
        and McClure (doi:10.1007/978-1-4612-3732-0).
        """
        return 1.0 / (self.sigma_m * (1.0 + (residual_m / self.scale_m) ** 2)) ** 2


def no_constraints() -> Constraints:
    """Return constraints without rows."""
    return Constraints(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0))


def join(parts: Sequence[Constraints]) -> Constraints:
    """Join several sets of constraints into one."""
    return Constraints(*(np.concatenate([getattr(p, name) for p in parts]) for name in Constraints.__slots__))


def surface_constraints(
    posed: PosedPoints, surface: Nodes, cameras: Sequence[Camera], reach_m: float, config: RegistrationConfig
) -> Constraints:
    """Return rows (linear equations) by which each node of the surface pulls the nearest skin point that faces the
    node's camera.

    The skin point is pulled onto a plane through the node. The plane's normal is the mean of the node's and the skin
    point's normals, so that errors due to curvature cancel (Rusinkiewicz 2019, doi:10.1145/3306346.3323037). A node
    more than ``UNCOVERED_M`` away pulls the skin point straight to itself: with planes alone, limbs could slide along
    their axis.
    """
    return rows_of_nodes(posed, surface, cameras, reach_m, config)[0]


def rows_of_nodes(
    posed: PosedPoints, surface: Nodes, cameras: Sequence[Camera], reach_m: float, config: RegistrationConfig
) -> tuple[Constraints, np.ndarray]:
    """Return the rows of ``surface_constraints``, and for each row the index (n,) of the node of the surface that pulls
    the row's skin point.
    """
    chosen, nodes, seen_from = _nodes_for_kernels(surface, config.node_count)
    point, node, direction = facing_rows(
        Oriented(posed.points_m, posed.normals),
        nodes,
        seen_from,
        np.array([camera.position_m for camera in cameras]),
        reach_m,
        NORMAL_WEIGHT_M,
        UNCOVERED_M,
    )
    rows = Constraints.alike(point, nodes.places_m[node], direction, config.surface_sigma_m, reach_m / 3.0)
    return rows, chosen[node]


@lru_cache(maxsize=8)  # cached, since all steps of a registration use the same nodes
def _nodes_for_kernels(surface: Nodes, count: int) -> tuple[np.ndarray, Oriented, np.ndarray]:
    """Return the indices of up to ``count`` nodes, their places and normals, and the index of the camera that saw each
    node.
    """
    chosen = thin(len(surface), count)
    nodes = Oriented(surface.points_m[chosen].astype(np.float64), surface.normals[chosen].astype(np.float64))
    return chosen, nodes, surface.camera[chosen].astype(np.int64)


def place_constraints(point: np.ndarray, target_m: np.ndarray, sigma_m: float, scale_m: float) -> Constraints:
    """Return constraints that put skin points (n,) at known places (n, 3), with a row per point and axis."""
    count = len(point)
    return Constraints.alike(
        np.repeat(point, 3), np.repeat(target_m, 3, axis=0), np.tile(np.eye(3), (count, 1)), sigma_m, scale_m
    )


def thin(count: int, wanted: int) -> np.ndarray:
    """Return up to ``wanted`` evenly spaced indices from 0 to ``count`` - 1; the choice is never random."""
    if count <= wanted:
        return np.arange(count)
    return np.linspace(0, count - 1, wanted).astype(np.int64)


_ANCHOR_SIGMA_M: Final = 0.05  # m, upper bound on the error of an anchor's place (paper, Section VI)


@cache
def anchor_points(points: SkinPoints) -> np.ndarray:
    """Return the indices (5,) of the skin points at the tips of head, hands and feet, ordered as ``ANCHOR_NAMES``."""
    place = points.asset.vertices[points.vertex]
    names = np.array(points.asset.bone_names)[points.part]
    tips = []
    for words, axis in (
        (("Head",), (0, 1, 0)),
        (("LeftHand", "LeftFingerBase", "LeftHandFinger1"), None),
        (("RightHand", "RightFingerBase", "RightHandFinger1"), None),
        (("LeftFoot", "LeftToeBase"), (1, 0, 0)),
        (("RightFoot", "RightToeBase"), (1, 0, 0)),
    ):
        own = np.flatnonzero(np.isin(names, words))
        sideways = np.abs(place[own] @ np.array([0.4, -0.4, 0.0])) + np.abs(place[own, 2])
        reach = place[own] @ np.array(axis) if axis else sideways
        tips.append(own[reach.argmax()])
    return np.array(tips)


def anchor_constraints(points: SkinPoints, anchors: Anchors, sigma_m: float = _ANCHOR_SIGMA_M) -> Constraints:
    """Return constraints that pull ``anchor_points`` to the anchors (head, hands, feet) that were found in a frame."""
    found = anchors.found
    return place_constraints(anchor_points(points)[found], anchors.position_m[found], sigma_m, 5.0 * sigma_m)
