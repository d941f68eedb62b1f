"""Choose the frame in which tracking begins: a frame that shows the patient well, and in which a body can be fitted
well to the patient.

In some frames, a therapist who holds the patient is mistaken for a part of the patient. In these frames, no body fits
all pixels with the patient's label, so another frame is preferred.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.explanation import node_area_m2
from anchorpose.body.likelihood import most_nats
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.skin_points import body_points, build_body
from anchorpose.camera import Camera
from anchorpose.isolation.other_place import without_other_places
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Subject
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Start
from anchorpose.tracker.patient_choice import GIVEN_M, Patient, choose_patient, distance_m
from anchorpose.tracker.prior_shape import shape_cost
from anchorpose.tracker.room import InitialFrame, Room, Run
from anchorpose.tracker.sighting import SeenPerson, Sighting
from anchorpose.tracker.start import NoStart, find_start, quality

# m, an arm's length plus half a trunk; a frame scores less if another person is closer to the patient than this
CROWDED_M: Final = 1.0
# factor on the score of a frame that shows fewer people than usual (the median over all frames that show the patient),
# since two people may have been taken for a single person
MERGED: Final = 0.5
# minimum fit of a body (``best_of``), 0 to 1. If a body fits a frame at least this well, and the frame also reaches
# ``WHOLE``, no other initial frame is tried. The fit of a body is 0.95 to 1 for a patient alone, and 0.7 if a
# therapist's arm has the patient's label
WELL: Final = 0.92
# minimum visible area of the patient, as a share of the usual area (``InitialFrame.whole``), for which no other frame
# is tried. The minimum area is needed besides the minimum fit ``WELL``, since any pose fits a frame that shows only a
# narrow strip of the patient
WHOLE: Final = 0.8
TRIES: Final = 8  # maximum number of frames in which a body is fitted; each frame takes one or two seconds
# desired distance between the frames in which a body is tried, as a share of the span from the first to the last
# candidate frame. A candidate frame that is nearer than this to a frame in which a body was tried already scores less,
# since it would probably fail for the same reason
APART: Final = 0.25


def rank_initial_frames(
    frames: Sequence[int],
    sightings: Sequence[Sighting],
    equipment: EquipmentModel | None,
    patient_xz_m: tuple[float, float] | None,
    cameras: Sequence[Camera],
) -> tuple[InitialFrame, ...]:
    """Return the frames that show the patient; frames that show the patient well and no other person nearby come first.

    frames: positions in the recording; sightings: the people in each frame. If the user gave the patient's place, only
    the first unbroken series of frames with the patient at this place is used, since the place refers to the beginning
    of the recording.
    """
    patient = choose_patient(sightings, equipment, patient_xz_m, cameras)
    if patient is None:
        return ()
    chosen = range(len(frames)) if patient_xz_m is None else _first_there(patient, np.array(patient_xz_m))
    return ranked_by_view(patient, [frames[k] for k in chosen], [sightings[k] for k in chosen], chosen)


def ranked_by_view(
    patient: Patient, frames: Sequence[int], sightings: Sequence[Sighting], chosen: Sequence[int]
) -> tuple[InitialFrame, ...]:
    """Return the frames that show the patient, best first; ``chosen`` gives each frame's index in ``patient.seen``."""
    shown = zip(frames, sightings, (patient.seen[k] for k in chosen), strict=True)
    found = [_Shown(frame, sighting, one) for frame, sighting, one in shown if one is not None]
    ordinary_m2 = float(np.median([shown.patient.person.area_m2 for shown in found]))
    usual = float(np.median([len(shown.sighting.people) for shown in found]))
    ranked = [_initial_frame(shown, patient, ordinary_m2, usual) for shown in found]
    return tuple(sorted(ranked, key=lambda initial: -initial.score))


class _Shown(NamedTuple):
    """A frame that shows the patient."""

    frame: int  # position of the frame in the recording
    sighting: Sighting
    patient: SeenPerson


def _first_there(patient: Patient, place_xz_m: np.ndarray) -> range:
    """Return the first unbroken series of frames that show the patient at a place; at least one frame must show the
    patient there.
    """
    there = [one is not None and distance_m(one, place_xz_m) < GIVEN_M for one in patient.seen]
    begin = there.index(True)
    return range(begin, there.index(False, begin) if False in there[begin:] else len(there))


def _initial_frame(shown: _Shown, patient: Patient, ordinary_m2: float, usual: float) -> InitialFrame:
    """Return a frame in which tracking may begin, with its score. A visible area above the patient's usual area does
    not raise the score: the additional surface may belong to a person who touches the patient.
    """
    one, sighting = shown.patient, shown.sighting
    people = sighting.people
    place = one.person.ground_xz_m
    away_m = [float(np.linalg.norm(other.person.ground_xz_m - place)) for other in people if other is not one]
    whole, apart = min(one.person.area_m2 / ordinary_m2, 1.0), min(min(away_m, default=CROWDED_M) / CROWDED_M, 1.0)
    explained = 1.0 if one.body is None else one.body.explained
    score = explained * whole * apart * (1.0 if len(people) >= usual else MERGED)
    choice = PatientChoice(place, patient.reason, patient.sure, sighting.frame, patient.rival_xz_m)
    return InitialFrame(shown.frame, choice, round(score, 1), whole, len(people) == 1, sighting.crowd)


def with_best_initial_frame(room: Room, config: TrackConfig) -> Room:
    """Return the room with its possible initial frames reordered, so that the best frame comes first. If every initial
    frame shows the patient alone, no person can be confused with the patient. So the order of the initial frames stays
    the same, and no body is fitted to compare them.
    """
    candidates = room.initial_frames
    if all(one.alone for one in candidates):
        return replace(room, initial_frames=tuple(replace(one, crowd=None) for one in candidates))

    found = dict[int, Start]()

    def explained(candidate: InitialFrame) -> tuple[float, float]:
        frame_set = without_other_places(read_frame(room.recording, candidate.frame), room.scenes)
        start = find_start(frame_set, Run(room, config), candidate.choice, None, candidate.crowd)
        if isinstance(start, NoStart):
            return 0.0, -np.inf
        found[candidate.frame] = start
        evidence, nats = start.observation.evidence, _log_probability(start, room.recording.subject, config)
        most = most_nats(float(node_area_m2(evidence)[evidence.surface.camera].sum()))
        return min(quality(start), nats / most), nats - (1.0 - start.explained) * most

    best = best_of(candidates, explained)
    others = (replace(one, crowd=None) for one in candidates if one is not best)
    return replace(room, initial_frames=(replace(best, crowd=None, start=found.get(best.frame)), *others))


def _log_probability(start: Start, subject: Subject, config: TrackConfig) -> float:
    """Return the log probability, in nats, of the pose and shape with which tracking would start, given the images and
    the prior knowledge of people's bodies.
    """
    body = build_body(body_points(), start.shape)
    readings = log_probability(body, start.belief.pose, start.observation.evidence)
    return readings - 0.5 * shape_cost(start.shape, subject, config)


def best_of(
    candidates: Sequence[InitialFrame], explained: Callable[[InitialFrame], tuple[float, float]]
) -> InitialFrame:
    """Return the first tried frame that shows the whole patient and in which a body fits the patient well. If no tried
    frame meets both conditions, return the frame with the most probable body.

    explained: function that returns two values for a frame: how well a body fits the patient, 0 to 1, and the body's
    log probability in nats, minus a penalty for surface far from the body. A body with the wrong facing lies near as
    much of the surface as the correct body. But the depth readings are less probable with this body, or its shape is
    rare. If a person behind the patient has the patient's label, no body fits all of the surface. The frame with the
    best score is tried first, then frames far from all tried frames.
    """
    left, tried = list(candidates), list[tuple[float, InitialFrame]]()
    while left and len(tried) < TRIES:
        candidate = max(left, key=lambda one: _worth(one, [other for _, other in tried], candidates))
        left.remove(candidate)
        share, nats = explained(candidate)
        if share >= WELL and candidate.whole >= WHOLE:
            return candidate
        tried.append((nats, candidate))
    return max(tried, key=lambda one: one[0])[1]


def _worth(candidate: InitialFrame, tried: Sequence[InitialFrame], candidates: Sequence[InitialFrame]) -> float:
    """Return the score of a frame, reduced if it is near a frame that was tried before."""
    if not tried:
        return candidate.score
    span = APART * max(1, np.ptp([one.frame for one in candidates]))
    gap = min(abs(candidate.frame - other.frame) for other in tried)
    return candidate.score * min(1.0, gap / span)
