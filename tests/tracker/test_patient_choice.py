"""Who of the people is the patient: each sign by itself, what outweighs what, and when it is not clear."""

import numpy as np
import pytest
from body_builder import FRONT, LEFT

from anchorpose.isolation.people import Person
from anchorpose.recording.equipment import Box, EquipmentModel
from anchorpose.tracker.initial_frame import rank_initial_frames
from anchorpose.tracker.patient_choice import choose_patient, named_patient
from anchorpose.tracker.sighting import RoughBody, SeenPerson, Sighting

CAMERAS = (FRONT, LEFT)  # both look at the world's origin
AHEAD = (1.0, 0.0)
NO_IMAGES = (None, None)
RAILS = EquipmentModel((Box("rails", np.array([0.0, 0.5, 1.0]), np.array([0.8, 0.05, 0.8]), np.eye(3)),))


def one(x, z, facing=AHEAD, explained=0.95, area_m2=0.6, past=0.03) -> SeenPerson:
    """A person whose surface lies 0.1 m before the pelvis; past: share of the trunk that cameras see past."""
    facing = np.array(facing) / np.linalg.norm(facing)
    place = np.array([x, z], float)
    body = RoughBody(place, facing, explained, past)
    return SeenPerson(Person(place + 0.1 * facing, 0.0, 1.7, area_m2), body)


def towards(x, z) -> tuple[float, float]:
    """The direction in which somebody at this place sees the middle."""
    return (-x, -z)


def times(count, *people) -> list[Sighting]:
    return [Sighting(7, tuple(people), NO_IMAGES)] * count


def chosen_place(sightings, equipment=None, place=None, cameras=CAMERAS):
    patient = choose_patient(sightings, equipment, place, cameras)
    seen = [person.place_xz_m for person in patient.seen if person is not None]
    return np.median(seen, axis=0), patient


def test_the_patient_is_who_the_user_says_however_the_votes_fall():
    place, patient = chosen_place(times(8, one(0, 0), one(0, 0.9)), place=(0.0, 0.8))
    assert place[1] == 0.9
    assert patient.sure
    assert patient.reason == "is nearest to the place that was given, of 2 people"


def test_no_other_person_is_taken_for_a_named_patient_who_is_not_there():
    assert choose_patient(times(8, one(0, 0), one(0, 0.9)), None, (40.0, -30.0), CAMERAS) is None
    assert rank_initial_frames([0, 1, 2], times(3, one(0, 0)), None, (0.0, 0.7), CAMERAS) == ()


def test_a_named_person_who_walks_is_followed_from_frame_to_frame():
    """Another person walks through the same places a second later."""
    ways = [(one(0.25 * k, 0.0), one(0.25 * (k - 4), 0.05)) for k in range(9)]
    sightings = [Sighting(40 + k, people, NO_IMAGES) for k, people in enumerate(ways)]
    patient = named_patient(sightings, 4, np.array([1.05, 0.0]))
    assert [seen.place_xz_m[0] for seen in patient.seen] == pytest.approx([0.25 * k for k in range(9)])
    assert "in frame 44" in patient.reason
    assert patient.sure


def test_nobody_is_named_where_nobody_stands():
    assert named_patient(times(5, one(0, 2)), 2, np.array([0.0, 0.0])) is None


def test_a_named_person_who_leaves_is_not_followed_into_another():
    sightings = [*times(3, one(0, 0)), *times(3, one(0, 1.5))]
    seen = named_patient(sightings, 0, np.zeros(2)).seen
    assert [person is None for person in seen] == [False] * 3 + [True] * 3


def test_the_place_is_that_of_the_first_who_comes_there():
    early, late = times(4, one(0, 2)), times(4, one(0.3, 0), one(0, 2))
    place, patient = chosen_place([*early, *late], place=(0.1, 0.0))
    assert place[0] == 0.3
    assert [person is None for person in patient.seen] == [True] * 4 + [False] * 4


def test_who_stands_in_the_equipment_is_the_patient_though_another_stands_in_the_middle():
    place, patient = chosen_place(times(8, one(0, 0), one(0.0, 1.0)), RAILS)
    assert place[1] == 1.0
    assert "within the equipment" in patient.reason


def test_who_is_faced_by_the_others_is_the_patient():
    helpers = [one(0.7, 0, (-1, 0.0)), one(0, -0.6, (0.0, 1.0))]
    place, patient = chosen_place(times(8, *helpers, one(0, 0.1)))
    assert place == pytest.approx([0, 0.1])
    assert "faced by 2.0 people" in patient.reason


def test_facing_outweighs_the_middle_of_the_view():
    place, _ = chosen_place(times(8, one(0, 0, (0, 1)), one(-0.4, 0.6, (0.4, 0)), one(0, 0.6, AHEAD)), cameras=CAMERAS)
    assert place == pytest.approx([0, 0.6])


def test_of_two_who_face_each_other_before_one_camera_the_patient_is_who_does_not_turn_the_back_to_it():
    """FRONT is at X = 2.4 m: a therapist who kneels before the patient faces away from it."""
    kneels, stands = one(0.7, 0, (-1, 0)), one(0, 0, AHEAD, area_m2=0.4)
    assert chosen_place(times(8, kneels, stands), cameras=(FRONT,))[0] == pytest.approx([0, 0])


def test_who_stays_is_the_patient_and_not_who_walks_through_the_middle():
    walks = [Sighting(7, (one(0.1, -2 + 0.5 * k), one(0.5, 0.6)), NO_IMAGES) for k in range(8)]
    place, patient = chosen_place(walks)
    assert place == pytest.approx([0.5, 0.6])
    assert "in place in 8 of 8 frames" in patient.reason


@pytest.mark.parametrize(("before_m", "patient_z_m"), [(0.9, 0.0), (-0.9, 0.45)])
def test_who_is_hidden_is_not_gone(before_m, patient_z_m):
    """Seen in 3 of 12 frames; in the others the camera measures something before the place, or something behind it."""
    wall = np.full((FRONT.height, FRONT.width), np.linalg.norm(FRONT.position_m) - before_m, np.float32)
    stays, comes = one(0, 0.45), one(0, 0)
    unseen = Sighting(7, (stays,), (wall,))
    sightings = [*times(3, comes, stays), *[unseen] * 9]
    assert chosen_place(sightings, cameras=(FRONT,))[0] == pytest.approx([0, patient_z_m])


def test_who_is_seen_once_is_not_the_patient_however_hidden():
    nearer = np.full((FRONT.height, FRONT.width), 1.0, np.float32)
    stays, once = one(0, 0.45), one(0, 0)
    sightings = [*times(1, once, stays), *[Sighting(7, (stays,), (nearer,))] * 11]
    assert chosen_place(sightings, cameras=(FRONT,))[0] == pytest.approx([0, 0.45])


def test_a_patient_who_is_seen_now_as_one_and_now_as_two_is_one_person():
    """Two halves of a patient share the frames; the helper is there in all of them."""
    helper = one(0.6, 0.0, facing=towards(0.6, 0.0))
    halves = [(one(0.0, 0.04),), (one(0.0, -0.04),), (one(0.0, 0.04), one(0.0, -0.04))]
    sightings = [Sighting(7, (*halves[k % 3], helper), NO_IMAGES) for k in range(12)]
    place, patient = chosen_place(sightings)
    assert place == pytest.approx([0, 0], abs=0.05)
    assert sum(seen is not None for seen in patient.seen) == 12


def test_what_no_body_explains_is_not_human():
    cupboard = one(0, 0, explained=0.4, area_m2=1.2)
    assert chosen_place(times(8, cupboard, one(1.2, 0.5)))[0] == pytest.approx([1.2, 0.5])


def test_a_patient_who_is_mostly_hidden_is_human_by_the_frames_that_show_more():
    """Sit to stand behind a pad and a kneeling therapist: a body explains the pixels only while the patient stands."""
    kneeling = one(0.8, 0.1, facing=towards(0.8, 0.1), area_m2=0.3)
    shares = (0.55, 0.6, 0.57, 0.97, 0.6, 0.98, 0.55, 1.0)
    sightings = [Sighting(7, (one(0, 0, explained=share, area_m2=0.15), kneeling), NO_IMAGES) for share in shares]
    assert chosen_place(sightings)[0] == pytest.approx([0, 0])


def test_a_thing_that_a_body_explains_once_is_not_human():
    shares = (0.4,) * 7 + (0.9,)
    sightings = [Sighting(7, (one(0, 0, explained=share, area_m2=1.2), one(1.2, 0.5)), NO_IMAGES) for share in shares]
    assert chosen_place(sightings)[0] == pytest.approx([1.2, 0.5])


def seen_past(shares, x=0.0, z=0.0, rival=(0.9, 0.0)) -> list[Sighting]:
    """Somebody at a place of whose trunk cameras see past such shares, a frame each, beside a rival who helps."""
    other = one(*rival, facing=towards(*rival))
    return [Sighting(7, (one(x, z, past=share), other), NO_IMAGES) for share in shares]


@pytest.mark.parametrize("shares", [(0.3,) * 16, (0.2, 0.45) * 7 + (0.2,)], ids=["a lunge", "a squat now and then"])
def test_a_patient_whose_posture_no_rough_body_fits_is_still_chosen(shares):
    assert chosen_place(seen_past(shares))[0] == pytest.approx([0, 0])


def test_what_cameras_nearly_always_see_past_is_not_human():
    assert chosen_place(seen_past((0.5,) * 14 + (0.1,) * 2))[0] == pytest.approx([0.9, 0.0])


def test_of_two_the_one_whom_cameras_do_not_see_past_is_likelier():
    twins = [Sighting(7, (one(0, 0.3), one(0, -0.3, past=0.3)), NO_IMAGES) for _ in range(12)]
    assert chosen_place(twins)[0] == pytest.approx([0, 0.3])


def test_without_anybody_human_the_likeliest_of_all_is_taken():
    assert chosen_place(times(8, one(0, 0, explained=0.4), one(1.2, 0.5, explained=0.4)))[0] == pytest.approx([0, 0])


@pytest.mark.parametrize(("apart_m", "unclear"), [(0.3, True), (2.5, False)])
def test_a_second_who_may_be_the_patient_as_well_is_named(apart_m, unclear):
    _, patient = chosen_place(times(8, one(0, 0, (0, 1)), one(0.2, apart_m + 0.2, (0, 1))), None)
    assert (patient.rival_xz_m is not None) == unclear
    assert not patient.sure


def test_the_person_keeps_the_name_through_a_frame_in_which_nobody_is_seen():
    gap = [*times(3, one(0, 0), one(0, 1)), Sighting(7, (), NO_IMAGES), *times(3, one(0, 1), one(0, 0))]
    _, patient = chosen_place(gap)
    assert [None if person is None else float(person.place_xz_m[1]) for person in patient.seen] == [0] * 3 + [None] + [
        0
    ] * 3


def test_nobody_is_nobody():
    assert choose_patient(times(3), None, None, CAMERAS) is None
    assert rank_initial_frames([0, 1, 2], times(3), None, None, CAMERAS) == ()
