"""Feet that stand: what holds them while nobody sees them, and what lets them go."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    FRONT,
    NOTHING,
    adult_body,
    hide_bones,
    joint_errors_m,
    joints_of,
    points,
    random_pose,
    seen_body,
    shaken,
)

from anchorpose.body.belief import PoseBelief
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import Constraints
from anchorpose.body.contact_regions import DRIFT_M_S, PLACES, SIGMA_M, STILL_M, StandingFeet
from anchorpose.body.pose import DEGREE, POSE_SIZE, Pose
from anchorpose.body.registration import register
from anchorpose.body.skin_points import pose_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JointState

BODY, POSE = adult_body(), random_pose(1, 0.2)
RIGHT = [JOINT_INDEX[name] for name in ("AnkleRight", "FootRight")]
STEP_S = 1 / 15
LEG_RIGHT = ("RightUpLeg", "RightLeg", "RightFoot", "RightToeBase")


def states(right: JointState) -> tuple[JointState, ...]:
    """Everything is seen, but for the right ankle."""
    return tuple(right if joint == RIGHT[0] else JointState.OBSERVED for joint in range(JOINT_COUNT))


class Watched:
    """Feet of a body that stands in one pose, and time."""

    def __init__(self, pose: Pose = POSE, step_s: float = STEP_S) -> None:
        self.feet, self.pose, self.step_s, self.time_s = StandingFeet(points()), pose, step_s, 0.0

    def see(self, frames: int, right: JointState = JointState.OBSERVED, shift_m: float = 0.0) -> Constraints:
        """So many frames later; the rows for the right foot in the next."""
        for _ in range(frames):
            shift = np.array([shift_m, 0.0, 0.0])
            skin = pose_points(BODY, self.pose).points_m + shift
            self.feet.note(skin, joints_of(BODY, self.pose) + shift, states(right), self.time_s)
            self.time_s += self.step_s
        return of_right(self.feet.rows(self.time_s))


def of_right(rows: Constraints) -> Constraints:
    names = np.array(points().asset.bone_names)[points().part[rows.point]]
    chosen = np.char.startswith(names, "Right")
    return Constraints(*(getattr(rows, name)[chosen] for name in Constraints.__slots__))


@pytest.mark.parametrize("step_s", [STEP_S, -STEP_S], ids=["forwards", "backwards"])
def test_a_foot_that_stood_is_held_where_it_stood_and_less_and_less(step_s: float) -> None:
    watched = Watched(step_s=step_s)
    assert len(watched.see(3)) == 0  # too short to be told from a step
    watched.see(6)
    soon, later = watched.see(3, JointState.HIDDEN_BY_PERSON), watched.see(12, JointState.HIDDEN_BY_PERSON)
    assert len(soon) == len(later) == 3 * PLACES
    np.testing.assert_allclose(soon.residuals(pose_points(BODY, POSE)), 0.0, atol=1e-9)
    np.testing.assert_allclose(soon.sigma_m, SIGMA_M + 4 * abs(step_s) * DRIFT_M_S)
    np.testing.assert_allclose(later.sigma_m, SIGMA_M + 16 * abs(step_s) * DRIFT_M_S)


def test_a_glimpse_at_the_same_place_keeps_it_and_elsewhere_lets_it_go() -> None:
    watched = Watched()
    watched.see(9)
    watched.see(4, JointState.HIDDEN)
    assert len(watched.see(1)) > 0
    watched.see(4, JointState.HIDDEN)
    assert len(watched.see(1, shift_m=2 * STILL_M)) == 0


def test_a_foot_that_moves_is_not_held() -> None:
    watched = Watched()
    for frame in range(12):
        rows = watched.see(1, shift_m=0.01 * frame)
    assert len(rows) == 0


@pytest.mark.parametrize("joint", RIGHT)
def test_cameras_that_look_past_it_and_people_who_know_better_let_it_go(joint: int) -> None:
    watched = Watched()
    watched.see(9)
    assert len(watched.see(1, JointState.LOST)) == 0
    told = Watched()
    told.see(9)
    told.feet.forget([joint])
    assert len(told.see(2, JointState.HIDDEN)) == 0


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_hidden_leg_stays_on_its_foot_and_is_no_surer_for_it(seed) -> None:
    evidence = seen_body(POSE, BODY, (FRONT,), hide_bones(*LEG_RIGHT))
    astray = shaken(POSE, seed, turn_deg=12.0, shift_m=0.0)
    variance = np.full(POSE_SIZE, (12.0 * DEGREE) ** 2)
    variance[-3:] = 0.02**2
    belief = PoseBelief(astray, np.diag(variance), np.diag(1.0 / variance))
    watched = Watched()
    watched.see(9)
    held = watched.see(2, JointState.HIDDEN_BY_PERSON)
    alone, standing = (
        register(BODY, belief, evidence, NOTHING, RegistrationConfig(), fixed=rows).belief for rows in (None, held)
    )
    errors = [joint_errors_m(BODY, found.pose, POSE)[RIGHT].max() for found in (alone, standing)]
    assert errors[0] > 0.03
    assert errors[1] < 0.75 * errors[0]
    settled = replace(belief, pose=standing.pose)
    again = [
        register(BODY, settled, evidence, NOTHING, RegistrationConfig(), fixed=rows).belief.covariance
        for rows in (None, held)
    ]
    assert np.trace(again[1]) > 0.9 * np.trace(again[0])


def test_a_foot_that_was_never_seen_hardly_moves_from_where_it_is_believed_to_stand() -> None:
    feet, posed = StandingFeet(points()), pose_points(BODY, POSE)
    joints, floor_m = joints_of(BODY, POSE), float(posed.points_m[:, 1].min())

    def rows_after(height_m: float | None, hidden: JointState) -> Constraints:
        feet.note(posed.points_m, joints, states(hidden), 0.0, None if height_m is None else floor_m - height_m)
        return of_right(feet.rows(STEP_S))

    stands = rows_after(0.0, JointState.HIDDEN_BY_PERSON)
    np.testing.assert_allclose(stands.residuals(posed), 0.0, atol=1e-9)
    np.testing.assert_allclose(stands.sigma_m, SIGMA_M + STEP_S * DRIFT_M_S)
    assert len(rows_after(0.5, JointState.HIDDEN_BY_PERSON)) == 0  # in the air it hangs on the knee
    assert len(rows_after(None, JointState.HIDDEN_BY_PERSON)) == 0
    assert len(rows_after(0.0, JointState.LOST)) == 0  # the cameras look past it
