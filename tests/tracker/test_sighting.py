"""Everybody in a frame with a rough body: where the pelvis is, which way they face, and whose pixels are whose."""

from collections.abc import Sequence

import numpy as np
import pytest
from body_builder import adult_body, asset, child_body, photograph, skin_in, standing, stepped
from room_builder import FRONT, ROOM, built_scene, camera_at, picture

from anchorpose.body.shape_prior import standing_height
from anchorpose.body.skin_points import Body, body_points
from anchorpose.isolation.people import PERSON_AREA_M2, PatientChoice, see_people
from anchorpose.isolation.scene import find_all_pieces
from anchorpose.isolation.separation import separate_initial
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.bystanders import Bystanders, follow_bystanders, label_by_bodies, rough_person
from anchorpose.tracker.sighting import sight_people

SIDE = camera_at((1.2, 1.3, -2.2), (0.0, 0.9, 0.0))
CAMERAS = (FRONT, SIDE)
SCENES = [built_scene(camera=camera) for camera in CAMERAS]


def photographed(*poses, bodies: Sequence[Body] | None = None) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Depth images of naked people in a room with a wall and a floor, and who is in each pixel, numbered from 1.

    bodies: of each; adults where None.
    """
    depths, truth = [], []
    for camera in CAMERAS:
        depth = picture(camera, *ROOM, seed=5)
        who = np.zeros(depth.shape, int)
        for number, pose in enumerate(poses, 1):
            body = adult_body() if bodies is None else bodies[number - 1]
            person = photograph(skin_in(pose, body), camera).depth_m
            nearer = (person > 0) & (person < depth)
            depth, who[nearer] = np.where(nearer, person, depth), number
        depths.append(depth)
        truth.append(who)
    return depths, truth


def seen(*poses):
    depths, _ = photographed(*poses)
    return sight_people(FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths)), SCENES)


def turned(angle_deg: float, x: float, z: float):
    return stepped(standing(Hips=(0.0, angle_deg, 0.0)), x, 0.0, z)


def test_each_has_a_body_where_it_stands_and_faces_where_it_faces():
    found = seen(turned(0.0, 0.0, 0.6), turned(90.0, 0.1, -0.6))
    people = sorted(found.people, key=lambda one: -one.place_xz_m[1])
    assert len(people) == 2
    for person, place, facing in zip(people, [(0.0, 0.6), (0.1, -0.6)], [(1.0, 0.0), (0.0, -1.0)], strict=True):
        assert person.body.explained > 0.9
        assert person.place_xz_m == pytest.approx(place, abs=0.08)
        assert person.body.facing_xz @ facing > 0.9


@pytest.mark.thorough
@pytest.mark.parametrize("height_m", [1.05, 1.3])
def test_a_child_has_the_body_of_a_child_and_an_adult_beside_it_that_of_an_adult(height_m):
    """An adult's body that crouches may fit a child, but not as well."""
    child = child_body(height_m)
    hips = asset().bone("Hips")
    lower_m = float(adult_body().mesh.bone_heads[hips, 1] - child.mesh.bone_heads[hips, 1])
    small = stepped(standing(), 0.0, -lower_m, 0.7)
    depths, truth = photographed(small, turned(0.0, 0.0, -0.7), bodies=[child, adult_body()])
    heights = []
    for number in (1, 2):
        views = [
            View(d, np.where(who == number, PixelLabel.PATIENT, 0).astype(np.uint8))
            for d, who in zip(depths, truth, strict=True)
        ]
        person = rough_person(views, CAMERAS, PixelLabel.PATIENT)
        assert person.found.explained > 0.9
        heights.append(standing_height(asset(), person.body.shape)[0])
    assert heights[0] == pytest.approx(height_m, abs=0.11)  # two steps of rough bodies
    assert heights[1] > 1.6


def test_a_person_who_shows_only_a_chest_is_a_person():
    """Less than a fifth of an adult."""
    depths, truth = photographed(standing(), turned(180.0, 0.0, 1.0))
    first = np.argwhere(truth[0] == 1)
    hidden = first[first[:, 0] > np.percentile(first[:, 0], 24)]
    depths[0][tuple(hidden.T)] = 0.0
    found = sight_people(FrameSet(frame=0, time_s=0.0, depths_m=(depths[0],)), SCENES[:1])
    chest, _ = sorted(found.people, key=lambda one: one.place_xz_m[1])
    assert chest.person.area_m2 < PERSON_AREA_M2
    assert chest.body.past < 0.25
    assert chest.place_xz_m == pytest.approx((0.0, 0.0), abs=0.12)


def test_an_arm_beside_the_body_is_no_person():
    reaching = standing(LeftArm=(0, 0, 0), LeftForeArm=(-80, 0, 0))
    depths, _ = photographed(reaching, turned(0.0, 0.0, 1.2))
    found = sight_people(FrameSet(frame=0, time_s=0.0, depths_m=(depths[0],)), SCENES[:1])
    assert len(found.people) == 2


def test_nobody_is_nobody():
    assert seen().people == ()


@pytest.mark.thorough
@pytest.mark.parametrize("away_m", [0.45, 0.5, 0.55])
def test_bodies_give_back_what_grew_over_people_who_touch(away_m):
    """Somebody beside the patient reaches across the patient's chest; more pixels are right than without bodies."""
    reaching = stepped(standing(Hips=(0, 90, 0), LeftArm=(0, 0, 70), RightArm=(0, 0, 70)), 0.05, 0.0, away_m)
    depths, truth = photographed(standing(), reaching)
    pieces = find_all_pieces(FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths)), SCENES)
    first = separate_initial(pieces, see_people(pieces, CAMERAS), PatientChoice(np.zeros(2), "", sure=True))
    others = follow_bystanders(Bystanders(), first, CAMERAS, body_points(), 0.0)
    assert others.followed
    patient = rough_person(first, CAMERAS, PixelLabel.PATIENT)
    assert patient is not None
    again = label_by_bodies(pieces, first, patient, others, CAMERAS)

    def wrong(views) -> int:
        return sum(
            int((view.patient & (who == 2)).sum() + (~view.patient & (who == 1)).sum())
            for view, who in zip(views, truth, strict=True)
        )

    assert wrong(again) < 0.7 * wrong(first)


def test_a_person_without_a_body_keeps_their_pixels():
    """A head behind the patient is too little for a body; it has a label since the descriptor found a person there."""
    behind = stepped(standing(), -0.8, 0.0, 0.45)
    depths, truth = photographed(standing(), behind)
    pieces = find_all_pieces(FrameSet(frame=0, time_s=0.0, depths_m=tuple(depths)), SCENES)
    views = list[View]()
    for pixels, who in zip(pieces, truth, strict=True):
        assert pixels is not None
        part = (who == 2) & (np.arange(who.shape[0])[:, None] < np.flatnonzero((who == 2).any(axis=1))[0] + 12)
        labels = np.where(who == 1, PixelLabel.PATIENT, np.where(part, 7, pixels.labels)).astype(np.uint8)
        views.append(View(pixels.depth_m, labels))
    patient = rough_person(views, CAMERAS, PixelLabel.PATIENT)
    assert patient is not None
    again = label_by_bodies(pieces, tuple(views), patient, Bystanders(), CAMERAS)
    for before, after in zip(views, again, strict=True):
        assert after is not None
        assert (after.labels[before.labels == 7] == 7).mean() > 0.9
