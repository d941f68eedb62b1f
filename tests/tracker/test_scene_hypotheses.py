"""Who is who after an occlusion: labels may be exchanged, or a helper may stand where the patient was expected."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import adult_body
from room_builder import FRONT, ROOM, body, built_scene, picture

from anchorpose.body.belief import vague_belief
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS, TRUNK
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.registration import Registration
from anchorpose.body.skin_points import Body
from anchorpose.isolation.people import PatientChoice
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_COUNT
from anchorpose.recording.recording import UNKNOWN, FrameSet
from anchorpose.tracker import scene_hypotheses
from anchorpose.tracker.bystanders import Bystanders
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Isolated, Observation
from anchorpose.tracker.observing import isolate_first, observe
from anchorpose.tracker.room import Run
from anchorpose.tracker.scene_hypotheses import (
    EVERY,
    OF_TRUNK,
    STRANGE,
    USUAL,
    ExpectedJoints,
    KnownPeople,
    likeliest_scene,
)
from anchorpose.tracker.search import LastSeen

HEIGHT_M, AGO_S = 1.7, 0.4  # AGO_S: how long the patient has been hidden
PATIENT, HELPER, PASSER_BY = (0.0, -0.45), (0.0, 0.45), (1.0, -0.27)
RUN = Run(
    SimpleNamespace(
        scenes=(built_scene(),),
        cameras=(FRONT,),
        recording=SimpleNamespace(equipment=None, subject=UNKNOWN),
        calibration=SimpleNamespace(floor_height_m=0.0),
    ),
    TrackConfig(),
)


def patient_body() -> Body:
    return adult_body(HEIGHT_M)


def frame(number: int, *places_xz_m: tuple[float, float]) -> FrameSet:
    """The patient raises an arm, so that the posture differs from the helper's."""
    people = [body(*at, HEIGHT_M, **({"LeftArm": (40.0, 0.0, 0.0)} if at[1] < 0 else {})) for at in places_xz_m]
    depth = picture(FRONT, *ROOM, *(part for person in people for part in person), seed=60 + number)
    return FrameSet(frame=number, time_s=number / 15.0, depths_m=(depth,))


def seen_with(frame_set: FrameSet, place_xz_m: tuple[float, float], others: int | None = None) -> Observation:
    """The frame with the patient's label on the person at a place; others: the label of all other people."""
    isolated = isolate_first(frame_set, PatientChoice(np.array(place_xz_m), "", sure=True), RUN)
    if others is not None:
        (view,) = isolated.views
        labels = np.where(view.labels >= PixelLabel.OTHER_PERSON, np.uint8(others), view.labels)
        isolated = replace(isolated, views=(View(view.depth_m, labels),), bystanders=Bystanders())
    return observe(frame_set, isolated, None, HEIGHT_M, RUN)


def relabelled(seen: Observation, label: int, other: int) -> Observation:
    """The frame with another label on all pixels with a label."""
    (view,) = seen.evidence.views
    changed = View(view.depth_m, np.where(view.labels == label, np.uint8(other), view.labels))
    isolated = Isolated(seen.pieces, (changed,), seen.memory, seen.bystanders)
    return observe(seen.frame_set, isolated, None, HEIGHT_M, RUN)


def helper_of(before: KnownPeople) -> int:
    return before.seen.bystanders.followed[0].label


def registered(seen: Observation, before: KnownPeople | None = None) -> Registration:
    """The patient's body on the pixels with the patient's label, from where most of these pixels are."""
    start = scene_hypotheses.rough_person(seen.evidence.views, (FRONT,), PixelLabel.PATIENT)
    pose = start.found.belief.pose
    known = before or SimpleNamespace(run=RUN, body=patient_body(), predicted=vague_belief(pose))
    return scene_hypotheses._registered(seen, pose, known)


@pytest.fixture(scope="module")
def before() -> KnownPeople:
    """Both were in view; then the patient was hidden for a while."""
    seen = seen_with(frame(0, PATIENT, HELPER), PATIENT)
    belief = registered(seen).belief
    last = LastSeen(seen, belief, gone_s=AGO_S)
    return KnownPeople(patient_body(), last, belief.later(belief.pose, AGO_S), seen, 1.0 / 15.0, HEIGHT_M, RUN)


def place_xz_m(registration: Registration) -> np.ndarray:
    return registration.belief.pose.root_m[[0, 2]]


def test_what_tracking_suggests_is_kept_where_it_is_right(before):
    now = seen_with(frame(1, PATIENT, HELPER), PATIENT)
    found = registered(now, before)
    assert likeliest_scene(now, found, before).seen is now


def test_exchanged_labels_are_exchanged_back(before):
    now = seen_with(frame(1, PATIENT, HELPER), HELPER)
    wrong = registered(now, before)
    assert np.linalg.norm(place_xz_m(wrong) - HELPER) < 0.1
    best = likeliest_scene(now, wrong, before)
    assert np.linalg.norm(place_xz_m(best.registration) - PATIENT) < 0.1
    (helper,) = best.seen.bystanders.followed
    assert helper.label == before.seen.bystanders.followed[0].label  # and the helper keeps the own label


def test_a_helper_is_not_the_patient_whom_a_passer_by_hides(before):
    """The helper has the patient's label and stands where helpers stood before: the patient is still hidden."""
    now = seen_with(frame(1, HELPER, PATIENT, PASSER_BY), HELPER, others=9)
    assert registered(now, before).found
    best = likeliest_scene(now, registered(now, before), before)
    assert not best.registration.found
    assert not best.seen.evidence.views[0].patient.any()


def test_it_costs_nothing_to_be_hidden_behind_somebody_and_much_to_be_hidden_in_the_open(before):
    def cost(*people: tuple[float, float], known: KnownPeople = before) -> float:
        now = seen_with(frame(1, HELPER, *people), HELPER, others=9)
        hidden = scene_hypotheses._hidden(scene_hypotheses._scored(now, registered(now, known), known), known)
        return known.hiding(hidden.seen.evidence.views)

    assert cost(PATIENT, PASSER_BY) < 1.0
    assert cost() == pytest.approx(2.0 * STRANGE)
    beside = (PASSER_BY[0], PASSER_BY[1] + 0.2)  # a patient who has been hidden for long may have walked there
    assert cost(beside, known=replace(before, last=replace(before.last, gone_s=1.0))) < STRANGE


def test_a_patient_who_has_another_label_is_found(before):
    """Tracking suggests that the patient is hidden, but all pixels of the patient have a bystander's label."""
    right = seen_with(frame(1, PATIENT, HELPER), PATIENT)
    now = relabelled(right, PixelLabel.PATIENT, helper_of(before))
    best = likeliest_scene(now, Registration(before.predicted, 0.0, False), before)
    assert best.registration.found
    assert np.linalg.norm(place_xz_m(best.registration) - PATIENT) < 0.1


def test_a_helper_with_the_right_label_does_not_become_the_patient_who_is_gone(before):
    """Tracking suggests rightly that the patient is not in view; the predicted place is empty."""
    now = relabelled(seen_with(frame(1, HELPER), HELPER), PixelLabel.PATIENT, helper_of(before))
    best = likeliest_scene(now, Registration(before.predicted, 0.0, False), before)
    assert not best.registration.found


def test_a_bystander_who_was_in_view_without_a_body_is_no_stranger(before):
    seen = replace(before.seen, bystanders=Bystanders())
    without = replace(before, seen=seen)
    assert without.came_and_went({helper_of(before): None}) == 0.0
    assert without.came_and_went({99: None}) == 0.0  # the same person, under a new label
    assert without.came_and_went({helper_of(before): None, 99: None}) == STRANGE
    assert before.came_and_went({helper_of(before): None}) == STRANGE  # a body was expected and does not fit


def test_a_bystander_who_disappears_is_strange(before):
    assert before.came_and_went({}) == STRANGE


def test_the_bodies_of_all_people_in_view_explain_the_readings(before):
    now = seen_with(frame(1, PATIENT, HELPER), PATIENT)
    found = registered(now, before)
    alone = log_probability(before.body, found.belief.pose, now.evidence)
    assert scene_hypotheses._scored(now, found, before).readings > 1.5 * alone > 0.0


def test_a_hidden_patient_explains_no_readings_and_is_never_worse_than_the_limit(before):
    """The same holds for what tracking suggests and for the alternative, so that both can be compared."""
    now = relabelled(seen_with(frame(1, HELPER), HELPER), PixelLabel.PATIENT, helper_of(before))
    away = replace(before.predicted, pose=replace(before.predicted.pose, root_m=np.array([0.0, 0.9, 50.0])))
    here, far = (
        scene_hypotheses._scored(now, Registration(one, 0.0, False), replace(before, predicted=one))
        for one in (before.predicted, away)
    )
    assert here.readings == far.readings > 0.0
    assert here.movement == pytest.approx(far.movement - 2.0 * STRANGE)


def test_without_bodies_of_bystanders_none_are_fitted(before):
    config = replace(RUN.config, follow=replace(RUN.config.follow, bystanders=False))
    known = replace(before, run=replace(RUN, config=config), seen=replace(before.seen, bystanders=Bystanders()))
    now = replace(seen_with(frame(1, PATIENT, HELPER), HELPER), bystanders=Bystanders())
    exchanged = list(scene_hypotheses._exchanged(now, known))
    assert exchanged
    assert all(not one.seen.bystanders.followed for one in exchanged)


def test_a_movement_costs_its_square_and_then_its_length():
    known = ExpectedJoints(np.zeros((JOINT_COUNT, 3)), 0.1)

    def cost(off_m: float, counted: np.ndarray = EVERY) -> float:
        return known.cost(np.tile([off_m, 0.0, 0.0], (JOINT_COUNT, 1)), counted)

    assert cost(0.0) == 0.0
    assert cost(0.2) == pytest.approx(4.0 * cost(0.1))
    assert cost(0.8) - cost(0.7) == pytest.approx(cost(0.7) - cost(0.6))
    assert cost(USUAL * 0.1 + 1e-6) == pytest.approx(cost(USUAL * 0.1), abs=1e-3)
    assert cost(0.2) == pytest.approx(PARTS * cost(0.2, OF_TRUNK))


FREE = np.arange(20, 255, dtype=np.uint8)


def test_a_bystander_whose_limbs_are_misplaced_keeps_the_label():
    expected = ExpectedJoints(np.zeros((JOINT_COUNT, 3)), 0.1)
    misplaced = np.where(LIMB_OF_JOINTS[:, None] == TRUNK, 0.0, 1.0) * np.ones(3)
    np.testing.assert_array_equal(scene_hypotheses._names([misplaced], {6: expected}, FREE), [6])


def test_each_person_gets_the_label_whose_way_costs_least_and_a_stranger_gets_a_new_one():
    at = [np.tile([0.0, 1.0, z], (JOINT_COUNT, 1)) for z in (0.0, 1.0, 5.0)]
    known = {7: ExpectedJoints(at[1], 0.1), 5: ExpectedJoints(at[0], 0.1)}
    found = [at[0] + 0.02, at[1] + 0.02, at[2]]
    np.testing.assert_array_equal(scene_hypotheses._names(found, known, FREE), [5, 7, 22])
    assert known[5].cost(at[2], OF_TRUNK) > STRANGE
    np.testing.assert_array_equal(scene_hypotheses._names([at[2]], known, FREE), [20])
    np.testing.assert_array_equal(scene_hypotheses._names([None], {}, FREE), [20])


def test_two_people_who_are_as_likely_leave_the_patient_hidden(before, monkeypatch):
    """Two hypotheses see the patient at different places and are as likely: neither is taken."""
    seen = seen_with(frame(1, PATIENT, HELPER), PATIENT)
    here = registered(seen, before)
    there = replace(here, belief=replace(here.belief, pose=replace(here.belief.pose, root_m=np.array([0, 0.9, 0.45]))))
    lost = Registration(before.predicted, 0.0, False)
    scene = scene_hypotheses.SceneHypothesis

    def compared(readings: float, hidden: float = 800.0, suggested: Registration = lost) -> Registration:
        both = iter([scene(seen, here, 1000.0, 0.0, {}), scene(seen, there, readings, 0.0, {})])
        monkeypatch.setattr(scene_hypotheses, "_exchanged", lambda now, known: both)
        monkeypatch.setattr(scene_hypotheses, "_hidden", lambda of, known: scene(seen, lost, hidden, 0.0, {}))
        monkeypatch.setattr(scene_hypotheses, "_scored", lambda now, found, known: scene(now, found, 0.0, 0.0, {}))
        return likeliest_scene(seen, suggested, before).registration

    wrong = replace(here, explained=0.5)
    assert compared(999.0, suggested=wrong) is lost
    assert not compared(600.0, hidden=999.0).found
    assert not compared(999.0).found
    assert compared(600.0) is here
