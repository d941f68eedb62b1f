"""Hands that segmentation gave to the patient: found by the posed skin, and what they touch."""

import numpy as np
import pytest
from body_builder import FRONT, adult_body, before_wall, photograph, points, skin_in, standing

from anchorpose.body.config import VisibilityConfig
from anchorpose.body.contact_regions import REGIONS, find_nearness, region_of_points
from anchorpose.body.hands_on_patient import find_hands
from anchorpose.body.skin_points import pose_points
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.isolation.bystander_memory import BystanderMemory
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.contact_intervals import ContactConfig, ContactIntervals

POSE = standing(LeftArm=(-20.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))
POSED = pose_points(adult_body(), POSE)
ALONE = before_wall(photograph(skin_in(POSE, adult_body()), FRONT), FRONT)
PERSON = 6
HAND_THICKNESS_M = 0.025
LENGTH_PX, HALF_WIDTH_PX = 60, 5  # an arm that ends 40 cm beside the knee, 7 cm wide
INWARDS_PX, OUTWARDS_PX = 7, 20  # of its hand, which is 18 cm long: the wrist is out of reach of the knee's skin


def knee_pixel(side: str) -> tuple[int, int]:
    """Column and row of a knee in the front camera's image."""
    knee_m = adult_body().joints(POSE)[JOINT_INDEX[f"Knee{side.capitalize()}"]]
    column, row, _ = FRONT.pixel_of(transform_points(invert_rigid(FRONT.require_pose()), knee_m[None]))
    return int(column[0]), int(row[0])


def reaching(side: str, gap_m: float, hand_label: int = PixelLabel.PATIENT) -> View:
    """An arm from outside to a knee, its palm so far from the skin; the hand has a label of its own."""
    column, row = knee_pixel(side)
    outwards = 1 if column > knee_pixel("right" if side == "left" else "left")[0] else -1
    depth_m, labels = ALONE.depth_m.copy(), ALONE.labels.copy()
    for along in range(-INWARDS_PX, LENGTH_PX):
        place = slice(row - HALF_WIDTH_PX, row + HALF_WIDTH_PX), column + outwards * along
        depth_m[place] = ALONE.depth_m[row, column] - HAND_THICKNESS_M - gap_m
        labels[place] = hand_label if along < OUTWARDS_PX else PERSON
    return View(depth_m, labels)


def seen_of_person(view: View) -> BystanderMemory:
    row, column = np.nonzero(view.labels == PERSON)
    place_m = transform_points(FRONT.require_pose(), FRONT.back_project(view.depth_m)[row, column])
    count = len(place_m)
    return BystanderMemory(
        place_m.astype(np.float32), np.full(count, PERSON, np.uint8), np.zeros(count, np.float32), PERSON + 1
    )


def touched(view: View) -> dict[str, bool]:
    """The parts that are touched after half a second of the same view, and whether that is seen."""
    near = find_nearness(adult_body(), POSED, seen_of_person(view), (view,), (FRONT,), VisibilityConfig())
    intervals = ContactIntervals(region_of_points(points()), ContactConfig())
    for frame in range(6):
        list(intervals.push(frame, frame / 10.0, near))
    return intervals.touched_now(by_equipment=False)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_hand_on_the_knee_touches_it_though_its_pixels_were_taken_for_the_patient(side):
    parts = touched(reaching(side, gap_m=0.0))
    assert parts[f"knee_{side}"]
    assert all(part.endswith(side) for part in parts)


def test_the_hand_is_found_where_it_is_and_belongs_to_the_person_of_the_arm():
    view = reaching("left", gap_m=0.0)
    place_m, owner = find_hands(POSED, (view, None), (FRONT, FRONT))
    knee_m = adult_body().joints(POSE)[JOINT_INDEX["KneeLeft"]]
    assert set(owner) == {PERSON}
    assert np.linalg.norm(place_m - knee_m, axis=1).max() < 0.2
    mine = view.labels == PixelLabel.PATIENT
    standing_off = (mine & (ALONE.depth_m - view.depth_m > HAND_THICKNESS_M / 2))[::2, ::2].sum()
    assert len(place_m) > 0.9 * standing_off


@pytest.mark.parametrize("hand_label", [PixelLabel.PATIENT, PERSON])
def test_who_is_ten_centimetres_away_touches_nobody(hand_label):
    away = reaching("left", gap_m=0.10, hand_label=hand_label)
    assert touched(away) == {}


def test_mirrored_scenes_have_mirrored_contacts():
    left, right = (touched(reaching(side, gap_m=0.0)) for side in ("left", "right"))
    assert {part.replace("left", "right"): seen for part, seen in left.items()} == right
    assert set(left) <= set(REGIONS)


def test_skin_that_stands_off_alone_is_nobodys_hand():
    joined = reaching("left", gap_m=0.0)
    away = np.where(joined.labels == PERSON, PixelLabel.BACKGROUND, joined.labels).astype(np.uint8)
    apart = away.copy()
    apart[:6, :6] = PERSON  # somebody elsewhere in the image
    for labels in (away, apart):
        place_m, owner = find_hands(POSED, (View(joined.depth_m, labels),), (FRONT,))
        assert (len(place_m), len(owner)) == (0, 0)


def test_a_person_beside_the_patient_has_no_hands_on_them():
    view = reaching("left", gap_m=0.0)
    labels = np.where(view.depth_m < ALONE.depth_m - 0.01, PERSON, view.labels).astype(np.uint8)
    place_m, _ = find_hands(POSED, (View(ALONE.depth_m, np.where(labels == PERSON, labels, ALONE.labels)),), (FRONT,))
    assert len(place_m) == 0  # every reading of the patient lies on the posed skin
