"""Clocks, calibration and room, from frames spread over the recording.

Which way the patient faces, where the world cannot say it yet: the body is fitted facing each way.

Of the frames in which tracking may begin, the one in which a body explains what is seen.

A therapist who holds the patient may be taken for a part of him; which frame shows him alone is told by fitting him.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.initial import find_first_pose, shape_of_height
from anchorpose.body.skin_points import body_points
from anchorpose.calibration.calibration import Calibration, PoseRecord, PoseSource
from anchorpose.calibration.clock.clocks import Clocks
from anchorpose.calibration.clock.settled import settle_clocks
from anchorpose.calibration.people.camera_to_camera import CameraToCameraConfig
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.isolation.people import choose_patient
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import observe_first
from anchorpose.tracker.room import (
    NOTHING_SAID,
    Opening,
    Review,
    Room,
    furnish_room,
    look_at,
    sample_recording,
    sight_people,
)
from anchorpose.tracker.start import ORDINARY_HEIGHT_M, NoStart, find_start, first_heights, known_shape
from anchorpose.tracker.stopwatch import Stopwatch

WELL: Final = 0.90  # of the patient's surface explained: alone he has 92 to 100 %, with a therapist's arm 70
WHOLE: Final = 0.8  # of the surface that is usually seen of him: a sliver behind a therapist is explained by anything
TRIES: Final = 6  # frames, a second or two of fitting each
APART: Final = 0.25  # of the frames' span: what spoils a frame spoils those around it


def with_best_opening(room: Room, config: TrackConfig) -> Room:
    """The room with the best of its openings first. One person alone cannot be mistaken, and is not fitted."""
    if config.patient_xz_m is not None or max((one.people for one in room.openings), default=0) < 2:
        return room

    def explained(opening: Opening) -> float:
        frame_set = next(iter(read_frames(room.recording, opening.frame, opening.frame + 1)))
        start = find_start(frame_set, room, opening.choice, None, config, Stopwatch())
        return 0.0 if isinstance(start, NoStart) else start.explained

    best = best_of(room.openings, explained)
    return replace(room, openings=(best, *(one for one in room.openings if one is not best)))


def best_of(openings: Sequence[Opening], explained: Callable[[Opening], float]) -> Opening:
    """The first that shows him whole and is explained well, or of ``TRIES`` the best; explained: share of his surface.

    After the best by score come those that are far from all that were tried.
    """
    left, tried = list(openings), list[tuple[float, Opening]]()
    while left and len(tried) < TRIES:
        opening = max(left, key=lambda one: _worth(one, [other for _, other in tried], openings))
        left.remove(opening)
        share = explained(opening)
        if share >= WELL and opening.whole >= WHOLE:
            return opening
        tried.append((share * opening.whole, opening))
    return max(tried, key=lambda one: one[0])[1]


def _worth(opening: Opening, tried: Sequence[Opening], openings: Sequence[Opening]) -> float:
    """Score, less near a frame that was tried."""
    if not tried:
        return opening.score
    span = APART * max(1, np.ptp([one.frame for one in openings]))
    gap = min(abs(opening.frame - other.frame) for other in tried)
    return opening.score * min(1.0, gap / span)


LOOKS: Final = 3  # frames, each 2 to 6 s of fitting
LEAST_RATIO: Final = 1.2  # of the next best heading's cost to the best one's: 1.3 to 3.8 where the patient is seen well


def heading_of_patient(
    room: Room, samples: Sequence[FrameSet], headings: Sequence[np.ndarray], config: TrackConfig
) -> int | None:
    """Index of the level unit vector (3,) that he faces; None unless every frame looked at says the same, clearly.

    room: with an opening that indexes ``samples``. Several frames, for in a single one somebody else may be taken for
    a part of him.
    """
    if room.opening is None:
        return None
    looks = sorted({room.opening.frame, *np.linspace(0, len(samples) - 1, LOOKS + 1).astype(int)[1:-1].tolist()})
    costs = [cost for look in looks if (cost := _costs(room, samples, look, headings, config)) is not None]
    if not costs:
        return None
    ratios = np.array(costs)
    best = int(np.log(ratios).sum(axis=0).argmin())
    others = np.delete(ratios, best, axis=1).min(axis=1) / ratios[:, best]
    sure = (others > 1.0).all() and float(np.exp(np.log(others).mean())) > LEAST_RATIO
    return best if sure else None


def _costs(
    room: Room, samples: Sequence[FrameSet], look: int, headings: Sequence[np.ndarray], config: TrackConfig
) -> list[float] | None:
    """Cost of the best body facing each way in one frame; None where too little of him is seen."""
    sightings = [sight_people(samples[look], room.scenes, config)]
    sightings += [sight_people(frame, room.scenes, config) for frame in (samples[0], samples[-1])]
    place = look_at(room.cameras[0])
    choice = choose_patient(sightings, room.recording.equipment, config.patient_xz_m, place, config.isolation)
    if choice is None or not choice.sure:
        return None
    height_m = room.recording.subject_height_m or ORDINARY_HEIGHT_M
    seen = observe_first(samples[look], room, choice, height_m, config, Stopwatch())
    if len(seen.surface) < config.registration.least_nodes:
        return None
    points = body_points()
    shapes = [shape_of_height(points.asset, height) for height in first_heights(seen.surface, room)]
    return [  # their anchors are named by a heading, so they are left out
        find_first_pose(
            points, seen.evidence, no_anchors(), shapes, known_shape(room.recording, config), False,
            config.registration.constraints, config.registration.fit, (float(np.arctan2(-heading[2], heading[0])),),
        ).cost
        for heading in headings
    ]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A recording on one clock and in one world, with the frames (positions ``chosen``) that told them."""

    recording: Recording
    clocks: Clocks
    calibration: Calibration
    chosen: tuple[int, ...]
    samples: tuple[FrameSet, ...]


def prepare_room(recording: Recording, config: TrackConfig, review: Review = NOTHING_SAID) -> Room:
    """Everything that is known before the first frame is followed."""
    settled = settle(recording, config)
    room = furnish_room(
        settled.recording, settled.clocks, settled.calibration, settled.chosen, settled.samples, config, review
    )
    return with_best_opening(room, config)


def settle(recording: Recording, config: TrackConfig) -> Settled:
    """Time and place of all cameras; clocks come out sharper with poses, poses found from people sharper with clocks.

    Raises InputError where a pose cannot be found.
    """
    unplaced = len(recording.cameras) > 1 and any(camera.T_world_camera is None for camera in recording.cameras)
    by_people = unplaced and recording.equipment is None
    settled = _settled(
        recording, recording.cameras, config, config.placing.first_look() if by_people else config.placing
    )
    if not unplaced:
        return settled
    if by_people:
        return _settled(recording, settled.calibration.cameras, config, config.placing)
    timed, clocks = settle_clocks(recording, settled.calibration.cameras, config.floor, config.clocks)
    chosen, samples = sample_recording(timed, config)
    return Settled(timed, clocks, settled.calibration, tuple(chosen), tuple(samples))


def _settled(
    recording: Recording, cameras: Sequence[Camera], config: TrackConfig, placing: CameraToCameraConfig
) -> Settled:
    """Clocks by what is known of the cameras' poses, then the poses that are not given."""
    timed, clocks = settle_clocks(recording, cameras, config.floor, config.clocks)
    chosen, samples = sample_recording(timed, config)
    calibration = calibrate(timed, samples, config, placing)
    return Settled(timed, clocks, calibration, tuple(chosen), tuple(samples))


def calibrate(
    recording: Recording, samples: Sequence[FrameSet], config: TrackConfig, placing: CameraToCameraConfig
) -> Calibration:
    """The poses of all cameras, given or found; the body model breaks the tie of equipment that is symmetric."""

    def tell_facing(cameras: tuple[Camera, ...], floor_m: float, headings: Sequence[np.ndarray]) -> int | None:
        records = tuple(PoseRecord(camera.name, PoseSource.EQUIPMENT) for camera in cameras)
        posed = replace(recording, cameras=cameras)
        provisional = Calibration(cameras, floor_m, (), (), records)
        timeless = Clocks((), None, 0)  # frames are paired already
        room = furnish_room(posed, timeless, provisional, range(len(samples)), samples, config, NOTHING_SAID)
        return heading_of_patient(room, samples, headings, config)

    return find_world(recording, samples, config.floor, config.equipment_pose, tell_facing, placing)
