"""Where depth is too poor for joints, and what sigma drawn-out edges leave."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, hide_bones, points, seen_body, standing, stepped
from pieces_builder import pieces_of

from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig, UncertaintyConfig, VisibilityConfig
from anchorpose.body.evidence import Evidence
from anchorpose.body.inverse_kinematics import CorrectedJoints, apply_corrections
from anchorpose.body.pose import LIMB_OF_JOINTS, PARTS
from anchorpose.body.registration import posterior
from anchorpose.body.skin_points import pose_points
from anchorpose.body.uncertainty import joint_sigma, smeared_sigma
from anchorpose.body.visibility import PoorDepth, PoorKind, missing_share, poor_depth, too_coarse
from anchorpose.isolation.depth_noise import LIMB_M, DepthDetail
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.joints import JOINT_INDEX, JointState
from anchorpose.simulate.render import TrueImage
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Earlier, Estimate, estimate_of

BODY = adult_body()
POSE = standing(LeftArm=(-20.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))
REACH_M = VisibilityConfig().reach_m
SHARP, FILTERED = DepthDetail(2.0, 365.0), DepthDetail(16.0, 365.0)  # 16 pixels are 105 mm at 2.4 m
HEAD, HAND = JOINT_INDEX["Head"], JOINT_INDEX["HandLeft"]
FOOT = JOINT_INDEX["FootLeft"]


def found(evidence: Evidence, *details: DepthDetail) -> tuple[PoorDepth | None, ...]:
    return poor_depth(pose_points(BODY, POSE), evidence.views, evidence.cameras, details, REACH_M)


def estimated(
    evidence: Evidence,
    *details: DepthDetail,
    belief: PoseBelief | None = None,
    unseen_s: np.ndarray | None = None,
    seen_sigma_m: np.ndarray | None = None,
    corrected: CorrectedJoints | None = None,
) -> Estimate:
    """What is reported of a frame that cameras of such detail show. belief: the pose, if it does not follow from the
    frame alone.
    """
    seen = posterior(BODY, POSE, vague_belief(POSE), evidence, RegistrationConfig())
    seen = seen if belief is None else replace(seen, belief=belief)
    pieces = []
    for view, camera, detail in zip(evidence.views, evidence.cameras, details, strict=True):
        own = pieces_of(view, camera)
        sensor = replace(own.sensor, edge_px=detail.edge_px, focal_px=detail.focal_px, step_per_m=detail.step_per_m)
        pieces.append(replace(own, sensor=sensor))
    frame = type("Seen", (), {"evidence": evidence, "pieces": pieces, "frame_set": None})()
    earlier = Earlier(unseen_s=unseen_s, seen_sigma_m=seen_sigma_m)
    return estimate_of(BODY, seen, frame, None, TrackConfig(), corrected, earlier)


def test_a_hidden_joint_that_is_too_uncertain_is_lost_and_still_shown_as_hidden():
    """A foot that a therapist hides keeps its stand (``StandingFeet``): no camera looks past it."""
    leg = hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase")
    unseen_s = np.zeros((PARTS, 2))
    unseen_s[LIMB_OF_JOINTS[FOOT]] = np.inf
    evidence, sharp = seen_body(POSE, BODY, (FRONT,), leg), (SHARP,)
    estimate = estimated(evidence, *sharp, unseen_s=unseen_s)
    assert estimate.states[FOOT] is JointState.LOST
    assert np.isnan(estimate.joints_m[FOOT]).all()
    assert estimate.shown[FOOT] is JointState.HIDDEN
    lately = np.where(unseen_s > 0.0, 0.2, 0.0)
    assert estimated(evidence, *sharp, unseen_s=lately).states[FOOT] is JointState.HIDDEN


def test_a_limb_that_becomes_hidden_does_not_become_more_certain():
    """While little of a leg was seen, its sigma was large; a moment later nothing of it is seen."""
    evidence = seen_body(POSE, BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    unseen_s = np.zeros((PARTS, 2))
    unseen_s[LIMB_OF_JOINTS[FOOT]] = 1.0 / 15.0
    before = np.full(21, 0.1)
    known, unknown = (
        estimated(evidence, SHARP, unseen_s=unseen_s, seen_sigma_m=sigma_m).sigma_m for sigma_m in (before, None)
    )
    leg = LIMB_OF_JOINTS[FOOT] == LIMB_OF_JOINTS
    assert (known[leg] > before[leg]).all()
    np.testing.assert_array_equal(known[~leg], unknown[~leg])


def test_a_hidden_joint_that_a_reviewer_placed_has_the_reviewer_s_sigma():
    evidence = seen_body(POSE, BODY, (FRONT,), hide_bones("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"))
    leg = np.flatnonzero(LIMB_OF_JOINTS[FOOT] == LIMB_OF_JOINTS)
    placed = CorrectedJoints(leg, BODY.joints(POSE)[leg], np.full(len(leg), 0.03))
    belief = apply_corrections(BODY, vague_belief(POSE), placed, UncertaintyConfig().inflation)
    estimate = estimated(evidence, SHARP, belief=belief, unseen_s=np.zeros((PARTS, 2)), corrected=placed)
    assert JointState.LOST not in [estimate.states[joint] for joint in leg]
    np.testing.assert_allclose(estimate.sigma_m[leg], 0.03, atol=0.01)


@pytest.mark.parametrize("edge_px", [11.0, 13.0])
def test_an_edge_wider_than_a_limb_is_poor_and_a_narrower_one_is_not(edge_px):
    detail = DepthDetail(edge_px, 300.0)
    poor = too_coarse("front", detail, 2.0)
    assert (poor is not None) == (detail.edge_m(2.0) > LIMB_M)
    assert poor is None or (poor.kind, poor.amount) == (PoorKind.EDGES, pytest.approx(detail.edge_m(2.0)))


def test_steps_higher_than_a_limb_are_poor_and_those_of_a_kinect_are_not():
    detail = DepthDetail(2.0, 285.0, 0.003)
    assert too_coarse("front", detail, 4.5) is None
    far = too_coarse("front", detail, 6.0)
    assert (far.kind, far.amount) == (PoorKind.STEPS, pytest.approx(0.108))


def test_a_sharp_camera_has_no_poor_frame_and_one_that_draws_edges_out_has():
    evidence = seen_body(POSE, BODY)
    assert found(evidence, SHARP) == (None,)
    (poor,) = found(evidence, FILTERED)
    assert (poor.camera, poor.kind) == ("front", PoorKind.EDGES)
    assert 0.09 < poor.amount < 0.12


def test_holes_in_most_of_the_skin_are_stated_and_those_in_an_arm_are_not():
    posed = pose_points(BODY, POSE)
    trunk = seen_body(POSE, BODY, change=hide_bones("LeftForeArm", "LeftHand"))
    assert found(trunk, SHARP) == (None,)
    names = [name for name in points().asset.bone_names if "Arm" not in name and "Hand" not in name]
    (poor,) = found(holes := seen_body(POSE, BODY, change=hide_bones(*names)), SHARP)
    assert poor.kind is PoorKind.HOLES
    assert poor.amount == missing_share(posed, holes.views[0], FRONT, REACH_M) > 0.5


def test_a_patient_of_whom_a_person_hides_most_has_no_holes():
    def behind_a_person(view: View, picture: TrueImage) -> View:
        hidden = view.patient & (np.arange(view.labels.shape[0])[:, None] > 120)
        labels = np.where(hidden, PixelLabel.OTHER_PERSON, view.labels).astype(np.uint8)
        return View(np.where(hidden, np.float32(1.2), view.depth_m), labels)

    assert found(seen_body(POSE, BODY, change=behind_a_person), SHARP) == (None,)


def test_a_camera_that_does_not_show_the_patient_is_not_poor():
    evidence = seen_body(POSE, BODY, change=hide_bones(*points().asset.bone_names))
    assert found(evidence, FILTERED) == (None,)


def test_what_was_not_resolved_is_not_called_observed():
    sharp, soft = (estimated(seen_body(POSE, BODY), detail) for detail in (SHARP, FILTERED))
    assert JointState.OBSERVED in sharp.states
    assert not sharp.poor
    assert JointState.OBSERVED not in soft.states
    assert soft.states[HEAD] is JointState.HIDDEN
    assert [one.kind for one in soft.poor] == [PoorKind.EDGES]
    assert np.nan_to_num(soft.sigma_m, nan=1.0).min() > 2.0 * sharp.sigma_m[HEAD]


def test_a_second_camera_that_resolves_limbs_makes_joints_observed():
    evidence = seen_body(POSE, BODY, (FRONT, LEFT))
    states = estimated(evidence, FILTERED, SHARP).states
    assert states[HEAD] is JointState.OBSERVED


def test_wider_edges_are_never_less_sigma_and_hands_are_less_certain_than_the_trunk():
    evidence, registration, config = seen_body(POSE, BODY), RegistrationConfig(), UncertaintyConfig()
    belief = posterior(BODY, POSE, vague_belief(POSE), evidence, registration).belief
    sharp = joint_sigma(BODY, pose_points(BODY, POSE), belief.covariance, config)
    widths = [smeared_sigma(BODY, POSE, evidence, edge, sharp, registration, config) for edge in (0.02, 0.05, 0.1)]
    for less, more in zip([sharp, *widths], widths, strict=False):
        assert (more >= less).all()
    assert widths[-1][HAND] > 2.0 * widths[-1][JOINT_INDEX["SpineMid"]]


def test_sigma_moves_with_the_body():
    """The same from a camera and a body that were moved together."""
    config, edge_m = UncertaintyConfig(), 0.1
    shift = (1.0, 0.0, -2.0)
    camera = replace(FRONT, T_world_camera=FRONT.T_world_camera + np.pad(np.array(shift)[:, None], ((0, 1), (3, 0))))
    one, other = (
        smeared_sigma(BODY, pose, seen_body(pose, BODY, (view,)), edge_m, np.zeros(21), RegistrationConfig(), config)
        for pose, view in ((POSE, FRONT), (stepped(POSE, *shift), camera))
    )
    np.testing.assert_allclose(one, other, rtol=1e-3)
