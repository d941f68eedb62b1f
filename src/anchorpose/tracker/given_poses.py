"""Check the camera poses that a recording states: each against its empty room, every two against each other.

What stands in between hides a surface; nothing lets a camera see through it but a wrong pose. The room shows a camera
that stands too near, too far, too high or tilted; people also one that slid along the surfaces that both see, for their
outlines are next to free space.

What contradicts a pose by far more than noise refuses the recording; less is noted, and widens every sigma. One camera
can be asked for its floor and its equipment only: where it sees neither, a wrong pose moves all joints alike and does
not show.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Final

import cv2
import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.calibration.calibration import Calibration, DoubtSource, PoseDoubt, PoseSource
from anchorpose.calibration.camera_to_camera import is_credible
from anchorpose.calibration.clocks import Clocks, NoClock
from anchorpose.calibration.common_view import LevelView, fit_people, level_view
from anchorpose.calibration.floor import FloorPlane, up_of
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.other_place import without_other_places
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.recording.recording import FrameSet, Recording

# Set on twelve simulated clinics (benchmarks/camera_agreement.py): with right poses at most 0.05 of the room and 0.13
# of the people are seen past; of the people 0.30 to 0.75 where a camera is 5 cm to the side
SOME_OF_ROOM, MUCH_OF_ROOM = 0.08, 0.30
SOME_OF_PEOPLE, MUCH_OF_PEOPLE = 0.15, 0.40
ROOM_ALONE: Final = 0.6  # where nobody's outline confirms it: cameras that draw edges out had 0.19 with right poses
ROOM_M, PEOPLE_M = 0.05, 0.04  # along the ray: edges, and people who move while cameras take turns
SIGMAS: Final = 2.0  # of both cameras' depth on people, where that is more; empty rooms are means of frames
LEAST_SHARED: Final = 500  # points that both cameras see
POINTS: Final = 20000  # of the room
POINTS_OF_PEOPLE: Final = 3000  # of one frame
FRAMES: Final = 8
EVERY_PX: Final = 3  # pixel of every third row, for surfaces in common view
OFF_M: Final = 0.010  # right poses have at most 0.004, a device's steady error of depth is as much
REFUTED_M: Final = 0.05  # a good calibration is within 0.02; more than a forearm's width, limbs do not meet


@dataclass(frozen=True, slots=True)
class SeenPast:
    """Shares of what one of two cameras shows and the other sees past, the larger of both ways; NaN where they share
    too little, and for people where a camera draws edges out, so that nobody has an outline."""

    cameras: tuple[str, str]
    of_room: float
    of_people: float

    @property
    def measured(self) -> str:
        """The shares that are known, for people; empty where none is."""
        shares = (("room", self.of_room), ("people", self.of_people))
        known = [f"{100 * share:.0f} % of the {what}" for what, share in shares if np.isfinite(share)]
        return f"see past {' and '.join(known)}" if known else ""


@dataclass(frozen=True, slots=True)
class CameraPair:
    """off_m: by the surfaces of the people in common view, how far the cameras have them apart; None where not known
    accurately."""

    past: SeenPast
    off_m: float | None

    @property
    def measured(self) -> str:
        """All that is known, for people; empty where nothing is."""
        apart = [] if self.off_m is None else [f"have people {1000 * self.off_m:.0f} mm apart"]
        return ", ".join([*([self.past.measured] if self.past.measured else []), *apart])


def compare_cameras(
    scenes: Sequence[Scene], backgrounds_m: Sequence[np.ndarray | None], samples: Sequence[FrameSet]
) -> list[CameraPair]:
    """Every pair of cameras; samples: frames of all cameras, spread over the recording."""
    chosen = [samples[k] for k in thin(len(samples), FRAMES)]
    whole = [frame for frame in chosen if all(depth is not None for depth in frame.depths_m)]
    views = [_level_view(k, scenes, backgrounds_m, whole) for k in range(len(scenes))] if whole else []
    past = seen_past(scenes, [find_all_pieces(frame, scenes) for frame in chosen])
    pairs = combinations(range(len(scenes)), 2)
    return [
        CameraPair(one, _off_m(views[a], views[b]) if views else None) for one, (a, b) in zip(past, pairs, strict=True)
    ]


def _off_m(first: LevelView, second: LevelView) -> float | None:
    """How far two cameras have the people whom both see from each other; None where that is not known accurately."""
    T_first_second = invert_rigid(first.camera.require_pose()) @ second.camera.require_pose()
    fit = fit_people(first, second, T_first_second)
    if fit is None or not is_credible(fit):
        return None
    people = np.concatenate([seen.points_m[seen.person] for seen in second.seen]).mean(axis=0, keepdims=True)
    moved = transform_points(fit.T_first_second, people) - transform_points(T_first_second, people)
    return float(np.linalg.norm(moved))


def _level_view(
    index: int, scenes: Sequence[Scene], backgrounds_m: Sequence[np.ndarray | None], frames: Sequence[FrameSet]
) -> LevelView:
    camera, depths = scenes[index].camera, [depth for frame in frames if (depth := frame.depths_m[index]) is not None]
    level = FloorPlane(up_of(camera), float(camera.position_m[1]), 0.0, 0.0)  # a frame that stands on Y = 0
    return level_view(camera, level, backgrounds_m[index], depths, EVERY_PX)


def seen_past(scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]]) -> list[SeenPast]:
    """Of all pairs of cameras; moments: each camera's people at some times, None without a frame."""
    return [_of_pair(one, other, scenes, moments) for one, other in combinations(range(len(scenes)), 2)]


def doubt_of(pair: CameraPair, clocks_known: bool) -> PoseDoubt | None:
    """What a pair of cameras says against their poses.

    The people's surfaces decide where both cameras see enough of them; else what is seen past, and of that the room
    where their clocks are not known: people are elsewhere at another time.
    """
    past, names = pair.past, " and ".join(pair.past.cameras)
    if pair.off_m is not None:
        sentence = f"cameras {names} have the people whom both see {1000 * pair.off_m:.0f} mm from each other"
        refuted = pair.off_m > REFUTED_M
        return (
            PoseDoubt(DoubtSource.CAMERAS, past.cameras, sentence, pair.off_m, refuted) if pair.off_m > OFF_M else None
        )
    if not (past.of_room > SOME_OF_ROOM or past.of_people > SOME_OF_PEOPLE):
        return None
    much_of_room = MUCH_OF_ROOM if np.isfinite(past.of_people) else ROOM_ALONE
    refuted = past.of_room > much_of_room or (clocks_known and past.of_people > MUCH_OF_PEOPLE)
    sentence = f"cameras {names} {past.measured}"  # a share measures no distance, so sigma stays as it is
    return PoseDoubt(DoubtSource.CAMERAS, past.cameras, sentence, float("nan"), refuted)


def _of_pair(one: int, other: int, scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]]) -> SeenPast:
    rooms, people = list[float](), list[float]()
    outlined = not any(scenes[k].background.detail.filtered for k in (one, other))
    for a, b in ((one, other), (other, one)):
        rooms.append(_share([_room_past(scenes[a], scenes[b])]))
        both = [(here, there) for moment in moments if (here := moment[a]) and (there := moment[b]) and outlined]
        people.append(_share([_people_past(here, there, scenes[a], scenes[b]) for here, there in both]))
    names = (scenes[one].camera.name, scenes[other].camera.name)
    return SeenPast(names, _largest(rooms), _largest(people))


def _largest(shares: Sequence[float]) -> float:
    return float(np.nanmax(shares)) if np.isfinite(shares).any() else float("nan")


def _share(counts: Sequence[tuple[int, int]]) -> float:
    """Seen past, of the points that are in view and not hidden; NaN where they are too few."""
    past, known = np.sum(counts, axis=0) if counts else (0, 0)
    return float(past / known) if known >= LEAST_SHARED else float("nan")


def _room_past(one: Scene, other: Scene) -> tuple[int, int]:
    points = one.camera.back_project(one.background.depth_m).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])].astype(np.float64)
    world = transform_points(one.camera.require_pose(), points[:: max(1, len(points) // POINTS)])
    return _past(world, other, other.background.depth_m, ROOM_M)


def _people_past(here: Pieces, there: Pieces, one: Scene, other: Scene) -> tuple[int, int]:
    world = here.points_m[:: max(1, len(here.points_m) // POINTS_OF_PEOPLE)].astype(np.float64)
    return _past(world, other, there.depth_m, PEOPLE_M, _spread(one, other))


def _spread(one: Scene, other: Scene) -> float:
    """Standard deviation (1/m) of the difference between readings of two cameras, times the square of the depth."""
    return float(np.hypot(_room_sigma_per_m(one.background), _room_sigma_per_m(other.background)))


def _room_sigma_per_m(room: BackgroundModel) -> float:
    """Of the room's readings over time: matching errors of stereo cameras are the same in neighbouring pixels."""
    known = room.depth_m > 0
    return float(np.median(room.sigma_m[known] / room.depth_m[known] ** 2)) if known.any() else room.noise_per_m


def _past(
    world_m: np.ndarray, other: Scene, depth_m: np.ndarray, slack_m: float, spread_per_m: float = 0.0
) -> tuple[int, int]:
    """(seen past, known) of the points (n, 3) in another camera's depth image (height, width) metres.

    Known are those in view where it has a reading and nothing stands before them; the nearest of nine pixels counts.
    """
    known_m = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    own, nearest_m, inside = other.camera.look(world_m, cv2.erode(known_m, np.ones((3, 3), np.uint8)))
    slack = np.maximum(slack_m, SIGMAS * spread_per_m * own**2)
    known = inside & np.isfinite(nearest_m) & (nearest_m > own - slack)
    return int(np.count_nonzero(nearest_m[known] > (own + slack)[known])), int(np.count_nonzero(known))


AMONG_OTHERS: Final = 0.5  # of its error: a camera that is off moves what others see as well by a part of it
REMEDY: Final = (
    "find the poses with 'anchorpose calibrate RECORDING --ignore-given' and track with --calibration, or correct "
    "camera_to_world"
)
TURN: Final = "turn its images by 180 degrees, or give camera_to_world as the camera stands, null where that is unknown"
MOVED: Final = "the cameras agree with each other, so it stands elsewhere than equipment.json has it"


@dataclass(frozen=True, slots=True)
class PosesAsked:
    """pairs: what every two cameras show of each other, none where no pose is given; doubts: all that contradicts."""

    pairs: tuple[CameraPair, ...]
    doubts: tuple[PoseDoubt, ...]


def agreeing_poses(
    recording: Recording,
    calibration: Calibration,
    clocks: Clocks,
    scenes: Sequence[Scene],
    samples: Sequence[FrameSet],
) -> Calibration:
    """The calibration with what little speaks against it; raises InputError where it cannot be right."""
    asked = ask_poses(recording, calibration, clocks, scenes, samples)
    _refuse_contradicted(recording, asked, scenes)
    notes = (*calibration.notes, *(f"{doubt.sentence}; the given pose is used" for doubt in asked.doubts))
    off_m = max((doubt.off_m for doubt in asked.doubts if np.isfinite(doubt.off_m)), default=0.0)
    displaced_m = float(off_m) * (1.0 if len(scenes) == 1 else AMONG_OTHERS)
    return replace(calibration, notes=notes, doubts=asked.doubts, displaced_m=displaced_m)


def ask_poses(
    recording: Recording,
    calibration: Calibration,
    clocks: Clocks,
    scenes: Sequence[Scene],
    samples: Sequence[FrameSet],
) -> PosesAsked:
    """The doubts of calibration and those that the cameras raise about each other.

    scenes: one per camera, with the poses that are used; samples: frames of all cameras, on one clock. Poses that were
    found are judged where they are found.
    """
    found = calibration.doubts
    if len(scenes) < 2 or not any(pose.source is PoseSource.GIVEN for pose in calibration.poses):
        return PosesAsked((), found)
    usual = [without_other_places(sample, scenes) for sample in samples]
    pairs = compare_cameras(scenes, recording.backgrounds_m, usual)
    known = all(camera.doubt in (None, NoClock.SWITCHED_OFF, NoClock.NO_MOTION) for camera in clocks.cameras)
    between = [doubt for pair in pairs if (doubt := doubt_of(pair, known)) is not None]
    agree = not between and all(pair.measured for pair in pairs)
    return PosesAsked(tuple(pairs), (*(_excused(doubt) if agree else doubt for doubt in found), *between))


def _excused(doubt: PoseDoubt) -> PoseDoubt:
    """A doubt by the equipment where all cameras agree with each other: then it was moved, not they."""
    if doubt.source is not DoubtSource.EQUIPMENT:
        return doubt
    return replace(doubt, sentence=f"{doubt.sentence}; {MOVED}", off_m=float("nan"), refuted=False)


def _refuse_contradicted(recording: Recording, asked: PosesAsked, scenes: Sequence[Scene]) -> None:
    """Raises InputError where poses are contradicted by far more than noise: by what, by how much, and what to do."""
    refuted = [doubt for doubt in asked.doubts if doubt.refuted]
    if not refuted:
        return
    exchanged = exchanged_cameras(scenes)
    if exchanged:
        one, other = exchanged
        problem = f"cameras {one} and {other} seem to be exchanged: with each other's poses they show one room"
        raise InputError(
            recording.folder / "recording.json", problem, "exchange their folders, or their entries camera_to_world"
        )
    named = Counter(camera for doubt in refuted for camera in doubt.cameras)
    most = named.most_common(1)[0][0]
    worst = next(doubt for doubt in refuted if most in doubt.cameras)
    raise InputError(recording.folder / "recording.json", worst.sentence, remedy_of(worst))


def remedy_of(doubt: PoseDoubt) -> str:
    """What the user can do about it."""
    return TURN if doubt.source is DoubtSource.UPSIDE_DOWN else REMEDY


def exchanged_cameras(scenes: Sequence[Scene]) -> tuple[str, str] | None:
    """Two cameras whose rooms fit all others' once their poses and lenses are exchanged; None without such."""
    for a, b in combinations(range(len(scenes)), 2):
        first, second = scenes[a].camera, scenes[b].camera
        if (first.width, first.height) != (second.width, second.height):
            continue
        swapped = list(scenes)
        swapped[a] = replace(scenes[a], camera=replace(second, name=first.name))
        swapped[b] = replace(scenes[b], camera=replace(first, name=second.name))
        shares = np.array([pair.of_room for pair in seen_past(swapped, ())])
        if np.isfinite(shares).any() and np.nanmax(shares) <= SOME_OF_ROOM:
            return first.name, second.name
    return None
