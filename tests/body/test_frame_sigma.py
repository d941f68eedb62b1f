"""A frame alone limits how certain its joints are, whatever the frames before say."""

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, hide_bones, joints_of, seen_body, standing

from anchorpose.body.config import RegistrationConfig, UncertaintyConfig
from anchorpose.body.likelihood import likelihood
from anchorpose.body.pose import LIMB_OF_JOINTS, POSE_SIZE
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import frame_errors, joint_sigma
from anchorpose.joints import JOINT_INDEX

BODY, CERTAIN = adult_body(), np.zeros((POSE_SIZE, POSE_SIZE))
"""A pose that frames before show without any error."""
POINTING = standing(LeftArm=(20.0, -60.0, 40.0), RightArm=(-25.0, 0.0, 0.0))
"""The left arm points at the camera in front, the right one hangs down."""

LEFT_ELBOW, RIGHT_ELBOW = JOINT_INDEX["ElbowLeft"], JOINT_INDEX["ElbowRight"]


def sigma_of(evidence, pose=POINTING, unseen_s=None, covariance=CERTAIN) -> np.ndarray:
    frame = frame_errors(BODY, pose, evidence, RegistrationConfig(), unseen_s=unseen_s)
    return joint_sigma(BODY, pose_points(BODY, pose), covariance, UncertaintyConfig(), frame=frame)


def test_joints_in_plain_view_are_certain_to_two_centimetres():
    found = sigma_of(seen_body(standing(), BODY, (FRONT, LEFT)), standing())
    nothing = joint_sigma(BODY, pose_points(BODY, standing()), CERTAIN, UncertaintyConfig())
    assert (found > nothing).all()
    assert (found < 0.02).all(), found


def test_a_larger_sigma_of_the_frames_before_is_kept():
    evidence, wide = seen_body(standing(), BODY, (FRONT,)), np.zeros((POSE_SIZE, POSE_SIZE))
    wide[-3:, -3:] = 0.5**2 * np.eye(3)  # the whole body may be elsewhere
    before = joint_sigma(BODY, pose_points(BODY, standing()), wide, UncertaintyConfig())
    np.testing.assert_allclose(sigma_of(evidence, standing(), covariance=wide), before)


def test_an_arm_that_points_at_the_only_camera_is_less_certain_than_an_arm_that_hangs_down():
    joints = joints_of(BODY, POINTING)
    along = joints[JOINT_INDEX["WristLeft"]] - joints[JOINT_INDEX["ShoulderLeft"]]
    assert along[0] > 0.9 * np.linalg.norm(along)
    one, two = (sigma_of(seen_body(POINTING, BODY, cameras)) for cameras in ((FRONT,), (FRONT, LEFT)))
    assert one[LEFT_ELBOW] > 1.2 * one[RIGHT_ELBOW]
    assert one[LEFT_ELBOW] > 1.2 * two[LEFT_ELBOW]  # a camera at the side shows where the elbow is


def test_a_forearm_that_this_frame_does_not_show_is_uncertain_whatever_frames_before_state():
    wrist, trunk = JOINT_INDEX["WristRight"], JOINT_INDEX["SpineMid"]
    whole = seen_body(standing(), BODY, (FRONT,))
    without = seen_body(standing(), BODY, (FRONT,), hide_bones("RightHand", "RightFingerBase", "RightForeArm"))
    seen, hidden = sigma_of(whole, standing()), sigma_of(without, standing())
    assert hidden[wrist] > 4.0 * seen[wrist]
    assert hidden[trunk] < 1.1 * seen[trunk]


def test_a_limb_that_was_never_seen_is_as_certain_as_the_range_of_its_joints_makes_it():
    """A hidden leg: the frames before cannot know where it is, whatever sigma they state."""
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    unseen = never_seen(evidence)
    assert np.isinf(unseen[LEG]).all()
    found = sigma_of(evidence, standing(), unseen)
    assert (found[LIMB_OF_JOINTS == LEG] > 0.05).all()  # knee, ankle and foot; the hip counts as a part of the trunk
    assert (found[LIMB_OF_JOINTS != LEG] < 0.02).all()


def test_a_shank_that_was_never_seen_leaves_its_knee_certain():
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftLeg", "LeftFoot", "LeftToeBase"))
    found = sigma_of(evidence, standing(), never_seen(evidence))
    beyond = [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["FootLeft"]]
    assert (found[beyond] > 0.05).all()
    assert (np.delete(found, beyond) < 0.02).all()


def test_a_hidden_limb_becomes_more_uncertain_with_the_time_since_it_was_seen():
    """In half a second thighs turn by 18 degrees about each axis; the knee is 0.4 m from the hip."""
    evidence = seen_body(standing(), BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    hidden = never_seen(evidence) > 0.0

    def knee_sigma(unseen_s: float) -> float:
        return sigma_of(evidence, standing(), np.where(hidden, unseen_s, 0.0))[JOINT_INDEX["KneeLeft"]]

    grown = np.array([knee_sigma(seconds) for seconds in (0.01, 0.1, 0.25, 0.5, np.inf)])
    assert (np.diff(grown) > 0.0).all()
    assert np.sqrt(grown[3] ** 2 - grown[0] ** 2) == pytest.approx(0.4 * np.radians(18.0), rel=0.2)


LEG = int(LIMB_OF_JOINTS[JOINT_INDEX["KneeLeft"]])


def never_seen(evidence) -> np.ndarray:
    """(PARTS, 2) seconds, as in ``vague_belief``: of the left leg what the first frame does not show was never seen."""
    unseen = ~likelihood(BODY, standing(), evidence).seen
    unseen[np.arange(len(unseen)) != LEG] = False
    return np.where(unseen, np.inf, 0.0)
