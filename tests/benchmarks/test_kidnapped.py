"""Poses spoilt on purpose are wrong as they should be, a spoilt tracker is wrong throughout and as confident as before,
and trials are judged by the rules."""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from body_builder import adult_body, standing, true_shape
from scipy.spatial import cKDTree

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks" / "probes"))

from kidnap import SEEN_AGAIN, Past, fork, kidnap
from kidnapped import Judge, TimePass, judged_joints
from spoilt_poses import Kind, Spoil, middle_of_trunk, spoilt

from anchorpose.body.evidence import trunk_and_arms
from anchorpose.body.pose import LIMB_OF_JOINTS, Pose
from anchorpose.body.skin_points import Body, pose_points
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.reader import open_recording
from anchorpose.results.evaluate import LIMBS_JUDGED
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import FollowConfig, TrackConfig
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Run

BODY = adult_body()
POSTURES = {
    "arms apart": standing(),
    "arms down": standing(LeftArm=(-60.0, 0.0, 0.0), RightArm=(60.0, 0.0, 0.0)),
    "arms up": standing(LeftArm=(80.0, 0.0, 0.0), RightArm=(-80.0, 0.0, 0.0)),
    "bent": standing(LowerBack=(0.0, 0.0, -30.0), LeftUpLeg=(0.0, 0.0, 40.0), LeftLeg=(0.0, 0.0, -50.0)),
}


def depth_in_trunk_m(body: Body, pose: Pose, place_m: np.ndarray) -> float:
    """Return how deep a place (3,) lies inside the trunk's skin, negative outside."""
    posed, trunk = pose_points(body, pose), trunk_and_arms(body.points)[0]
    nearest = trunk[cKDTree(posed.points_m[trunk]).query(place_m)[1]]
    return float((posed.points_m[nearest] - place_m) @ posed.normals[nearest])


def displacement_m(body: Body, before: Pose, after: Pose) -> np.ndarray:
    """Return how far each joint (21,) was moved."""
    return np.linalg.norm(body.joints(after) - body.joints(before), axis=1)


def joints(pose) -> np.ndarray:
    return BODY.joints(pose)


def at(pose, name: str) -> np.ndarray:
    return joints(pose)[JOINT_INDEX[name]]


@pytest.mark.parametrize("posture", POSTURES)
@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("height", [0.2, 0.5, 0.75])
def test_an_arm_put_into_the_trunk_has_its_hand_deep_inside(posture, side, height):
    pose = POSTURES[posture]
    after = spoilt(BODY, pose, Spoil(Kind.ARM_IN_TRUNK, side, height))
    hand = at(after, f"Hand{side}")
    assert np.linalg.norm(hand - middle_of_trunk(BODY, pose, height)) < 0.02
    assert depth_in_trunk_m(BODY, after, hand) > 0.06
    assert displacement_m(BODY, pose, after)[JOINT_INDEX[f"Hand{side}"]] > 0.15


@pytest.mark.parametrize("posture", POSTURES)
def test_exchanged_arms_cross_the_body_and_each_hand_is_nearer_to_the_other_ones_place(posture):
    pose = POSTURES[posture]
    after = spoilt(BODY, pose, Spoil(Kind.ARMS_EXCHANGED))
    for side, other in (("Left", "Right"), ("Right", "Left")):
        hand = at(after, f"Hand{side}")
        away_m = np.linalg.norm(hand - at(pose, f"Hand{other}"))
        assert away_m < 0.3 * np.linalg.norm(at(pose, f"Hand{side}") - at(pose, f"Hand{other}"))
        assert hand[2] * at(pose, f"Hand{side}")[2] < 0.0  # on the other side of the body, which faces X


@pytest.mark.parametrize("side", ["Left", "Right"])
@pytest.mark.parametrize("posture", POSTURES)
def test_one_leg_lies_on_the_other_one(posture, side):
    pose, other = POSTURES[posture], {"Left": "Right", "Right": "Left"}[side]
    after = spoilt(BODY, pose, Spoil(Kind.LEG_ON_LEG, side))
    for joint, within_m in (("Knee", 0.12), ("Ankle", 0.08), ("Foot", 0.08)):  # hips are 18 cm apart
        assert np.linalg.norm(at(after, f"{joint}{side}") - at(pose, f"{joint}{other}")) < within_m


@pytest.mark.parametrize("posture", POSTURES)
def test_a_body_turned_round_has_every_joint_on_the_far_side_of_the_vertical_through_the_pelvis(posture):
    pose = POSTURES[posture]
    before, after = joints(pose), joints(spoilt(BODY, pose, Spoil(Kind.TURNED_ROUND)))
    axis = pose.root_m * (1.0, 0.0, 1.0)
    np.testing.assert_allclose(after - axis, (before - axis) * (-1.0, 1.0, -1.0), atol=1e-9)


@pytest.mark.parametrize("kind", list(Kind))
def test_only_the_limbs_concerned_move_and_bones_keep_their_length(kind):
    pose, spoil = POSTURES["arms apart"], Spoil(kind, "Right")
    after = spoilt(BODY, pose, spoil)
    moved_m = displacement_m(BODY, pose, after)
    names = {"arm_left": 1, "leg_left": 2, "arm_right": 3, "leg_right": 4, "trunk_and_head": 0}
    limbs = [names[limb] for limb in spoil.limbs]
    assert moved_m[~np.isin(LIMB_OF_JOINTS, limbs)].max(initial=0.0) < 1e-9
    for one, other in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Knee", "Ankle")):
        lengths = [np.linalg.norm(at(p, f"{one}Right") - at(p, f"{other}Right")) for p in (pose, after)]
        assert lengths[0] == pytest.approx(lengths[1], abs=1e-9)
    assert moved_m[np.concatenate([LIMBS_JUDGED[limb] for limb in spoil.limbs])].max() > 0.15


def _judge(errors_m, usual_m=0.0, joints=(JOINT_INDEX["HandLeft"],), period_s=0.1) -> Judge:
    """A judge who has seen one error of the hand per frame, one frame every ``period_s`` after the spoilt one."""
    place = np.zeros((JOINT_COUNT, 3))

    def off(error_m: float) -> np.ndarray:
        joints_m = place.copy()
        joints_m[JOINT_INDEX["HandLeft"], 1] = error_m
        return joints_m

    judge = Judge(5.0, np.array(joints), lambda frame: place, lambda frame: off(usual_m))
    for frame, error_m in enumerate(errors_m, 1):
        if not judge.done:
            judge.take(frame, 5.0 + frame * period_s, off(error_m))
    return judge


@pytest.mark.parametrize(
    ("errors_m", "recovered_s"),
    [
        ([0.3] * 4 + [0.09] * 6, 0.5),  # right from half a second on
        ([0.3] * 5 + [0.0] * 5, None),  # a frame too late
        ([0.0] * 10, 0.1),
        ([0.0] * 3 + [0.3] + [0.0] * 6, 0.5),  # right, wrong, and right for good
        ([0.0] * 8 + [0.3, 0.0], None),  # does not stay so
        ([0.3] * 4 + [0.101] * 6, None),
        ([0.3] * 4 + [0.02] * 6 + [0.4] * 5, 0.5),  # what comes after the second is not judged
    ],
)
def test_a_limb_is_right_again_by_half_a_second_and_stays_so_until_a_second(errors_m, recovered_s):
    assert _judge(errors_m).recovered_s == pytest.approx(np.inf if recovered_s is None else recovered_s)


def test_a_limb_may_be_as_wrong_as_without_the_spoiling_and_fifty_millimetres_more():
    assert np.isfinite(_judge([0.24] * 10, usual_m=0.2).recovered_s)
    assert np.isinf(_judge([0.26] * 10, usual_m=0.2).recovered_s)


VISIBLE = dict.fromkeys(LIMBS_JUDGED, True)


def test_the_limbs_concerned_must_be_in_plain_view():
    arm = Spoil(Kind.ARM_IN_TRUNK, "Right")
    assert judged_joints(arm, VISIBLE).tolist() == LIMBS_JUDGED["arm_right"].tolist()
    assert judged_joints(arm, VISIBLE | {"arm_left": False}) is not None
    assert judged_joints(arm, VISIBLE | {"arm_right": False}) is None
    assert judged_joints(Spoil(Kind.ARMS_EXCHANGED), VISIBLE | {"arm_right": False}) is None


FRAMES = 11
CONFIG = TrackConfig(follow=FollowConfig(history=SEEN_AGAIN + 2))
HAND, HEAD = JOINT_INDEX["HandLeft"], JOINT_INDEX["Head"]


@dataclass(frozen=True, slots=True, eq=False)
class MidRecording:
    """A tracker after some frames, what went before, and where the next frame is on its way."""

    time_pass: TimePass
    tracker: PatientTracker
    past: Past
    read: int


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> MidRecording:
    out = tmp_path_factory.mktemp("kidnapping") / "single"
    simulate_recording(out, single(5, seconds=FRAMES / 10.0, fps=10.0))
    room = prepare_room(open_recording(out / "recording"), CONFIG)
    with np.load(out / "truth/truth.npz") as truth:
        shape = true_shape(truth["shape_coefficients"], 0.007)  # known: here only the state is tested
    time_pass, past = TimePass(Run(room, CONFIG), shape, range(FRAMES)), None
    for read, tracker, _ in time_pass.trackers():
        past = Past.of(tracker) if past is None else past
        if tracker.window[0].frame_set.frame > 0:
            past.note(tracker)
        if past.full:
            return MidRecording(time_pass, tracker, past, read)
    raise AssertionError("the recording is too short")


@pytest.mark.thorough
def test_a_fork_goes_on_exactly_as_the_tracker_and_leaves_it_alone(here):
    forked, again = fork(here.tracker), fork(here.tracker)
    ahead = [here.time_pass.read(place) for place in range(here.read, FRAMES)]
    by_fork = [forked.step(frame_set).joints_m for frame_set in ahead]
    before = here.tracker.belief
    by_other = [again.step(frame_set).joints_m for frame_set in ahead]
    np.testing.assert_array_equal(by_fork, by_other)
    assert here.tracker.belief is before
    assert [frame_set.frame for frame_set in here.tracker.window.frames] == list(range(here.read - 3, here.read))


@pytest.mark.thorough
def test_a_kidnapped_tracker_is_wrong_and_as_sure_as_before(here):
    tracker, spoil = here.tracker, Spoil(Kind.ARM_IN_TRUNK, "Left")
    kidnapped = kidnap(tracker, here.past, spoil)
    hand = tracker.body.joints(kidnapped.belief.pose)[HAND]
    assert depth_in_trunk_m(tracker.body, kidnapped.belief.pose, hand) > 0.06
    assert depth_in_trunk_m(tracker.body, tracker.belief.pose, tracker.body.joints(tracker.belief.pose)[HAND]) < 0.0
    np.testing.assert_array_equal(kidnapped.belief.covariance, tracker.belief.covariance)
    np.testing.assert_array_equal(kidnapped.belief.information, tracker.belief.information)
