"""Everybody in the room from frame to frame: where their skin was last seen, and so may be claimed again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.config import IsolationConfig
from anchorpose.isolation.ownership import OwnershipLikelihood
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View

SAMPLE_PX = 3  # of the pixels' rows and columns: two centimetres at 2.5 m
CUBES_A_FACE = (
    1.5  # cubes that a slanting plane passes through for each of their faces that it is large: mean over slants
)
CELL_M = 0.05  # skin that is seen again replaces what is remembered within it


@dataclass(frozen=True, slots=True, eq=False)
class BystanderMemory:
    """The skin of all people as last seen: points_m (n, 3) float32 world, owner (n,) uint8 label, age_s (n,) float32.

    next_label: the label that a new person gets.
    """

    points_m: np.ndarray
    owner: np.ndarray
    age_s: np.ndarray
    next_label: int

    @property
    def without_patient(self) -> BystanderMemory:
        """Everybody but the patient."""
        return self.without(np.array([PixelLabel.PATIENT]))

    def without(self, labels: np.ndarray) -> BystanderMemory:
        """Everybody but those of the labels (k,)."""
        return self._of(~np.isin(self.owner, labels))

    def _of(self, kept: np.ndarray) -> BystanderMemory:
        return BystanderMemory(self.points_m[kept], self.owner[kept], self.age_s[kept], self.next_label)

    def likelihood(self, elapsed_s: float, config: IsolationConfig) -> OwnershipLikelihood:
        """What everybody claims ``elapsed_s`` after the last frame: skin moves, and what was hidden longest most."""
        spread = np.hypot(config.memory_sigma_m, config.memory_speed_m_s * (self.age_s + abs(elapsed_s)))
        return OwnershipLikelihood(self.points_m, self.owner, spread.astype(np.float32))


def empty_memory() -> BystanderMemory:
    """An empty room."""
    return BystanderMemory(
        np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32), PixelLabel.OTHER_PERSON
    )


def update_memory(
    before: BystanderMemory,
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
    config: IsolationConfig,
) -> BystanderMemory:
    """The memory after one more frame.

    Skin that no camera can see now, because something stands before it, is remembered for ``memory_s``; where a camera
    looks past it, it has gone. Clusters too small to be a person are left out: an arm of the patient that was once
    taken for somebody else's, or a head taken for the patient's, must not claim itself again.
    """
    points, owner = _seen_now(pieces, views)
    kept = _hidden_since(before, points, pieces, cameras, elapsed_s, config)
    memory = BystanderMemory(
        np.concatenate([points, kept.points_m]),
        np.concatenate([owner, kept.owner]),
        np.concatenate([np.zeros(len(points), np.float32), kept.age_s]),
        max(before.next_label, int(owner.max(initial=0)) + 1),
    )
    return memory._of(_in_large_clusters(memory, config))


def _seen_now(pieces: Sequence[Pieces | None], views: Sequence[View | None]) -> tuple[np.ndarray, np.ndarray]:
    """points_m (n, 3) and owner (n,) of every third row's and column's pixels of people."""
    points, owners = [np.zeros((0, 3), np.float32)], [np.zeros(0, np.uint8)]
    for piece, view in zip(pieces, views, strict=True):
        if piece is None or view is None:
            continue
        chosen = piece.index[::SAMPLE_PX, ::SAMPLE_PX]
        chosen = chosen[chosen >= 0]
        owner = view.labels[piece.row[chosen], piece.column[chosen]]
        person = owner >= PixelLabel.PATIENT
        points.append(piece.points_m[chosen[person]])
        owners.append(owner[person])
    return np.concatenate(points), np.concatenate(owners)


def _hidden_since(
    before: BystanderMemory,
    seen_m: np.ndarray,
    pieces: Sequence[Pieces | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
    config: IsolationConfig,
) -> BystanderMemory:
    """What of the memory was seen before, not now, and may still be where it was."""
    age = before.age_s + np.float32(abs(elapsed_s))
    kept = np.flatnonzero((age < config.memory_s) & ~_near(before.points_m, seen_m))
    points = before.points_m[kept]
    hidden = np.ones(len(kept), dtype=bool)
    for piece, camera in zip(pieces, cameras, strict=True):
        if piece is None or not hidden.any():
            continue
        in_camera = transform_points(invert_rigid(camera.require_pose()), points)
        column, row, inside = camera.pixel_of(in_camera)
        depth = piece.depth_m[row, column]
        hidden &= ~inside | ((depth > 0) & (depth < in_camera[:, 2] - CELL_M)) | (in_camera[:, 2] <= 0)
    kept = kept[hidden]
    return BystanderMemory(before.points_m[kept], before.owner[kept], age[kept], before.next_label)


def _near(points_m: np.ndarray, seen_m: np.ndarray) -> np.ndarray:
    """(n,) bool: whether any skin was seen in a point's cell or beside it."""
    if not len(points_m) or not len(seen_m):
        return np.zeros(len(points_m), dtype=bool)
    low = np.minimum(points_m.min(axis=0), seen_m.min(axis=0)) - CELL_M
    cell, seen = ((np.floor((p - low) / CELL_M).astype(np.int64)) for p in (points_m, seen_m))
    filled = np.zeros(np.maximum(cell.max(axis=0), seen.max(axis=0)) + 2, dtype=bool)
    filled[tuple(seen.T)] = True
    near: np.ndarray = filled[tuple(cell.T)]
    return near


def _in_large_clusters(memory: BystanderMemory, config: IsolationConfig) -> np.ndarray:
    """(n,) bool: points that hang together with enough of the same person's to be a person."""
    large = np.zeros(len(memory.owner), dtype=bool)
    for label in np.flatnonzero(np.bincount(memory.owner)):
        own = np.flatnonzero(memory.owner == label)
        points = memory.points_m[own]
        cube = np.floor((points - points.min(axis=0)) / config.cluster_gap_m).astype(np.int64)
        filled = np.zeros(cube.max(axis=0) + 1, dtype=bool)
        filled[tuple(cube.T)] = True
        cluster, count = ndimage.label(filled, structure=np.ones((3, 3, 3), dtype=int))
        cubes = np.bincount(cluster[filled], minlength=count + 1)
        area = cubes * config.cluster_gap_m**2 / CUBES_A_FACE
        large[own] = (area >= config.other_surface_m2)[cluster[tuple(cube.T)]]
    return large
