"""Which way the patient faces, where the world cannot say it yet: the body is fitted facing each way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.body.initial import find_first_pose, shape_of_height
from anchorpose.body.skin_points import body_points
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.isolation.people import choose_patient
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import observe_first
from anchorpose.tracker.opening import look_at
from anchorpose.tracker.room import Room, sight_people
from anchorpose.tracker.start import ORDINARY_HEIGHT_M, first_heights, known_shape
from anchorpose.tracker.stopwatch import Stopwatch

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
