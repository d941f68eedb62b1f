"""Propose the equipment model: the boxes and tubes that stand near the patient's place in the empty room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from anchorpose.calibration.proposal_joining import extended, guessed_lengths, hollow_share, merged, on_its_feet
from anchorpose.calibration.proposal_readings import LEAST_PIXELS, Found, Readings, Region, find_parts, gather_readings
from anchorpose.calibration.proposal_shape import REACH_M, Fit, first_fit, refine
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.recording.equipment import Box, Cylinder, EquipmentModel
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.rotations import rotation_about_y

ROUNDS: Final = 3  # number of rounds, in which readings are assigned to the nearest part and parts are fitted again
# rad, maximum angle by which a part's axes are turned to lie along the common directions (the vertical, and the level
# directions of most bars). Readings of another bar may cause an error of 10 degrees in the direction of a bar
SNAP_RAD: Final = np.radians(10.0)
# maximum cost of a fit with axes along the common directions, as a factor on the cost with free axes; if the fit costs
# more, the free axes are kept
SNAP_WORSE: Final = 1.15
EXPLAINED_M: Final = 0.015  # m from a part's surface; readings within this distance count as readings of the part
# m; a part whose axes lie along the common directions keeps these axes if its readings spread about its surface by less
# than this
WELL_M: Final = 0.006
# m, maximum spread of a part's readings about its surface; a part with a larger spread is neither a bar nor a plate
WORST_RESIDUAL_M: Final = 0.012
# maximum share of the rays through a part's core that may end beyond the part; wrong parts have a larger share
MOST_HOLLOW: Final = 0.2
END_SHARE: Final = 0.15  # share of a bar's length at each end that is left out when its cross-section is measured
# m above the floor; a level bar below the first height is a runner, a level plate above the second is a seat
RUNNER_M, SEAT_M = 0.15, 0.30
SAMPLES: Final = 8  # number of frames from which the patient's place is found if no pose is given


@dataclass(frozen=True, slots=True, eq=False)
class ProposedPart:
    """A proposed part, the robust spread of its readings about its surface, the number of readings, and the names of
    guessed lengths (length, breadth, thickness), which no camera sees.
    """

    part: Box | Cylinder
    residual_m: float
    readings: int
    guessed: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentProposal:
    """The proposed parts, sorted by kind. explained_share: share of the readings on free-standing objects that lie
    within 15 mm of a part's surface.
    """

    parts: tuple[ProposedPart, ...]
    explained_share: float

    @property
    def model(self) -> EquipmentModel:
        """Return the parts as an equipment model."""
        return EquipmentModel(tuple(proposed.part for proposed in self.parts))


class NoEquipment(StrEnum):
    """The reason why no equipment is proposed."""

    NOTHING_STANDS = "nothing stands free on the floor near that place"
    NO_SHAPE = "what stands there consists of neither bars nor plates"


@dataclass(frozen=True, slots=True, eq=False)
class FittedRoom:
    """The fitted room: cameras with the poses used; rooms_m: one depth image of the empty room per camera; the proposed
    equipment; notes on how the poses were found.
    """

    cameras: tuple[Camera, ...]
    rooms_m: tuple[np.ndarray, ...]
    proposal: EquipmentProposal
    notes: tuple[str, ...]


def fit_equipment(recording: Recording, camera: str | None, region: Region) -> FittedRoom:
    """Fit the equipment that stands in ``region`` in the empty rooms of all cameras, or of the named camera only.

    If the poses are given, parts are in the world of these poses; a single camera without a pose is placed by the floor
    and by the place at which a person is first seen. Raises InputError if a depth image of the empty room, the floor or
    the equipment is missing.
    """
    chosen = _with_cameras(recording, camera)
    rooms = tuple(room for room in chosen.backgrounds_m if room is not None)
    if len(rooms) < len(chosen.cameras):
        missing = next(c.name for c, room in zip(chosen.cameras, chosen.backgrounds_m, strict=True) if room is None)
        path = recording.folder / missing / "background.png"
        raise InputError(path, "there is no such file", "record the empty room with the equipment, or choose --camera")
    count = len(chosen.streams[0].files)
    places = np.unique(np.linspace(0, count - 1, min(SAMPLES, count)).astype(int)).tolist()
    samples = [read_frame(chosen, place) for place in places]
    world = find_world(chosen, samples)
    if world.floor_height_m is None:
        path = recording.folder / chosen.cameras[0].name / "background.png"
        raise InputError(path, "shows no floor to stand on", "let the camera see some floor, then record it again")
    proposal = propose_equipment(world.cameras, rooms, world.floor_height_m, region)
    if isinstance(proposal, NoEquipment):
        x, z = region.center_xz_m
        where = f"{region.radius_m:g} m around x {x:g}, z {z:g}"
        raise InputError(recording.folder, f"{proposal.value} ({where})", "say where it is with --around and --radius")
    return FittedRoom(world.cameras, rooms, proposal, world.notes)


def _with_cameras(recording: Recording, name: str | None) -> Recording:
    """Return the recording with one camera, or with all, and without equipment, since the equipment is to be found."""
    names = [camera.name for camera in recording.cameras]
    if name is not None and name not in names:
        raise InputError(recording.folder, f"has no camera '{name}'", f"choose one of {', '.join(names)}")
    kept = [index for index, other in enumerate(names) if name in (None, other)]
    unknown = [names[index] for index in kept if recording.cameras[index].T_world_camera is None]
    if len(kept) > 1 and unknown:
        problem = f"the pose of {', '.join(unknown)} is unknown, so the cameras' depth images cannot be combined"
        raise InputError(recording.folder / "recording.json", problem, "choose one with --camera, or calibrate first")
    return replace(recording.of_cameras(kept), equipment=None)


def propose_equipment(
    cameras: Sequence[Camera], rooms_m: Sequence[np.ndarray], floor_height_m: float, region: Region
) -> EquipmentProposal | NoEquipment:
    """Propose boxes and tubes that fit the objects in the cylinder ``region`` of the empty room.

    cameras: with poses; rooms_m: one (height, width) float32 depth image of the empty room per camera. A side of a bar
    that no camera sees is placed so that the bar is square. The name of the length from this side to the opposite side
    is then listed in ``guessed``.
    """
    readings = gather_readings(cameras, rooms_m, floor_height_m, region)
    if readings.stands.sum() < LEAST_PIXELS:
        return NoEquipment.NOTHING_STANDS
    points = readings.points_m[readings.stands]
    found = find_parts(points)
    if not found:
        return NoEquipment.NO_SHAPE
    yaw = _common_yaw(found)
    fits = [_begin(part, readings, yaw) for part in found]
    fits = _fit_together(fits, readings, 1)
    fits = _fit_together(merged(fits, readings), readings, ROUNDS)
    fits = [on_its_feet(fit, readings, floor_height_m) for fit in fits if fit.readings >= LEAST_PIXELS]
    fits = [fit for fit in fits if fit.residual_m < WORST_RESIDUAL_M and hollow_share(fit, readings) < MOST_HOLLOW]
    if not fits:
        return NoEquipment.NO_SHAPE
    nearest = np.min([np.abs(fit.distance_m(points)) for fit in fits], axis=0)
    parts = tuple(
        ProposedPart(fit.part(name), fit.residual_m, fit.readings, guessed_lengths(fit, floor_height_m))
        for name, fit in _named(fits, floor_height_m)
    )
    return EquipmentProposal(parts, float((nearest < EXPLAINED_M).mean()))


def _common_yaw(found: Sequence[Found]) -> float:
    """Return the common angle of the level bars about the vertical, radians, within 45 degrees of 0; a very small angle
    is set to 0.

    Bars meet at right angles, so the angles are multiplied by four before they are averaged, which makes angles that
    differ by 90 degrees equal. Longer bars count more.
    """
    total = 0.0 + 0.0j
    for part in found:
        axis = part.rotation[:, 0] if part.plate else part.rotation[:, 2]
        if abs(axis[1]) < 0.2:
            total += len(part.members) * np.exp(4j * np.arctan2(-axis[2], axis[0]))
    yaw = float(np.angle(total)) / 4.0 if abs(total) > 0 else 0.0
    return 0.0 if abs(yaw) < np.radians(2.0) else yaw


def _begin(part: Found, readings: Readings, yaw: float) -> Fit:
    """Fit a part. The part's axes are set to the common directions (the vertical, and the level directions at the angle
    ``yaw``) if they are nearly parallel to them.

    The fit is run twice, started once from a larger and once from a smaller box around the part, and the better result
    counts. Readings of other parts may make the larger box too large; one of its faces then converges to the wrong side
    of the readings.
    """
    rotation = _snapped(part.rotation, yaw)
    rows = np.flatnonzero(readings.stands)[part.members]
    points = readings.points_m[rows]
    local = points @ rotation
    seen_from = ((readings.origin_m[rows] - points) @ rotation).mean(axis=0)
    inner = np.ones(len(local), dtype=bool)
    if not part.plate:  # the ends of a bar, where other bars join it, are left out
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
    """Return a rotation whose axes are the common directions: the vertical, and the level directions at the angle
    ``yaw``. Its last axis is the common direction that is nearest, apart from the sign, to the last axis of the given
    rotation. If these two axes differ by more than ``SNAP_RAD``, return the given rotation.
    """
    common = rotation_about_y(yaw)
    overlap = np.abs(common.T @ rotation)
    choice = int(np.argmax(overlap[:, 2]))
    if overlap[choice, 2] < np.cos(SNAP_RAD):
        return rotation
    axes = [common[:, choice - 2], common[:, choice - 1], common[:, choice]]  # cyclic order keeps the axes right-handed
    return np.stack(axes, axis=1)


def _is_snapped(fit: Fit) -> bool:
    return bool(np.isin(np.round(np.abs(fit.rotation[1]), 12), (0.0, 1.0)).all())


def _fit_together(fits: Sequence[Fit], readings: Readings, rounds: int) -> list[Fit]:
    """Assign readings to the nearest part and fit every part to its readings, repeatedly. Parts left with too few
    readings are dropped.
    """
    fits = list(fits)
    stands = np.flatnonzero(readings.stands)
    points = readings.points_m[stands]
    for number in range(rounds):
        distances = np.array([np.abs(fit.distance_m(points)) for fit in fits])
        beside = [np.delete(distances, k, axis=0).min(axis=0, initial=np.inf) > EXPLAINED_M for k in range(len(fits))]
        fits = [extended(fit, points, of_no_other) for fit, of_no_other in zip(fits, beside, strict=True)]
        owner = np.where(distances.min(axis=0) < REACH_M, distances.argmin(axis=0), -1)
        kept = []
        for index, fit in enumerate(fits):
            own = np.zeros(len(readings.depth_m), dtype=bool)
            own[stands[owner == index]] = True
            if own.sum() >= LEAST_PIXELS:
                kept.append(_settled(fit, readings, own, tubes=number == ROUNDS - 1))
        fits = kept
        if not fits:
            break
    return fits


def _settled(fit: Fit, readings: Readings, own: np.ndarray, tubes: bool) -> Fit:
    """Refit the part. If the part's axes lie along the common directions (the vertical, and the level directions of
    most bars), they stay there unless free axes fit clearly better; a part with other axes is refitted with free axes.
    """
    straight = refine(fit, readings, own, tubes=tubes)
    if _is_snapped(fit) and straight.residual_m < WELL_M:
        return straight
    turned = refine(straight, readings, own, turn=True, tubes=tubes)
    return straight if _is_snapped(fit) and straight.cost < SNAP_WORSE * turned.cost else turned


def _named(fits: Sequence[Fit], floor_height_m: float) -> list[tuple[str, Fit]]:
    """Name the parts post, strut, runner, rail (level, along X), bar (level, along Z), seat, plate; numbered from the
    patient's left to right.
    """
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
