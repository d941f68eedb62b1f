"""Legs that were taken for each other are put right; legs that stand apart are left alone."""

import numpy as np
from body_builder import adult_body, standing

from anchorpose.body.inverse_kinematics import exchange_crossed_legs
from anchorpose.body.pose import Pose
from anchorpose.joints import JOINT_INDEX

BODY = adult_body()
ANKLES = [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["AnkleRight"]]


def joints(pose: Pose) -> np.ndarray:
    return BODY.joints(pose)


def test_legs_that_stand_or_step_are_left_alone():
    for pose in (standing(), standing(LeftUpLeg=(0.0, 0.0, 40.0), LeftLeg=(0.0, 0.0, -50.0))):
        assert exchange_crossed_legs(BODY, pose) is None


def test_crossed_legs_change_places():
    crossed = standing(LeftUpLeg=(30.0, 0.0, 0.0), RightUpLeg=(-30.0, 0.0, 0.0))
    if joints(crossed)[JOINT_INDEX["KneeLeft"], 2] < joints(crossed)[JOINT_INDEX["KneeRight"], 2]:
        crossed = standing(LeftUpLeg=(-30.0, 0.0, 0.0), RightUpLeg=(30.0, 0.0, 0.0))
    found = exchange_crossed_legs(BODY, crossed)
    assert exchange_crossed_legs(BODY, found) is None
    before, after = joints(crossed), joints(found)
    assert np.linalg.norm(after[ANKLES] - before[ANKLES[::-1]], axis=1).max() < 0.08  # hips are not in the same place
    trunk = [JOINT_INDEX[name] for name in ("SpineBase", "SpineMid", "SpineShoulder", "Neck", "Head")]
    np.testing.assert_allclose(after[trunk], before[trunk], atol=0.02)
    np.testing.assert_allclose(after[: JOINT_INDEX["HipLeft"]], before[: JOINT_INDEX["HipLeft"]], atol=0.05)
