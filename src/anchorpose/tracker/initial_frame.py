"""Where tracking begins: the sampled frames that show the patient, and the first of them that a body explains.

A therapist who holds the patient may be mistaken for a part of the patient; fitting a body shows in which frame the
patient is alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from anchorpose.camera import Camera
from anchorpose.isolation.other_place import without_other_places
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.reader import read_frame
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.patient_choice import GIVEN_M, Patient, choose_patient, distance_m
from anchorpose.tracker.room import InitialFrame, Room, Run
from anchorpose.tracker.sighting import SeenPerson, Sighting
from anchorpose.tracker.start import NoStart, find_start, quality

CROWDED_M: Final = 1.0  # from axis to axis: an outstretched arm and half a trunk
MERGED: Final = 0.5  # weight of a frame with fewer people than usual: two who stand close may be taken for one
WELL: Final = 0.92  # of the surface explained, all limbs seen: 95 to 100 % when alone, 70 with a therapist's arm
WHOLE: Final = 0.8  # of the patient's usual visible surface: a sliver behind a therapist is explained by anything
TRIES: Final = 8  # frames; each takes a second or two to fit
APART: Final = 0.25  # of the frames' span: what spoils a frame spoils those around it


def rank_initial_frames(
    frames: Sequence[int],
    sightings: Sequence[Sighting],
    equipment: EquipmentModel | None,
    patient_xz_m: tuple[float, float] | None,
    cameras: Sequence[Camera],
) -> tuple[InitialFrame, ...]:
    """The frames that show the patient: first those that show the patient well and nobody nearby.

    frames: positions in the recording; sightings: the people of each. If the user gave the patient's place, only the
    first frames in a row with the patient there, since the place is given for the start.
    """
    patient = choose_patient(sightings, equipment, patient_xz_m, cameras)
    if patient is None:
        return ()
    chosen = range(len(frames)) if patient_xz_m is None else _first_there(patient, np.array(patient_xz_m))
    return ranked_by_view(patient, [frames[k] for k in chosen], [sightings[k] for k in chosen], chosen)


def ranked_by_view(
    patient: Patient, frames: Sequence[int], sightings: Sequence[Sighting], chosen: Sequence[int]
) -> tuple[InitialFrame, ...]:
    """The frames that show the patient well first; chosen: which of ``patient.seen`` each of them is."""
    shown = zip(frames, sightings, (patient.seen[k] for k in chosen), strict=True)
    found = [_Shown(frame, sighting, one) for frame, sighting, one in shown if one is not None]
    ordinary_m2 = float(np.median([shown.patient.person.area_m2 for shown in found]))
    usual = float(np.median([len(shown.sighting.people) for shown in found]))
    ranked = [_initial_frame(shown, patient, ordinary_m2, usual) for shown in found]
    return tuple(sorted(ranked, key=lambda initial: -initial.score))


class _Shown(NamedTuple):
    """A frame in which the patient is seen."""

    frame: int
    sighting: Sighting
    patient: SeenPerson


def _first_there(patient: Patient, place_xz_m: np.ndarray) -> range:
    """The frames from the first in which the patient is at a place to the next without; all if never there."""
    there = [one is not None and distance_m(one, place_xz_m) < GIVEN_M for one in patient.seen]
    if not any(there):
        return range(len(there))
    begin = there.index(True)
    return range(begin, there.index(False, begin) if False in there[begin:] else len(there))


def _initial_frame(shown: _Shown, patient: Patient, ordinary_m2: float, usual: float) -> InitialFrame:
    """The frame with its score; more surface than usual is not better: it may be another person's who touches."""
    one, sighting = shown.patient, shown.sighting
    people = sighting.people
    place = one.person.ground_xz_m
    away_m = [float(np.linalg.norm(other.person.ground_xz_m - place)) for other in people if other is not one]
    whole, apart = min(one.person.area_m2 / ordinary_m2, 1.0), min(min(away_m, default=CROWDED_M) / CROWDED_M, 1.0)
    explained = 1.0 if one.body is None else one.body.explained
    score = explained * whole * apart * (1.0 if len(people) >= usual else MERGED)
    choice = PatientChoice(place, patient.reason, patient.sure, sighting.frame, sighting.group, patient.rival_xz_m)
    return InitialFrame(shown.frame, choice, round(score, 1), whole, one.body is None)


def with_best_initial_frame(room: Room, config: TrackConfig) -> Room:
    """The room with its best initial frame first. A person who is alone cannot be confused: no fit is needed."""
    candidates = room.initial_frames
    if all(one.alone for one in candidates):
        return room

    found = dict[int, Start]()

    def explained(candidate: InitialFrame) -> float:
        frame_set = without_other_places(read_frame(room.recording, candidate.frame), room.scenes)
        start = find_start(frame_set, Run(room, config), candidate.choice, None)
        if isinstance(start, NoStart):
            return 0.0
        found[candidate.frame] = start
        return quality(start)

    best = best_of(candidates, explained)
    others = (one for one in candidates if one is not best)
    return replace(room, initial_frames=(replace(best, start=found.get(best.frame)), *others))


def best_of(candidates: Sequence[InitialFrame], explained: Callable[[InitialFrame], float]) -> InitialFrame:
    """The first that shows the whole patient and is explained well, or the best of ``TRIES``.

    explained: 0 to 1, how well a body explains the patient there. After the best by score come those that are far
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
