"""Find where all people moved since the last frame, from the depth images alone.

At a low frame rate, a walking person moves a quarter of a metre between frames. This is too far for the person to be
recognised by the remembered or predicted skin. So the points at which each person was last seen are moved over the
ground and compared with the new frame.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import combinations, product
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from anchorpose.body.visibility import Projection, pixels_of, projection_of
from anchorpose.camera import Camera
from anchorpose.isolation.scene import Pieces

REACH_M: Final = 0.60  # m, maximum length of a step from frame to frame: 3 m/s at 5 frames per second
GRID_M: Final = 0.05  # m, spacing of the steps (movements over the ground) that are tried: half a limb's width
# m, maximum gap between a moved point and the reading at its pixel: half the spacing of the tried steps (GRID_M), plus
# clothes and noise
SAME_M: Final = 0.06
# m; a reading this far behind a point refutes the point: the person's skin is not there
PAST_M: Final = 0.15
POINTS: Final = 250  # maximum number of points used per person; the sampling error of the share found is then 0.03
STAYED: Final = 0.6  # minimum share of a person's points found without a step, for the person to count as not walking
# minimum worth (``_worth``) of a person's predicted skin without a step; if it is reached, no step is needed. The
# minimum is far below 1, since limbs in front may hide the rest of the skin
PLACED: Final = 0.4
BETTER: Final = 0.2  # a step is accepted only if it increases the share of points found by at least this
LEAST: Final = 0.25  # minimum share of the points found after a step; other people may hide the rest
# reduction of the worth of a step (``_worth``), per metre of its length, so that the shorter of two good steps is
# preferred
FAR_COST: Final = 0.2
# maximum number of walking people whose steps are compared jointly; an image has no room for more people
MOST_WALKERS: Final = 5
MOST_STEPS: Final = 4  # maximum number of steps considered for each person
APART_M: Final = 0.25  # m, minimum distance between two people's places, and between two considered steps of a person
LEAST_POINTS: Final = 60  # minimum number of a person's points, as many as on a hand; with fewer, no step is found


def find_steps(
    skin_m: Mapping[int, np.ndarray], pieces: Sequence[Pieces | None], cameras: Sequence[Camera]
) -> dict[int, np.ndarray]:
    """Return each walking person's step over the ground, (3,) metres by label. People who stayed, or are not seen, have
    no entry.

    skin_m: (n, 3) world points per label: the person's skin seen in the last frame. The points are moved by each tried
    step. A moved point counts as found if a pixel of a person lies at the point's depth. The point counts as refuted if
    a camera sees past it (reads something farther away), and as unknown if it is hidden. The combination of steps with
    which most points are found and fewest refuted is chosen.
    """
    shown = [(pixels, projection_of(camera)) for pixels, camera in zip(pieces, cameras, strict=True) if pixels]
    free = [pixels.index >= 0 for pixels, _ in shown]
    left = {label: points.astype(np.float64) for label, points in skin_m.items() if len(points) >= LEAST_POINTS}
    stay = np.zeros((1, 3))
    worth = {label: _worth(_thinned(points), stay, shown, free)[0] for label, points in left.items()}
    if all(value >= STAYED for value in worth.values()):
        return {}
    for label in [label for label in left if worth[label] >= STAYED]:
        _take(left.pop(label), shown, free)
    walkers = sorted(left)[:MOST_WALKERS]
    options = [_options(left[label], worth[label], shown, free) for label in walkers]
    chosen = max(product(*options), key=_together)
    return {label: one.step for label, one in zip(walkers, chosen, strict=True) if one.step.any()}


class _Option(NamedTuple):
    """A possible step of one person."""

    step: np.ndarray  # (3,) m, movement over the ground
    place_xz_m: np.ndarray  # (2,) the person's place on the ground after the step
    worth: float  # share of the points found minus the share refuted, minus ``FAR_COST`` times the distance


def _options(
    points_m: np.ndarray, staying: float, shown: Sequence[tuple[Pieces, Projection]], free: Sequence[np.ndarray]
) -> list[_Option]:
    """Return the possible steps of a person: none (staying), and up to ``MOST_STEPS`` good steps that lead to different
    places.
    """
    steps, center = _grid(), points_m.mean(axis=0)[[0, 2]]
    worth = _worth(_thinned(points_m), steps, shown, free) - FAR_COST * np.linalg.norm(steps, axis=1)
    found = [_Option(np.zeros(3), center, max(staying, 0.0))]
    open_ = worth > max(staying + BETTER, LEAST)
    while open_.any() and len(found) <= MOST_STEPS:
        best = int(np.where(open_, worth, -np.inf).argmax())
        found.append(_Option(steps[best], center + steps[best, [0, 2]], float(worth[best])))
        open_ &= np.linalg.norm(steps - steps[best], axis=1) > APART_M
    return found


def _together(chosen: Sequence[_Option]) -> float:
    """Return the sum of ``worth`` (mainly the share of points found minus the share refuted) over the chosen steps, one
    step per person; -inf if a step would bring two people to the same place.
    """
    for one, other in combinations(chosen, 2):
        if (one.step.any() or other.step.any()) and np.linalg.norm(one.place_xz_m - other.place_xz_m) < APART_M:
            return -np.inf
    return sum(one.worth for one in chosen)


def step_onto(
    skin_m: np.ndarray, seen_m: np.ndarray, pieces: Sequence[Pieces | None], cameras: Sequence[Camera]
) -> np.ndarray:
    """Return the step (3,) over the ground that moves a person's expected skin to where the person is seen; zero if the
    skin already fits or no step fits clearly better.

    skin_m (p, 3): expected skin that faces a camera; seen_m (n, 3): points at which ``find_steps`` found the person.
    """
    nowhere = np.zeros(3)
    if len(skin_m) < LEAST_POINTS or len(seen_m) < LEAST_POINTS:
        return nowhere
    shown = [(pixels, projection_of(camera)) for pixels, camera in zip(pieces, cameras, strict=True) if pixels]
    others = [np.ones(pixels.depth_m.shape, dtype=np.bool_) for pixels, _ in shown]
    _take(seen_m.astype(np.float64), shown, others)
    own = [~taken for taken in others]
    points = _thinned(skin_m)
    there = _worth(points, nowhere[None], shown, own)[0]
    if there >= PLACED:
        return nowhere
    step, value = _best_step(points, shown, own)
    return step if value > max(there + BETTER, LEAST) else nowhere


def facing_points(points_m: np.ndarray, normals: np.ndarray, cameras: Sequence[Camera]) -> np.ndarray:
    """Return the points of ``points_m`` (n, 3) that face at least one camera, by their normals (n, 3)."""
    facing = np.zeros(len(points_m), dtype=bool)
    for camera in cameras:
        facing |= ((camera.position_m - points_m) * normals).sum(axis=1) > 0
    return points_m[facing]


def _thinned(points_m: np.ndarray) -> np.ndarray:
    return points_m[:: max(1, len(points_m) // POINTS)].astype(np.float64)


@cache
def _grid() -> np.ndarray:
    """Return the tried steps (k, 3) over the ground, the zero step first."""
    side = np.arange(-REACH_M, REACH_M + GRID_M / 2, GRID_M)
    x, z = (axis.ravel() for axis in np.meshgrid(side, side))
    steps = np.column_stack([x, np.zeros_like(x), z])
    length = np.linalg.norm(steps, axis=1)
    order = np.argsort(length, kind="stable")
    return steps[order[length[order] <= REACH_M]]


def _best_step(
    points_m: np.ndarray, shown: Sequence[tuple[Pieces, Projection]], free: Sequence[np.ndarray]
) -> tuple[np.ndarray, float]:
    """Return the best step (3,) and its worth, which is already reduced by ``FAR_COST`` times the step's length."""
    steps = _grid()
    worth = _worth(points_m, steps, shown, free) - FAR_COST * np.linalg.norm(steps, axis=1)
    best = int(worth.argmax())
    return steps[best], float(worth[best])


def _worth(
    points_m: np.ndarray, steps: np.ndarray, shown: Sequence[tuple[Pieces, Projection]], free: Sequence[np.ndarray]
) -> np.ndarray:
    """Return (k,) for each step: the share of points that count as found after the step, minus the share of points that
    count as refuted (``find_steps``).
    """
    found = np.zeros((len(steps), len(points_m)), np.int8)
    for (pixels, projection), open_ in zip(shown, free, strict=True):
        _look(points_m, steps, projection, pixels.depth_m, open_, found)
    return np.asarray(found.mean(axis=1))


@njit(cache=True, nogil=True)
def _look(
    points: np.ndarray,
    steps: np.ndarray,
    projection: Projection,
    depth: np.ndarray,
    free: np.ndarray,
    found: np.ndarray,
) -> None:
    """Set ``found`` to 1 for each moved point whose pixel is free (not another person's) and has the point's depth. Set
    it to -1 if the camera sees past the point.
    """
    height, width = depth.shape
    for k in range(len(steps)):
        column, row, far = pixels_of(points + steps[k], projection, height, width)
        for p in range(len(points)):
            if column[p] < 0 or found[k, p] > 0:
                continue
            reading = depth[row[p], column[p]]
            if reading <= 0.0:
                continue
            if abs(reading - far[p]) < SAME_M:
                if free[row[p], column[p]]:
                    found[k, p] = 1
            elif reading > far[p] + PAST_M:
                found[k, p] = -1


def _take(points_m: np.ndarray, shown: Sequence[tuple[Pieces, Projection]], free: Sequence[np.ndarray]) -> None:
    """Mark the pixels at the points as taken by a person, so that no other person is found there."""
    for (pixels, projection), open_ in zip(shown, free, strict=True):
        _close(points_m, projection, pixels.depth_m, open_)


@njit(cache=True, nogil=True)
def _close(points: np.ndarray, projection: Projection, depth: np.ndarray, free: np.ndarray) -> None:
    height, width = depth.shape
    column, row, far = pixels_of(points, projection, height, width)
    for p in range(len(points)):
        if column[p] < 0:
            continue
        reach = int(np.ceil(0.5 * GRID_M * projection.lens[0] / far[p]))
        for r in range(max(row[p] - reach, 0), min(row[p] + reach + 1, height)):
            for c in range(max(column[p] - reach, 0), min(column[p] + reach + 1, width)):
                if abs(depth[r, c] - far[p]) < PAST_M:
                    free[r, c] = False
