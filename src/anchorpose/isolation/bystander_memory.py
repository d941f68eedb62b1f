"""Everybody in the room from frame to frame: where their skin was last seen, and so is likely to be again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy import ndimage

from anchorpose.camera import Camera
from anchorpose.isolation.ownership import OwnershipLikelihood
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View

SAMPLE_PX: Final = 3  # of the pixels' rows and columns: two centimetres at 2.5 m
CELL_M: Final = 0.05  # skin that is seen again replaces what is remembered within it
MEMORY_S: Final = 1.0  # for which hidden skin is remembered: somebody crosses in front of it
SIGMA_M: Final = 0.012  # noise and half the spacing of remembered points
SPEED_M_S: Final = 0.30  # of skin between frames: people who hold or stand; those who walk are reached by growing
CLUSTER_GAP_M: Final = 0.10  # a bar with its margins: a head over a rail still belongs to its body
CLUSTER_AREA_M2: Final = 0.25  # of a person's skin, seen by all cameras together: more than an arm, 0.15
CUBES_PER_FACE: Final = 1.5  # cubes that a plane passes through per face of its size: mean over all slants


@dataclass(frozen=True, slots=True, eq=False)
class BystanderMemory:
    """The skin of all people, the patient included, as last seen.

    points_m (n, 3) float32 world; owner (n,) uint8 label; age_s (n,) float32: since it was seen; next_label: the label
    that a new person gets.
    """

    points_m: np.ndarray
    owner: np.ndarray
    age_s: np.ndarray
    next_label: int

    @property
    def without_patient(self) -> BystanderMemory:
        """Return everybody but the patient."""
        return self.without(np.array([PixelLabel.PATIENT]))

    def without(self, labels: np.ndarray) -> BystanderMemory:
        """Return everybody but the people with the labels (k,)."""
        return self._of(~np.isin(self.owner, labels))

    def _of(self, kept: np.ndarray) -> BystanderMemory:
        return BystanderMemory(self.points_m[kept], self.owner[kept], self.age_s[kept], self.next_label)

    @property
    def seen_last(self) -> dict[int, np.ndarray]:
        """Return the label to the points (n, 3) of each person that the last frame showed."""
        seen = self.age_s == 0.0
        return {
            int(label): self.points_m[seen & (self.owner == label)]
            for label in np.flatnonzero(np.bincount(self.owner[seen]))
        }

    def moved(self, steps: Mapping[int, np.ndarray]) -> BystanderMemory:
        """With what the last frame showed of people moved by a step (3,) each."""
        if not steps:
            return self
        points = self.points_m.copy()
        for label, step in steps.items():
            points[(self.owner == label) & (self.age_s == 0.0)] += step.astype(np.float32)
        return replace(self, points_m=points)

    def likelihood(self, elapsed_s: float, doubt_m: float = 0.0) -> OwnershipLikelihood:
        """Return where skin is likely ``elapsed_s`` after the last frame: it moves, and what was hidden longest most.

        doubt_m: added to its deviation, since who was seen there may have been mistaken.
        """
        spread = np.hypot(np.hypot(SIGMA_M, doubt_m), SPEED_M_S * (self.age_s + abs(elapsed_s)))
        return OwnershipLikelihood(self.points_m, self.owner, spread.astype(np.float32))


def empty_memory() -> BystanderMemory:
    """Return an empty room."""
    return BystanderMemory(
        np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32), PixelLabel.OTHER_PERSON
    )


def update_memory(
    before: BystanderMemory,
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
) -> BystanderMemory:
    """Return the memory after one more frame.

    Skin that no camera can see now, because something stands before it, is remembered for ``MEMORY_S``; where a camera
    looks past it, it has gone. Clusters too small to be a person are left out: an arm of the patient that was once
    taken for another person's, or a head taken for the patient's, must not keep its wrong owner.
    """
    points, owner = _seen_now(pieces, views)
    kept = _hidden_since(before, points, pieces, cameras, elapsed_s)
    memory = BystanderMemory(
        np.concatenate([points, kept.points_m]),
        np.concatenate([owner, kept.owner]),
        np.concatenate([np.zeros(len(points), np.float32), kept.age_s]),
        max(before.next_label, int(owner.max(initial=0)) + 1),
    )
    return memory._of(_in_large_clusters(memory))


def _seen_now(pieces: Sequence[Pieces | None], views: Sequence[View | None]) -> tuple[np.ndarray, np.ndarray]:
    """points_m (n, 3) and owner (n,) of every third row's and column's pixels of people."""
    points, owners = [np.zeros((0, 3), np.float32)], [np.zeros(0, np.uint8)]
    for pixels, view in zip(pieces, views, strict=True):
        if pixels is None or view is None:
            continue
        chosen = pixels.index[::SAMPLE_PX, ::SAMPLE_PX]
        chosen = chosen[chosen >= 0]
        owner = view.labels[pixels.row[chosen], pixels.column[chosen]]
        person = owner >= PixelLabel.PATIENT
        points.append(pixels.points_m[chosen[person]])
        owners.append(owner[person])
    return np.concatenate(points), np.concatenate(owners)


def _hidden_since(
    before: BystanderMemory,
    seen_m: np.ndarray,
    pieces: Sequence[Pieces | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
) -> BystanderMemory:
    """Return what was seen before, is not seen now, and may still be where it was."""
    age = before.age_s + np.float32(abs(elapsed_s))
    kept = np.flatnonzero((age < MEMORY_S) & ~_near(before.points_m, seen_m))
    points = before.points_m[kept]
    hidden = np.ones(len(kept), dtype=bool)
    for pixels, camera in zip(pieces, cameras, strict=True):
        if pixels is None or not hidden.any():
            continue
        own, read, inside = camera.look(points, pixels.depth_m)
        hidden &= ~inside | ((read > 0) & (read < own - CELL_M)) | (own <= 0)
    kept = kept[hidden]
    return BystanderMemory(before.points_m[kept], before.owner[kept], age[kept], before.next_label)


def _near(points_m: np.ndarray, seen_m: np.ndarray) -> np.ndarray:
    """Return (n,) bool: whether any skin was seen in a point's cell or beside it."""
    if not len(points_m) or not len(seen_m):
        return np.zeros(len(points_m), dtype=bool)
    low = np.minimum(points_m.min(axis=0), seen_m.min(axis=0)) - CELL_M
    cell, seen = ((np.floor((p - low) / CELL_M).astype(np.int64)) for p in (points_m, seen_m))
    filled = np.zeros(np.maximum(cell.max(axis=0), seen.max(axis=0)) + 2, dtype=bool)
    filled[tuple(seen.T)] = True
    near: np.ndarray = filled[tuple(cell.T)]
    return near


def _in_large_clusters(memory: BystanderMemory) -> np.ndarray:
    """Return (n,) bool: points connected to enough skin of the same person to be a person."""
    large = np.zeros(len(memory.owner), dtype=bool)
    for label in np.flatnonzero(np.bincount(memory.owner)):
        own = np.flatnonzero(memory.owner == label)
        points = memory.points_m[own]
        cube = np.floor((points - points.min(axis=0)) / CLUSTER_GAP_M).astype(np.int64)
        filled = np.zeros(cube.max(axis=0) + 1, dtype=bool)
        filled[tuple(cube.T)] = True
        cluster, count = ndimage.label(filled, structure=np.ones((3, 3, 3), dtype=int))
        cubes = np.bincount(cluster[filled], minlength=count + 1)
        area = cubes * CLUSTER_GAP_M**2 / CUBES_PER_FACE
        large[own] = (area >= CLUSTER_AREA_M2)[cluster[tuple(cube.T)]]
    return large
