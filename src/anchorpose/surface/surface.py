"""The surface mesh M = {V, E} (paper, Section III), organised as the camera's pixel grid.

The patient's skin where it is predicted: what the surface may know of the body before it is registered.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

HIDDEN_SKIN: Final = 255
"""``Surface.camera`` of a node that no camera saw."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Nodes on the patient's visible skin and the edges between them, from one camera or several.

    points_m (n, 3) float32, world frame; normals (n, 3) float32, unit, towards the camera that saw the node.
    ring (n, 8) int32: the node's neighbours on its camera's grid in circular order (E, NE, N, NW, W, SW, S, SE), -1
    where there is none. Consecutive neighbours that both exist form a triangle with the node.
    link_start (n + 1,) int32, link_node (m,) int32 and link_length_m (m,) float32: edges that the grid does not have,
    to nodes of other cameras and across what hides the skin, compressed rows, symmetric.
    camera (n,) uint8, pixel (n, 2) int16 row and column: where the node was seen; ``HIDDEN_SKIN`` and -1 where it was
    not: such nodes are inferred, come last, and only lead geodesics from one seen place to another.
    skin (n,) int32: the expected skin point that the node shows, -1 where that is not known.
    """

    points_m: np.ndarray
    normals: np.ndarray
    ring: np.ndarray
    link_start: np.ndarray
    link_node: np.ndarray
    link_length_m: np.ndarray
    camera: np.ndarray
    pixel: np.ndarray
    skin: np.ndarray

    def __len__(self) -> int:
        return len(self.points_m)

    @property
    def seen_count(self) -> int:
        """How many nodes a camera saw: these come first."""
        return int(np.searchsorted(self.camera == HIDDEN_SKIN, True))


def seen_part(surface: Surface) -> Surface:
    """The nodes that a camera saw, with the edges and links among them."""
    count = surface.seen_count
    if count == len(surface):
        return surface
    first = surface.link_start[count]
    stay = surface.link_node[:first] < count
    start = np.concatenate([[0], np.cumsum(stay)])[surface.link_start[: count + 1]]
    return Surface(
        points_m=surface.points_m[:count],
        normals=surface.normals[:count],
        ring=surface.ring[:count],
        link_start=start.astype(np.int32),
        link_node=surface.link_node[:first][stay],
        link_length_m=surface.link_length_m[:first][stay],
        camera=surface.camera[:count],
        pixel=surface.pixel[:count],
        skin=surface.skin[:count],
    )


@dataclass(frozen=True, slots=True, eq=False)
class BodyMap:
    """Distances along the body between k sampled skin points, whatever of it is seen; they hold in every pose.

    landmarks_m (k, l) float32: geodesic distance of each point to l landmarks: the paper's descriptor (Definition 3) on
    the body itself. pairs (e, 2) int32: neighbours; via (e,) int32: the neighbour of both that a pair's way leads over
    (of direct neighbours the first one itself); straight (e,) float32: the pair's distance over the length of that way.
    """

    landmarks_m: np.ndarray
    pairs: np.ndarray
    via: np.ndarray
    straight: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedSkin:
    """points_m, normals (k, 3) float32, world: where the skin is expected, outwards; map: of the same k points."""

    points_m: np.ndarray
    normals: np.ndarray
    map: BodyMap


@njit(cache=True)
def way_over_skin(landmarks: np.ndarray, a: int, b: int) -> np.float32:
    """A lower bound of the distance of two skin points along the body's mesh: what the triangle inequality leaves."""
    most = np.float32(0.0)
    for k in range(landmarks.shape[1]):
        apart = abs(landmarks[a, k] - landmarks[b, k])
        most = apart if apart > most else most  # not max(), of which the compiler makes no vector instructions
    return most
