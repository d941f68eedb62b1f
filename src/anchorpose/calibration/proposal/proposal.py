"""A proposal for chi_0: the boxes and tubes that stand near the patient's place in the empty room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from anchorpose.calibration.proposal.bars import DetectionConfig, Found, find_parts
from anchorpose.calibration.proposal.points import UNREAD_M, Readings, Region, gather_readings
from anchorpose.calibration.proposal.refine import LEAST_SUPPORT, REACH_M, Fit, first_fit, refine
from anchorpose.camera import Camera
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel

ROUNDS = 3  # readings go to the part they are nearest to, and the parts are fitted again
SNAP_RAD = np.radians(10.0)  # what a bar's direction is off where another bar's readings are mixed in
SNAP_WORSE = 1.15  # a snapped part may explain the readings this much worse than a free one
OFF_LINE_M, LARGEST_CUT_M = 0.02, 0.30  # pieces of one bar: aligned, and cut by what is no broader than a person's leg
SEEN_THROUGH = 4  # rays through a gap that say that nothing is in it
EXPLAINED_M = 0.015  # of a part's surface: what the part explains
WELL_M = 0.006  # spread of the readings of a part that lies well, so that it need not be turned
LEAST_READINGS = 40
ALONG_M = 0.01  # a reading so near to the extension of a bar's faces belongs to it; a step along it
DENSE = 3  # readings in a step: one pixel's breadth of a bar at 3 m has five
END_SHARE = 0.15  # of a bar's length at each end, left out of its cross-section
LIES_M = 0.06  # a level bar whose lower side is not seen and so low lies on the floor
TO_FLOOR_M = 0.12  # an upright bar that ends so low stands on the floor, or in a runner that hides its end
RUNNER_M, SEAT_M = 0.15, 0.30  # heights that tell names apart


@dataclass(frozen=True, slots=True, kw_only=True)
class EquipmentFitConfig:
    """Where equipment is looked for, and what passes for a part of it."""

    region: Region = field(default_factory=Region)
    detection: DetectionConfig = field(default_factory=DetectionConfig)
    worst_residual_m: float = 0.012  # spread of a part's readings about it; more is no bar and no plate

    most_hollow: float = 0.2  # of the rays through a part's core; more pass by a thing that is not there

    def __post_init__(self) -> None:
        if not (self.worst_residual_m > 0 and self.most_hollow > 0):
            raise ValueError("worst_residual_m and most_hollow must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class ProposedPart:
    """A part, how far its readings are off it (robust spread), how many there are, and which lengths are guesses."""

    part: Box | Cylinder
    residual_m: float
    readings: int
    guessed: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentProposal:
    """parts, tallest names first; explained_share: of the readings that stand free, those within 15 mm of a part."""

    parts: tuple[ProposedPart, ...]
    explained_share: float

    @property
    def model(self) -> EquipmentModel:
        """The parts as chi_0."""
        return EquipmentModel(tuple(proposed.part for proposed in self.parts))


class NoEquipment(StrEnum):
    """Why nothing is proposed."""

    NOTHING_STANDS = "nothing stands free on the floor near the place that was looked at"
    NO_SHAPE = "what stands there is made of no bars and no plates"


def propose_equipment(
    cameras: Sequence[Camera], rooms_m: Sequence[np.ndarray], floor_height_m: float, config: EquipmentFitConfig
) -> EquipmentProposal | NoEquipment:
    """Boxes and tubes that explain the empty room near the patient's place.

    cameras: with poses; rooms_m: one (height, width) float32 picture of the empty room a camera. Only what is seen is
    known: a side that no camera sees is placed so that the bar is square, and named in ``guessed``.
    """
    readings = gather_readings(cameras, rooms_m, floor_height_m, config.region)
    if readings.stands.sum() < LEAST_READINGS:
        return NoEquipment.NOTHING_STANDS
    points = readings.points_m[readings.stands]
    found = find_parts(points, config.detection)
    if not found:
        return NoEquipment.NO_SHAPE
    yaw = _common_yaw(found)
    fits = [_begin(part, readings, yaw) for part in found]
    fits = _fit_together(fits, readings, 1)
    fits = _fit_together(_merged(fits, readings), readings, ROUNDS)
    fits = [_on_its_feet(fit, readings, floor_height_m) for fit in fits if fit.readings >= LEAST_READINGS]
    fits = [
        fit for fit in fits
        if fit.residual_m < config.worst_residual_m and _hollow_share(fit, readings) < config.most_hollow
    ]  # fmt: skip
    if not fits:
        return NoEquipment.NO_SHAPE
    nearest = np.min([np.abs(fit.distance_m(points)) for fit in fits], axis=0)
    parts = tuple(
        ProposedPart(fit.part(name), fit.residual_m, fit.readings, _guessed(fit, floor_height_m))
        for name, fit in _named(fits, floor_height_m)
    )
    return EquipmentProposal(parts, float((nearest < EXPLAINED_M).mean()))


def _common_yaw(found: Sequence[Found]) -> float:
    """Direction of the level bars about the vertical, radians in (-45, 45] degrees, 0 where that is as good.

    Right angles make it a mean of four times the angle; longer bars count more.
    """
    total = 0.0 + 0.0j
    for part in found:
        axis = part.rotation[:, 0] if part.plate else part.rotation[:, 2]
        if abs(axis[1]) < 0.2:
            total += len(part.members) * np.exp(4j * np.arctan2(-axis[2], axis[0]))
    yaw = float(np.angle(total)) / 4.0 if abs(total) > 0 else 0.0
    return 0.0 if abs(yaw) < np.radians(2.0) else yaw


def _begin(part: Found, readings: Readings, yaw: float) -> Fit:
    """The part with its axes along the vertical and the common directions where they nearly are.

    It is fitted from two starts, for other parts' readings among its own make one of them too large: then a face
    settles on the wrong side of the readings.
    """
    rotation = _snapped(part.rotation, yaw)
    rows = np.flatnonzero(readings.stands)[part.members]
    points = readings.points_m[rows]
    local = points @ rotation
    seen_from = ((readings.origin_m[rows] - points) @ rotation).mean(axis=0)
    inner = np.ones(len(local), dtype=bool)
    if not part.plate:  # at a bar's ends, others start from it
        ends = np.percentile(local[:, 2], [0, 100]) @ np.array([[1 - END_SHARE, END_SHARE], [END_SHARE, 1 - END_SHARE]])
        inner = (local[:, 2] >= ends[0]) & (local[:, 2] <= ends[1])
    across = slice(0, 2) if not part.plate else slice(2, 3)
    own = np.zeros(len(readings.depth_m), dtype=bool)
    own[rows] = True
    fits = []
    for cut in (5, 25):
        low, high = np.percentile(local, [1, 99], axis=0)
        low[across], high[across] = np.percentile(local[inner][:, across], [cut, 100 - cut], axis=0)
        fits.append(refine(first_fit(rotation, low, high, part.plate, seen_from), readings, own))
    return min(fits, key=lambda fit: fit.cost)


def _snapped(rotation: np.ndarray, yaw: float) -> np.ndarray:
    """The rotation of the common frame nearest to this one, or as it is where none is within ``SNAP_RAD``."""
    c, s = np.cos(yaw), np.sin(yaw)
    common = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    overlap = np.abs(common.T @ rotation)
    choice = int(np.argmax(overlap[:, 2]))
    if overlap[choice, 2] < np.cos(SNAP_RAD):
        return rotation
    axes = [common[:, choice - 2], common[:, choice - 1], common[:, choice]]  # cyclic, so right-handed
    return np.stack(axes, axis=1)


def _is_snapped(fit: Fit) -> bool:
    return bool(np.isin(np.round(np.abs(fit.rotation[1]), 12), (0.0, 1.0)).all())


def _fit_together(fits: Sequence[Fit], readings: Readings, rounds: int) -> list[Fit]:
    """Readings to the nearest part, every part to its readings, over and over; thin leftovers are dropped."""
    fits = list(fits)
    stands = np.flatnonzero(readings.stands)
    points = readings.points_m[stands]
    for number in range(rounds):
        distances = np.array([np.abs(fit.distance_m(points)) for fit in fits])
        fits = [_extended(fit, points, _of_no_other(distances, index)) for index, fit in enumerate(fits)]
        owner = np.where(distances.min(axis=0) < REACH_M, distances.argmin(axis=0), -1)
        kept = []
        for index, fit in enumerate(fits):
            own = np.zeros(len(readings.depth_m), dtype=bool)
            own[stands[owner == index]] = True
            if own.sum() >= LEAST_READINGS:
                kept.append(_settled(fit, readings, own, tubes=number == ROUNDS - 1))
        fits = kept
        if not fits:
            break
    return fits


def _of_no_other(distances: np.ndarray, index: int) -> np.ndarray:
    """(n,) bool: readings that no part but this one is near to."""
    others = np.delete(distances, index, axis=0)
    return np.asarray(others.min(axis=0, initial=np.inf) > EXPLAINED_M)


def _extended(fit: Fit, points: np.ndarray, free: np.ndarray) -> Fit:
    """A bar made longer as far as readings go on in its own cross-section; free (n,) bool: those of no other part.

    Other parts' readings carry it on, so that a runner goes on behind the post upon it, but no bar ends in them.
    """
    if fit.plate:
        return fit
    local = points @ fit.rotation
    in_line = ((local > fit.low - ALONG_M) & (local < fit.high + ALONG_M))[:, :2].all(axis=1)
    low, high = fit.low.copy(), fit.high.copy()
    low[2] -= _run_m(low[2] - local[in_line, 2], free[in_line])
    high[2] += _run_m(local[in_line, 2] - high[2], free[in_line])
    return replace(fit, low=low, high=high)


def _run_m(beyond_m: np.ndarray, free: np.ndarray) -> float:
    """How far readings go on beyond an end, in steps that each hold some of them; the last step holds free ones."""
    steps = (beyond_m / ALONG_M).astype(int)
    ahead = beyond_m > 0
    count = int(steps[ahead].max(initial=0)) + 2
    filled = np.bincount(steps[ahead], minlength=count) >= DENSE
    gaps = np.flatnonzero(~(filled | np.append(filled[1:], False)))  # one empty step is noise, two are the end
    own = np.flatnonzero(np.bincount(steps[ahead & free], minlength=count)[: gaps[0]] >= DENSE)
    return ALONG_M * float(own[-1] + 1) if len(own) else 0.0


def _settled(fit: Fit, readings: Readings, own: np.ndarray, tubes: bool) -> Fit:
    """With its axes as they are where the common directions explain it, free to turn otherwise."""
    straight = refine(fit, readings, own, tubes=tubes)
    if _is_snapped(fit) and straight.residual_m < WELL_M:
        return straight
    turned = refine(straight, readings, own, turn=True, tubes=tubes)
    return straight if _is_snapped(fit) and straight.cost < SNAP_WORSE * turned.cost else turned


def _merged(fits: Sequence[Fit], readings: Readings) -> list[Fit]:
    """Pieces of one bar that something else cuts become one, unless rays pass between them."""
    fits = list(fits)
    for first in range(len(fits)):
        for second in range(first + 1, len(fits)):
            joined = _join(fits[first], fits[second], readings)
            if joined is not None:
                rest = [fit for index, fit in enumerate(fits) if index not in (first, second)]
                return _merged([*rest, joined], readings)
    return fits


def _join(one: Fit, other: Fit, readings: Readings) -> Fit | None:
    if one.plate or other.plate or abs(one.axis @ other.axis) < np.cos(np.radians(3.0)):
        return None
    offset = (other.center_m - one.center_m) @ one.rotation
    gap = abs(offset[2]) - (one.size_m[2] + other.size_m[2]) / 2.0
    if np.abs(offset[:2]).max() > OFF_LINE_M or gap > LARGEST_CUT_M:
        return None
    long, short = (one, other) if one.size_m[2] >= other.size_m[2] else (other, one)
    ends = np.concatenate(
        [[long.low[2], long.high[2]], long.axis @ short.axis * np.array([short.low[2], short.high[2]])]
    )
    between = np.sort(ends)[1:3]
    if gap > 0 and _seen_through(long, between, readings):
        return None
    low, high = long.low.copy(), long.high.copy()
    low[2], high[2] = ends.min(), ends.max()
    return replace(long, low=low, high=high, round=False)


def _seen_through(bar: Fit, between: np.ndarray, readings: Readings) -> bool:
    """Whether rays pass through the gap in a bar: then there is nothing in it."""
    low, high = _core(bar)
    margin = min(0.01, 0.2 * float(np.ptp(between)))
    low[2], high[2] = between[0] + margin, between[1] - margin
    passing, _ = _rays_through(bar.rotation, low, high, readings)
    return passing >= SEEN_THROUGH


def _hollow_share(fit: Fit, readings: Readings) -> float:
    """Share of the rays through a part's core that end beyond it: of a thing that is there, none."""
    passing, ending = _rays_through(fit.rotation, *_core(fit), readings)
    return passing / max(passing + ending, 1)


def _core(fit: Fit) -> tuple[np.ndarray, np.ndarray]:
    trim = 0.15 * fit.size_m
    return fit.low + trim, fit.high - trim


def _rays_through(rotation: np.ndarray, low: np.ndarray, high: np.ndarray, readings: Readings) -> tuple[int, int]:
    """How many of the rays that meet a box end beyond it, and how many within it or just before."""
    origin, ray = readings.origin_m @ rotation, readings.ray @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - origin) / ray, (high - origin) / ray
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    meets = (enter < leave) & (enter > 0) & (readings.depth_m < UNREAD_M)
    slack = 3.0 * readings.sigma_m + REACH_M
    passing = meets & (readings.depth_m > leave + slack)
    ending = meets & ~passing & (readings.depth_m > enter - slack)
    return int(np.count_nonzero(passing)), int(np.count_nonzero(ending))


def _on_its_feet(fit: Fit, readings: Readings, floor_height_m: float) -> Fit:
    """Down to the floor where the lowest face is lost in the floor's noise or in a runner; nothing below the floor."""
    upright = np.abs(fit.rotation[1])
    axis = int(np.argmax(upright))
    if upright[axis] < 0.95 or (fit.round and axis < 2):
        return fit
    low, high = fit.low.copy(), fit.high.copy()
    sign = np.sign(fit.rotation[1, axis])
    face = low if sign > 0 else high
    height = sign * face[axis] - floor_height_m
    stands = axis == 2 and not fit.plate
    if height > (TO_FLOOR_M if stands else LIES_M) or (not stands and _lifted(fit, axis, height, readings)):
        return fit
    face[axis] = sign * floor_height_m
    return replace(fit, low=low, high=high)


def _lifted(fit: Fit, axis: int, height_m: float, readings: Readings) -> bool:
    """Whether rays pass between a level part and the floor below it."""
    if height_m < 2.0 * ALONG_M:
        return False
    low, high = _core(fit)
    if fit.rotation[1, axis] > 0:
        low[axis], high[axis] = fit.low[axis] - height_m + ALONG_M, fit.low[axis] - ALONG_M / 2.0
    else:
        low[axis], high[axis] = fit.high[axis] + ALONG_M / 2.0, fit.high[axis] + height_m - ALONG_M
    passing, ending = _rays_through(fit.rotation, low, high, readings)
    return passing >= SEEN_THROUGH and passing > ending


def _guessed(fit: Fit, floor_height_m: float) -> tuple[str, ...]:
    """Lengths that no camera sees: a side along which all of them look, an end that nothing places.

    What stands on the floor ends there.
    """
    names = ("breadth", "thickness", "length") if not fit.plate else ("length", "breadth", "thickness")
    unplaced = fit.support < LEAST_SUPPORT
    ends = (2,) if not fit.plate else (0, 1)
    unknown = set(np.flatnonzero(fit.blind).tolist())
    unknown |= {
        axis for axis in ends if unplaced[axis].any() and not _on_floor(fit, axis, unplaced[axis], floor_height_m)
    }
    return tuple(names[axis] for axis in sorted(unknown) if not (fit.round and axis < 2))


def _on_floor(fit: Fit, axis: int, sides: np.ndarray, floor_height_m: float) -> bool:
    """Whether the only unseen face along this axis lies on the floor."""
    upright = fit.rotation[1, axis]
    if abs(upright) < 0.99 or sides.all():
        return False
    face = (fit.low if sides[0] else fit.high)[axis] * np.sign(upright)
    return bool(abs(face - floor_height_m) < 0.03)


def _named(fits: Sequence[Fit], floor_height_m: float) -> list[tuple[str, Fit]]:
    """post, strut, runner, rail (along X), bar (across), seat, plate; numbered from the patient's left to his right."""
    kinds = [_kind(fit, floor_height_m) for fit in fits]
    order = sorted(range(len(fits)), key=lambda i: (kinds[i], *np.round(fits[i].center_m[[2, 1, 0]], 2)))
    counts: dict[str, int] = {}
    named = []
    for index in order:
        counts[kinds[index]] = counts.get(kinds[index], 0) + 1
        named.append((f"{kinds[index]}-{counts[kinds[index]]}", fits[index]))
    return named


def _kind(fit: Fit, floor_height_m: float) -> str:
    height = fit.center_m[1] - floor_height_m
    upright = abs(fit.axis[1])
    if fit.plate:
        return "seat" if upright > 0.9 and height > SEAT_M else "plate"
    if upright > 0.9:
        return "post"
    if upright > 0.3:
        return "strut"
    if height < RUNNER_M:
        return "runner"
    return "rail" if abs(fit.axis[0]) > abs(fit.axis[2]) else "bar"
