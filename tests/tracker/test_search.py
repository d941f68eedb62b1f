"""Looking for a lost patient: nobody who was beside him is taken for him, and he is found where he may have come."""

from dataclasses import replace
from io import BytesIO
from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import standing
from room_builder import FRONT, ROOM, body, built_scene, picture

from anchorpose.body.belief import vague_belief
from anchorpose.isolation.bystander_memory import FORWARD_LABELS, empty_memory, update_memory
from anchorpose.isolation.people import PatientChoice, see_people
from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.separation import separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import Follower
from anchorpose.tracker.journal import read_value, write_value
from anchorpose.tracker.observation import Start
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import NO_REVIEW, Run
from anchorpose.tracker.search import WALK_M_S, LastSeen, Search, seen_as_strip
from anchorpose.tracker.start import NoStart

CONFIG = TrackConfig()
ROOM_NOW = SimpleNamespace(scenes=(built_scene(),), cameras=(FRONT,), recording=SimpleNamespace(equipment=None))
A_FRAME_S = 1.0 / 15.0
PELVIS_M = 0.08  # of the votes for it
THERAPIST = body(0.0, 0.8)


def frame(number: int, *people) -> FrameSet:
    parts = [part for person in people for part in person]
    depth = picture(FRONT, *ROOM, *parts, seed=40 + number)
    return FrameSet(frame=number, time_s=number * A_FRAME_S, depths_m=(depth,))


def seen(*people) -> SimpleNamespace:
    """A frame, number 0, in which the patient stands in the middle, as far as the search asks for it."""
    first = frame(0, *people)
    pieces = [find_pieces(first.depths_m[0], ROOM_NOW.scenes[0])]
    found = see_people(pieces, (FRONT,))
    views = separate_initial(pieces, found, PatientChoice(np.zeros(2), "", sure=True))
    memory = update_memory(empty_memory(), pieces, views, (FRONT,), 0.0)
    return SimpleNamespace(memory=memory, frame_set=first)


def lost_beside(*people, left: bool = False, hidden: dict[int, np.ndarray] | None = None) -> Search:
    """left: the patient was last seen on the way out of the picture; hidden: where (2,) people were who are hidden."""
    before = seen(body(0.0, 0.0), *people)
    met = frozenset(np.unique(before.memory.owner).tolist()) - {PixelLabel.PATIENT}
    return Search(before, LastSeen(before, vague_belief(standing((0.0, 0.9, 0.0))), met, hidden or {}), left)


def looked(search: Search, *moments: tuple, first: int = 1) -> list[PatientChoice | NoStart]:
    """What is found in each of some frames, from the frame ``first`` on; a moment: the people in it."""
    numbered = enumerate(moments, first)
    return [search.look(frame(number, *people), Run(ROOM_NOW, CONFIG)) for number, people in numbered]


LATER = 20  # more than a second after the patient was lost


def test_a_pass_that_begins_with_a_search_takes_nobody_who_was_beside_him():
    room = SimpleNamespace(**vars(ROOM_NOW), why_nobody="", review=NO_REVIEW)
    follower = Follower(Run(room, CONFIG), None, None, search=lost_beside(THERAPIST))
    (estimate,) = follower.step(frame(LATER, THERAPIST))
    assert estimate.why_lost == NoStart.NOBODY_NEW.value
    assert follower.tracker is None


def test_a_search_with_which_a_pass_back_begins_is_stored_and_read():
    search, stream = lost_beside(THERAPIST), BytesIO()
    write_value(stream, search, {})
    stream.seek(0)
    found = read_value(stream, Start | Search | None, {})
    assert isinstance(found, Search)
    np.testing.assert_array_equal(found.memory.points_m, search.memory.points_m)
    assert looked(found, (THERAPIST,), first=LATER) == [NoStart.NOBODY_NEW]


def test_who_was_beside_him_is_known_although_newcomers_get_the_first_labels_again():
    """The therapist has the last label of all, so whoever comes next gets the first label, which is a lower one."""
    before = seen(body(0.0, 0.0), THERAPIST)
    last = FORWARD_LABELS[-1]
    memory = replace(before.memory, owner=np.full_like(before.memory.owner, last), next_label=FORWARD_LABELS[0])
    before = SimpleNamespace(memory=memory, frame_set=before.frame_set)
    search = Search(before, LastSeen(before, vague_belief(standing((0.0, 0.9, 0.0))), frozenset({last})), left=False)
    found = looked(search, (THERAPIST,), (THERAPIST, body(0.0, 0.0)), first=LATER)
    assert found[0] is NoStart.NOBODY_NEW
    assert found[1].ground_xz_m == pytest.approx([0.0, 0.0], abs=PELVIS_M)


def test_nobody_is_found_in_an_empty_room():
    assert looked(lost_beside(), (), ()) == [NoStart.NOBODY_THERE] * 2


def test_who_was_beside_him_is_not_him():
    assert looked(lost_beside(THERAPIST), *[(THERAPIST,)] * 3) == [NoStart.NOBODY_NEW] * 3


def test_who_was_beside_him_is_not_him_in_his_place_either():
    way = [(body(0.0, float(z)),) for z in np.arange(0.76, 0.0, -0.04)]
    assert looked(lost_beside(THERAPIST), *way) == [NoStart.NOBODY_NEW] * len(way)


def test_who_was_hidden_with_him_and_comes_out_at_another_place_is_not_him():
    someone = {int(PixelLabel.OTHER_PERSON) + 7: np.array([0.0, 0.45])}
    assert looked(lost_beside(hidden=someone), (body(0.0, 0.4),)) == [NoStart.NOBODY_NEW]
    (found,) = looked(lost_beside(hidden=someone), (body(0.1, -0.1),))
    assert found.ground_xz_m == pytest.approx([0.1, -0.1], abs=PELVIS_M)


def test_he_is_found_beside_those_who_stayed():
    found = looked(lost_beside(THERAPIST), (THERAPIST,), (THERAPIST, body(0.1, -0.1)))
    assert found[0] is NoStart.NOBODY_NEW
    assert found[1].ground_xz_m == pytest.approx([0.1, -0.1], abs=PELVIS_M)


def test_labels_that_spread_to_him_from_a_therapist_hide_nobody():
    """Of two people who share the therapist's label one is the therapist."""
    search = lost_beside(THERAPIST)
    label = next(iter(search._met))
    patient = seen(body(0.0, 0.0)).memory
    everywhere = np.concatenate([search.memory.points_m, patient.points_m])
    age_s, owner = np.zeros(len(everywhere), np.float32), np.full(len(everywhere), label, np.uint8)
    search.memory = replace(search.memory, points_m=everywhere, owner=owner, age_s=age_s)
    found = looked(search, (THERAPIST, body(0.0, 0.0)))[0]
    assert isinstance(found, PatientChoice)
    assert found.ground_xz_m == pytest.approx([0.0, 0.0], abs=PELVIS_M)


def test_he_cannot_have_run_away_at_once_but_may_have_walked():
    far = body(-0.4, -1.0)
    search = lost_beside(THERAPIST)
    enough = int(np.ceil(1.1 / WALK_M_S / A_FRAME_S))
    found = looked(search, *[(THERAPIST, far)] * enough)
    assert found[0] is NoStart.NOBODY_NEW
    assert found[-1].ground_xz_m == pytest.approx([-0.4, -1.0], abs=PELVIS_M)


def test_of_two_newcomers_the_nearer_is_taken():
    found = looked(lost_beside(), (body(0.0, -0.8), body(0.1, 0.2)))
    assert found[0].ground_xz_m == pytest.approx([0.1, 0.2], abs=PELVIS_M)


@pytest.mark.parametrize("left", [False, True])
def test_who_comes_in_may_be_the_other_who_left_too(left):
    newcomer = body(0.1, -0.1)
    found = looked(lost_beside(THERAPIST, left=left), (newcomer,), first=LATER)[0]
    if left:
        assert found is NoStart.WHO_IS_IT
    else:
        assert isinstance(found, PatientChoice)  # was hidden, not away


def test_a_place_that_was_seen_without_him_says_nothing_about_who_comes_there():
    """He has left the place where he was lost: who stands there later may be the therapist, who is away, too."""
    newcomer = body(0.1, -0.1)
    assert isinstance(looked(lost_beside(THERAPIST), (newcomer,), first=LATER)[0], PatientChoice)
    assert looked(lost_beside(THERAPIST), (), (newcomer,), first=LATER)[1] is NoStart.WHO_IS_IT


def test_who_left_a_few_pixels_of_their_label_on_another_person_is_away():
    """Labels spread where people touch, so a few pixels do not show that the second therapist is in view."""
    search = lost_beside(THERAPIST, left=True)
    (label,) = search._met
    search._met, search._newcomer = frozenset({label, label + 1}), label + 2
    few = np.arange(len(search.memory.owner)) % 20 == 0
    search.memory = replace(search.memory, owner=np.where(few, label + 1, label).astype(np.uint8), next_label=label + 2)
    assert looked(search, (THERAPIST, body(0.1, -0.1)), first=LATER) == [NoStart.WHO_IS_IT]


def test_he_comes_back_while_everybody_else_stays():
    found = looked(lost_beside(THERAPIST, left=True), (THERAPIST,), (THERAPIST, body(0.1, -0.1)), first=LATER)
    assert isinstance(found[1], PatientChoice)


def test_who_comes_in_as_he_leaves_is_another_person_and_stays_one():
    """Two people who walk in opposite directions pass each other outside of the picture."""
    newcomer = body(0.1, -0.1)
    moments = [(THERAPIST, newcomer)] * (LATER + 2)
    assert set(looked(lost_beside(THERAPIST, left=True), *moments)) == {NoStart.NOBODY_NEW}


def view_of(depth_m: np.ndarray, patient: np.ndarray) -> View:
    labels = np.where(patient, PixelLabel.PATIENT, PixelLabel.BACKGROUND).astype(np.uint8)
    return View(depth_m, labels)


def at_left_border(width_m: float, distance_m: float, unread_px: int = 0) -> View:
    """A person of whom width_m is in the picture; the camera reads nothing in the first columns."""
    depth_m = np.full((FRONT.height, FRONT.width), 4.0, np.float32)
    patient = np.zeros(depth_m.shape, bool)
    patient[40:, unread_px : unread_px + round(width_m * FRONT.intrinsics.fx / distance_m)] = True
    depth_m[patient] = distance_m
    depth_m[:, :unread_px] = 0.0
    return view_of(depth_m, patient)


@pytest.mark.parametrize("distance_m", [0.8, 1.5, 3.0])
@pytest.mark.parametrize("unread_px", [0, 8])
def test_a_strip_at_the_border_is_told_from_half_a_person_by_its_width_in_metres(distance_m, unread_px):
    strip, half = (at_left_border(width_m, distance_m, unread_px) for width_m in (0.08, 0.25))
    assert seen_as_strip((strip,), (FRONT,))
    assert not seen_as_strip((half,), (FRONT,))


def test_every_border_may_cut_a_person_off():
    strip = at_left_border(0.08, 1.5)
    right = view_of(strip.depth_m[:, ::-1], strip.patient[:, ::-1])
    low = np.full_like(strip.depth_m, 4.0)
    low[-12:, 60:120] = 1.5
    assert seen_as_strip((right,), (FRONT,))
    assert seen_as_strip((view_of(low, low < 4.0),), (FRONT,))


def test_an_arm_seen_between_others_is_no_strip_and_another_camera_may_see_more():
    strip = at_left_border(0.08, 1.5)
    inside = view_of(np.roll(strip.depth_m, 60, axis=1), np.roll(strip.patient, 60, axis=1))
    assert not seen_as_strip((inside,), (FRONT,))
    assert not seen_as_strip((strip, at_left_border(0.25, 1.5)), (FRONT, FRONT))
    assert not seen_as_strip((None, view_of(strip.depth_m, np.zeros_like(strip.patient))), (FRONT, FRONT))


@pytest.mark.parametrize(
    ("aside_m", "seen", "left"),
    [
        ((3.0, 3.2, 3.4), False, True),
        ((3.0, 3.2, 3.4), True, False),
        ((0.0, 0.2, 0.4), False, False),
        ((-1.39, -1.5, -1.7, -1.8, -1.9), False, True),  # a hip is in the image, by a few pixels
    ],
)
def test_who_is_neither_seen_nor_in_view_has_left(aside_m, seen, left):
    """Near a camera people walk out of its image from one frame to the next; in view, something may hide them."""
    inside = at_left_border(0.6, 1.5) if seen else view_of(np.full((424, 512), 3.0), np.zeros((424, 512), bool))
    tracker = PatientTracker.__new__(PatientTracker)
    tracker.run = SimpleNamespace(room=SimpleNamespace(cameras=(FRONT,)))
    tracker.window = [SimpleNamespace(evidence=SimpleNamespace(views=(inside,)))]
    places_m = np.array([(FRONT.require_pose() @ np.array([x_m, 0.0, 2.0, 1.0]))[:3] for x_m in aside_m])
    tracker.belief, tracker.body = SimpleNamespace(pose=None), SimpleNamespace(joints=lambda pose: places_m)
    assert tracker.has_left == left
