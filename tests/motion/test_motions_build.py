"""Files of reference movements: made from results and skeletons, read back, refused, and used by the tracker's rule."""

from pathlib import Path

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results

from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.motion.database import (
    DERIVED,
    SHIPPED,
    ReferenceClips,
    pose_vectors,
    read_motions,
    read_skeletons,
    write_motions,
)
from anchorpose.motion.prediction import MotionConfig, MotionRule, load_motions
from anchorpose.results.reference_clips import clips_of_results

UIPRMD = Path(__file__).parents[3] / "shared" / "data" / "uiprmd_kinect" / "skeletons.npz"
ARM, LEG = ("UpperArm", "Forearm", "Hand"), ("UpperLeg", "LowerLeg", "Foot", "Toes")
LIMBS = (f"{side}{bone}" for bones in (ARM, LEG) for side in "LR" for bone in bones)
BONES = ("Waist", "Spine", "Chest", "Neck", "Head", *LIMBS)
OURS = [name for name in JOINT_NAMES if not name.startswith("Hand")]


def squats(frames: int) -> np.ndarray:
    """(frames, 21, 3) metres: up and down, 4 m from the origin."""
    joints = np.repeat(standing_joints()[None] + [4.0, 0.0, -1.0], frames, axis=0)
    joints[:, :, 1] -= 0.1 * np.sin(np.arange(frames) / 6)[:, None] ** 2
    return joints


def results_of(folder: Path, joints: np.ndarray, lost: tuple[int, ...] = (), hz: float = 30.0, missing=()) -> Path:
    frames = [
        make_frame(i, i / hz, joints[i], ("Head",) if i in lost else ()) for i in range(len(joints)) if i not in missing
    ]
    return write_results(folder, frames)


def skeletons(path: Path, names=JOINT_NAMES, **changes) -> Path:
    """Two clips of squats, 40 and 30 frames, in the joints ``names``."""
    joints = squats(70)[:, [JOINT_INDEX.get(name, 0) for name in names]]
    arrays = {
        "joints_mm": np.rint(1000 * (joints - [4.0, 0.0, 0.0])).astype(np.int16),
        "offsets": np.array([0, 40, 70]),
        "names": np.array(["one", "two"]),
        "joint_names": np.array(names),
    } | changes
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    return path


def test_a_file_of_movements_is_a_round_trip_to_the_millimetre_beside_the_origin(tmp_path):
    clips = ReferenceClips((squats(30), squats(12)), ("squat", "short"), (30.0, 15.0), ("made here",))
    write_motions(tmp_path / "m.npz", clips)
    found = read_motions(tmp_path / "m.npz")
    assert (found.names, found.rate_hz, found.notes) == (clips.names, clips.rate_hz, clips.notes)
    for one, other in zip(found.joints_m, clips.joints_m, strict=True):
        assert one == pytest.approx(other - other[0, 0], abs=0.0006)
    assert [path.name for path in tmp_path.iterdir()] == ["m.npz"]


def test_lost_frames_and_gaps_cut_the_clips_of_a_result(tmp_path):
    folder = results_of(tmp_path / "run", squats(100), lost=(40, 41, 45), missing=(70,))
    clips = clips_of_results(folder)
    assert [len(clip) for clip in clips.joints_m] == [40, 24, 29]  # three frames between lost ones are too short
    assert clips.rate_hz == pytest.approx([30.0] * 3)
    assert clips.joints_m[1] == pytest.approx(squats(100)[46:70])
    assert clips.notes == ("run: 3 clips, 93 frames at 30 Hz; 6 frames with lost joints or beside gaps left out",)


def test_a_result_without_half_a_second_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"has no 0.5 s without a lost joint or a gap; give a result"):
        clips_of_results(results_of(tmp_path / "run", squats(30), lost=tuple(range(0, 30, 10))))


def test_joints_of_a_skeleton_file_go_by_our_names_or_the_bones_and_the_rest_is_derived_and_said(tmp_path):
    clips = read_skeletons(skeletons(tmp_path / "ours.npz"), 25.0)
    assert clips.rate_hz == (25.0, 25.0)
    assert np.concatenate(clips.joints_m) == pytest.approx(squats(70) - [4.0, 0.0, 0.0], abs=0.0006)
    assert clips.notes == ("ours.npz: 2 clips, 70 frames at 25 Hz",)
    same = np.load(skeletons(tmp_path / "o.npz", OURS))
    np.savez(tmp_path / "bones.npz", **{**same, "joint_names": np.array(BONES)}, rate_hz=30.0)
    bones = read_skeletons(tmp_path / "bones.npz", None)
    assert bones.notes[0].endswith("; derived, since the file has none: HandLeft, HandRight")
    found = np.concatenate(bones.joints_m)
    for name in OURS:
        assert found[:, JOINT_INDEX[name]] == pytest.approx(np.concatenate(clips.joints_m)[:, JOINT_INDEX[name]])
    elbow, wrist, hand = (found[:, JOINT_INDEX[name]] for name in ("ElbowLeft", "WristLeft", "HandLeft"))
    assert hand - elbow == pytest.approx(DERIVED["HandLeft"][2] * (wrist - elbow))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"offsets": None}, "has no array 'offsets'"),
        ({"offsets": np.array([0, 40, 60])}, "offsets do not cut"),
        ({"offsets": np.array([0, 0, 70])}, "offsets do not cut"),
        ({"joint_names": np.array(["a"])}, "do not fit 1 joint names"),
        (
            {"joint_names": np.array(["Hip", *JOINT_NAMES[1:]])},
            "no joint for SpineBase; name a joint SpineBase or Waist",
        ),
        ({"joints_mm": np.full((70, 21, 3), np.nan)}, "not numbers"),
        ({"joints_mm": np.cumsum(np.full((70, 21, 3), 500), axis=0)}, "more than 10 m .* write them in millimetres"),
        ({"rate_hz": np.array(-1.0)}, "rate_hz is not one number above 0"),
    ],
)
def test_a_skeleton_file_that_cannot_be_used_is_refused_with_a_remedy(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        read_skeletons(skeletons(tmp_path / "s.npz", **changes), 30.0)


def test_the_rate_of_a_skeleton_file_must_be_known(tmp_path):
    with pytest.raises(InputError, match="does not state how many frames per second it has; give --rate"):
        read_skeletons(skeletons(tmp_path / "s.npz"), None)


def test_the_verb_puts_all_kinds_of_sources_into_one_file_and_says_what_went_in(tmp_path, capsys):
    run = results_of(tmp_path / "run", squats(60), hz=15.0)
    out, more = tmp_path / "new" / "m.npz", tmp_path / "more.npz"
    assert main(["motions", "build", str(out), str(run), str(skeletons(tmp_path / "s.npz")), "--rate", "30"]) == 0
    printed = capsys.readouterr().out
    assert "run: 1 clips, 60 frames at 15 Hz." in printed
    assert "3 clips, 130 frames" in printed
    assert main(["motions", "build", str(more), str(out), str(run)]) == 0
    assert read_motions(more).rate_hz == pytest.approx([15.0, 30.0, 30.0, 15.0])
    database = load_motions(out, 30.0, MotionConfig())
    assert database.theta[:60, 1] == pytest.approx(pose_vectors(squats(60))[:, 1], abs=0.001)


def test_the_verb_refuses_in_one_sentence_and_leaves_what_is_there(tmp_path, refusal):
    out, run = tmp_path / "m.npz", results_of(tmp_path / "run", squats(60))
    assert main(["motions", "build", str(out), str(run)]) == 0
    before = out.read_bytes()
    (tmp_path / "text.npz").write_text("no archive")
    (tmp_path / "empty").mkdir()
    refusals = {
        (str(out), str(run)): "--overwrite",
        (str(out), str(out), "--overwrite"): "is given twice",
        (str(tmp_path / "m.json"), str(run)): "does not end in .npz",
        (str(tmp_path / "n.npz"),): "No sources are given",
        (str(tmp_path / "n.npz"), str(tmp_path / "empty")): "there is no such file",
        (str(tmp_path / "n.npz"), str(tmp_path / "text.npz")): "not a readable .npz file",
    }
    for arguments, sentence in refusals.items():
        assert sentence in refusal(["motions", "build", *arguments])
    assert out.read_bytes() == before
    assert not (tmp_path / "n.npz").exists()
    assert main(["motions", "build", str(out), str(run), "--overwrite"]) == 0


def test_a_file_that_is_none_is_refused_when_tracking_asks_for_it(tmp_path):
    np.savez(tmp_path / "other.npz", a=1)
    for name, problem in (("other.npz", "not a file of reference movements"), ("none.npz", "no such file")):
        with pytest.raises(InputError, match=problem):
            load_motions(tmp_path / name, 30.0, MotionConfig())
    assert load_motions(tmp_path / "none.npz", 30.0, MotionConfig(rule=MotionRule.VELOCITY)) is None
    write_motions(tmp_path / "short.npz", ReferenceClips((squats(4),), ("s",), (30.0,)))
    with pytest.raises(InputError, match=r"cannot be used at 30 frames per second \(no clip"):
        load_motions(tmp_path / "short.npz", 30.0, MotionConfig())


def test_the_shipped_movements_are_such_a_file_and_say_where_they_come_from():
    clips = read_motions(SHIPPED)
    assert clips.frame_count == 1800
    assert "simulated movements" in clips.notes[0]
    hip, knee = (clips.joints_m[0][:, JOINT_INDEX[name]] for name in ("HipLeft", "KneeLeft"))
    thigh_m = np.linalg.norm(hip - knee, axis=1)
    assert np.ptp(thigh_m) < 0.002
    assert 0.3 < thigh_m.mean() < 0.5


def test_the_skeletons_of_ui_prmd_become_a_database():
    if not UIPRMD.exists():
        pytest.skip(f"{UIPRMD} is absent: the UI-PRMD skeletons are not part of this project")
    clips = read_skeletons(UIPRMD, 30.0)
    assert (len(clips.names), clips.frame_count) == (1400, 110_457)
    assert "HandLeft, HandRight" in clips.notes[0]
