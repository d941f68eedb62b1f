"""Choose the patient among the people in the sampled frames.

Usually, the patient stands in the equipment, is present all the time, is near the cameras' optical axes, and does not
turn the back to all cameras. Helpers stand around the patient and face the patient. None of these signs is certain, so
each sign adds to a person's votes, and the person with most votes is the patient.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.camera import Camera
from anchorpose.recording.equipment import EquipmentModel
from anchorpose.rotations import unit
from anchorpose.tracker.bystanders import MOST_TRUNK_PAST
from anchorpose.tracker.sighting import RoughBody, SeenPerson, Sighting

# m; a person who is closer than this to the usual place of a known person is the same person, who may have stepped
# aside or stood up
STAYS_M: Final = 0.40
# m; two people whose usual places are closer together than this are one person. The value is half of the minimum
# distance between the pelvises of two people
SAME_M: Final = 0.15
# minimum share of a person's nodes that must lie near the rough body; people have at least 0.68. Objects have up to
# 0.70; they are rejected because cameras see past the fitted body (``MOST_PAST``)
HUMAN: Final = 0.65
# maximum share of a trunk that cameras may see past (read something farther away); it is 0.25 for a person in a lunge,
# and 0.37 and more for a chair that was taken for a person
MOST_PAST: Final = 0.3
HELP_M: Final = 1.2  # m, maximum distance between the pelvises of helper and patient; an outstretched arm plus a step
FACES: Final = 0.7  # minimum cosine between a helper's heading and the direction to the patient: 45 degrees
ASIDE_M: Final = 0.4  # m; a person this far from the cameras' axes loses ln 2 votes (0.7); users aim cameras by eye
OUTSIDE_M: Final = 0.2  # m; a person this far outside the equipment loses ln 2 votes (0.7); patients may lean out
# minimum difference in votes between patient and next person for a sure choice; it means odds of three to one if votes
# are log likelihoods
SURE: Final = 1.0
# number that is added to the count of frames in which a person is missing. The addition lowers the votes of a person
# who was seen only once, since the body of such a person may have been fitted to an arm
CHANCE: Final = 2
# seven heights, in m below the top of the head; the trunk of a standing or sitting person is at all of them
CHEST_M: Final = np.linspace(0.35, 0.75, 7)
BEFORE_M: Final = 0.3  # m; a reading this far in front of the middle of a trunk shows something that hides the person
STEP_M: Final = 0.4  # m, maximum movement of a person from frame to frame: 2 m/s at 5 frames per second
# m, maximum distance of the patient from the place that the user gave; a person farther away is another person
GIVEN_M: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A person who may be the patient."""

    seen: tuple[SeenPerson | None, ...]  # the person in each sighting; None if not seen
    votes: float  # sum of the votes; the candidate with the largest sum is most likely the patient
    within: bool  # whether the person's usual place lies inside the outline of the equipment
    faced: float  # number of people nearby who face this person, averaged over the sightings of this person

    @property
    def place_xz_m(self) -> np.ndarray:
        """Return the place (2,) where the person usually is."""
        return _usual_place(self.seen)


@dataclass(frozen=True, slots=True, eq=False)
class Patient:
    """The chosen patient; fields without a comment are described in ``PatientChoice``."""

    seen: tuple[SeenPerson | None, ...]  # the patient in each sighting; None if not seen
    reason: str
    sure: bool
    rival_xz_m: np.ndarray | None


def choose_patient(
    sightings: Sequence[Sighting],
    equipment: EquipmentModel | None,
    patient_xz_m: tuple[float, float] | None,
    cameras: Sequence[Camera],
) -> Patient | None:
    """Choose the patient among all people in the sightings; None if no person is seen.

    If ``patient_xz_m`` is given, the patient is the person nearest to this place in the first sighting with a person
    there; None if no sighting shows a person there. Otherwise, the patient is the person with most votes.
    """
    candidates = find_candidates(sightings, equipment, cameras)
    if not candidates:
        return None
    if patient_xz_m is not None:
        named = _at_place(candidates, np.array(patient_xz_m))
        if named is None:
            return None
        return Patient(named.seen, f"is nearest to the place that was given, {_others(sightings)}", True, None)
    first, *rest = sorted(candidates, key=lambda one: -one.votes)
    rival = next((one.place_xz_m for one in rest if one.votes > first.votes - SURE), None)
    return Patient(first.seen, _reason(first, sightings), first.within and rival is None, rival)


def named_patient(sightings: Sequence[Sighting], first: int, place_xz_m: np.ndarray) -> Patient | None:
    """Take the person who stands at a place in the sighting number ``first`` for the patient, and follow this person
    from frame to frame; return None if no person is near the place.

    sightings: sightings of successive frames. In each later frame, the person nearest to the patient's previous place
    is taken for the patient.
    """
    seen: list[SeenPerson | None] = [None] * len(sightings)
    for way in (range(first, len(sightings)), range(first, -1, -1)):
        at, reach_m = place_xz_m, GIVEN_M
        for number in way:
            people = sightings[number].people
            nearest = min(people, key=lambda one: distance_m(one, at), default=None)
            if nearest is None or distance_m(nearest, at) > reach_m:
                break
            seen[number], at, reach_m = nearest, nearest.place_xz_m, STEP_M
    if seen[first] is None:
        return None
    reason = f"was at the given place in frame {sightings[first].frame}, {_others(sightings)}"
    return Patient(tuple(seen), reason, True, None)


def find_candidates(
    sightings: Sequence[Sighting], equipment: EquipmentModel | None, cameras: Sequence[Camera]
) -> list[Candidate]:
    """Return all seen people with their votes; if some people pass the test ``_is_human``, return only these people."""
    members = _joined(_followed(sightings))
    human = [seen for seen in members if _is_human(seen)]
    return [_candidate(seen, sightings, equipment, cameras) for seen in human or members]


def _followed(sightings: Sequence[Sighting]) -> list[list[SeenPerson | None]]:
    """Return, for each person, the person as seen in each sighting (None: not seen); a sighting has all people seen in
    one frame. People with the same usual place count as one person.
    """
    members = list[list[SeenPerson | None]]()
    for number, sighting in enumerate(sightings):
        people = sighting.people
        places = [_usual_place(seen) for seen in members]
        away = np.array([[np.linalg.norm(one.place_xz_m - place) for place in places] for one in people])
        away = away.reshape(len(people), len(places))
        known = {
            int(row): int(column)
            for row, column in zip(*linear_sum_assignment(np.minimum(away, STAYS_M)), strict=True)
            if away[row, column] < STAYS_M
        }
        for seen in members:
            seen.append(None)
        for row, one in enumerate(people):
            if row in known:
                members[known[row]][-1] = one
            else:
                members.append([*[None] * number, one])
    return members


def _joined(members: Sequence[list[SeenPerson | None]]) -> list[list[SeenPerson | None]]:
    """Join people with the same usual place into a single person, since a squatting person is sometimes taken for two
    people.
    """
    joined = list[list[SeenPerson | None]]()
    for seen in sorted(members, key=lambda one: -sum(person is not None for person in one)):
        place = _usual_place(seen)
        same = next((one for one in joined if np.linalg.norm(_usual_place(one) - place) < SAME_M), None)
        if same is None:
            joined.append(list(seen))
        else:
            same[:] = [one or other for one, other in zip(same, seen, strict=True)]
    return joined


def _usual_place(seen: Sequence[SeenPerson | None]) -> np.ndarray:
    return np.asarray(np.median([one.place_xz_m for one in seen if one is not None], axis=0))


def _is_human(seen: Sequence[SeenPerson | None]) -> bool:
    """Return whether the seen person is human: most of the person's surface lies near the fitted rough body (average
    shape), and cameras do not see past a large share of this body's trunk.

    In each sighting, a share of the person's surface lies near the body. The upper quartile of these shares decides,
    since a pad and a therapist may hide almost all of a patient until the patient stands up.
    """
    bodies = _bodies(seen)
    if not bodies:
        return False
    return bool(np.quantile([body.explained for body in bodies], 0.75) >= HUMAN and _seen_past(seen) <= MOST_PAST)


def _seen_past(seen: Sequence[SeenPerson | None]) -> float:
    """Return the median share of the trunk that cameras see past (read something farther away). Return 0 if the share
    is unknown in every frame, since nothing then contradicts the body.
    """
    known = [body.past for body in _bodies(seen) if np.isfinite(body.past)]
    return float(np.median(known or [0.0]))


def _bodies(seen: Sequence[SeenPerson | None]) -> list[RoughBody]:
    return [one.body for one in seen if one is not None and one.body is not None]


def _candidate(
    seen: Sequence[SeenPerson | None],
    sightings: Sequence[Sighting],
    equipment: EquipmentModel | None,
    cameras: Sequence[Camera],
) -> Candidate:
    there = [(one, sighting) for one, sighting in zip(seen, sightings, strict=True) if one is not None]
    place = _usual_place(seen)
    faced = float(np.mean([_faced_by(one, sighting) for one, sighting in there]))
    beyond_m = 0.0 if equipment is None else outside_m(place, equipment)
    votes = (
        -np.log1p((CHANCE + _times_gone(seen, sightings, cameras)) / len(there))
        + 0.5 * np.log(np.median([one.person.area_m2 for one, _ in there]))
        + faced
        + 0.5 * np.mean([_turned_to_camera(one, cameras) for one, _ in there])
        - np.log1p((_seen_past(seen) / MOST_TRUNK_PAST) ** 2)
        - np.log1p((_aside_m(place, cameras) / ASIDE_M) ** 2)
        - np.log1p((beyond_m / OUTSIDE_M) ** 2)
    )
    return Candidate(tuple(seen), float(votes), equipment is not None and beyond_m == 0.0, faced)


def _times_gone(seen: Sequence[SeenPerson | None], sightings: Sequence[Sighting], cameras: Sequence[Camera]) -> int:
    """Count the frames in which a person is not seen although nothing hides the person's usual place."""
    there = [one for one in seen if one is not None]
    x, z = _usual_place(there)
    chest = min(one.person.top_m for one in there) - CHEST_M
    axis = np.column_stack([np.full(len(chest), x), chest, np.full(len(chest), z)])
    return sum(
        one is None and not _is_hidden(axis, sighting.depths_m, cameras)
        for one, sighting in zip(seen, sightings, strict=True)
    )


def _is_hidden(points_m: np.ndarray, depths_m: Sequence[np.ndarray | None], cameras: Sequence[Camera]) -> bool:
    """Return whether an object hides most of the points (n, 3) in every camera that has most of the points in view."""
    hidden = [
        bool(np.mean((read > 0) & (read < own - BEFORE_M)) > 0.5)
        for own, read in looks_at_most(points_m, depths_m, cameras)
    ]
    return bool(hidden) and all(hidden)


def looks_at_most(
    points_m: np.ndarray, depths_m: Sequence[np.ndarray | None], cameras: Sequence[Camera]
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield, for each camera that has most of the points (n, 3) in view, the depths of these points in the camera, and
    the readings at their pixels (``Camera.look``).
    """
    for depth_m, camera in zip(depths_m, cameras, strict=True):
        if depth_m is not None:
            own, read, inside = camera.look(points_m, depth_m)
            if np.mean(inside) > 0.5:
                yield own[inside], read[inside]


def _faced_by(one: SeenPerson, sighting: Sighting) -> int:
    """Count the people within ``HELP_M`` of a person who face this person."""
    count = 0
    for other in sighting.people:
        if other is one or other.body is None:
            continue
        towards = one.place_xz_m - other.body.place_xz_m
        count += bool(np.linalg.norm(towards) < HELP_M and unit(towards) @ other.body.facing_xz > FACES)
    return count


def _turned_to_camera(one: SeenPerson, cameras: Sequence[Camera]) -> float:
    """Return the largest cosine between a person's heading and the direction to a camera; 0 without a body."""
    if one.body is None:
        return 0.0
    towards = [unit(camera.position_m[[0, 2]] - one.body.place_xz_m) for camera in cameras]
    return max(float(direction @ one.body.facing_xz) for direction in towards)


def _aside_m(place_xz_m: np.ndarray, cameras: Sequence[Camera]) -> float:
    """Return the distance of a place on the ground from the cameras' optical axes (root mean square over cameras)."""
    aside = []
    for camera in cameras:
        x, z = unit(camera.require_pose()[[0, 2], 2])
        dx, dz = place_xz_m - camera.position_m[[0, 2]]
        aside.append(x * dz - z * dx)
    return float(np.sqrt(np.mean(np.square(aside))))


def outside_m(place_xz_m: np.ndarray, equipment: EquipmentModel) -> float:
    """Return how far (m) a place on the ground lies outside the outline of the equipment; 0 inside the outline."""
    outline = cv2.convexHull(equipment.triangles()[0][:, [0, 2]].astype(np.float32))
    x, z = place_xz_m
    return max(0.0, -float(cv2.pointPolygonTest(outline, (float(x), float(z)), True)))


def _at_place(candidates: Sequence[Candidate], place_xz_m: np.ndarray) -> Candidate | None:
    """Return the person nearest to a place, in the first sighting with a person at this place; None if no sighting
    shows a person there.
    """

    def away_m(candidate: Candidate, number: int) -> float:
        one = candidate.seen[number]
        return np.inf if one is None else distance_m(one, place_xz_m)

    for number in range(len(candidates[0].seen)):
        nearest = min(candidates, key=lambda one: away_m(one, number))
        if away_m(nearest, number) < GIVEN_M:
            return nearest
    return None


def distance_m(one: SeenPerson, place_xz_m: np.ndarray) -> float:
    """Return the distance of a place from a person's fitted pelvis or from the person's place on the ground, whichever
    is nearer: users may mean either place.
    """
    return float(min(np.linalg.norm(one.place_xz_m - place_xz_m), np.linalg.norm(one.person.ground_xz_m - place_xz_m)))


def _reason(patient: Candidate, sightings: Sequence[Sighting]) -> str:
    """Return why this person was chosen as the patient, as the end of a sentence that begins with "who"."""
    count = sum(one is not None for one in patient.seen)
    parts = ["stands within the equipment"] if patient.within else []
    parts.append(f"was seen in place in {count} of {len(sightings)} frames")
    if patient.faced >= 0.5:
        parts.append(f"is faced by {patient.faced:.1f} people on average")
    return f"{', '.join(parts)}, {_others(sightings)}"


def _others(sightings: Sequence[Sighting]) -> str:
    most = max(len(sighting.people) for sighting in sightings)
    return f"of {most} people" if most > 1 else "the only person"
