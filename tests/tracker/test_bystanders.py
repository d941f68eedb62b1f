"""Everybody but the patient: found in any heading and posture, followed as he moves, given up when it is not him."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, asset, before_wall, photograph, points, skin_in, standing, stepped
from scipy.spatial import cKDTree

from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import pose_points
from anchorpose.isolation.bystander_memory import MEMORY_S
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.mesh import build_surface
from anchorpose.tracker import bystanders, observing
from anchorpose.tracker.bystanders import (
    COARSE,
    GROWTH_M_S,
    SKIN_SIGMA_M,
    Bystander,
    Bystanders,
    bystander_likelihood,
    follow_bystanders,
    nodes_of_pixels,
)
from anchorpose.tracker.config import FollowConfig, TrackConfig
from anchorpose.tracker.room import Run

CAMERAS = (FRONT, LEFT)
A_FRAME_S = 1.0 / 15.0
LABEL = int(PixelLabel.OTHER_PERSON) + 1
HEIGHT_M = 1.80  # not what the tracker takes an unknown adult to be

POSTURES = {
    "upright": {},
    "bent": {"LowerBack": (0, 0, -30), "LeftUpLeg": (0, 0, 25), "RightUpLeg": (0, 0, 25), "LeftArm": (0, 0, 40)},
    "squatting": {
        "LeftUpLeg": (0, 0, 90),
        "RightUpLeg": (0, 0, 90),
        "LeftLeg": (0, 0, -100),
        "RightLeg": (0, 0, -100),
        "LeftArm": (0, 0, 50),
        "RightArm": (0, 0, 50),
    },
}


def posed(posture: str, heading_deg: float) -> Pose:
    return standing((0.0, 0.6 if posture == "squatting" else 0.95, 0.0), Hips=(0, heading_deg, 0), **POSTURES[posture])


def views_of(pose: Pose, label: int = LABEL) -> list[View]:
    views = []
    for camera in CAMERAS:
        view = before_wall(photograph(skin_in(pose, adult_body(HEIGHT_M)), camera), camera)
        views.append(View(view.depth_m, np.where(view.patient, label, view.labels).astype(np.uint8)))
    return views


def see(before: Bystanders, pose: Pose, elapsed_s: float = A_FRAME_S) -> Bystanders:
    return follow_bystanders(before, views_of(pose), CAMERAS, points(), elapsed_s)


def the_one(bystanders: Bystanders) -> Bystander:
    (found,) = bystanders.followed
    return found


def off_skin_m(places_m: np.ndarray, pose: Pose) -> np.ndarray:
    """(n,) distance from the true skin."""
    distance, _ = cKDTree(skin_in(pose, adult_body(HEIGHT_M))).query(places_m)
    return distance


@pytest.mark.parametrize("posture", POSTURES)
@pytest.mark.parametrize("heading_deg", [0.0, 100.0, 200.0])
def test_whoever_is_seen_is_found_whatever_he_does(posture, heading_deg):
    """What is seen of him lies on the body's skin; a body turned round by 180 degrees would have its feet elsewhere."""
    pose = posed(posture, heading_deg)
    one = the_one(see(Bystanders(), pose))
    assert one.label == LABEL
    skin = pose_points(one.body, one.belief.pose).points_m
    seen = nodes_of_pixels([v.depth_m for v in views_of(pose)], [v.labels == LABEL for v in views_of(pose)], CAMERAS)
    distance, _ = cKDTree(skin).query(seen.points_m)
    assert np.quantile(distance, 0.9) < 0.04  # skin points are 28 mm apart, and the body has the wrong height


def test_he_is_expected_where_his_movement_leads():
    """Walking at 1.2 m/s he claims the places he will be at, far nearer than where he was."""
    poses = [stepped(posed("upright", 0.0), 0.0, 0.0, 0.08 * k) for k in range(4)]
    found = Bystanders()
    for pose in poses[:3]:
        found = see(found, pose)
    likelihood = bystander_likelihood(found, points(), A_FRAME_S)
    assert (likelihood.owner == LABEL).all()
    ahead, stay = (np.median(off_skin_m(likelihood.points_m, pose)) for pose in (poses[3], poses[2]))
    assert ahead < 0.03
    assert ahead < 0.75 * stay


def test_claims_grow_less_sure_with_time_and_are_surest_in_the_frame_itself():
    found = see(Bystanders(), posed("upright", 0.0))
    now, then = (bystander_likelihood(found, points(), after_s).sigma_m for after_s in (0.0, 0.2))
    assert now == pytest.approx(SKIN_SIGMA_M)
    assert then == pytest.approx(SKIN_SIGMA_M + 0.2 * GROWTH_M_S)


def test_time_may_run_backwards():
    """On the way back to the start he goes on as he went, the other way round."""
    poses = [stepped(posed("upright", 0.0), 0.0, 0.0, 0.08 * k) for k in range(3)]
    found = Bystanders()
    for pose in poses:
        found = see(found, pose, -A_FRAME_S)
    likelihood = bystander_likelihood(found, points(), -A_FRAME_S)
    assert np.median(off_skin_m(likelihood.points_m, stepped(poses[-1], 0.0, 0.0, 0.08))) < 0.03


def test_a_body_that_explains_nothing_any_more_is_given_up_and_found_again():
    """The label jumps by a metre, as when people cross: the old body is nowhere near and must not be dragged along."""
    found = see(Bystanders(), posed("upright", 0.0))
    away = stepped(posed("upright", 0.0), 0.0, 0.0, 1.0)
    again = the_one(see(found, away))
    assert np.linalg.norm(again.belief.pose.root_m - away.root_m) < 0.1
    assert not again.change.any()  # a new body has no movement yet


def test_what_is_not_a_person_is_searched_for_less_and_less_often(monkeypatch):
    """A wall has no body: one search, a pause, one search, a pause twice as long."""
    monkeypatch.setattr(bystanders, "FIRST_PAUSE", 2)
    monkeypatch.setattr(bystanders, "LONGEST_PAUSE", 4)
    depth = np.full((FRONT.height, FRONT.width), 3.0, np.float32)
    labels = np.full(depth.shape, PixelLabel.BACKGROUND, np.uint8)
    labels[100:300, 50:450] = LABEL
    waits, found = [], Bystanders()
    for _ in range(12):
        found = follow_bystanders(found, [View(depth, labels)], [FRONT], points(), A_FRAME_S)
        assert not found.followed
        waits.append(found.searched[0].wait)
    assert waits == [2, 1, 0, 4, 3, 2, 1, 0, 4, 3, 2, 1]


def test_who_has_left_and_a_room_with_nobody_have_no_body():
    shape = FRONT.height, FRONT.width
    empty = [View(np.full(shape, 4.0, np.float32), np.full(shape, PixelLabel.BACKGROUND, np.uint8))] * 2
    found = see(Bystanders(), posed("upright", 0.0))
    for before, views in ((found, empty), (Bystanders(), [None, None])):
        nobody = follow_bystanders(before, views, CAMERAS, points(), A_FRAME_S)
        assert (nobody.followed, nobody.searched) == ((), ())
    assert len(bystander_likelihood(Bystanders(), points(), 0.0)) == 0


def behind_a_wall() -> list[View]:
    """Everything hidden by a wall a metre before each camera."""
    return [
        View(
            np.full((camera.height, camera.width), 1.0, np.float32),
            np.full((camera.height, camera.width), PixelLabel.CLUTTER, np.uint8),
        )
        for camera in CAMERAS
    ]


def test_whom_something_hides_is_kept_for_a_second_less_and_less_surely():
    found = see(Bystanders(), posed("upright", 0.0))
    before, spread = the_one(found), list[float]()
    for _ in range(5):
        found = follow_bystanders(found, behind_a_wall(), CAMERAS, points(), A_FRAME_S)
        kept = the_one(found)
        np.testing.assert_array_equal(kept.belief.pose.root_m, before.belief.pose.root_m)
        spread.append(float(bystander_likelihood(found, points(), 0.0).sigma_m[0]))
    np.testing.assert_allclose(np.diff(spread), GROWTH_M_S * A_FRAME_S, rtol=1e-4)
    assert the_one(see(found, posed("upright", 0.0))).hidden_s == 0.0
    late = follow_bystanders(found, behind_a_wall(), CAMERAS, points(), MEMORY_S)
    assert (late.followed, late.searched) == ((), ())


def with_a_table(views: list[View]) -> list[View]:
    """The views with a table in front of the person's lower half."""
    hidden = []
    for view in views:
        rows = np.flatnonzero((view.labels == LABEL).any(axis=1))
        table = np.zeros(view.labels.shape, dtype=bool)
        table[rows[len(rows) // 2] :] = True
        depth = np.where(table, np.float32(1.0), view.depth_m)
        hidden.append(View(depth, np.where(table, PixelLabel.CLUTTER, view.labels).astype(np.uint8)))
    return hidden


def test_legs_that_nothing_shows_claim_no_place_in_an_initial_frame():
    """A table hides a person's legs, so their place is a guess; pixels of another person may be there."""
    seen = views_of(posed("upright", 0.0))
    for views, least_m, most_m in ((seen, -0.1, 0.1), (with_a_table(seen), 0.3, 1.0)):
        one = the_one(follow_bystanders(Bystanders(), views, CAMERAS, points(), A_FRAME_S))
        assert pose_points(one.body, one.belief.pose).points_m[:, 1].min() < 0.2
        claimed_m = bystanders._shown_skin(one, views, CAMERAS).points_m
        assert least_m < claimed_m[:, 1].min() < most_m
        assert claimed_m[:, 1].max() > 1.6


@pytest.mark.parametrize("heading_deg", [0.0, 90.0, 180.0])
def test_readings_decide_if_the_descriptor_takes_a_front_for_a_back(monkeypatch, heading_deg):
    said = bystanders.matches_of
    monkeypatch.setattr(bystanders, "matches_of", lambda *seen: said(*seen).turned)
    pose = posed("bent", heading_deg)
    found = bystanders.rough_person(views_of(pose), CAMERAS, LABEL)
    assert not found.found.belief.pose.faces_away(pose)


def test_the_nodes_of_pixels_are_those_of_every_cameras_sheet():
    views = views_of(posed("upright", 0.0))
    loose = nodes_of_pixels([v.depth_m for v in views], [v.labels == LABEL for v in views], CAMERAS)
    for number, (view, camera) in enumerate(zip(views, CAMERAS, strict=True)):
        sheet = build_surface(view.depth_m, view.labels == LABEL, camera, COARSE)
        mine = loose.camera == number
        np.testing.assert_array_equal(loose.points_m[mine], sheet.points_m)
        np.testing.assert_array_equal(loose.normals[mine], sheet.normals)
    assert len(nodes_of_pixels([None], [None], [FRONT])) == 0


def test_following_can_be_switched_off():
    """Without bodies of their own, bystanders are only remembered where they were seen."""
    run = Run(SimpleNamespace(cameras=CAMERAS), TrackConfig(follow=FollowConfig(bystanders=False)))
    assert not observing.see_bystanders(Bystanders(), views_of(posed("upright", 0.0)), A_FRAME_S, run).followed


def test_two_arms_are_no_person():
    """A body can be laid over them, but the cameras see past its trunk and legs."""
    pose = standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(60.0, 0.0, 0.0))
    arms = [asset().bone(f"{side}{bone}") + 1 for side in ("Left", "Right") for bone in ("Arm", "ForeArm", "Hand")]
    views = []
    for camera in CAMERAS:
        picture = photograph(skin_in(pose, adult_body(HEIGHT_M)), camera)
        view, kept = before_wall(picture, camera), np.isin(picture.part, arms)
        labels = np.where(kept, LABEL, np.where(view.patient, PixelLabel.BACKGROUND, view.labels)).astype(np.uint8)
        views.append(View(np.where(kept, view.depth_m, np.float32(4.0)), labels))
    found = follow_bystanders(Bystanders(), views, CAMERAS, points(), A_FRAME_S)
    assert found.followed == ()
    assert len(found.searched) == 1
