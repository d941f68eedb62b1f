"""Find people in the foreground of all cameras by their trunks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from scipy.sparse.csgraph import connected_components

from anchorpose.isolation.region_growing import smooth_contact_m
from anchorpose.isolation.scene import Pieces
from anchorpose.settings import Positive, settings


@settings
class IsolationConfig:
    """How far people reach, and how closely their skin follows its prediction."""

    reach_m: Positive = 0.90  # from the body's axis to an outstretched hand
    skin_sigma_m: Positive = 0.02  # clothes and shape, for the patient's predicted skin


PERSON_AREA_M2: Final = 0.12  # what must be seen of a person: a fifth of an adult's frontal area
PERSON_RADIUS_M: Final = 0.25  # half a shoulder breadth (95th percentile of men 0.26 m)
LEAST_PEAK: Final = 0.02  # of the greatest mass on the ground
CELL_M: Final = 0.04  # ground cells: a sixth of a person's radius
SADDLE_NEAR, SADDLE_FAR = 0.6, 0.8  # two peaks with more than this of the lower one between them are one body, near
NEAR_M, FAR_M = 0.35, 0.50  # each other and far apart: arms carry less, the thighs of a seated person carry more

ONE_BODY_M: Final = 0.47  # axes of one body's columns are at most so far apart: two thighs, two raised arms
GAP_M: Final = 0.5  # in the heights of a person's surface: a table hides less of it
LONG_CONTACT_M: Final = 0.50  # most of a trunk: of two people who stand half behind each other 0.4 m meet by chance


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """One person: ground_xz_m (2,) float64, the body's axis on the ground; bottom_m, top_m: heights.

    area_m2, pixels: the surface seen about the axis, and by how many pixels.
    """

    ground_xz_m: np.ndarray
    bottom_m: float
    top_m: float
    area_m2: float
    pixels: int


class Size(NamedTuple):
    """The least that must be seen of a person: from top to bottom, and as surface."""

    height_m: float
    area_m2: float


PERSON: Final = Size(0.50, PERSON_AREA_M2)  # half of one who sits
FAINT: Final = Size(0.35, 0.06)  # head and chest of one who is hidden from the only camera; an arm has as much


@dataclass(frozen=True, slots=True, eq=False)
class People:
    """The people of one moment.

    of: one per camera, (n,) int32 person of each foreground pixel, -1 = nobody. group: the person of each column, -1 of
    a column that is nobody. faint: people who may show no more than ``FAINT``.
    """

    people: tuple[Person, ...]
    of: tuple[np.ndarray | None, ...]
    group: tuple[int, ...]
    faint: tuple[int, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PatientChoice:
    """Where the patient stands in a frame, (2,) float64 X and Z, and why.

    sure: named or in the equipment, and nobody else is nearly as likely. group: as in ``find_people``, for the frame
    with the number ``frame`` only; None where nothing better is known than what touches. rival_xz_m: (2,) where another
    person stands who may be the patient as well, None without one.
    """

    ground_xz_m: np.ndarray
    reason: str
    sure: bool
    frame: int | None = None
    group: tuple[int, ...] | None = None
    rival_xz_m: np.ndarray | None = None


def find_people(
    pieces: Sequence[Pieces | None], config: IsolationConfig, group: Sequence[int] | None = None, faint: bool = False
) -> People:
    """Split the foreground of all cameras into persons.

    Each person is a column of mass over the ground (Y is up). Columns whose surface goes on from one to the other
    without a crease are one person, whose arms are raised, or of whom something hides the middle, unless ``group``
    says which person each column belongs to. A connected piece that covers one column belongs to that person, one that
    covers several is divided by the nearest axis, one that covers none goes to the nearest
    person within reach.
    faint: columns as small as ``FAINT`` count too; they come after the others.
    """
    seen = [pixels for pixels in pieces if pixels is not None]
    points = np.concatenate([pixels.points_m for pixels in seen]) if seen else np.empty((0, 3), np.float32)
    area = np.concatenate([pixels.area_m2 for pixels in seen]) if seen else np.empty(0, np.float32)
    ordinary = find_columns(points, area)
    columns = ordinary + (find_columns(points, area, FAINT, ordinary) if faint else ())
    kept = np.arange(len(columns)) if group is None else np.flatnonzero(np.array(group, dtype=np.int64) >= 0)
    of = [None if pixels is None else _owners(pixels, [columns[k] for k in kept], config) for pixels in pieces]
    person = _one_body(columns, pieces, of) if group is None else np.array(group, dtype=np.int64)
    members = [np.flatnonzero(person == p) for p in range(person.max(initial=-1) + 1)]
    renumbered = np.append(person[kept], -1)  # the last one: nobody
    return People(
        tuple(_joined([columns[k] for k in member]) for member in members),
        tuple(None if owner is None else renumbered[owner].astype(np.int32) for owner in of),
        tuple(person.tolist()),
        tuple(p for p, member in enumerate(members) if member.min() >= len(ordinary)),
    )


def _one_body(
    columns: Sequence[Person], pieces: Sequence[Pieces | None], of: Sequence[np.ndarray | None]
) -> np.ndarray:
    """(k,) int: which person each column belongs to, numbered in the order of the columns."""
    contact_m = np.zeros((len(columns), len(columns)))
    axes = np.array([column.ground_xz_m for column in columns]).reshape(-1, 2)
    near = np.linalg.norm(axes[:, None] - axes[None], axis=2) < ONE_BODY_M
    if near.sum() > len(columns):
        for pixels, owner in zip(pieces, of, strict=True):
            if pixels is not None and owner is not None:
                contact_m = np.maximum(contact_m, smooth_contact_m(pixels, owner, len(columns)))
    _, group = connected_components(near & (contact_m >= LONG_CONTACT_M), directed=False)
    return np.asarray(group)


def _joined(columns: Sequence[Person]) -> Person:
    """One person of several columns; the axis is that of their common mass."""
    if len(columns) == 1:
        return columns[0]
    area = np.array([column.area_m2 for column in columns])
    return Person(
        area @ np.array([column.ground_xz_m for column in columns]) / area.sum(),
        min(column.bottom_m for column in columns),
        max(column.top_m for column in columns),
        float(area.sum()),
        sum(column.pixels for column in columns),
    )


def find_columns(
    points_m: np.ndarray, area_m2: np.ndarray, least: Size = PERSON, known: Sequence[Person] = ()
) -> tuple[Person, ...]:
    """Peaks of the ground's smoothed mass that are tall enough and large enough to be a person.

    least: how tall and large; known: people found before, beside whom others are looked for.
    """
    if not len(points_m):
        return ()
    ground = points_m[:, [0, 2]]
    low = ground.min(axis=0) - 2 * PERSON_RADIUS_M
    cell = ((ground - low) / CELL_M).astype(np.int64)
    shape = cell.max(axis=0) + 1 + int(2 * PERSON_RADIUS_M / CELL_M)
    mass = np.bincount(cell[:, 0] * shape[1] + cell[:, 1], weights=area_m2, minlength=shape.prod()).reshape(shape)
    mass = cv2.GaussianBlur(mass, (0, 0), PERSON_RADIUS_M / (4 * CELL_M))
    peaks = [((one.ground_xz_m - low) / CELL_M).astype(np.int64) for one in known]
    left = mass.copy()
    for peak in peaks:
        _clear(left, peak)
    ground_cells = GroundCells(cell, shape)
    found: list[Person] = []
    for peak in _falling(left, LEAST_PEAK * mass.max()):
        height = left[tuple(peak)]
        if height == 0.0:  # beside a higher one
            continue
        _clear(left, peak)
        person = _person_at(low + (peak + 0.5) * CELL_M, ground_cells.around(peak), points_m, area_m2, least)
        if person is None:
            continue
        near = _perhaps_one_body(mass, peak, peaks)
        if not any(_saddle(mass, peak, other) > _one_body_share(peak - other) * height for other in near):
            found.append(person)
            peaks.append(peak)
    return tuple(found)


def _falling(mass: np.ndarray, least: float) -> np.ndarray:
    """(n, 2) int64: the cells with more than ``least``, the heaviest first."""
    above = np.flatnonzero(mass > least)
    order = np.argsort(-mass.ravel()[above], kind="stable")
    return np.stack(np.unravel_index(above[order], mass.shape), axis=1)


class GroundCells:
    """Which points stand in which cell of the ground, so that those around a place are found without a look at all."""

    def __init__(self, cell: np.ndarray, shape: np.ndarray) -> None:
        """cell (n, 2) int64, of each point; shape (2,): of the grid."""
        number = cell[:, 0] * shape[1] + cell[:, 1]
        self._shape, self._order = shape, np.argsort(number, kind="stable")
        self._number = number[self._order]

    def around(self, cell: np.ndarray) -> np.ndarray:
        """Indices, rising, of all points that may be within ``PERSON_RADIUS_M`` of the middle of a cell (2,)."""
        reach = int(np.ceil(PERSON_RADIUS_M / CELL_M)) + 1
        (top, left), (bottom, right) = np.maximum(cell - reach, 0), np.minimum(cell + reach + 1, self._shape)
        rows = self._shape[1] * np.arange(top, bottom)
        first, last = np.searchsorted(self._number, rows + left), np.searchsorted(self._number, rows + right)
        return np.sort(np.concatenate([self._order[a:b] for a, b in zip(first, last, strict=True)]))


def _clear(mass: np.ndarray, peak: np.ndarray) -> None:
    """Removes what stands about a peak."""
    cv2.circle(mass, (int(peak[1]), int(peak[0])), int(1.5 * PERSON_RADIUS_M / CELL_M), 0.0, -1)


def _person_at(
    axis_xz: np.ndarray, around: np.ndarray, points_m: np.ndarray, area_m2: np.ndarray, least: Size
) -> Person | None:
    """The person with an axis (2,), of whose surface all points are among ``around`` (indices); None: too little."""
    near = around[((points_m[around][:, [0, 2]] - axis_xz) ** 2).sum(axis=1) < PERSON_RADIUS_M**2]
    area = float(area_m2[near].sum())
    if area < least.area_m2:
        return None
    bottom, top = _extent(points_m[near, 1], area_m2[near])
    if top - bottom < least.height_m:
        return None
    return Person(axis_xz.astype(np.float64), bottom, top, area, len(near))


def _extent(heights_m: np.ndarray, area_m2: np.ndarray) -> tuple[float, float]:
    """From 1 to 99 % of the heights of the largest part without a gap of ``GAP_M``: specks of ceiling are no head."""
    order = np.argsort(heights_m)
    ordered = heights_m[order]
    part = np.concatenate([[0], np.cumsum(np.diff(ordered) > GAP_M)])
    largest = np.bincount(part, area_m2[order]).argmax()
    bottom, top = np.percentile(ordered[part == largest], [1, 99])
    return float(bottom), float(top)


def ground_distance(points_m: np.ndarray, axes_xz: np.ndarray) -> np.ndarray:
    """(n,) distance over the ground of points (n, 3) from axes (n, 2) or one axis (2,)."""
    return np.hypot(points_m[:, 0] - axes_xz[..., 0], points_m[:, 2] - axes_xz[..., 1])


def _one_body_share(cells: np.ndarray) -> np.ndarray:
    """The least saddle of one body whose two peaks are so many cells (..., 2) apart."""
    return np.interp(CELL_M * np.linalg.norm(cells, axis=-1), (NEAR_M, FAR_M), (SADDLE_NEAR, SADDLE_FAR))


def _perhaps_one_body(mass: np.ndarray, peak: np.ndarray, others: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The other peaks without those that some cells of the straight line to them part from this one.

    The whole line (``_saddle``) decides; it takes a hundred times as long.
    """
    if not others:
        return []
    ends, height = np.array(others), mass[tuple(peak)]
    steps = np.abs(ends - peak).max(axis=1)  # as in ``_saddle``
    for eighth in (4, 2, 6, 1, 3, 5, 7):
        least = _one_body_share(peak - ends) * height
        line = np.rint((eighth * steps // 8)[:, None] * ((ends - peak) / steps[:, None]) + peak).astype(np.int64)
        connected = mass[line[:, 0], line[:, 1]] > least
        ends, steps = ends[connected], steps[connected]
    return list(ends)


def _saddle(mass: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """Least mass on the straight line between two cells."""
    steps = int(np.abs(end - start).max()) + 1
    line = np.rint(np.linspace(start, end, steps)).astype(np.int64)
    return float(mass[line[:, 0], line[:, 1]].min())


def _owners(pixels: Pieces, people: Sequence[Person], config: IsolationConfig) -> np.ndarray:
    """(n,) int32 person of each foreground pixel of one camera, -1 = nobody: out of reach of the axis."""
    if not people or not len(pixels.row):
        return np.full(len(pixels.row), -1, dtype=np.int32)
    axes = np.array([person.ground_xz_m for person in people], dtype=np.float32)
    distance = np.linalg.norm(pixels.points_m[:, None, [0, 2]] - axes, axis=2)  # (n, people)
    nearest = distance.argmin(axis=1)
    height = pixels.points_m[:, 1:2]
    bottom, top = np.array([(person.bottom_m, person.top_m) for person in people], np.float32).T
    beyond_m = np.abs(height - np.clip(height, bottom, top))
    in_core = (distance < PERSON_RADIUS_M) & (beyond_m < GAP_M)
    covered = np.stack(
        [np.bincount(pixels.piece, pixels.area_m2 * core, pixels.piece_count + 1) for core in in_core.T], axis=1
    )  # (pieces, people)
    covers = covered > PERSON_AREA_M2 / 4
    only = np.where(covers.sum(axis=1) == 1, covers.argmax(axis=1), -1)[pixels.piece]
    owner = np.where(only >= 0, only, nearest)
    every = np.arange(len(owner))
    away_m = np.hypot(distance[every, owner], beyond_m[every, owner])
    return np.where(away_m > config.reach_m, -1, owner).astype(np.int32)
