"""Evaluation against values worked out by hand, and refusal of what does not belong together."""

import json

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results
from scipy.spatial.transform import Rotation

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, JointState
from anchorpose.results.evaluate import evaluate
from anchorpose.results.evaluation_file import confidence_sentences, write_evaluation
from anchorpose.results.truth import read_true_touch, read_truth


def _write_truth(path, position_m, time_s, **more):
    np.savez(path, joints=position_m, names=np.array(JOINT_NAMES), time=np.array(time_s), **more)
    return path


def _shifted(shift_m):
    return standing_joints() + shift_m


def _evaluated(tmp_path, frames, true_m=None, time_s=None, **more):
    """The frames against a truth of as many frames, by default standing; time_s: by default ten frames a second."""
    true_m = np.stack([standing_joints()] * len(frames)) if true_m is None else true_m
    time_s = np.arange(len(true_m)) / 10 if time_s is None else time_s
    results = write_results(tmp_path / "results", frames)
    return evaluate(results, _write_truth(tmp_path / "truth.npz", true_m, time_s, **more))


def test_errors_are_distances_in_millimetres(tmp_path):
    """Four frames 30 mm off, six 50 mm off (3-4-5 triangles): every figure can be read off."""
    shifts = [(0.03, 0, 0)] * 4 + [(0.03, 0.04, 0)] * 6
    frames = [make_frame(i, i / 10, _shifted(shift), sigma_m=0.018) for i, shift in enumerate(shifts)]
    found = _evaluated(tmp_path, frames)
    assert (found.overall.mean_mm, found.overall.median_mm) == pytest.approx((42.0, 50.0))
    assert (found.overall.p95_mm, found.overall.lost_share) == (pytest.approx(50.0), 0.0)
    assert found.overall.coverage_95 == pytest.approx((4 * 3 + 6 * 2) / 30)  # 1.96 x 18 = 35 mm: only 40 mm is outside
    assert found.drift_ratio == pytest.approx(50.0 / 34.0)
    assert (found.matched_frames, found.truth_frames, found.missing_frames) == (10, 10, 0)
    assert dict(found.per_joint)["Head"].mean_mm == pytest.approx(42.0)
    assert dict(found.per_state)["observed"].joint_frames == 210
    assert dict(found.per_state)["hidden"].mean_mm is None


def test_lost_joints_are_counted_and_leave_the_means_alone(tmp_path):
    frames = [make_frame(i, i / 10, _shifted((0.01, 0, 0)), lost=("Head",) if i < 2 else ()) for i in range(4)]
    found = _evaluated(tmp_path, frames)
    assert (found.overall.lost_share, found.overall.mean_mm) == pytest.approx((2 / 84, 10.0))
    assert dict(found.per_joint)["Head"].lost_share == pytest.approx(0.5)
    assert dict(found.per_state)["lost"].joint_frames == 2
    assert dict(found.per_state)["lost"].mean_mm is None


def test_frames_called_occluded_are_evaluated_separately(tmp_path):
    frames = [make_frame(i, i / 10, _shifted((0.01 * (1 + i % 2), 0, 0))) for i in range(6)]
    found = _evaluated(tmp_path, frames, occluded=np.arange(6) % 2 == 1)
    assert (found.occluded_frames.mean_mm, found.clear_frames.mean_mm) == pytest.approx((20.0, 10.0))


def test_frames_are_matched_by_the_nearest_time_and_the_start_may_be_skipped(tmp_path):
    """The result lacks the frame at 0.2 s and its clock is 20 ms late; positions tell the frames apart."""
    places = [_shifted((0, 0, 0.1 * i)) for i in range(5)]
    frames = [make_frame(i, i / 10 + 0.02, places[i]) for i in (0, 1, 3, 4)]
    found = _evaluated(tmp_path, frames, np.stack(places))
    assert found.overall.mean_mm == pytest.approx(0.0, abs=1e-9)
    assert (found.matched_frames, found.missing_frames) == (4, 1)
    assert evaluate(tmp_path / "results", tmp_path / "truth.npz", skip_s=0.25).truth_frames == 2
    with pytest.raises(InputError, match="skip less"):
        evaluate(tmp_path / "results", tmp_path / "truth.npz", skip_s=5.0)


def test_truth_in_another_order_or_with_unknown_joints_is_the_same(tmp_path):
    results = write_results(tmp_path / "results", [make_frame(i, i / 10, _shifted((0.01, 0, 0))) for i in range(3)])
    order = np.random.default_rng(1).permutation(JOINT_COUNT)
    joints = np.stack([standing_joints()] * 3)
    joints[:, JOINT_INDEX["Neck"]] = np.nan
    names = np.array(JOINT_NAMES)[order]
    np.savez(tmp_path / "t.npz", joints=joints[:, order], names=names, time=np.arange(3) / 10)
    found = evaluate(results, tmp_path / "t.npz")
    assert (found.overall.mean_mm, found.overall.joint_frames) == (pytest.approx(10.0), 60)
    assert dict(found.per_joint)["Neck"].lost_share is None


def test_hidden_joints_are_those_that_were_inferred(tmp_path):
    """A head seen to 10 mm, hidden by a person at 20 mm and by a hole at 40 mm: the mean of the hidden ones is 30."""
    shifts = [(0.01, 0, 0), (0.02, 0, 0), (0.04, 0, 0)]
    states = [{}, {"Head": JointState.HIDDEN_BY_PERSON}, {"Head": JointState.HIDDEN}]
    frames = [make_frame(i, i / 10, _shifted(shift), states=states[i]) for i, shift in enumerate(shifts)]
    found = _evaluated(tmp_path, frames)
    assert (found.hidden.joint_frames, found.hidden.mean_mm) == (2, pytest.approx(30.0))


def test_angles_are_compared_with_those_of_the_true_joints(tmp_path):
    """An ankle turned about the knee by 10 degrees bends that knee by 10 degrees more, and no other angle."""
    joints = standing_joints()
    knee, ankle = joints[JOINT_INDEX["KneeLeft"]], joints[JOINT_INDEX["AnkleLeft"]]
    hip = joints[JOINT_INDEX["HipLeft"]]
    shank, thigh = ankle - knee, knee - hip
    normal = np.cross(thigh, shank)
    normal = normal / np.linalg.norm(normal) if np.linalg.norm(normal) > 1e-9 else np.array([0.0, 0.0, 1.0])
    bent = joints.copy()
    bent[JOINT_INDEX["AnkleLeft"]] = knee + Rotation.from_rotvec(normal * np.radians(10.0)).apply(shank)
    angles = dict(_evaluated(tmp_path, [make_frame(i, i / 10, bent, sigma_m=0.005) for i in range(3)]).angles)
    assert angles["knee_flexion_left"].mean_abs_deg == pytest.approx(10.0, abs=0.1)
    assert angles["knee_flexion_right"].mean_abs_deg == pytest.approx(0.0, abs=1e-6)
    assert (angles["elbow_flexion_left"].frames, angles["knee_flexion_left"].coverage_95) == (3, 0.0)
    assert angles["knee_flexion_right"].coverage_95 == 1.0


def test_the_longest_time_far_off_is_that_of_one_joint_without_a_break(tmp_path):
    """A wrist 0.2 m off in frames 1, 2 and 4 to 7 of ten a second, lost in 5, and a hand 0.14 m off all the time."""
    frames = []
    for i in range(10):
        joints = standing_joints().copy()
        joints[JOINT_INDEX["HandRight"]] += (0.14, 0, 0)
        if i in (1, 2, 4, 5, 6, 7):
            joints[JOINT_INDEX["WristLeft"]] += (0, 0.2, 0)
        frames.append(make_frame(i, i / 10, joints, lost=("WristLeft",) if i == 4 else ()))
    off = _evaluated(tmp_path, frames).longest_off
    assert (off.joint, off.start_s) == ("WristLeft", pytest.approx(0.5))
    assert off.seconds == pytest.approx(0.3)


def test_a_confident_error_is_far_off_and_outside_four_sigma_on_an_axis(tmp_path):
    """Of 21 joints in two frames: a hand 120 mm off along X at 20 mm, the same at 40 mm (within 4 sigma), a foot
    120 mm off in space but 70 mm on each axis at 20 mm (within), one 90 mm off at 20 mm, and a lost head."""
    joints, sigma_m = standing_joints(), 0.02
    joints[JOINT_INDEX["HandLeft"]] += (0.12, 0, 0)
    joints[JOINT_INDEX["FootLeft"]] += (0.07, 0.07, 0.07)
    joints[JOINT_INDEX["FootRight"]] += (0.0, 0.09, 0.0)
    joints[JOINT_INDEX["Head"]] += (0.0, 0.5, 0.0)
    frames = [make_frame(i, i / 10, joints, lost=("Head",), sigma_m=sigma_m * (1 + i)) for i in range(2)]
    assert _evaluated(tmp_path, frames).confident_errors == pytest.approx(1 / 42)


def test_joints_reported_where_the_truth_has_none_are_counted(tmp_path):
    """Of four frames, the patient is away in two and lacks the left foot: 21 + 21 + 1 + 1 places are absent. The result
    reports all joints in one of the frames without the patient, none in the other, and the foot once."""
    true_m = np.stack([standing_joints()] * 4)
    true_m[:2], true_m[:, JOINT_INDEX["FootLeft"]] = np.nan, np.nan
    lost = [(), JOINT_NAMES, ("FootLeft",), ()]
    frames = [make_frame(i, i / 10, standing_joints(), lost=lost[i]) for i in range(4)]
    found = _evaluated(tmp_path, frames, true_m)
    assert found.reported_absent_share == pytest.approx(22 / 44)
    assert (found.overall.joint_frames, found.confident_errors) == (40, 0.0)
    write_evaluation(tmp_path / "e.json", found)
    assert json.loads((tmp_path / "e.json").read_text())["reported_absent_share"] == pytest.approx(0.5)
    assert "Of the joints without a true position, 50.00 % are reported" in " ".join(confidence_sentences(found))
    assert _evaluated(tmp_path / "all", frames).reported_absent_share is None


def _wrong_arm(tmp_path, frames, **more):
    """The left elbow 0.2 m off in the given frames of ten at 10 Hz; the rest is exact."""
    rows = []
    for i in range(10):
        joints = standing_joints()
        joints[JOINT_INDEX["ElbowLeft"]] += (0, 0.2 if i in frames else 0.0, 0)
        joints[JOINT_INDEX["ShoulderRight"]] += (0.16 if i == 0 else 0.14, 0, 0)
        rows.append(make_frame(i, i / 10, joints))
    return _evaluated(tmp_path, rows, **more)


def test_a_limb_is_wrong_only_while_one_camera_sees_most_of_it(tmp_path):
    """The arm is wrong in frames 1 to 8. One camera sees 0.7 of it in frames 4 to 6; in frames 1 to 3 two cameras see
    0.4 each, which is most of it for neither; in frames 7 and 8 one sees the hand only."""
    share = np.zeros((10, JOINT_COUNT, 2))
    arm = [JOINT_INDEX[f"{name}Left"] for name in ("Elbow", "Wrist", "Hand")]
    share[1:4, arm] = 0.4
    share[4:7, arm, 1] = 0.7
    share[7:9, arm[2], 0] = 1.0
    found = _wrong_arm(tmp_path, range(1, 9), seen_share=share)
    wrong = dict(found.wrong_in_view)
    assert (wrong["arm_left"].seconds, wrong["arm_left"].start_s) == (pytest.approx(0.3), pytest.approx(0.4))
    assert wrong["arm_right"].seconds == wrong["leg_left"].seconds == wrong["trunk_and_head"].seconds == 0.0
    assert found.view_known


def test_without_what_cameras_saw_a_limb_counts_as_in_view_outside_occluded_frames(tmp_path):
    found = _wrong_arm(tmp_path, range(1, 9), occluded=np.arange(10) == 3)
    wrong = dict(found.wrong_in_view)
    assert (wrong["arm_left"].seconds, wrong["arm_left"].start_s) == (pytest.approx(0.5), pytest.approx(0.4))
    assert (wrong["trunk_and_head"].seconds, wrong["trunk_and_head"].start_s) == (pytest.approx(0.1), 0.0)
    assert not found.view_known
    assert found.truly_seen is None
    assert "not state what each camera saw" in " ".join(confidence_sentences(found))


def test_coverage_of_seen_and_hidden_joints_is_apart_by_the_result_and_by_the_truth(tmp_path):
    """Heads 30 mm off along X at 10 mm sigma: two axes of three are covered. The result calls the head hidden in one
    frame of four; the truth calls all joints seen but the head in two frames, seen by one of two cameras only."""
    joints, share = standing_joints(), np.zeros((4, JOINT_COUNT, 2))
    joints[JOINT_INDEX["Head"]] += (0.03, 0, 0)
    share[:, :, 1] = 0.9
    share[:2, JOINT_INDEX["Head"]] = 0.1
    states = [{"Head": JointState.HIDDEN_BY_PERSON}, {}, {}, {}]
    frames = [make_frame(i, i / 10, joints, sigma_m=0.01, states=states[i]) for i in range(4)]
    found = _evaluated(tmp_path, frames, seen_share=share)
    assert found.hidden.coverage_95 == pytest.approx(2 / 3)
    assert found.observed.coverage_95 == pytest.approx(1 - 3 / (83 * 3))
    assert (found.truly_hidden.joint_frames, found.truly_hidden.coverage_95) == (2, pytest.approx(2 / 3))
    assert found.truly_seen.coverage_95 == pytest.approx(1 - 2 / (82 * 3))


def test_the_json_and_the_sentences_state_what_is_wrong_in_view(tmp_path):
    found = _wrong_arm(tmp_path, [2, 3], seen_share=np.ones((10, JOINT_COUNT, 1)))
    write_evaluation(tmp_path / "e.json", found)
    document = json.loads((tmp_path / "e.json").read_text())
    assert document["longest_wrong_s"]["arm_left"] == pytest.approx(0.2)
    assert document["longest_wrong_from_s"]["arm_left"] == pytest.approx(0.2)
    assert document["longest_wrong_from_s"]["leg_left"] is None
    assert document["plain_view_by"] == "seen_share"
    assert document["confident_errors"] == pytest.approx(12 / 210)
    assert document["observed"]["coverage_95"] == pytest.approx(found.overall.coverage_95)
    confident, view, covered = confidence_sentences(found)
    assert "5.71 % of all joints" in confident
    assert "arm left 0.20 s, arm right 0.00 s" in view
    assert covered.startswith("Within 1.96 sigma: 98.1 % of observed joints;")  # 12 of 630 axes are outside


def test_seen_shares_are_read_in_the_order_of_the_joints(tmp_path):
    order = np.random.default_rng(2).permutation(JOINT_COUNT)
    share = np.random.default_rng(3).uniform(size=(2, JOINT_COUNT, 3))
    np.savez(
        tmp_path / "t.npz",
        joints=np.stack([standing_joints()] * 2)[:, order],
        names=np.array(JOINT_NAMES)[order],
        time=np.arange(2) / 10,
        seen_share=share[:, order],
    )
    assert np.array_equal(read_truth(tmp_path / "t.npz").seen_share, share)


BAD_TRUTH = {
    "seen_share .* does not fit": {"seen_share": np.ones((2, 4, 1))},
    "values outside of 0 to 1": {"seen_share": np.full((2, JOINT_COUNT, 1), np.nan)},
    "only 0 of 2 frames": {"time": np.array([90.0, 90.1])},
    "no array 'time'": {"time": None},
    "do not fit together": {"time": np.array([0.0])},
    "do not increase": {"time": np.array([0.1, 0.0])},
    "not numbers": {"time": np.array(["0", "1"])},
    r"do not fit together \(joints \(2, 21, 3\), time \(\)\)": {"time": np.array(0.0)},
    "occluded are not numbers": {"occluded": np.array(["a", "b"])},
    "as if they were milliseconds": {"time": np.array([0.0, 66.7])},
    "unknown or given twice": {"names": np.array(["Head"] * JOINT_COUNT)},
}


@pytest.mark.parametrize("problem", BAD_TRUTH)
def test_a_truth_that_does_not_belong_is_refused_by_name(tmp_path, problem):
    results = write_results(tmp_path / "results", [make_frame(i, i / 10, standing_joints()) for i in range(2)])
    arrays = {"joints": np.stack([standing_joints()] * 2), "names": np.array(JOINT_NAMES), "time": np.arange(2) / 10}
    arrays |= BAD_TRUTH[problem]
    np.savez(tmp_path / "truth.npz", **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(InputError, match=rf"truth\.npz: .*{problem}"):
        evaluate(results, tmp_path / "truth.npz")


@pytest.mark.parametrize("touched", [np.zeros((2, 2)), np.array(["a"]), np.array(1.0)])
@pytest.mark.parametrize("time_s", [np.arange(2) / 10, np.array(0.0)])
def test_contacts_that_do_not_fit_are_refused(tmp_path, touched, time_s):
    np.savez(tmp_path / "truth.npz", touched=touched, part_names=np.array("Spine"), time=time_s)
    with pytest.raises(InputError, match="touched and part_names do not fit"):
        read_true_touch(tmp_path / "truth.npz")


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 cut", b"no archive", "pickled"])
def test_a_truth_file_that_is_none_is_refused_and_pickled_objects_are_not_run(tmp_path, content):
    results = write_results(tmp_path / "results", [make_frame(0, 0.0, standing_joints())])
    if content == "pickled":
        _write_truth(tmp_path / "truth.npz", np.array([{}], dtype=object), [0.0])
    elif content is not None:
        (tmp_path / "truth.npz").write_bytes(content)
    with pytest.raises(InputError, match=r"truth\.npz: .*not a readable" if content == "pickled" else r"truth\.npz: "):
        evaluate(results, tmp_path / "truth.npz")


EXCHANGED = [
    JOINT_INDEX[name.replace("Left", "-").replace("Right", "Left").replace("-", "Right")] for name in JOINT_NAMES
]
METRES = "write its joints in metres, in a right-handed world with Y up"
BACKWARD = "toes and knees that point backward: it is mirrored, or its left and right are exchanged; change the sign"


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda joints: joints / 0.0254, f"bones 39.4 times as long as those of the results; {METRES}"),
        (lambda joints: joints / 0.3048, f"bones 3.28 times as long as those of the results; {METRES}"),
        (lambda joints: joints[..., [0, 2, 1]], f"a trunk 90 degrees off the vertical, unlike the results; {METRES}"),
        (lambda joints: joints * [1, -1, 1], f"a trunk 180 degrees off the vertical, unlike the results; {METRES}"),
        (lambda joints: joints * [-1, 1, 1], BACKWARD),
        (lambda joints: joints * [1, 1, -1], BACKWARD),
        (lambda joints: joints[..., [2, 1, 0]], BACKWARD),
        (lambda joints: joints[EXCHANGED], BACKWARD),
    ],
)
@pytest.mark.parametrize("tracked", ["right", "elsewhere", "back to front"])
def test_a_truth_in_another_unit_or_other_axes_is_refused_however_the_patient_was_tracked(
    tmp_path, change, sentence, tracked
):
    joints = standing_joints() + np.array([0.4, 0.0, 0.3])
    found = {"right": joints, "elsewhere": joints + 1.0, "back to front": joints * [-1, 1, -1]}[tracked]
    with pytest.raises(InputError, match=sentence):
        _evaluated(tmp_path, [make_frame(i, i / 10, found) for i in range(4)], np.stack([change(joints)] * 4))


@pytest.mark.parametrize("axis", [0, 2])
def test_a_truth_with_an_axis_reversed_and_labels_exchanged_is_refused_with_both_misfits(tmp_path, axis):
    """Its body is a right one; one arm is raised, and it is the other arm."""
    joints = standing_joints() + np.array([0.4, 0.0, 0.3])
    joints[JOINT_INDEX["HandLeft"]] += [0.5, 0.6, 0.0]
    mirrored = (joints * np.where(np.arange(3) == axis, -1.0, 1.0))[EXCHANGED]
    with pytest.raises(InputError, match=r"is mirrored: with one axis reversed it fits within 0 mm instead of \d\d mm"):
        _evaluated(tmp_path, [make_frame(i, i / 10, joints + 0.01) for i in range(4)], np.stack([mirrored] * 4))


@pytest.mark.parametrize("frames", [6, 60])
@pytest.mark.parametrize("unit_s", [60.0, 3600.0])
def test_a_truth_with_times_in_minutes_or_hours_is_refused(tmp_path, frames, unit_s):
    """Of six frames the first has a partner, which was enough."""
    time_s = np.arange(frames) / 15
    with pytest.raises(InputError, match=r"times closer than the results, as where its times are in minutes; write se"):
        _evaluated(
            tmp_path, [make_frame(i, t, standing_joints()) for i, t in enumerate(time_s)], time_s=time_s / unit_s
        )


def test_a_truth_that_is_turned_or_knows_few_joints_is_evaluated(tmp_path):
    """Turned by 180 degrees about the vertical, it fits with an axis reversed as well, as any symmetrical pose."""
    joints = standing_joints()
    few = np.where(np.arange(JOINT_COUNT)[:, None] == JOINT_INDEX["Neck"], joints, np.nan)
    for name, true, least_mm in (("turned", joints * [-1, 1, -1], 100.0), ("few", few, 0.0)):
        frames = [make_frame(i, i / 10, joints) for i in range(4)]
        assert _evaluated(tmp_path / name, frames, np.stack([true] * 4)).overall.mean_mm >= least_mm


def test_a_patient_tracked_back_to_front_or_in_another_place_is_an_error_that_is_reported(tmp_path):
    joints = standing_joints()
    for number, wrong in enumerate((joints[EXCHANGED], joints + np.array([0.0, 0.0, 1.5]))):
        frames, true_m = [make_frame(i, i / 10, wrong) for i in range(4)], np.stack([joints - [0.0, 0.0, 0.7]] * 4)
        assert _evaluated(tmp_path / str(number), frames, true_m).overall.mean_mm > 100


def test_a_truth_without_any_position_is_refused(tmp_path):
    frames = [make_frame(i, i / 10, standing_joints()) for i in range(4)]
    with pytest.raises(InputError, match=r"truth.npz: has no position of any joint in the 4 frames"):
        _evaluated(tmp_path, frames, np.full((4, JOINT_COUNT, 3), np.nan))
