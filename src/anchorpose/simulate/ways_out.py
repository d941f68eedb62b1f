"""Find places that no camera sees, to which a patient who leaves can walk."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.camera import Camera, invert_rigid, transform_points

# m, radius around a walking person, 2 m tall, that contains the arms even if they are abducted for balance
ARMS_WITHIN_M: Final = 0.7
TALLEST_M: Final = 2.0  # m, maximum height of a simulated patient
DISTANCES_M: Final = np.arange(0.5, 6.0, 0.1)  # m, tried distances from the place of training
AZIMUTHS_RAD: Final = np.radians(np.arange(5.0, 180.0, 5.0))  # rad, tried directions on each side, from the front on


def ways_out(cameras: Sequence[Camera], room: np.ndarray) -> np.ndarray:
    """Return (2, 2) x and z, metres, of two places: to the left and to the right of the place of training, the nearest
    place at which no camera sees any part of a person. Such a place is outside the images or beyond a wall.

    room (n, 3, 3): triangles of a rectangular room, metres, world; the place of training is the origin.
    """
    rays = np.stack([np.cos(AZIMUTHS_RAD), np.sin(AZIMUTHS_RAD)], axis=1)
    tried = (DISTANCES_M[:, None, None] * rays).reshape(-1, 2)  # the nearest first
    sides = [tried * [1.0, way] for way in (-1.0, 1.0)]
    return np.array([places[np.argmax(_unseen(cameras, room, places))] for places in sides])


def _unseen(cameras: Sequence[Camera], room: np.ndarray, places_m: np.ndarray) -> np.ndarray:
    """Return (n,) bool: whether no camera sees a person who stands at each place (n, 2), x and z."""
    walls_m = room.reshape(-1, 3)[:, [0, 2]]
    low_m, high_m = walls_m.min(axis=0) - ARMS_WITHIN_M, walls_m.max(axis=0) + ARMS_WITHIN_M
    beyond = ((places_m < low_m) | (places_m > high_m)).any(axis=1)
    around = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    angle, height_m = (grid.ravel() for grid in np.meshgrid(around, np.linspace(0.0, TALLEST_M, 9)))
    outline = np.stack([ARMS_WITHIN_M * np.cos(angle), height_m, ARMS_WITHIN_M * np.sin(angle)], axis=1)
    points_m = np.insert(places_m, 1, 0.0, axis=1)[:, None] + outline
    seen = [camera.pixel_of(_inside(camera, points_m))[2].reshape(len(places_m), -1).any(axis=1) for camera in cameras]
    return np.asarray(beyond | ~np.any(seen, axis=0))


def _inside(camera: Camera, points_m: np.ndarray) -> np.ndarray:
    return transform_points(invert_rigid(camera.require_pose()), points_m.reshape(-1, 3))
