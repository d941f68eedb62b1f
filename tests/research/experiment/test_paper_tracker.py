"""What methods of the comparison may change in the framework: lost limbs, the filter, and rejection."""

from types import SimpleNamespace

import numpy as np
import pytest
from body_builder import FRONT, LEFT, adult_body, joint_errors_m, seen_body, standing, stepped

from anchorpose.body.belief import PATIENT_PACE, PoseBelief, vague_belief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.pose import Pose
from anchorpose.body.registration import node_parts
from anchorpose.body.skin_points import pose_points
from anchorpose.geodesics.anchors import anchor_descriptor, find_anchors
from anchorpose.joints import JOINT_INDEX
from anchorpose.research.experiment.config import Form, Update
from anchorpose.research.experiment.framework import NEVER_M, paper_config
from anchorpose.research.experiment.own_surface import SeenGeodesics
from anchorpose.research.experiment.paper_tracker import bring_limbs_back
from anchorpose.research.experiment.pose_filters import match_rows, update_by_rows
from anchorpose.track_tree.tree import TreeConfig

BODY = adult_body()
RAISED = standing(LeftArm=(30.0, 0.0, 0.0), RightArm=(-15.0, 0.0, 25.0), RightForeArm=(0.0, -30.0, 20.0))
LEFT_ARM = [JOINT_INDEX[f"{name}Left"] for name in ("Elbow", "Wrist", "Hand")]
TRUNK = [JOINT_INDEX[name] for name in ("SpineBase", "SpineMid", "SpineShoulder", "HipLeft", "HipRight")]
REST = [index for index in range(len(JOINT_INDEX)) if index not in LEFT_ARM]


def expected(pose: Pose) -> PoseBelief:
    """As uncertain as a prediction over a fifth of a second."""
    return PoseBelief(pose, np.diag(variance := PATIENT_PACE.variance(0.2)), np.diag(1.0 / variance))


def seen_of_raised() -> SeenGeodesics:
    surface = seen_body(RAISED, BODY, (FRONT, LEFT)).surface
    height_m = float(np.ptp(BODY.mesh.vertices[:, 1]))
    anchors = find_anchors(surface, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), height_m)
    return SeenGeodesics(surface, anchors, anchor_descriptor(surface, anchors))


def test_a_lost_arm_comes_back_and_the_rest_stays() -> None:
    wrong = standing(RightArm=(-15.0, 0.0, 25.0), RightForeArm=(0.0, -30.0, 20.0))
    before = joint_errors_m(BODY, wrong, RAISED)
    assert before[LEFT_ARM].max() > 0.2
    back = bring_limbs_back(BODY, wrong, seen_of_raised())
    after = joint_errors_m(BODY, back, RAISED)
    assert after[LEFT_ARM].max() < 0.07
    assert np.linalg.norm(BODY.joints(back) - BODY.joints(wrong), axis=1)[REST].max() < 0.03


def test_a_pose_that_the_anchors_confirm_is_left_alone() -> None:
    assert bring_limbs_back(BODY, RAISED, seen_of_raised()) is RAISED


@pytest.mark.parametrize(
    ("update", "robust", "draws", "within_m"),
    [(Update.KALMAN, True, 1, 0.012), (Update.KALMAN, False, 1, 0.012), (Update.PARTICLES, True, 16, 0.029)],
)
def test_matches_bring_a_body_back_that_has_drifted_off_the_surface(
    update: Update, robust: bool, draws: int, within_m: float
) -> None:
    """Every node is matched with itself for some frames: only the drift of 30 mm is left to be undone.

    Particles undo a sixth of it, in the mean of several draws. Without robust kernels, they undo nothing.
    """
    surface, errors_m = seen_body(RAISED, BODY, (FRONT, LEFT)).surface, list[float]()
    node = np.arange(0, len(surface), 3)
    nodes_m = surface.points_m[node].astype(np.float64)
    for seed in range(draws):
        pose = stepped(RAISED, 0.03, 0.0, 0.0)
        for _ in range(4):
            point, part = node_parts(BODY, pose, nodes_m, 0.08)
            pairs = SimpleNamespace(node=node, point=point, part=part, matched_m=nodes_m)
            belief, window = expected(pose), [SimpleNamespace(surface=surface)]
            rows = match_rows(BODY, pose_points(BODY, pose), pairs, window, belief, robust)
            pose = update_by_rows(update, BODY, rows, belief, RegistrationConfig(), seed).pose
        errors_m.append(float(joint_errors_m(BODY, pose, RAISED)[TRUNK].mean()))
    assert np.mean(errors_m) < within_m


def test_missed_nodes_alone_leave_the_prediction() -> None:
    seen = seen_body(RAISED, BODY, (FRONT,))
    node, none = np.arange(40), np.zeros(40, np.int64)
    pairs = SimpleNamespace(node=node, point=none, part=none, matched_m=np.full((40, 3), np.nan))
    belief, window = vague_belief(RAISED), [SimpleNamespace(surface=seen.surface)]
    rows = match_rows(BODY, pose_points(BODY, RAISED), pairs, window, belief, True)
    assert all(update_by_rows(update, BODY, rows, belief, RegistrationConfig(), 1) is belief for update in Update)


def test_without_rejection_the_tree_gives_no_node_up(tmp_path) -> None:
    costs = {form: paper_config(tmp_path / "m.npz", form).tree.missed_cost_m for form in Form}
    assert {costs[form] for form in Form if form.rejects} == {TreeConfig().missed_cost_m}
    assert {costs[form] for form in Form if not form.rejects} == {NEVER_M}
