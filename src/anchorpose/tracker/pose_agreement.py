"""Check whether two cameras show the same room and the same people: neither camera may see past a surface that the
other shows.

A surface may be hidden by objects in between, but only a wrong pose lets a camera see through it. The room reveals a
camera whose pose is too near, too far, too high or tilted. People also reveal a pose that is shifted along the common
surfaces, since their outlines are next to free space.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final

import cv2
import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.calibration.calibration import DoubtSource, PoseDoubt
from anchorpose.calibration.common_view import Displacement, LevelView, common_surfaces, find_displacement
from anchorpose.calibration.world import WORST_FLOOR_TILT_RAD
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.recording.recording import FrameSet, depths_of

# Shares of the commonly viewed surface that one camera sees past by more than AWAY_M: above the first it is noted,
# above the second refused
SOME_OF_ROOM, MUCH_OF_ROOM = 0.08, 0.30
SOME_OF_PEOPLE, MUCH_OF_PEOPLE = 0.15, 0.40
# share that is refused where cameras smear depth edges, so that no person's outline confirms it
ROOM_ALONE: Final = 0.6
AWAY_M: Final = 0.10  # m; smaller errors are tolerable: poses 3 cm and a degree off displace people by up to 0.12
LEAST_SHARED: Final = 500  # points that both cameras see; with fewer there is no share
POINTS: Final = 20000  # points of the room that are compared
POINTS_OF_PEOPLE: Final = 3000  # points of the people of one frame
FRAMES: Final = 8
OFF_M: Final = 0.015  # m between the common surfaces; correct poses have at most 0.009
REFUTED_M: Final = 0.15  # m between the common surfaces, as between two cameras that are each 10 cm off


@dataclass(frozen=True, slots=True)
class SeenPast:
    """Shares of the surfaces shown by one of two cameras that the other camera sees past; the larger share of both
    directions. They are NaN where the cameras share too little, and for people where a camera smears depth edges, so
    that outlines are unreliable.
    """

    cameras: tuple[str, str]
    of_room: float
    of_people: float

    @property
    def measured(self) -> str:
        """Return the known shares as a text for users; empty if none is known."""
        shares = (("room", self.of_room), ("people", self.of_people))
        known = [f"{100 * share:.0f} % of the {what}" for what, share in shares if np.isfinite(share)]
        return f"see past {' and '.join(known)}" if known else ""


@dataclass(frozen=True, slots=True)
class CameraPair:
    """The comparison of two cameras. by: displacement between the surfaces that both cameras see, None where these do
    not determine it.
    """

    past: SeenPast
    by: Displacement | None

    @property
    def measured(self) -> str:
        """Return all known measurements as a text for users; empty if none is known."""
        return ", ".join(part for part in (self.past.measured, self.apart) if part)

    @property
    def apart(self) -> str:
        """Return the displacement as a text for users; empty if it is unknown."""
        if self.by is None:
            return ""
        turn = "" if self.by.turn_rad is None else f" and {np.degrees(self.by.turn_rad):.1f} degrees"
        return f"have the people and the room {1000 * self.by.off_m:.0f} mm{turn} from each other"


def compare_cameras(
    scenes: Sequence[Scene], backgrounds_m: Sequence[np.ndarray | None], samples: Sequence[FrameSet]
) -> list[CameraPair]:
    """Compare every pair of cameras; ``samples`` are frames of all cameras, spread over the recording."""
    chosen = [samples[k] for k in thin(len(samples), FRAMES)]
    whole = [frame for frame in chosen if all(depth is not None for depth in frame.depths_m)]
    views = [_surfaces(k, scenes, backgrounds_m, whole) for k in range(len(scenes))] if whole else []
    past = seen_past(scenes, [find_all_pieces(frame, scenes) for frame in chosen])
    pairs = combinations(range(len(scenes)), 2)
    return [
        CameraPair(one, find_displacement(views[a], views[b]) if views else None)
        for one, (a, b) in zip(past, pairs, strict=True)
    ]


def _surfaces(
    index: int, scenes: Sequence[Scene], backgrounds_m: Sequence[np.ndarray | None], frames: Sequence[FrameSet]
) -> LevelView:
    scene = scenes[index]
    return common_surfaces(scene.camera, scene.background.depth_m, backgrounds_m[index], depths_of(frames, index))


def seen_past(scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]]) -> list[SeenPast]:
    """Return the shares seen past for all pairs of cameras. moments: each camera's people at some times, None without a
    frame.
    """
    return [_of_pair(one, other, scenes, moments) for one, other in combinations(range(len(scenes)), 2)]


def doubt_of(pair: CameraPair, clocks_known: bool) -> PoseDoubt | None:
    """Return the doubt that the comparison of two cameras raises about their poses, None without a doubt.

    The common surfaces decide where they determine the displacement, otherwise the shares seen past. Where the clocks
    are unknown, only the room counts, since people are elsewhere at another time.
    """
    past, names = pair.past, " and ".join(pair.past.cameras)
    if pair.by is not None:
        off_m, turn_rad = pair.by.off_m, pair.by.turn_rad or 0.0
        refuted = off_m > REFUTED_M or turn_rad > WORST_FLOOR_TILT_RAD
        if not (off_m > OFF_M or refuted):
            return None
        return PoseDoubt(DoubtSource.CAMERAS, past.cameras, f"cameras {names} {pair.apart}", off_m, refuted)
    if not (past.of_room > SOME_OF_ROOM or past.of_people > SOME_OF_PEOPLE):
        return None
    much_of_room = MUCH_OF_ROOM if np.isfinite(past.of_people) else ROOM_ALONE
    refuted = past.of_room > much_of_room or (clocks_known and past.of_people > MUCH_OF_PEOPLE)
    sentence = f"cameras {names} {past.measured}"  # a share does not measure a distance, so sigma stays unchanged
    return PoseDoubt(DoubtSource.CAMERAS, past.cameras, sentence, float("nan"), refuted)


def _of_pair(one: int, other: int, scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]]) -> SeenPast:
    rooms, people = list[float](), list[float]()
    outlined = not any(scenes[k].background.sensor.filtered for k in (one, other))
    for a, b in ((one, other), (other, one)):
        rooms.append(_share([_room_past(scenes[a], scenes[b])]))
        both = [(here, there) for moment in moments if (here := moment[a]) and (there := moment[b]) and outlined]
        people.append(_share([_people_past(here, there, scenes[a], scenes[b]) for here, there in both]))
    names = (scenes[one].camera.name, scenes[other].camera.name)
    return SeenPast(names, _largest(rooms), _largest(people))


def _largest(shares: Sequence[float]) -> float:
    return float(np.nanmax(shares)) if np.isfinite(shares).any() else float("nan")


def _share(counts: Sequence[tuple[int, int]]) -> float:
    """Return the share of the visible, unhidden points that is seen past; NaN where they are too few."""
    past, known = np.sum(counts, axis=0) if counts else (0, 0)
    return float(past / known) if known >= LEAST_SHARED else float("nan")


def _room_past(one: Scene, other: Scene) -> tuple[int, int]:
    points = one.camera.back_project(one.background.depth_m).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])].astype(np.float64)
    world = transform_points(one.camera.require_pose(), points[:: max(1, len(points) // POINTS)])
    return _past(world, other, other.background.depth_m)


def _people_past(here: Pieces, there: Pieces, one: Scene, other: Scene) -> tuple[int, int]:
    world = here.points_m[:: max(1, len(here.points_m) // POINTS_OF_PEOPLE)].astype(np.float64)
    return _past(world, other, there.depth_m)


def _past(world_m: np.ndarray, other: Scene, depth_m: np.ndarray) -> tuple[int, int]:
    """Return which of the points (n, 3) another camera sees past, and for which this is known, (n,) bool each, by its
    depth image (height, width) metres.

    It is known for points in view where the camera has a reading and nothing hides the point. The nearest reading
    within ``AWAY_M`` sideways is used.
    """
    seen = transform_points(invert_rigid(other.camera.require_pose()), world_m)
    column, row, inside = other.camera.pixel_of(seen)
    if not inside.any():
        return 0, 0
    read = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    reach_px = int(other.camera.intrinsics.fx * AWAY_M / np.median(seen[inside, 2]))
    nearest_m = cv2.erode(read, np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8))[row, column]
    known = inside & np.isfinite(nearest_m) & (nearest_m > seen[:, 2] - AWAY_M)
    return int(np.count_nonzero(nearest_m[known] > seen[known, 2] + AWAY_M)), int(np.count_nonzero(known))
