"""Other people among the patient's pixels: who is split off, when, and who stays the patient."""

import numpy as np
import pytest
from room_builder import FRONT, ROOM, body, built_scene, in_front, picture

from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.equipment import Box
from anchorpose.tracker.one_patient import one_patient

SCENE = built_scene()
PATIENT, FREE = int(PixelLabel.PATIENT), 9
HERE = np.zeros(2)
NOWHERE = np.zeros((0, 3))


def pieces_of(*parts):
    return find_pieces(picture(FRONT, *ROOM, *parts, seed=3), SCENE)


def skin_of(*parts) -> np.ndarray:
    """The places of the pixels that show these parts alone."""
    return pieces_of(*parts).points_m[::3]


def labelled(parts, skin_m, due: bool, place_xz_m=HERE, named=PATIENT) -> np.ndarray:
    """The labels after the test of a frame in which all these parts had the same label."""
    pieces = pieces_of(*parts)
    labels = pieces.labels.copy()
    labels[pieces.row, pieces.column] = named
    free = np.arange(FREE, 255, dtype=np.uint8)
    (view,) = one_patient([pieces], [View(pieces.depth_m, labels)], [FRONT], skin_m, place_xz_m, free, due)
    assert view is not None
    return view.labels


def most_of(labels, *parts, behind=()) -> int:
    """The label of most pixels on which these parts are seen."""
    seen = picture(FRONT, *ROOM, *parts, *behind) < picture(FRONT, *ROOM, *behind) - 1e-3
    return int(np.bincount(labels[seen & in_front(FRONT, *parts)]).argmax())


def test_people_off_the_expected_skin_are_split_off_at_once():
    one, other = body(0, 0), body(0.2, 0.8)
    for skin_m in (skin_of(*one), NOWHERE):
        labels = labelled([*one, *other], skin_m, due=False)
        assert (most_of(labels, *one), most_of(labels, *other)) == (PATIENT, FREE)


def test_a_body_drawn_onto_another_person_is_noticed_when_the_descriptor_is_due():
    """The wrong body has the trunk of one person and the legs of the other: no pixel is far from it."""
    one, other = body(0, 0), body(0.2, 0.8)
    trunk, legs = skin_of(*one), skin_of(*other)
    wrong = np.concatenate([trunk[trunk[:, 1] > 0.8], legs[legs[:, 1] < 0.8]])
    asked = labelled([*one, *other], wrong, due=True)
    assert (most_of(asked, *one), most_of(asked, *other)) == (PATIENT, FREE)


def test_pixels_that_one_body_explains_are_not_divided_although_the_descriptor_finds_two_people():
    """Somebody who squats low may look like two people."""
    one, other = body(0, 0), body(0.2, 0.8)
    for due in (False, True):
        labels = labelled([*one, *other], skin_of(*one, *other), due)
        assert most_of(labels, *one) == most_of(labels, *other) == PATIENT


def test_the_patient_is_the_person_at_the_expected_place_not_the_one_who_shows_more():
    far, near = body(-0.4, 0), body(0.9, 0.7)
    for place, patient, other in ((np.array([-0.4, 0.0]), far, near), (np.array([0.9, 0.7]), near, far)):
        labels = labelled([*far, *near], NOWHERE, due=True, place_xz_m=place)
        assert (most_of(labels, *patient), most_of(labels, *other)) == (PATIENT, FREE)


@pytest.mark.parametrize("foreseen", [True, False])
def test_a_second_column_is_the_patients_where_their_skin_is_predicted(foreseen):
    """Somebody who bends down has trunk and legs in two columns, each as large as a person."""
    trunk, legs = body(0.3, 0.55), body(0, 0)[:1]
    joint = Box("arm", np.array([0.15, 1.0, 0.27]), np.array([0.08, 0.08, 0.5]), np.eye(3))
    skin_m = skin_of(*trunk, *legs, joint) if foreseen else skin_of(*trunk)
    labels = labelled([*trunk, *legs, joint], skin_m, due=False, place_xz_m=np.array([0.3, 0.55]))
    assert most_of(labels, *legs, behind=(*trunk, joint)) == (PATIENT if foreseen else FREE)


def test_one_person_is_never_divided_and_others_keep_their_labels():
    one = body(0, 0, LeftArm=(0.0, 0.0, 0.0))
    for due in (False, True):
        assert not (labelled(one, NOWHERE, due) >= FREE).any()
    both = labelled([*one, *body(0.2, 0.8)], NOWHERE, due=True, named=PATIENT + 1)
    assert not (both >= FREE).any()


def test_a_camera_without_a_frame_stays_without_a_view():
    assert one_patient([None], [None], [FRONT], NOWHERE, HERE, np.zeros(0, np.uint8), True) == (None,)
