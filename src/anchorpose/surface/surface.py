"""Define the surface mesh M = {V, E} (paper, Section III), organised as the camera's pixel grid, and its settings.

The module also defines the patient's expected skin, which is predicted before the body is fitted to the frame
(registration).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from numba import njit
from pydantic import Field

from anchorpose.settings import Count, NotNegative, Positive, settings

HIDDEN_SKIN: Final = 255
"""Camera number of a node that no camera saw."""


@settings
class SurfaceConfig:
    """Settings for meshing labelled depth images to one surface."""

    # whether the predicted body decides where the mesh is cut and closed; False = depth images alone, as in the paper
    by_body: bool = True
    # pixels between nodes, 13 mm at 2.4 m. With a node at every second pixel instead of every pixel, the geodesic error
    # grows by 3 mm, and the computing time falls to a quarter
    step: Count = 2
    # m2, minimum area of a piece of surface, half a palm; smaller pieces are left out: bits of clothes, bars and floor
    min_piece_m2: NotNegative = 0.0020
    # m, maximum width of a gap across which pieces are joined, such as chin to neck; 0 = no joins
    max_join_m: NotNegative = 0.10
    # pixels; smoothing in a window of 5x5 pixels (3 cm at 2.4 m) reduces errors of path lengths to about 1 %
    denoise_radius_px: Count = 2
    # minimum number of a pixel's 8 neighbours on the same surface; pixels with fewer are dropped. A pixel at a
    # fingertip 2 pixels wide has 3 neighbours on the same surface
    min_support: Annotated[int, Field(ge=0, le=8)] = 3
    # m, maximum width of a bridged bar, as wide as a knee pad with its shadow; skin behind wider bars is unknown
    bridge_max_width_m: NotNegative = 0.15
    # m, maximum distance of two cameras' nodes on the same skin: calibration errors plus half of a slanted mesh cell
    fusion_max_apart_m: Positive = 0.03


class MeshArrays(NamedTuple):
    """The mesh in the form that compiled functions (kernels) read: the fields of ``Surface`` with the same names, each
    as a C-ordered array.

    points_m, normals (n, 3), link_length_m (m,) float32; ring (n, 8), link_start (n + 1,), link_node (m,) int32.
    """

    points_m: np.ndarray
    normals: np.ndarray
    ring: np.ndarray
    link_start: np.ndarray
    link_node: np.ndarray
    link_length_m: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Points of the skin that cameras saw."""

    points_m: np.ndarray  # (n, 3) float32, places of the nodes, metres in the world frame
    normals: np.ndarray  # (n, 3) float32, unit vectors towards the camera that saw the node
    camera: np.ndarray  # (n,) uint8, the camera that saw the node
    pixel: np.ndarray  # (n, 2) int16, row and column in that camera's image

    def __len__(self) -> int:
        return len(self.points_m)

    def take(self, chosen: np.ndarray) -> Nodes:
        """Return the chosen nodes, without edges. chosen: numbers (k,) of nodes, or a mask (n,) bool."""
        return Nodes(self.points_m[chosen], self.normals[chosen], self.camera[chosen], self.pixel[chosen])


def join_nodes(parts: Sequence[Nodes]) -> Nodes:
    """Return the nodes of all parts as one object, in the order of the parts."""
    nowhere = np.zeros((0, 3), np.float32)
    empty = Nodes(nowhere, nowhere, np.zeros(0, np.uint8), np.zeros((0, 2), np.int16))
    return Nodes(*(np.concatenate([getattr(one, name) for one in (empty, *parts)]) for name in Nodes.__slots__))


@dataclass(frozen=True, slots=True, eq=False)
class Surface(Nodes):
    """Nodes on the patient's skin and the edges between them, from one camera or several.

    Nodes that no camera saw are inferred: they come last, have ``HIDDEN_SKIN`` as camera and -1 as pixel, and only
    serve geodesics between seen nodes. Links are edges outside the grid, to nodes of other cameras and to hidden skin;
    they are stored as compressed rows, with each link in the rows of both its nodes.
    """

    # (n, 8) int32, the node's neighbours on its camera's grid in circular order (E, NE, N, NW, W, SW, S, SE), -1 =
    # missing; consecutive neighbours that both exist form a triangle with the node
    ring: np.ndarray
    link_start: np.ndarray  # (n + 1,) int32, where the links of each node begin
    link_node: np.ndarray  # (m,) int32, the node at the other end of each link
    link_length_m: np.ndarray  # (m,) float32, length of each link in metres
    skin: np.ndarray  # (n,) int32, the expected skin point that the node shows, -1 = unknown

    @property
    def seen_count(self) -> int:
        """Return the number of nodes that a camera saw; these come first."""
        return int(np.searchsorted(self.camera == HIDDEN_SKIN, True))

    @property
    def arrays(self) -> MeshArrays:
        """Return the nodes and edges in the form that compiled functions (kernels) read."""
        return MeshArrays(
            np.ascontiguousarray(self.points_m, dtype=np.float32),
            np.ascontiguousarray(self.normals, dtype=np.float32),
            np.ascontiguousarray(self.ring, dtype=np.int32),
            np.ascontiguousarray(self.link_start, dtype=np.int32),
            np.ascontiguousarray(self.link_node, dtype=np.int32),
            np.ascontiguousarray(self.link_length_m, dtype=np.float32),
        )


def seen_part(surface: Surface) -> Surface:
    """Return the surface of only the nodes that a camera saw, with the edges and links among them."""
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
    """Distances along the skin between k sampled skin points of the body; the distances are the same in every pose."""

    # (k, l) float32, geodesic distance of each point to l landmarks: the paper's descriptor (Definition 3) on the
    # complete body
    landmarks_m: np.ndarray
    pairs: np.ndarray  # (e, 2) int32, skin points that are neighbours or second neighbours
    via: np.ndarray  # (e,) int32, the common neighbour on a pair's path; for direct neighbours, the pair's first point
    straight: np.ndarray  # (e,) float32, straight-line distance of the pair divided by the length of its path


class SkinArrays(NamedTuple):
    """Expected skin in the form that compiled functions (kernels) read: points_m, normals (k, 3) and landmarks_m (k,
    l), float32, C-ordered.
    """

    points_m: np.ndarray
    normals: np.ndarray
    landmarks_m: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class ExpectedSkin:
    """The patient's skin at the places that follow from the predicted pose."""

    points_m: np.ndarray  # (k, 3) float32, predicted places of the skin points, metres in the world frame
    normals: np.ndarray  # (k, 3) float32, world, outwards
    map: BodyMap  # distances along the skin between the same k points

    @property
    def arrays(self) -> SkinArrays:
        """Return the skin points' places, normals and distances to landmarks, in the form that compiled functions
        (kernels) read.
        """
        return SkinArrays(
            np.ascontiguousarray(self.points_m, dtype=np.float32),
            np.ascontiguousarray(self.normals, dtype=np.float32),
            np.ascontiguousarray(self.map.landmarks_m, dtype=np.float32),
        )


@njit(cache=True, nogil=True)
def geodesic_lower_bound(landmarks: np.ndarray, a: Any, b: Any) -> np.float32:
    """Return a lower bound, by the triangle inequality, on the distance of two skin points along the body's mesh.

    landmarks (k, l) float32: distances of the skin points to l landmarks of the body, from ``BodyMap``.
    """
    most = np.float32(0.0)
    for k in range(landmarks.shape[1]):
        apart = abs(landmarks[a, k] - landmarks[b, k])
        most = apart if apart > most else most  # max() would not be vectorised
    return most
