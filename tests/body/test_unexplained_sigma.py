"""A limb that leaves seen skin uncovered is less certain."""

import numpy as np
from body_builder import adult_body, joints_of, points, seen_body, standing

from anchorpose.body.explanation import explain
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import unexplained_sigma
from anchorpose.joints import JOINT_INDEX

BODY, SIGMA = adult_body(), np.full(21, 0.005)
TRUTH = standing(LeftArm=(40.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0))
SEEN = seen_body(TRUTH, BODY)


def sigma_of(pose):
    posed = pose_points(BODY, pose)
    return unexplained_sigma(BODY, pose, SEEN, explain(points(), posed, SEEN), SIGMA)


def test_a_pose_that_covers_all_keeps_its_sigma():
    np.testing.assert_array_equal(sigma_of(TRUTH), SIGMA)


def test_the_arm_beside_which_skin_is_uncovered_covers_its_error_with_four_sigma():
    bent = standing(LeftArm=(40.0, 0.0, 0.0), RightArm=(-20.0, 0.0, 0.0), LeftForeArm=(0.0, 0.0, 50.0))
    found = sigma_of(bent)
    hand = JOINT_INDEX["HandLeft"]
    off_m = np.linalg.norm(joints_of(BODY, bent) - joints_of(BODY, TRUTH), axis=1)
    assert off_m[hand] > 0.15
    assert 4.0 * found[hand] > off_m[hand]
    others = [k for name, k in JOINT_INDEX.items() if not name.endswith("Left") or "Shoulder" in name or "Hip" in name]
    np.testing.assert_array_equal(found[others], SIGMA[others])
