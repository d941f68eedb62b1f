"""Whether two cameras show one room and the same people: what one shows, the other must not see past.

What stands in between hides a surface; nothing lets a camera see through it but a wrong pose. The room shows a camera
that stands too near, too far, too high or tilted; people also one that slid along the surfaces that both see, for their
outlines are next to free space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import cv2
import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.check.finding import Finding, OfCamera, level_of, of_cameras
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.recording.recording import FrameSet

# Set on twelve simulated clinics (benchmarks/camera_agreement.py): with right poses at most 0.05 of the room and 0.13
# of the people are seen past; of the people 0.30 to 0.75 where a camera is 5 cm to the side
SOME_OF_ROOM, MUCH_OF_ROOM = 0.08, 0.30
SOME_OF_PEOPLE, MUCH_OF_PEOPLE = 0.15, 0.40
ROOM_M, PEOPLE_M = 0.05, 0.04  # along the ray: edges, and people who move while cameras take turns
SIGMAS: Final = 2.0  # of both cameras' depth on people, where that is more; empty rooms are means of frames
LEAST_SHARED: Final = 500  # points that both cameras see
POINTS: Final = 20000  # of the room
POINTS_OF_PEOPLE: Final = 3000  # of one frame
FRAMES: Final = 8


@dataclass(frozen=True, slots=True)
class SeenPast:
    """Shares of what one of two cameras shows and the other sees past, the larger of both ways; NaN where they share
    too little, and for people where a camera draws edges out, so that nobody has an outline."""

    cameras: tuple[str, str]
    of_room: float
    of_people: float


def check_agreement(scenes: Sequence[Scene], samples: Sequence[FrameSet]) -> list[Finding]:
    """One finding over all pairs of cameras; none where no pair shares enough. samples: frames of all cameras."""
    if len(scenes) < 2:
        return []
    moments = [find_all_pieces(samples[k], scenes) for k in thin(len(samples), FRAMES)]
    parts = [part for pair in seen_past(scenes, moments) if (part := agreement_of(pair)) is not None]
    return [of_cameras("cameras agree", parts)] if parts else []


def seen_past(scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]]) -> list[SeenPast]:
    """Of all pairs of cameras; moments: each camera's people at some times, None without a frame."""
    return [_of_pair(one, other, scenes, moments) for one, other in combinations(range(len(scenes)), 2)]


def agreement_of(pair: SeenPast) -> OfCamera | None:
    """What two cameras' shares mean; None where nothing is known."""
    shares = (("room", pair.of_room), ("people", pair.of_people))
    known = [f"{100 * share:.0f} % of the {what}" for what, share in shares if np.isfinite(share)]
    if not known:
        return None
    room = level_of(pair.of_room, SOME_OF_ROOM, MUCH_OF_ROOM)
    people = level_of(pair.of_people, SOME_OF_PEOPLE, MUCH_OF_PEOPLE)
    remedy = "a camera was moved: run 'anchorpose calibrate' with --ignore-given, and look at its pictures"
    return OfCamera(" and ".join(pair.cameras), max(room, people), f"see past {' and '.join(known)}", remedy)


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
    seen = transform_points(invert_rigid(other.camera.require_pose()), world_m)
    column, row, inside = other.camera.pixel_of(seen)
    read = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    nearest_m = cv2.erode(read, np.ones((3, 3), np.uint8))[row, column]
    slack = np.maximum(slack_m, SIGMAS * spread_per_m * seen[:, 2] ** 2)
    known = inside & np.isfinite(nearest_m) & (nearest_m > seen[:, 2] - slack)
    return int(np.count_nonzero(nearest_m[known] > (seen[:, 2] + slack)[known])), int(np.count_nonzero(known))
