"""Where tracking may begin: the sampled frames that show the patient, by how well and how far apart from others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.calibration.calibration import Calibration
from anchorpose.camera import Camera
from anchorpose.isolation.people import PatientChoice, People, choose_patient
from anchorpose.recording.recording import Recording
from anchorpose.tracker.config import TrackConfig

THERE_M = 0.5  # from the place that was named: beyond, somebody else is seen and the patient has not come yet
CROWDED_M = 1.0  # from axis to axis: an outstretched arm and half a trunk
MERGED = 0.5  # worth of a frame with fewer people than usual: somebody may stand so near that two are taken for one


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A frame (position in the recording) that shows the patient, and where he stands in it.

    score: 0 to 1, by the surface that is seen of him and the way to the next person alone; whole: 0 to 1, that surface
    against the usual one; people: seen in the frame.
    """

    frame: int
    choice: PatientChoice
    score: float
    whole: float
    people: int


def rank_openings(
    frames: Sequence[int], sightings: Sequence[People], calibration: Calibration, recording: Recording,
    config: TrackConfig,
) -> tuple[Opening, ...]:  # fmt: skip
    """The frames that show the patient, first those that show him well and nobody near him; if he was named, those with
    somebody at that place. Of equals the earlier comes first: the patient is named as he stands there.

    frames: positions in the recording, sightings: the people of each.
    """
    place = look_at(calibration.cameras[0])
    openings, seen = [], []
    for number, frame in enumerate(frames):
        others = [*sightings[:number], *sightings[number + 1 :]]
        choice = choose_patient(
            [sightings[number], *others], recording.equipment, config.patient_xz_m, place, config.isolation
        )
        if choice is not None:
            openings.append(Opening(frame, choice, 0.0, 0.0, len(sightings[number].people)))
            seen.append(_patient_and_distance(sightings[number], choice))
    if not openings:
        return ()
    if config.patient_xz_m is not None:
        named_m = [float(np.linalg.norm(opening.choice.ground_xz_m - config.patient_xz_m)) for opening in openings]
        there = [opening for opening, off_m in zip(openings, named_m, strict=True) if off_m < THERE_M]
        return tuple(there or openings)
    ordinary_m2 = float(np.median([area_m2 for area_m2, _ in seen]))
    sure = any(opening.choice.sure for opening in openings)
    usual = float(np.median([opening.people for opening in openings]))
    scored = []
    for opening, (area_m2, distance_m) in zip(openings, seen, strict=True):
        whole, apart = min(area_m2 / ordinary_m2, 1.0), min(distance_m / CROWDED_M, 1.0)
        possible = float(opening.choice.sure or not sure) * (1.0 if opening.people >= usual else MERGED)
        scored.append(replace(opening, score=round(possible * whole * apart, 1), whole=whole))
    return tuple(sorted(scored, key=lambda one: -one.score))


def _patient_and_distance(sighting: People, choice: PatientChoice) -> tuple[float, float]:
    """Surface of the patient that is seen, m^2, and how far the nearest other person is, m (inf where he is alone).

    More surface than usual is no better: it may be somebody else's who touches him.
    """
    axes = np.array([person.ground_xz_m for person in sighting.people])
    distance = np.linalg.norm(axes - choice.ground_xz_m, axis=1)
    patient = int(distance.argmin())
    return sighting.people[patient].area_m2, float(np.delete(distance, patient).min(initial=np.inf))


def look_at(camera: Camera) -> np.ndarray:
    """(2,) X and Z of the place 2.5 m along the first camera's axis: where people are asked to stand."""
    place = camera.position_m + 2.5 * camera.require_pose()[:3, 2]
    return np.asarray(place[[0, 2]])
