"""Remember the skin of all people (the points on them that cameras saw, clothes included) from frame to frame, to
predict its place in the next frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.ownership import OwnershipLikelihood
from anchorpose.isolation.scene import Pieces
from anchorpose.isolation.view import PixelLabel, View

# pixels, step in rows and columns between sampled pixels; on a person 2.5 m from the camera, this is 2 cm
SAMPLE_PX: Final = 3
# m, side of the cubes in which newly seen skin replaces remembered skin. Remembered skin also counts as hidden from a
# camera if the camera's reading lies more than ``CELL_M`` in front of this skin
CELL_M: Final = 0.05
# s, time for which skin that is hidden from all cameras is remembered. A person who passes near the camera, or stops
# there, hides other people for two seconds; after three seconds, the hidden people's places are uncertain by about a
# metre, at ``SPEED_M_S``
MEMORY_S: Final = 3.0
# m, standard deviation of skin about a remembered point, due to noise and to half the spacing of the points
SIGMA_M: Final = 0.012
# m/s, growth of the standard deviation of remembered points with time, for people who stand or hold the patient.
# Walking people move faster than ``SPEED_M_S``; their pixels are found by region growing (pixels take the label of
# connected pixels).
SPEED_M_S: Final = 0.30
# labels of people who are first seen in a pass forward in time, and in a pass backward. The labels of a range are given
# one after another; then the range begins again, since one hour of a busy clinic has more people who come and go
FORWARD_LABELS: Final = range(PixelLabel.OTHER_PERSON, 128)
BACKWARD_LABELS: Final = range(128, 255)


@dataclass(frozen=True, slots=True, eq=False)
class BystanderMemory:
    """The skin of all people, the patient included, as last seen."""

    points_m: np.ndarray  # (n, 3) float32, points on the skin, metres in the world frame
    owner: np.ndarray  # (n,) uint8, label of the person to whom each point belongs
    age_s: np.ndarray  # (n,) float32, time since the point was last seen
    next_label: int  # label that the next person to appear will get, if nobody in the memory has it

    @property
    def without_patient(self) -> BystanderMemory:
        """Return the memory without the patient."""
        return self.without(np.array([PixelLabel.PATIENT]))

    def since(self, hidden_s: float) -> BystanderMemory:
        """Return the memory without skin that has been hidden for longer than ``hidden_s`` seconds."""
        return self._of(self.age_s <= hidden_s)

    def without(self, labels: np.ndarray) -> BystanderMemory:
        """Return the memory without the people with these labels (k,)."""
        return self._of(~np.isin(self.owner, labels))

    def _of(self, kept: np.ndarray) -> BystanderMemory:
        return BystanderMemory(self.points_m[kept], self.owner[kept], self.age_s[kept], self.next_label)

    @property
    def seen_last(self) -> dict[int, np.ndarray]:
        """Return, per label, the points (n, 3) of each person in the last frame."""
        seen = self.age_s == 0.0
        return {
            int(label): self.points_m[seen & (self.owner == label)]
            for label in np.flatnonzero(np.bincount(self.owner[seen]))
        }

    def moved(self, steps: Mapping[int, np.ndarray]) -> BystanderMemory:
        """Return the memory after a displacement of the skin seen in the last frame. steps: for the label of a person,
        the displacement (3,) in metres; the skin of people without an entry keeps its place.
        """
        if not steps:
            return self
        points = self.points_m.copy()
        for label, step in steps.items():
            points[(self.owner == label) & (self.age_s == 0.0)] += step.astype(np.float32)
        return replace(self, points_m=points)

    def free_labels(self, elapsed_s: float) -> np.ndarray:
        """Return labels (k,) uint8 for new people, in the order in which they are given; no label of a person in the
        memory is among the first.

        elapsed_s: time since the remembered frame; negative in a backward pass, in which new people get labels from
        another range.
        """
        labels = BACKWARD_LABELS if elapsed_s < 0.0 or self.next_label in BACKWARD_LABELS else FORWARD_LABELS
        in_turn = np.roll(np.array(labels, np.uint8), labels.start - max(self.next_label, labels.start))
        return in_turn[np.argsort(np.isin(in_turn, self.owner), kind="stable")]

    def given_since(self, label: int) -> frozenset[int]:
        """Return the labels given to new people since ``label`` was the label for the next person."""
        labels = _range_of(self.next_label)
        first, count = labels.index(label) if label in labels else 0, len(labels)
        given = (labels.index(self.next_label) - first) % count
        return frozenset(labels[(first + k) % count] for k in range(given))

    def likelihood(self, elapsed_s: float, doubt_m: float = 0.0) -> OwnershipLikelihood:
        """Predict the remembered skin ``elapsed_s`` after the last frame. A point's uncertainty grows with the time
        since the point was seen.

        doubt_m: a further standard deviation in metres, added in quadrature to the standard deviation of each point of
        skin, for memories whose person labels may be wrong.
        """
        spread = np.hypot(np.hypot(SIGMA_M, doubt_m), SPEED_M_S * (self.age_s + abs(elapsed_s)))
        return OwnershipLikelihood(self.points_m, self.owner, spread.astype(np.float32))


def empty_memory() -> BystanderMemory:
    """Return a memory without any person's skin."""
    return BystanderMemory(
        np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), np.zeros(0, np.float32), PixelLabel.OTHER_PERSON
    )


def memory_of(pieces: Sequence[Pieces | None], views: Sequence[View | None]) -> BystanderMemory:
    """Return the memory of a single frame: the points at the people's pixels in every third row and column."""
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
    points_m, owner = np.concatenate(points), np.concatenate(owners)
    next_label = _next_label(FORWARD_LABELS.start, owner)
    return BystanderMemory(points_m, owner, np.zeros(len(owner), np.float32), next_label)


def _range_of(label: int) -> range:
    return BACKWARD_LABELS if label in BACKWARD_LABELS else FORWARD_LABELS


def _next_label(before: int, owner: np.ndarray) -> int:
    """Return the label for the next new person. before: this label before the labels ``owner`` were given. A label
    less than half a range after ``before`` was given to a new person, all other labels to people seen earlier.
    """
    following = before
    for label in np.unique(owner[owner >= FORWARD_LABELS.start]).tolist():
        labels = _range_of(label)
        if following not in labels and labels is BACKWARD_LABELS:
            following = labels.start
        if following in labels and (label - following) % len(labels) < len(labels) // 2:
            following = labels[(label + 1 - labels.start) % len(labels)]
    return following


def update_memory(
    before: BystanderMemory,
    pieces: Sequence[Pieces | None],
    views: Sequence[View | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
) -> BystanderMemory:
    """Update the memory of people's skin by one more frame.

    Skin that is hidden from all cameras is remembered for ``MEMORY_S``. Skin that was not seen again is forgotten if it
    lies in the image of a camera that reads nothing in front of it (nearer by more than ``CELL_M``).
    """
    now = memory_of(pieces, views)
    kept = _hidden_since(before, now.points_m, pieces, cameras, elapsed_s)
    return BystanderMemory(
        np.concatenate([now.points_m, kept.points_m]),
        np.concatenate([now.owner, kept.owner]),
        np.concatenate([now.age_s, kept.age_s]),
        _next_label(before.next_label, now.owner[~np.isin(now.owner, before.owner)]),
    )


def _hidden_since(
    before: BystanderMemory,
    seen_m: np.ndarray,
    pieces: Sequence[Pieces | None],
    cameras: Sequence[Camera],
    elapsed_s: float,
) -> BystanderMemory:
    """Return the skin that was seen less than ``MEMORY_S`` ago, is not seen now, and may still be there: for every
    camera with a frame, it lies outside the image or behind a nearer surface.
    """
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
    """Return (n,) bool: points in whose cell (a cube with sides of ``CELL_M``) some skin of ``seen_m`` lies."""
    if not len(points_m) or not len(seen_m):
        return np.zeros(len(points_m), dtype=bool)
    low = np.minimum(points_m.min(axis=0), seen_m.min(axis=0)) - CELL_M
    cell, seen = ((np.floor((p - low) / CELL_M).astype(np.int64)) for p in (points_m, seen_m))
    filled = np.zeros(np.maximum(cell.max(axis=0), seen.max(axis=0)) + 2, dtype=bool)
    filled[tuple(seen.T)] = True
    near: np.ndarray = filled[tuple(cell.T)]
    return near
