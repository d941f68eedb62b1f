"""Little tells how long a limb is that is seen end on: it is less certain than the frames before say."""

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, hide_bones, joints_of, seen_body, standing

from anchorpose.body.config import RegistrationConfig
from anchorpose.body.likelihood import likelihood
from anchorpose.body.pose import LIMB_OF_JOINTS
from anchorpose.body.uncertainty import frame_alone_sigma
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX

BODY, SIGMA = adult_body(), np.full(21, 0.005)
POINTING = standing(LeftArm=(20.0, -60.0, 40.0), RightArm=(-25.0, 0.0, 0.0))
"""The left arm points at the camera in front, the right one hangs down."""

ARM = [JOINT_INDEX[f"{name}Left"] for name in ("Shoulder", "Elbow", "Wrist", "Hand")]
OTHERS = np.setdiff1d(np.arange(21), ARM)


def sigma_of(evidence, pose=POINTING):
    return frame_alone_sigma(BODY, pose, evidence, SIGMA, RegistrationConfig(), 0.0035)


def test_an_arm_that_points_at_the_only_camera_is_as_certain_as_its_frame_makes_it():
    joints = joints_of(BODY, POINTING)
    along = joints[JOINT_INDEX["WristLeft"]] - joints[JOINT_INDEX["ShoulderLeft"]]
    assert along[0] > 0.9 * np.linalg.norm(along)
    found = sigma_of(seen_body(POINTING, BODY, (FRONT,)))
    assert (found[ARM] > SIGMA[ARM]).all()
    assert found[JOINT_INDEX["ElbowLeft"]] > 2.0 * SIGMA[0]
    np.testing.assert_array_equal(found[OTHERS], SIGMA[OTHERS])


def test_a_camera_at_the_side_shows_where_the_elbow_is():
    np.testing.assert_array_equal(sigma_of(seen_body(POINTING, BODY, (FRONT, LEFT))), SIGMA)


def test_an_arm_behind_another_person_is_as_certain_as_the_frames_before_make_it():
    def somebody_before(view, picture):
        """All that is not the patient's right half is a person who stands in front."""
        hidden = np.arange(view.labels.shape[1]) > 0.5 * view.labels.shape[1] - 5
        labels = np.where(hidden, PixelLabel.OTHER_PERSON, view.labels).astype(np.uint8)
        return View(np.where(hidden, np.float32(1.0), view.depth_m), labels)

    np.testing.assert_array_equal(sigma_of(seen_body(POINTING, BODY, (FRONT,), somebody_before)), SIGMA)


def test_arms_that_hang_down_keep_their_sigma():
    pose = standing(LeftArm=(-25.0, 0.0, 0.0), RightArm=(-25.0, 0.0, 0.0))
    np.testing.assert_array_equal(sigma_of(seen_body(pose, BODY, (FRONT,)), pose), SIGMA)


def test_a_limb_that_was_never_seen_is_as_certain_as_the_range_of_its_joints_makes_it():
    """A hidden leg: the frames before cannot know where it is, whatever sigma they state."""
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    leg = int(LIMB_OF_JOINTS[JOINT_INDEX["KneeLeft"]])
    unseen = never_seen(evidence)
    assert np.isinf(unseen[leg]).all()
    found = frame_alone_sigma(BODY, standing(), evidence, SIGMA, RegistrationConfig(), 0.0035, unseen)
    mine = leg == LIMB_OF_JOINTS
    assert (found[mine] > 0.05).all()
    np.testing.assert_array_equal(found[~mine], SIGMA[~mine])


def test_a_shank_that_was_never_seen_leaves_its_knee_certain():
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftLeg", "LeftFoot", "LeftToeBase"))
    found = frame_alone_sigma(BODY, standing(), evidence, SIGMA, RegistrationConfig(), 0.0035, never_seen(evidence))
    mine = [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["FootLeft"]]
    assert (found[mine] > 0.05).all()
    np.testing.assert_array_equal(np.delete(found, mine), np.delete(SIGMA, mine))


def test_a_hidden_limb_becomes_more_uncertain_with_the_time_since_it_was_seen():
    """In half a second thighs turn by 18 degrees about each axis; the knee is 0.4 m from the hip."""
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    hidden = never_seen(evidence) > 0.0
    knee = JOINT_INDEX["KneeLeft"]

    def knee_sigma(unseen_s: float) -> float:
        times = np.where(hidden, unseen_s, 0.0)
        return frame_alone_sigma(BODY, standing(), evidence, SIGMA, RegistrationConfig(), 0.0035, times)[knee]

    assert knee_sigma(0.0) == SIGMA[knee]
    grown = np.array([knee_sigma(seconds) for seconds in (0.01, 0.1, 0.25, 0.5, np.inf)])
    assert (np.diff(grown) > 0.0).all()
    assert np.sqrt(grown[3] ** 2 - grown[0] ** 2) == pytest.approx(0.4 * np.radians(18.0), rel=0.2)


def never_seen(evidence) -> np.ndarray:
    """(PARTS, 2) seconds, as in ``vague_belief``: of the left leg what the first frame does not show was never seen."""
    leg = int(LIMB_OF_JOINTS[JOINT_INDEX["KneeLeft"]])
    unseen = ~likelihood(BODY, standing(), evidence).seen
    unseen[np.arange(len(unseen)) != leg] = False
    return np.where(unseen, np.inf, 0.0)
