"""The likelihood of images where a body has a pose."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, Change, adult_body, asset, camera_at, hide_bones, seen_body, standing, stepped
from scipy.ndimage import distance_transform_edt

from anchorpose.body.evidence import Evidence
from anchorpose.body.likelihood import LEAST_SEEN, likelihood, render_skin, skin_faces
from anchorpose.body.pose import LIMB_OF_BONES, MOVING_BONES, TRUNK, Pose
from anchorpose.body.pose_probability import log_probability
from anchorpose.body.skin_points import body_points, pose_points
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX
from anchorpose.simulate.render import TrueImage

BODY = adult_body()
TRUTH = standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
SEEN = seen_body(TRUTH, BODY)
LEFT_ARM = int(LIMB_OF_BONES[MOVING_BONES.index("LeftForeArm")])
ARM_BONES = tuple(f"Left{bone}" for bone in ("Shoulder", "Arm", "ForeArm", "Hand", "FingerBase", "HandFinger1"))


def labelled(evidence: Evidence, old: PixelLabel, new: PixelLabel) -> Evidence:
    views = [
        View(view.depth_m, np.where(view.labels == old, np.uint8(new), view.labels))
        for view in evidence.views
        if view is not None
    ]
    return replace(evidence, views=tuple(views))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_farther_a_body_has_strayed_the_less_likely_are_the_images(axis):
    logs = [likelihood(BODY, stepped(TRUTH, *(off * np.eye(3)[axis])), SEEN).total for off in (0.0, 0.03, 0.06, 0.12)]
    assert (np.diff(logs) < 0.0).all(), logs


def loose_clothes(wider_m: float) -> Change:
    """A change for ``seen_body``: the patient's outline is wider by this much on every side."""

    def change(view: View, _: TrueImage) -> View:
        own = view.labels == PixelLabel.PATIENT
        away, nearest = distance_transform_edt(~own, return_indices=True)
        pixel_m = float(np.median(view.depth_m[own])) / FRONT.intrinsics.fx
        clothes = ~own & (away * pixel_m <= wider_m)
        labels = np.where(clothes, np.uint8(PixelLabel.PATIENT), view.labels)
        return View(np.where(clothes, view.depth_m[tuple(nearest)], view.depth_m), labels)

    return change


@pytest.mark.parametrize("wider_m", [0.0, 0.01, 0.02])
def test_loose_clothes_do_not_make_a_taller_person_likelier(wider_m):
    """Otherwise, a body that fills the clothes counts as better than the right body, by its area."""
    clothed = seen_body(standing(), adult_body(1.65), change=loose_clothes(wider_m))
    shifts_m = np.linspace(-0.04, 0.08, 7)

    def best(height_m: float) -> float:
        body = adult_body(height_m)
        return max(likelihood(body, stepped(standing(), 0.0, up_m, 0.0), clothed).total for up_m in shifts_m)

    right, *others = (best(height_m) for height_m in (1.65, 1.60, 1.70, 1.75, 1.80))
    assert right > max(others) + 20.0, (right, others)


def test_a_wrong_limb_costs_by_itself():
    wrong = standing(LeftArm=(-20.0, 0.0, 70.0), RightArm=(-20.0, 0.0, 0.0))
    right, other = likelihood(BODY, TRUTH, SEEN), likelihood(BODY, wrong, SEEN)
    assert other.log[LEFT_ARM].sum() < right.log[LEFT_ARM].sum() / 3.0
    assert other.past[LEFT_ARM].sum() > right.past[LEFT_ARM].sum()
    assert np.argmax((right.log - other.log).sum(axis=1)) == LEFT_ARM


@pytest.mark.parametrize("pose", [TRUTH, standing(LeftArm=(-20.0, 0.0, 70.0))])
def test_what_is_hidden_tells_nothing(pose: Pose):
    """Wherever an arm is: an image in which every pixel may hide it says nothing about it."""
    dark = labelled(
        labelled(SEEN, PixelLabel.PATIENT, PixelLabel.NO_READING), PixelLabel.BACKGROUND, PixelLabel.NO_READING
    )
    found = likelihood(BODY, pose, dark)
    assert found.total == 0.0
    assert found.hidden.sum() > 0.0
    assert found.explained.sum() == found.past.sum() == 0.0


def test_another_person_s_pixels_explain_no_skin_and_hide_what_is_behind_them():
    theirs = labelled(SEEN, PixelLabel.PATIENT, PixelLabel.OTHER_PERSON)
    assert likelihood(BODY, TRUTH, theirs).total <= 0.0
    behind, in_front = (likelihood(BODY, stepped(TRUTH, off_m, 0.0, 0.0), theirs) for off_m in (-0.2, 0.2))
    assert behind.past.sum() < 0.1 * behind.hidden.sum()  # the outline of who stands behind is a little smaller
    assert in_front.past.sum() > 10.0 * in_front.hidden.sum()


def test_a_person_with_another_label_is_judged_by_that_label():
    theirs = replace(labelled(SEEN, PixelLabel.PATIENT, PixelLabel.OTHER_PERSON), label=PixelLabel.OTHER_PERSON)
    assert likelihood(BODY, TRUTH, theirs).total == pytest.approx(likelihood(BODY, TRUTH, SEEN).total)


def test_a_body_behind_the_camera_is_not_seen():
    assert likelihood(BODY, stepped(TRUTH, 50.0, 0.0, 0.0), SEEN).total == 0.0


def test_the_range_of_the_joints_counts_besides():
    bent = standing(LeftArm=(60.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0), LeftHand=(80.0, 80.0, 0.0))
    hidden = seen_body(TRUTH, BODY, change=hide_bones(*ARM_BONES))
    usual, rare = (log_probability(BODY, pose, hidden) for pose in (TRUTH, bent))
    assert usual > rare + 5.0


def test_the_skin_is_drawn_where_the_simulator_draws_it():
    (view,) = SEEN.views
    assert view is not None
    drawn = render_skin(body_points(), pose_points(BODY, TRUTH).points_m, SEEN.cameras[0], 0.0)
    assert drawn is not None
    both = view.patient & np.isfinite(drawn.depth_m)
    assert both.sum() > 0.93 * (view.patient | np.isfinite(drawn.depth_m)).sum()
    assert np.percentile(np.abs(drawn.depth_m - view.depth_m)[both], 95) < 0.015


def test_the_triangles_between_skin_points_close_the_skin():
    """Every edge belongs to two triangles, but for the few where the body's asset itself is open."""
    faces = skin_faces(body_points())
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert np.mean(count == 2) > 0.97
    posed = pose_points(BODY, TRUTH)
    corners = posed.points_m[faces]
    assert np.percentile(np.linalg.norm(corners[:, 0] - corners[:, 1], axis=1), 99) < 0.08


def test_feet_in_the_air_are_less_likely_the_higher_and_cost_at_most_six_nats_each():
    floor = replace(SEEN, floor_m=0.0, views=(None,) * len(SEEN.views))
    stands = standing((0.0, 0.0, 0.0))
    lowest_m = float(pose_points(BODY, stands).points_m[:, 1].min())
    logs = [log_probability(BODY, stepped(stands, 0.0, up_m - lowest_m, 0.0), floor) for up_m in (0.0, 0.1, 0.3, 30.0)]
    assert (np.diff(logs) < 0.0).all()
    assert 11.0 < logs[0] - logs[-1] < 13.0


@pytest.mark.parametrize(("shown_m", "seen"), [(0.05, False), (0.25, True)])
def test_a_strip_of_a_thigh_does_not_show_the_thigh(shown_m, seen):
    """Nothing is read of the left leg farther from the hip than ``shown_m``."""
    hip = BODY.joints(TRUTH)[JOINT_INDEX["HipLeft"]]

    def hidden(view: View, picture: TrueImage) -> View:
        below = np.isin(picture.part, [asset().bone(f"Left{bone}") + 1 for bone in ("UpLeg", "Leg", "Foot", "ToeBase")])
        row = int((picture.part > 0).any(axis=1).argmax())  # of the top of the head
        height_px = int(np.ptp(np.flatnonzero((picture.part > 0).any(axis=1))))
        top_m = BODY.joints(TRUTH)[:, 1].max() + 0.1
        below[: row + int((top_m - hip[1] + shown_m) / 1.8 * height_px)] = False
        labels = np.where(below, np.uint8(PixelLabel.NO_READING), view.labels)
        return View(np.where(below, np.float32(0.0), view.depth_m), labels)

    found = likelihood(BODY, TRUTH, seen_body(TRUTH, BODY, (FRONT,), hidden))
    leg = int(LIMB_OF_BONES[MOVING_BONES.index("LeftUpLeg")])
    assert found.explained[leg, 0] > LEAST_SEEN
    assert found.seen[leg, 0] == seen


def test_a_chest_may_be_seen_where_the_pelvis_is_hidden():
    found = likelihood(
        BODY, TRUTH, seen_body(TRUTH, BODY, (FRONT,), hide_bones("Hips", "LHipJoint", "RHipJoint", "LowerBack"))
    )
    assert found.seen[TRUNK].tolist() == [False, True]


def test_a_part_that_a_camera_shows_is_seen_however_many_views_are_blocked():
    """From the front, the lower two thirds of the shanks are hidden; from the sides, a person hides everything."""
    place_m = transform_points(invert_rigid(FRONT.require_pose()), BODY.joints(TRUTH))
    row = FRONT.intrinsics.fy * place_m[:, 1] / place_m[:, 2] + FRONT.intrinsics.cy
    knee, ankle = (row[JOINT_INDEX[name]] for name in ("KneeLeft", "AnkleLeft"))

    def hidden(view: View, picture: TrueImage) -> View:
        below = np.arange(len(view.labels))[:, None] > knee + 0.35 * (ankle - knee)
        labels = np.where(below, np.uint8(PixelLabel.NO_READING), view.labels)
        return View(np.where(below, np.float32(0.0), view.depth_m), labels)

    bar = seen_body(TRUTH, BODY, (FRONT,), hidden)
    sides = [camera_at((0.9, 1.2, z), (0.0, 0.9, 0.0), name) for z, name in ((-2.2, "left"), (2.2, "right"))]
    blocked = [
        View(np.full((one.height, one.width), 0.5, np.float32), np.full((one.height, one.width), 9, np.uint8))
        for one in sides
    ]
    three = replace(bar, views=(*bar.views, *blocked), cameras=(FRONT, *sides), outlines=(None,) * 3)
    alone, together = (likelihood(BODY, TRUTH, evidence) for evidence in (bar, three))
    np.testing.assert_array_equal(together.seen, alone.seen)
    assert alone.seen[int(LIMB_OF_BONES[MOVING_BONES.index("LeftLeg")])].all()
