"""The patient's skin where it is predicted: what the surface may know of the body before it is registered."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit


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


@njit(cache=True, fastmath=True)
def way_over_skin(landmarks: np.ndarray, a: int, b: int) -> np.float32:
    """A lower bound of the distance of two skin points along the body's mesh: what the triangle inequality leaves."""
    most = np.float32(0.0)
    for k in range(landmarks.shape[1]):
        apart = abs(landmarks[a, k] - landmarks[b, k])
        most = apart if apart > most else most  # not max(), of which the compiler makes no vector instructions
    return most
