"""Where tracking begins: the sampled frames that show the patient, and the first of them that a body explains.

A therapist who holds the patient may be mistaken for a part of the patient; fitting a body shows in which frame the
patient is alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration
from anchorpose.camera import Camera
from anchorpose.isolation.people import PatientChoice, People, choose_patient
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import InitialFrame, Room
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import NoStart, find_start

THERE_M: Final = 0.5  # from the given place: beyond it another person is seen, and the patient has not come yet
CROWDED_M: Final = 1.0  # from axis to axis: an outstretched arm and half a trunk
MERGED: Final = 0.5  # weight of a frame with fewer people than usual: two who stand close may be taken for one
WELL: Final = 0.90  # of the patient's surface explained: 92 to 100 % when alone, 70 with a therapist's arm
WHOLE: Final = 0.8  # of the patient's usual visible surface: a sliver behind a therapist is explained by anything
TRIES: Final = 6  # frames; each takes a second or two to fit
APART: Final = 0.25  # of the frames' span: what spoils a frame spoils those around it


def rank_initial_frames(
    frames: Sequence[int],
    sightings: Sequence[People],
    calibration: Calibration,
    recording: Recording,
    config: TrackConfig,
) -> tuple[InitialFrame, ...]:
    """The frames that show the patient: first those that show the patient well and nobody nearby.

    If the user gave the patient's place, those with a person at that place; of equals the earlier comes first, since
    the place is given for the start. frames: positions in the recording; sightings: the people of each.
    """
    place = look_at(calibration.cameras[0])
    found, seen = [], []
    for number, frame in enumerate(frames):
        others = [*sightings[:number], *sightings[number + 1 :]]
        choice = choose_patient(
            [sightings[number], *others], recording.equipment, config.patient_xz_m, place, config.isolation
        )
        if choice is not None:
            found.append(InitialFrame(frame, choice, 0.0, 0.0, len(sightings[number].people)))
            seen.append(_patient_and_distance(sightings[number], choice))
    if not found:
        return ()
    if config.patient_xz_m is not None:
        off_m = [float(np.linalg.norm(one.choice.ground_xz_m - config.patient_xz_m)) for one in found]
        there = [one for one, distance_m in zip(found, off_m, strict=True) if distance_m < THERE_M]
        return tuple(there or found)
    return tuple(sorted(_scored(found, seen), key=lambda one: -one.score))


def _scored(found: Sequence[InitialFrame], seen: Sequence[tuple[float, float]]) -> list[InitialFrame]:
    """The frames with their scores; seen: area of the patient and distance of the next person in each."""
    ordinary_m2 = float(np.median([area_m2 for area_m2, _ in seen]))
    sure = any(one.choice.sure for one in found)
    usual = float(np.median([one.people for one in found]))
    scored = []
    for one, (area_m2, distance_m) in zip(found, seen, strict=True):
        whole, apart = min(area_m2 / ordinary_m2, 1.0), min(distance_m / CROWDED_M, 1.0)
        possible = float(one.choice.sure or not sure) * (1.0 if one.people >= usual else MERGED)
        scored.append(replace(one, score=round(possible * whole * apart, 1), whole=whole))
    return scored


def _patient_and_distance(sighting: People, choice: PatientChoice) -> tuple[float, float]:
    """The patient's visible surface in m^2, and the distance of the nearest other person in m (inf if there is none).

    More surface than usual is not better: it may belong to another person who touches the patient.
    """
    axes = np.array([person.ground_xz_m for person in sighting.people])
    distance = np.linalg.norm(axes - choice.ground_xz_m, axis=1)
    patient = int(distance.argmin())
    return sighting.people[patient].area_m2, float(np.delete(distance, patient).min(initial=np.inf))


def look_at(camera: Camera) -> np.ndarray:
    """(2,) X and Z of the place 2.5 m along the first camera's axis: where people are asked to stand."""
    place = camera.position_m + 2.5 * camera.require_pose()[:3, 2]
    return np.asarray(place[[0, 2]])


def with_best_initial_frame(room: Room, config: TrackConfig) -> Room:
    """The room with its best initial frame first. A person who is alone cannot be confused: no fit is needed."""
    candidates = room.initial_frames
    if config.patient_xz_m is not None or max((one.people for one in candidates), default=0) < 2:
        return room

    def explained(candidate: InitialFrame) -> float:
        frame_set = read_frame(room.recording, candidate.frame)
        start = find_start(frame_set, Run(room, config), candidate.choice, None)
        return 0.0 if isinstance(start, NoStart) else start.explained

    best = best_of(candidates, explained)
    return replace(room, initial_frames=(best, *(one for one in candidates if one is not best)))


def best_of(candidates: Sequence[InitialFrame], explained: Callable[[InitialFrame], float]) -> InitialFrame:
    """The first that shows the whole patient and is explained well, or the best of ``TRIES``.

    explained: share of the patient's surface that a body accounts for. After the best by score come those that are far
    from all that were tried.
    """
    left, tried = list(candidates), list[tuple[float, InitialFrame]]()
    while left and len(tried) < TRIES:
        candidate = max(left, key=lambda one: _worth(one, [other for _, other in tried], candidates))
        left.remove(candidate)
        share = explained(candidate)
        if share >= WELL and candidate.whole >= WHOLE:
            return candidate
        tried.append((share * candidate.whole, candidate))
    return max(tried, key=lambda one: one[0])[1]


def _worth(candidate: InitialFrame, tried: Sequence[InitialFrame], candidates: Sequence[InitialFrame]) -> float:
    """The score, reduced near a frame that was tried."""
    if not tried:
        return candidate.score
    span = APART * max(1, np.ptp([one.frame for one in candidates]))
    gap = min(abs(candidate.frame - other.frame) for other in tried)
    return candidate.score * min(1.0, gap / span)
