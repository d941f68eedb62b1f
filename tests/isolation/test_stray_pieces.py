"""Pieces of the patient's pixels that continue another person are that person's; what a bar cuts off stays."""

import numpy as np
from room_builder import FRONT, ROOM, body, built_scene, picture

from anchorpose.isolation.patient_label import without_strays
from anchorpose.isolation.scene import Pieces, find_pieces
from anchorpose.isolation.view import PixelLabel

SCENE = built_scene()
PATIENT, OTHER = PixelLabel.PATIENT, PixelLabel.OTHER_PERSON


def two_people() -> tuple[Pieces, np.ndarray]:
    """The pixels of two who stand apart, and their true owners."""
    pixels = find_pieces(picture(FRONT, *ROOM, *body(0.0, -0.4), *body(0.0, 0.4), seed=3), SCENE)
    return pixels, np.where(pixels.points_m[:, 2] < 0.0, PATIENT, OTHER).astype(np.uint8)


def above(pixels: Pieces, true: np.ndarray, below_top_m: float) -> np.ndarray:
    """(n,) owners with the upper end of the other person given to the patient."""
    top_m = pixels.points_m[true == OTHER, 1].max()
    return np.where((true == OTHER) & (pixels.points_m[:, 1] > top_m - below_top_m), np.uint8(PATIENT), true)


def test_a_part_of_another_person_that_was_given_to_the_patient_goes_back():
    pixels, true = two_people()
    given = above(pixels, true, 0.08)
    assert (given != true).sum() > 50
    (found,) = without_strays([pixels], [given])
    assert (found == true).mean() > 0.999


def test_a_piece_larger_than_a_head_stays():
    """Who kneels before a leg that a bar cuts off borders on all of it."""
    pixels, true = two_people()
    given = above(pixels, true, 0.5)
    (found,) = without_strays([pixels], [given])
    np.testing.assert_array_equal(found, given)


def test_the_largest_piece_is_the_patient_even_where_another_person_has_a_part_of_them():
    pixels, true = two_people()
    given = np.where((true == PATIENT) & (pixels.points_m[:, 1] > 1.3), np.uint8(OTHER), true)
    (found,) = without_strays([pixels], [given])
    np.testing.assert_array_equal(found, given)


def test_a_piece_that_touches_nobody_smoothly_stays_the_patients():
    pixels, true = two_people()
    band = (true == PATIENT) & (np.abs(pixels.points_m[:, 1] - 0.9) < 0.06)  # a bar hides it
    kept = pixels.only(~band)
    given = true[~band]
    (found,) = without_strays([kept], [given])
    np.testing.assert_array_equal(found, given)


def test_a_small_contact_is_a_hold_and_changes_nothing():
    pixels, true = two_people()
    above = (true == PATIENT) & (pixels.points_m[:, 1] > 1.0)
    narrow = above & (pixels.points_m[:, 1] < 1.2) & (np.abs(pixels.points_m[:, 2] + 0.4) > 0.04)
    cut = (true == PATIENT) & (np.abs(pixels.points_m[:, 1] - 1.0) < 0.05)
    held = pixels.only(~(cut | narrow))
    given = np.where(true == OTHER, OTHER, PATIENT).astype(np.uint8)[~(cut | narrow)]
    hand = (given == PATIENT) & (np.abs(held.points_m[:, 1] - 1.1) < 0.05)
    given = np.where(hand, np.uint8(OTHER), given)
    (found,) = without_strays([held], [given])
    np.testing.assert_array_equal(found, given)


def test_where_nobody_else_is_seen_nothing_is_given_away():
    pixels, _ = two_people()
    alone = np.full(len(pixels.row), PATIENT, np.uint8)
    assert without_strays([pixels], [alone])[0] is alone
