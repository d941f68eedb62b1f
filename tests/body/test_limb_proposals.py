"""Proposals of limbs along the paths of anchors."""

from dataclasses import replace

import numpy as np
from body_builder import FRONT, LEFT, adult_body, joint_errors_m, seen_body, standing

from anchorpose.body.limb_proposals import CHAINS, CONTRADICTED_M, anchor_paths, anchor_poses
from anchorpose.geodesics.anchors import Anchors, SeenAnchors, find_anchors, no_anchors
from anchorpose.geodesics.extrema import Cap
from anchorpose.joints import JOINT_INDEX

BODY = adult_body()
HEIGHT_M = float(np.ptp(BODY.mesh.vertices[:, 1]))
REACHING = standing(LeftArm=(30.0, 0.0, 0.0), RightArm=(-15.0, 0.0, 25.0), RightForeArm=(0.0, -30.0, 20.0))


def seen_of(pose) -> SeenAnchors:
    """What two cameras see of a pose."""
    surface = seen_body(pose, BODY, (FRONT, LEFT)).surface
    return SeenAnchors(surface, find_anchors(surface, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), HEIGHT_M))


def test_anchors_where_the_pose_has_its_tips_give_no_path():
    seen = seen_of(REACHING)
    assert seen.anchors.found.sum() >= 4
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=replace(seen.anchors, free=())))) == []


def test_a_hand_elsewhere_gives_the_path_of_an_arm():
    seen = seen_of(REACHING)
    wrong = standing(
        LeftArm=(-70.0, 0.0, 0.0),
        LeftForeArm=(0.0, -60.0, 0.0),
        RightArm=(-15.0, 0.0, 25.0),
        RightForeArm=(0.0, -30.0, 20.0),
    )
    anchors = replace(seen.anchors, free=())
    ((path, chains),) = anchor_paths(BODY, wrong, replace(seen, anchors=anchors))
    assert [chain.root for chain in chains] == ["ShoulderLeft", "ShoulderRight"]
    node = seen.anchors.node[1]
    np.testing.assert_array_equal(path.places_m[0], seen.whole.points_m[node].astype(np.float64))
    assert (np.diff(path.along_m) > 0.0).all()
    assert 0.0 < path.along_m[0] < CONTRADICTED_M
    errors = [
        joint_errors_m(BODY, pose, REACHING) for pose in anchor_poses(BODY, wrong, replace(seen, anchors=anchors))
    ]
    arm = [JOINT_INDEX[name] for name in ("ElbowLeft", "WristLeft", "HandLeft")]
    assert min(error[arm].max() for error in errors) < 0.10


def test_a_free_end_may_be_that_of_any_limb_and_a_head_is_that_of_none():
    seen = seen_of(REACHING)
    tip = int(seen.anchors.node[1])
    cap = Cap(tip, np.array([tip]), seen.whole.points_m[tip].astype(np.float64), 0.8, 0.01, False, False)
    ((_, chains),) = anchor_paths(BODY, REACHING, replace(seen, anchors=replace(no_anchors(), free=(cap,))))
    assert chains == CHAINS
    head = no_anchors()
    head.node[0], head.position_m[0] = tip, seen.whole.points_m[tip]
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=head))) == []


def test_missed_anchors_give_no_path():
    seen = seen_of(REACHING)
    none: Anchors = no_anchors()
    assert list(anchor_paths(BODY, REACHING, replace(seen, anchors=none))) == []
