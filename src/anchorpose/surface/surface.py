"""The surface mesh M = {V, E} (paper, Section III), organised as the camera's pixel grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

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
