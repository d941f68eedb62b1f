"""Check whether two cameras show the same room and the same people: neither camera may see past a surface that the
other camera shows. A camera sees past a surface if it reads something farther away there.

Objects may hide a surface from a camera, but a camera reads something behind a surface only if a camera pose is wrong.
The room's surfaces reveal a camera pose that is too near to them, too far from them, too high or tilted. A pose that is
shifted along the room's surfaces is revealed only by people, since the cameras see free space beside people.
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
from anchorpose.calibration.common_view import LevelView
from anchorpose.calibration.displacement import Displacement, common_surfaces, find_displacement
from anchorpose.calibration.world import WORST_FLOOR_TILT_RAD
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.isolation.scene import Pieces, Scene, find_all_pieces
from anchorpose.recording.recording import FrameSet, depths_of

# two limits of the share of the room's common surface that a camera sees past (it reads something more than AWAY_M
# farther away). If a camera sees past a share of the room above the first limit, a note is made; above the second
# limit, the recording is refused
SOME_OF_ROOM, MUCH_OF_ROOM = 0.08, 0.30
# two limits of the share of the people's surface that a camera sees past; a share above the first limit causes a note,
# a share above the second limit a refusal of the recording
SOME_OF_PEOPLE, MUCH_OF_PEOPLE = 0.15, 0.40
# limit of the share of the room that a camera may see past, used if the share of the people's surface is unknown, for
# example because a camera blurs depth edges. If a camera sees past more than this share of the room, the recording is
# refused. The limit is higher than MUCH_OF_ROOM, since the people's surface cannot confirm that a camera pose is wrong
ROOM_ALONE: Final = 0.6
# m; a camera sees past a surface that another camera shows if its reading is more than this behind the surface. For
# scale: a pose that is wrong by 3 cm and 1 degree displaces people by 0.12 m
AWAY_M: Final = 0.10
LEAST_SHARED: Final = 500  # minimum number of points that both cameras see; with fewer, shares are unknown
POINTS: Final = 20000  # number of points of one camera's room that are compared
POINTS_OF_PEOPLE: Final = 3000  # number of points on the people in one camera's frame that are compared
FRAMES: Final = 8  # maximum number of frames in which people are compared
# m; camera poses are doubted if the surfaces seen by both cameras are farther apart than this. With correct camera
# poses, the surfaces that both cameras see are at most 0.009 m apart
OFF_M: Final = 0.015
# m; the recording is refused if the surfaces seen by both cameras are farther apart than this: each of the two poses is
# then wrong by about 10 cm
REFUTED_M: Final = 0.15


@dataclass(frozen=True, slots=True)
class SeenPast:
    """The shares of one camera's surfaces that another camera sees past (the other camera reads something farther away
    there).

    Each camera's surfaces are compared with the readings of the other camera; the larger of the two shares counts. A
    share is NaN if both cameras see too little of the same surface.
    """

    cameras: tuple[str, str]
    of_room: float  # 0 to 1, share of one camera's room that the other camera sees past
    # 0 to 1, share of the people's surface that the other camera sees past; also NaN if a camera blurs depth edges,
    # since it then blurs the outlines of people
    of_people: float

    @property
    def measured(self) -> str:
        """Return the known shares as a text for users; empty if none is known."""
        shares = (("room", self.of_room), ("people", self.of_people))
        known = [f"{100 * share:.0f} % of the {what}" for what, share in shares if np.isfinite(share)]
        return f"see past {' and '.join(known)}" if known else ""


@dataclass(frozen=True, slots=True)
class CameraPair:
    """The results of comparing two cameras."""

    past: SeenPast
    by: Displacement | None  # displacement between the surfaces that both cameras see; None if it is undetermined

    @property
    def measured(self) -> str:
        """Return all known measurements as a text for users; empty if none is known."""
        return ", ".join(part for part in (self.past.measured, self.apart) if part)

    @property
    def apart(self) -> str:
        """Return the displacement between both cameras' surfaces as a text for users; empty if it is unknown."""
        if self.by is None:
            return ""
        turn = "" if self.by.turn_rad is None else f" and {np.degrees(self.by.turn_rad):.1f} degrees"
        return f"have the people and the room {1000 * self.by.off_m:.0f} mm{turn} from each other"


def compare_cameras(
    scenes: Sequence[Scene],
    backgrounds_m: Sequence[np.ndarray | None],
    samples: Sequence[FrameSet],
    clocks_known: bool = True,
) -> list[CameraPair]:
    """Compare every pair of cameras; ``samples`` are frames of all cameras, spread over the recording; clocks_known:
    whether the depth images of all cameras in a sample were taken at the same time.
    """
    chosen = [samples[k] for k in thin(len(samples), FRAMES)]
    whole = [frame for frame in chosen if all(depth is not None for depth in frame.depths_m)]
    views = [_surfaces(k, scenes, backgrounds_m, whole) for k in range(len(scenes))] if whole else []
    past = seen_past(scenes, [find_all_pieces(frame, scenes) for frame in chosen], clocks_known)
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


def seen_past(
    scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]], clocks_known: bool = True
) -> list[SeenPast]:
    """Return, for each pair of cameras, the shares of surfaces that one of them sees past (reads something farther
    away). moments: for each moment, the pixels of people in each camera; None for a camera without a frame.

    clocks_known: whether both cameras' frames of a moment were taken at the same time. If not, a point on a person
    counts as seen past only if the other camera sees past it at all moments, since the other camera's frame may have
    been taken before or after the person was at this point.
    """
    pairs = combinations(range(len(scenes)), 2)
    return [_of_pair(one, other, scenes, moments, clocks_known) for one, other in pairs]


def doubt_of(pair: CameraPair) -> PoseDoubt | None:
    """Return the doubt that the comparison of two cameras raises about their poses; None without a doubt.

    If the common surfaces determine a displacement, the displacement decides; otherwise the shares of surface seen past
    (``SeenPast``) decide.
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
    refuted = past.of_room > much_of_room or past.of_people > MUCH_OF_PEOPLE
    # a share of surface seen past does not state a distance, so off_m is NaN and sigma is not increased
    sentence = f"cameras {names} {past.measured}"
    return PoseDoubt(DoubtSource.CAMERAS, past.cameras, sentence, float("nan"), refuted)


def _of_pair(
    one: int, other: int, scenes: Sequence[Scene], moments: Sequence[Sequence[Pieces | None]], clocks_known: bool
) -> SeenPast:
    rooms, people = list[float](), list[float]()
    outlined = not any(scenes[k].background.sensor.filtered for k in (one, other))
    for a, b in ((one, other), (other, one)):
        rooms.append(_share([_room_past(scenes[a], scenes[b])]))
        both = [(here, there) for moment in moments if (here := moment[a]) and (there := moment[b]) and outlined]
        anytime = [there.depth_m for _, there in both]
        shown = [(here, [there.depth_m] if clocks_known else anytime) for here, there in both]
        people.append(_share([_people_past(here, depths_m, scenes[a], scenes[b]) for here, depths_m in shown]))
    names = (scenes[one].camera.name, scenes[other].camera.name)
    return SeenPast(names, _largest(rooms), _largest(people))


def _largest(shares: Sequence[float]) -> float:
    return float(np.nanmax(shares)) if np.isfinite(shares).any() else float("nan")


def _share(counts: Sequence[tuple[int, int]]) -> float:
    """Return the share of points that a camera sees past; NaN if too few points can be compared. counts: results of
    ``_past``.
    """
    past, known = np.sum(counts, axis=0) if counts else (0, 0)
    return float(past / known) if known >= LEAST_SHARED else float("nan")


def _room_past(one: Scene, other: Scene) -> tuple[int, int]:
    points = one.camera.back_project(one.background.depth_m).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])].astype(np.float64)
    world = transform_points(one.camera.require_pose(), points[:: max(1, len(points) // POINTS)])
    return _past(world, other, [other.background.depth_m])


def _people_past(here: Pieces, depths_m: Sequence[np.ndarray], one: Scene, other: Scene) -> tuple[int, int]:
    world = here.points_m[:: max(1, len(here.points_m) // POINTS_OF_PEOPLE)].astype(np.float64)
    return _past(world, other, depths_m)


def _past(world_m: np.ndarray, other: Scene, depths_m: Sequence[np.ndarray]) -> tuple[int, int]:
    """Return how many of the points (n, 3) another camera sees past (reads something farther away), and how many of the
    points can be compared with its depth images (height, width). A point counts as seen past only if none of these
    images has a reading in front of the point or up to ``AWAY_M`` behind it.

    A point in view can be compared with an image if the camera has a reading there and nothing hides the point. Each
    point is compared with the smallest reading among the pixels within ``AWAY_M`` of the point.
    """
    seen = transform_points(invert_rigid(other.camera.require_pose()), world_m)
    column, row, inside = other.camera.pixel_of(seen)
    if not inside.any():
        return 0, 0
    reach_px = int(other.camera.intrinsics.fx * AWAY_M / np.median(seen[inside, 2]))
    around = np.ones((2 * reach_px + 1, 2 * reach_px + 1), np.uint8)
    nearest_m = np.stack(
        [cv2.erode(np.where(depth > 0, depth, np.float32(np.inf)), around)[row, column] for depth in depths_m]
    )
    known = inside & (np.isfinite(nearest_m) & (nearest_m > seen[:, 2] - AWAY_M)).any(axis=0)
    past = known & (nearest_m > seen[:, 2] + AWAY_M).all(axis=0)
    return int(np.count_nonzero(past)), int(np.count_nonzero(known))
