"""Pieces without a person: which become a hidden limb of the patient, and which stay an unknown object's."""

import numpy as np
import pytest
from room_builder import FRONT, ROOM, built_scene, in_front, picture

from anchorpose.isolation.hidden_limbs import CLUTTER_PER_M3, HiddenSkin, label_hidden_limbs
from anchorpose.isolation.scene import find_pieces
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.equipment import Box

SCENE = built_scene()
FOOT_M, HAND_M = np.array([0.1, 0.05, 0.1]), np.array([0.2, 0.9, -0.3])


def box_at(place_m: np.ndarray) -> Box:
    return Box("piece", place_m, np.full(3, 0.09), np.eye(3))


def skin_at(*places_m: np.ndarray, sigma_m: float = 0.1) -> HiddenSkin:
    """Parts of eight points each, within two centimetres of the places."""
    around = 0.02 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    points = np.concatenate([place + around for place in places_m])
    return HiddenSkin(points, np.full(len(points), sigma_m), np.repeat(np.arange(len(places_m)), 8))


def is_patient(hidden: HiddenSkin, *pieces: Box, named: int = PixelLabel.CLUTTER) -> list[bool]:
    """Whether most of each piece's pixels have the patient's label; named: their label before."""
    found = find_pieces(picture(FRONT, *ROOM, *pieces, seed=3), SCENE)
    labels = found.labels.copy()
    labels[found.row, found.column] = named
    (view,) = label_hidden_limbs([found], [View(found.depth_m, labels)], hidden)
    assert view is not None
    return [bool(view.patient[in_front(FRONT, piece)].mean() > 0.5) for piece in pieces]


def test_a_piece_where_a_limb_is_hidden_is_the_patients_and_others_are_not():
    foot, beside, far = (
        box_at(FOOT_M),
        box_at(FOOT_M + np.array([0.0, 0.0, 0.45])),
        box_at(FOOT_M + np.array([0.0, 1.5, 0.0])),
    )
    assert is_patient(skin_at(FOOT_M), foot, beside, far) == [True, False, False]


def test_each_limb_finds_its_own_piece():
    assert is_patient(skin_at(FOOT_M, HAND_M), box_at(FOOT_M), box_at(HAND_M)) == [True, True]


def test_a_piece_of_another_person_stays_theirs():
    assert is_patient(skin_at(FOOT_M), box_at(FOOT_M), named=PixelLabel.OTHER_PERSON) == [False]


def test_a_limb_that_may_be_anywhere_claims_nothing():
    assert is_patient(skin_at(FOOT_M, sigma_m=0.5), box_at(FOOT_M)) == [False]


def test_without_hidden_limbs_and_without_an_image_nothing_changes():
    nothing = HiddenSkin(np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64))
    assert is_patient(nothing, box_at(FOOT_M)) == [False]
    assert label_hidden_limbs([None], [None], skin_at(FOOT_M)) == (None,)


def test_the_density_is_a_probability_per_cubic_metre():
    """Its integral over space is one for one part."""
    hidden, step_m = skin_at(np.zeros(3), sigma_m=0.06), 0.02
    axis = np.arange(-0.4, 0.4, step_m)
    places = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    assert hidden.density(places).sum() * step_m**3 == pytest.approx(1.0, rel=1e-3)
    assert hidden.density(np.zeros((1, 3)))[0] > CLUTTER_PER_M3
