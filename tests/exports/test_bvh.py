"""BVH: forward kinematics of the file gives the joints back."""

import json
from pathlib import Path

import numpy as np
import pytest
from bvh_reader import Bvh, read_bvh
from exports_builder import times, true_joints, write_all_poses, write_true_results
from scipy.spatial.transform import Rotation

from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import MOVING_BONES, Pose, moving_bones
from anchorpose.body.segments import load_body_asset
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.exports.bvh import skeleton_of_joints
from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.exports.opensim_coordinates import joint
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.options import ExportConfig
from anchorpose.results.tables import BodyPose
from anchorpose.rotations import rotation_matrices

BY_JOINTS = {
    **{name: name for name in JOINT_NAMES if not name.startswith(("Hand", "Foot", "Head"))},
    "Neck_end": "Head",
    "WristLeft_end": "HandLeft",
    "WristRight_end": "HandRight",
    "AnkleLeft_end": "FootLeft",
    "AnkleRight_end": "FootRight",
}
BY_BONES = {"Hips": "SpineBase", "Spine": "SpineMid", "Neck": "SpineShoulder", "Neck1": "Neck", "Head_end": "Head"}
ARM = {"Arm": "Shoulder", "ForeArm": "Elbow", "Hand": "Wrist", "Hand_end": "Hand"}
LEG = {"UpLeg": "Hip", "Leg": "Knee", "Foot": "Ankle", "Foot_end": "Foot"}
BY_BONES |= {f"{side}{bone}": f"{name}{side}" for side in ("Left", "Right") for bone, name in (ARM | LEG).items()}


def exported(results: Path) -> list[Bvh]:
    ((folder, _),) = export_results(results, [Format.BVH], ExportConfig())
    return [read_bvh(path.read_text()) for path in sorted(folder.glob("*.bvh"))]


def off_mm(bvh: Bvh, joints: np.ndarray, names: dict[str, str]) -> dict[str, float]:
    return {
        name: float(np.linalg.norm(10.0 * bvh.paths_cm[node] - 1000.0 * joint(joints, name), axis=1).max())
        for node, name in names.items()
    }


def posed(count: int, spin_deg: float = 0.0) -> tuple[np.ndarray, list[BodyPose]]:
    """Joints (n, 21, 3) and poses of a body that turns all its bones, about every axis; spin: of the whole, a frame."""
    asset, rng = load_body_asset(), np.random.default_rng(11)
    body, moving = shape_body(asset, rng.normal(size=5)), moving_bones(asset)
    swing = rng.normal(scale=0.5, size=(2, len(moving), 3))
    joints, poses = [], []
    for frame in range(count):
        rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
        rotations[moving] = rotation_matrices(swing[0] * np.sin(0.3 * frame) + swing[1] * np.cos(0.2 * frame))
        rotations[moving[0]] = (
            rotation_matrices(np.array([[0.0, np.radians(spin_deg) * frame, 0.0]]))[0] @ rotations[moving[0]]
        )
        pose = Pose(rotations, np.array([0.1 * frame, 0.9, 0.0]))
        placed = body.bone_transforms(pose.rotations, pose.root_m)
        heads = np.einsum("bij,bj->bi", placed[moving, :3, :3], body.bone_heads[moving]) + placed[moving, :3, 3]
        quaternion = Rotation.from_matrix(placed[moving, :3, :3]).as_quat(canonical=True, scalar_first=True)
        joints.append(body.joints(placed))
        poses.append(BodyPose(frame, float(times(count)[frame]), heads, quaternion, np.full(len(moving), 0.1)))
    return np.array(joints), poses


def posed_results(folder: Path, spin_deg: float = 0.0, lost: int | None = None) -> np.ndarray:
    joints, poses = posed(20, spin_deg)
    write_true_results(folder, joints, lost={} if lost is None else {lost: JOINT_NAMES})
    if lost is not None:
        arrays = (poses[lost].head_m, poses[lost].quaternion, poses[lost].axial_sigma_rad)
        poses[lost] = BodyPose(lost, poses[lost].time_s, *(np.full_like(array, np.nan) for array in arrays))
    write_all_poses(folder, poses)
    return joints


def test_bones_of_constant_length_come_back_to_a_hundredth_of_a_millimetre(tmp_path):
    joints = true_joints()
    (bvh,) = exported(write_true_results(tmp_path / "results", joints))
    off = off_mm(bvh, joints, BY_JOINTS)
    assert len(off) == 21
    legs = [f"{name}{side}" for name in ("Hip", "Knee", "Ankle", "Foot") for side in ("Left", "Right")]
    assert max(off[name] for name in ["SpineBase", *legs]) < 0.01
    assert max(off.values()) < 15.0  # the joints' spine and collar bones have no constant length
    assert bvh.frame_s == pytest.approx(1.0 / 15.0)


@pytest.mark.parametrize("spin_deg", [0.0, 100.0])
def test_with_poses_every_joint_comes_back_and_bones_turn_about_themselves(tmp_path, spin_deg):
    joints = posed_results(tmp_path / "results", spin_deg)
    (bvh,) = exported(tmp_path / "results")
    assert set(bvh.paths_cm) >= set(MOVING_BONES)
    off = off_mm(bvh, joints, BY_BONES)
    assert len(off) == 21
    assert max(off.values()) < 0.05  # poses.parquet has single precision
    text = (tmp_path / "results" / "exports" / "bvh" / "motion.bvh").read_text()
    assert "End Site" in text


def test_a_frame_in_which_the_patient_is_lost_parts_the_file(tmp_path):
    joints = posed_results(tmp_path / "results", lost=8)
    first, second = exported(tmp_path / "results")
    assert len(first.paths_cm["Hips"]) == 8
    assert max(off_mm(first, joints[:8], BY_BONES).values()) < 0.05
    assert max(off_mm(second, joints[9:], BY_BONES).values()) < 0.05


def test_a_pause_longer_than_the_recording_parts_the_file_and_hides_no_bone(tmp_path):
    joints, time_s = true_joints(), times(75) + np.where(np.arange(75) >= 40, 10.0, 0.0)
    results = write_true_results(tmp_path / "results", joints, time_s, {20: ("AnkleLeft",), 22: ("AnkleLeft",)})
    parts = exported(results)
    assert [len(bvh.paths_cm["SpineBase"]) for bvh in parts] == [20, 17, 35]
    assert "AnkleLeft" in parts[0].paths_cm
    record = json.loads((results / "exports" / "bvh" / "export.json").read_text())
    assert record["counts"]["frames_left_out"] == 3
    assert any(note.endswith("next to them are not: 1.") for note in record["notes"])


def test_a_hand_that_is_lost_most_of_the_time_leaves_the_rest_of_the_arm(tmp_path):
    joints = true_joints()
    lost = dict.fromkeys(range(60), ("WristLeft", "HandLeft"))
    (bvh,) = exported(write_true_results(tmp_path / "results", joints, lost=lost))
    assert len(bvh.paths_cm["SpineBase"]) == 75
    assert "ElbowLeft" not in bvh.paths_cm  # it would have to point to the wrist
    upper_arm = np.linalg.norm(bvh.paths_cm["ShoulderLeft_end"] - bvh.paths_cm["ShoulderLeft"], axis=1)
    known = np.linalg.norm(joint(joints, "ElbowLeft") - joint(joints, "ShoulderLeft"), axis=1)
    assert upper_arm == pytest.approx(100.0 * known, abs=0.01)


def test_poses_between_jittering_stamps_are_turned_and_not_shortened(tmp_path):
    joints, poses = posed(20, spin_deg=15.0)  # past half a turn, where quaternions change their sign
    stamps = times(20) + np.random.default_rng(2).uniform(-0.01, 0.01, 20)
    folder = write_true_results(tmp_path / "results", joints, stamps)
    write_all_poses(folder, poses)
    (bvh,) = exported(folder)
    shank = np.linalg.norm(bvh.paths_cm["LeftFoot"] - bvh.paths_cm["LeftLeg"], axis=1)
    known = np.linalg.norm(joint(joints, "AnkleLeft") - joint(joints, "KneeLeft"), axis=1)
    assert np.ptp(shank) < 0.01
    grid = stamps[0] + bvh.frame_s * np.arange(len(shank))
    place = np.stack([np.interp(grid, stamps, axis) for axis in joint(joints, "KneeLeft").T], axis=1)
    assert np.linalg.norm(bvh.paths_cm["LeftLeg"] / 100.0 - place, axis=1).max() < 0.01  # an arc against its chord
    assert shank[0] == pytest.approx(100.0 * known[0], abs=0.01)


def test_the_chest_is_turned_by_the_shoulders_and_the_pelvis_by_the_hips():
    joints = true_joints()[:1].copy()
    before = {node.name: node.axes[0] for node in skeleton_of_joints(joints)}
    middle, turn = joint(joints, "SpineShoulder").copy(), Rotation.from_euler("Y", 40.0, degrees=True)
    for name in ("ShoulderLeft", "ShoulderRight"):
        joints[:, JOINT_INDEX[name]] = turn.apply(joints[:, JOINT_INDEX[name]] - middle) + middle
    after = {node.name: node.axes[0] for node in skeleton_of_joints(joints)}
    turned_deg = np.degrees(Rotation.from_matrix(after["SpineMid"] @ before["SpineMid"].T).magnitude())
    assert turned_deg == pytest.approx(40.0, abs=2.0)
    assert np.array_equal(after["SpineBase"], before["SpineBase"])


def test_poses_of_other_frames_are_refused(tmp_path):
    joints, poses = posed(20)
    folder = write_true_results(tmp_path / "results", joints)
    write_all_poses(folder, poses[:-1])
    with pytest.raises(InputError, match="other frames"):
        export_results(folder, [Format.BVH], ExportConfig())
    assert not (folder / "exports").exists()


@pytest.mark.parametrize("kind", [Format.BVH, Format.MOT])
def test_a_patient_who_is_lost_most_of_the_time_is_exported_where_known(tmp_path, kind):
    results = write_true_results(tmp_path / "results", true_joints(), lost=dict.fromkeys(range(30, 75), JOINT_NAMES))
    ((_, product),) = export_results(results, [kind], ExportConfig())
    counts = dict(product.counts)
    assert (counts["files"], counts["frames"], counts["frames_left_out"]) == (1, 30, 45)


@pytest.mark.parametrize("kind", [Format.BVH, Format.MOT])
def test_nothing_to_animate_is_refused(tmp_path, kind):
    lost = dict.fromkeys(range(75), JOINT_NAMES)
    results = write_true_results(tmp_path / "results", true_joints(), lost=lost)
    with pytest.raises(AnchorposeError, match="csv"):
        export_results(results, [kind], ExportConfig())
    assert not (results / "exports").exists()
