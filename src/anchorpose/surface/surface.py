"""The surface mesh M = {V, E} (paper, Section III), organised as the camera's pixel grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Nodes on the patient's visible skin and the edges between them, from one camera or several.

    points_m (n, 3) float32, world frame; normals (n, 3) float32, unit, towards the camera that saw the node.
    ring (n, 8) int32: the node's neighbours on its camera's grid in circular order (E, NE, N, NW, W, SW, S, SE), -1
    where there is none. Consecutive neighbours that both exist form a triangle with the node.
    link_start (n + 1,) int32, link_node (m,) int32 and link_length_m (m,) float32: edges that the grid does not have, to
    nodes of other cameras and across what hides the skin, compressed rows, symmetric.
    camera (n,) uint8, pixel (n, 2) int16 row and column: where the node was seen.
    """

    points_m: np.ndarray
    normals: np.ndarray
    ring: np.ndarray
    link_start: np.ndarray
    link_node: np.ndarray
    link_length_m: np.ndarray
    camera: np.ndarray
    pixel: np.ndarray

    def __len__(self) -> int:
        return len(self.points_m)
