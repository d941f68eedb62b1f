"""OpenSim itself reads what is exported: markers, coordinates, the model, scaling and inverse kinematics."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exports_builder import angle_names, angle_of, column, times, true_joints, write_all_poses, write_true_results
from scipy.spatial.transform import Rotation

from anchorpose.body.joint_ranges import hinge_axes
from anchorpose.body.kinematics import shape_body
from anchorpose.body.pose import moving_bones
from anchorpose.body.segments import load_body_asset
from anchorpose.cli import main
from anchorpose.exports.exporting import export_results
from anchorpose.exports.formats import Format
from anchorpose.exports.opensim_coordinates import (
    LOWER_SPINE_LEAN_DEG,
    SHIFTS,
    UPPER_SPINE_LEAN_DEG,
    bend_deg,
    joint,
    opensim_coordinates,
    torso_axes,
)
from anchorpose.exports.opensim_model import measure_body, model_xml
from anchorpose.joints import JOINT_NAMES
from anchorpose.options import CoordinateModel, ExportConfig
from anchorpose.results.tables import BodyPose
from anchorpose.results.truth import read_truth
from anchorpose.rotations import unit

BOTH, RAJAGOPAL = (Format.TRC, Format.MOT), CoordinateModel.RAJAGOPAL


@pytest.fixture(scope="module")
def osim() -> Any:
    package = pytest.importorskip("opensim", reason="there is no opensim wheel for this machine")
    package.Logger.setLevelString("Off")
    return package


@pytest.fixture(scope="module")
def squat(tmp_path_factory) -> tuple[Path, np.ndarray]:
    """The exports of a squat, and its joints."""
    results = write_true_results(tmp_path_factory.mktemp("squat") / "results", true_joints())
    export_results(results, BOTH, ExportConfig())
    return results / "exports", true_joints()


@contextmanager
def inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)  # set-up files name their neighbours, as they do where one is double-clicked
    try:
        yield
    finally:
        os.chdir(before)


def exported(folder: Path, joints: np.ndarray | None = None, kind: Format = Format.TRC, **more: Any) -> Path:
    """The export of results of these joints, by default a squat's."""
    joints = true_joints() if joints is None else joints
    ((out, _),) = export_results(write_true_results(folder / "results", joints, **more), [kind], ExportConfig())
    return out


def coordinate_column(osim: Any, path: Path, name: str) -> np.ndarray:
    return osim.TimeSeriesTable(str(path)).getDependentColumn(name).to_numpy()


def markers_of(osim: Any, path: Path) -> np.ndarray:
    """(n, 21, 3) as OpenSim reads a TRC."""
    table = osim.TimeSeriesTableVec3(str(path))
    assert list(table.getColumnLabels()) == list(JOINT_NAMES)
    assert table.getTableMetaDataString("Units") == "m"
    rows = range(table.getNumRows())
    return np.array([[table.getRowAtIndex(r)[m].to_numpy() for m in range(len(JOINT_NAMES))] for r in rows])


def solved(osim: Any, folder: Path, setup: str, name: str) -> np.ndarray:
    """A coordinate (n,) that OpenSim's inverse kinematics finds for a set-up file."""
    with inside(folder):
        tool = osim.InverseKinematicsTool(setup)
        assert tool.run()
        return coordinate_column(osim, Path(tool.getOutputMotionFileName()), name)


def knee_flexion(joints: np.ndarray, side: str) -> np.ndarray:
    hip, knee, ankle = (joint(joints, f"{name}{side}") for name in ("Hip", "Knee", "Ankle"))
    return bend_deg(knee - hip, ankle - knee)


def test_opensim_reads_every_marker_where_it_is_upright_and_in_metres(osim, squat):
    exports, joints = squat
    assert np.abs(markers_of(osim, exports / "trc" / "joints.trc") - joints).max() < 1e-6
    data = osim.MarkerData(str(exports / "trc" / "joints.trc"))
    assert (data.getUnits().getLabel(), data.getDataRate()) == ("meters", pytest.approx(15.0))
    assert joints[:, column("Head"), 1].min() > 1.0


def test_missing_markers_are_read_as_missing_by_both_of_opensims_readers(osim, tmp_path):
    lost = {0: ("SpineBase",), 3: ("FootRight", "HandLeft"), 4: JOINT_NAMES}
    path = exported(tmp_path, lost=lost) / "joints.trc"
    expected = np.zeros((75, 21), bool)
    for row, names in lost.items():
        expected[row, [column(name) for name in names]] = True
    assert np.array_equal(np.isnan(markers_of(osim, path)).all(axis=2), expected)
    data = osim.MarkerData(str(path))
    assert np.isnan(data.getFrame(3).getMarker(20).get(0))
    assert not np.isnan(data.getFrame(3).getMarker(0).get(0))


@pytest.mark.parametrize("seed", [3, 4])
def test_the_knee_of_inverse_kinematics_agrees_with_ours(osim, tmp_path, seed):
    joints = true_joints(seed=seed)
    folder = exported(tmp_path, joints)
    with inside(folder):
        assert osim.InverseKinematicsTool("ik_setup.xml").run()
    for side, end in (("Right", "r"), ("Left", "l")):
        ours = knee_flexion(joints, side)
        assert np.ptp(ours) > 20.0  # it is a squat
        theirs = coordinate_column(osim, folder / "ik_result.mot", f"knee_angle_{end}")
        assert np.abs(theirs - ours).max() < 5.0
    errors = osim.TimeSeriesTable(str(folder / "joints_ik_marker_errors.sto"))
    assert errors.getDependentColumn("marker_error_RMS").to_numpy().max() < 0.02


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12])
def test_from_a_recording_to_opensim_with_two_commands(osim, tmp_path, seed):
    recording, results = tmp_path / "squat" / "recording", tmp_path / "results"
    asked = ["--preset", "single", "--motions", "squat", "--seed", str(seed), "--seconds", "5"]
    assert main(["simulate", str(tmp_path / "squat"), *asked]) == 0
    assert main(["track", str(recording), "-o", str(results)]) == 0
    assert main(["export", str(results), "--to", "trc"]) == 0
    with inside(results / "exports" / "trc"):
        assert osim.InverseKinematicsTool("ik_setup.xml").run()
    truth = read_truth(tmp_path / "squat" / "truth" / "truth.npz").position_m
    for side, end in (("right", "r"), ("left", "l")):
        theirs = coordinate_column(osim, results / "exports" / "trc" / "ik_result.mot", f"knee_angle_{end}")
        assert np.abs(theirs - angle_of(results, f"knee_flexion_{side}")).max() < 5.0
        assert np.abs(theirs - knee_flexion(truth, side.capitalize()))[15:].max() < 10.0  # tracking's own error too


def test_inverse_kinematics_gets_over_missing_markers(osim, tmp_path):
    joints = true_joints()
    lost = dict.fromkeys(range(10, 20), ("HandLeft", "WristLeft", "Head"))
    folder = exported(tmp_path, joints, lost=lost)
    with inside(folder):
        assert osim.InverseKinematicsTool("ik_setup.xml").run()
    theirs = coordinate_column(osim, folder / "ik_result.mot", "knee_angle_r")
    assert np.abs(theirs - knee_flexion(joints, "Right")).max() < 5.0


def test_a_leg_that_is_lost_most_of_the_time_is_solved_where_it_is_known(osim, tmp_path):
    joints = true_joints()
    folder = exported(tmp_path, joints, lost=dict.fromkeys(range(30, 75), ("AnkleLeft", "FootLeft")))
    assert [path.name for path in folder.glob("ik_setup*.xml")] == ["ik_setup.xml"]
    theirs = solved(osim, folder, "ik_setup.xml", "knee_angle_l")
    assert np.abs(theirs - knee_flexion(joints[:30], "Left")).max() < 5.0


def test_a_leg_that_is_never_known_with_the_rest_gives_no_set_up(tmp_path):
    lost = {row: ("AnkleLeft",) if row < 40 else ("KneeRight",) for row in range(75)}
    folder = exported(tmp_path, lost=lost)
    assert list(folder.glob("ik_setup*.xml")) == []
    assert "No ik_setup.xml" in (folder / "export.json").read_text()


def test_a_pause_longer_than_the_recording_parts_the_set_up_and_hides_no_marker(osim, tmp_path):
    joints, time_s = true_joints(), times(75) + np.where(np.arange(75) >= 40, 10.0, 0.0)
    folder = exported(tmp_path, joints, time_s=time_s, lost=dict.fromkeys(range(20), ("AnkleLeft",)))
    assert "55 of 75 frames" in (folder / "export.json").read_text()
    for number, rows in enumerate((slice(20, 40), slice(40, 75)), 1):
        theirs = solved(osim, folder, f"ik_setup_{number:03d}.xml", "knee_angle_l")
        assert np.abs(theirs - knee_flexion(joints[rows], "Left")).max() < 5.0


@pytest.mark.parametrize("kind", CoordinateModel)
def test_a_knee_bent_back_by_18_degrees_is_not_cut_off(osim, tmp_path, kind):
    joints = standing_with({})[0]
    hip, knee, ankle, foot = (joints[column(f"{name}Left")] for name in ("Hip", "Knee", "Ankle", "Foot"))
    across, along = joints[column("HipRight")] - joints[column("HipLeft")], unit(knee - hip)
    forward = unit(np.cross(across, along))
    back = np.radians(18.0)
    placed = knee + np.linalg.norm(ankle - knee) * (np.cos(back) * along + np.sin(back) * forward)
    joints[column("AnkleLeft")], joints[column("FootLeft")] = placed, placed + foot - ankle
    results = write_true_results(tmp_path / "results", np.tile(joints, (3, 1, 1)))
    ((folder, _),) = export_results(results, [Format.TRC], ExportConfig(model=kind))
    assert angle_of(results, "knee_flexion_left") == pytest.approx(-18.0, abs=0.5)
    sign = 1.0 if kind is RAJAGOPAL else -1.0
    assert sign * solved(osim, folder, "ik_setup.xml", "knee_angle_l") == pytest.approx(-18.0, abs=2.0)


def lengths_off_m(osim: Any, trc_folder: Path, work: Path, joints: np.ndarray) -> np.ndarray:
    """How far bones are off after OpenSim has scaled the mean adult by the TRC."""
    mean = measure_body(shape_body(load_body_asset(), np.zeros(0)).rest_joints()[None])
    assert abs((mean["AnkleLeft"] - measure_body(joints)["AnkleLeft"])[1]) > 0.005  # there is something to scale
    (work / "model.osim").write_text(model_xml(mean, RAJAGOPAL))
    for name in ("joints.trc", "scale_setup.xml"):
        (work / name).write_text((trc_folder / name).read_text())
    with inside(work):
        assert osim.ScaleTool("scale_setup.xml").run()
    model = osim.Model(str(work / "scaled.osim"))
    state = model.initSystem()
    places = {m.getName(): m.getLocationInGround(state).to_numpy() for m in model.getMarkerSet()}
    bones = [
        (f"{a}{side}", f"{b}{side}")
        for side in ("Left", "Right")
        for a, b in (("Hip", "Knee"), ("Knee", "Ankle"), ("Ankle", "Foot"), ("Elbow", "Wrist"))
    ]
    ours = [np.linalg.norm(joint(joints, end) - joint(joints, start), axis=1).mean() for start, end in bones]
    return np.abs(np.array([np.linalg.norm(places[end] - places[start]) for start, end in bones]) - ours)


def test_the_scale_tool_turns_the_mean_adult_into_the_patient(osim, squat, tmp_path):
    exports, joints = squat
    assert lengths_off_m(osim, exports / "trc", tmp_path, joints).max() < 0.001


def test_scaling_takes_the_longest_time_in_which_all_markers_are_there(osim, tmp_path):
    lost = {row: ("HandLeft", "KneeRight") for row in range(60) if row % 2}
    folder = exported(tmp_path, lost=lost)
    span = f"<time_range>{float(times(75)[60])!r} {float(times(75)[74])!r}</time_range>"
    assert span in (folder / "scale_setup.xml").read_text()
    (tmp_path / "work").mkdir()
    assert lengths_off_m(osim, folder, tmp_path / "work", true_joints()).max() < 0.001


def place_markers(osim: Any, model: Any, state: Any, path: Path, row: int) -> np.ndarray:
    """(21, 3) where the model's markers are with the coordinates of a MOT's row."""
    table = osim.TimeSeriesTable(str(path))
    assert table.getTableMetaDataString("inDegrees") == "yes"
    for name, value in zip(table.getColumnLabels(), table.getRowAtIndex(row).to_numpy(), strict=True):
        in_metres = name in ("pelvis_tx", "pelvis_ty", "pelvis_tz")
        model.getCoordinateSet().get(name).setValue(state, value if in_metres else np.radians(value), False)
    model.realizePosition(state)
    return np.array([model.getMarkerSet().get(n).getLocationInGround(state).to_numpy() for n in JOINT_NAMES])


@pytest.mark.parametrize("kind", CoordinateModel)
@pytest.mark.parametrize("turned_deg", [0.0, 130.0])
def test_the_mot_played_on_the_model_puts_its_markers_where_the_joints_are(osim, tmp_path, kind, turned_deg):
    cosine, sine = np.cos(np.radians(turned_deg)), np.sin(np.radians(turned_deg))
    joints = true_joints("weight-shift") @ np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    results = write_true_results(tmp_path / "results", joints)
    export_results(results, BOTH, ExportConfig(model=kind))
    model = osim.Model(str(results / "exports" / "trc" / "model.osim"))
    state = model.initSystem()
    carried = [column(f"{name}{side}") for name in ("Hip", "Knee", "Elbow") for side in ("Left", "Right")]
    for row in (0, 30, 60):
        off = np.linalg.norm(
            place_markers(osim, model, state, results / "exports" / "mot" / "motion.mot", row) - joints[row], axis=1
        )
        assert off[[column("SpineBase"), *carried]].max() < 0.025  # the chest of the model is stiff
        assert off[[column("HipLeft"), column("KneeRight")]].max() < 0.003


def bent_body() -> tuple[np.ndarray, BodyPose]:
    """Joints (21, 3) and pose of a body with thighs lifted, spread and turned inwards, knees and elbows bent."""
    asset = load_body_asset()
    body, moving = shape_body(asset, np.zeros(0)), moving_bones(asset)
    rotations = np.tile(np.eye(3), (len(asset.bone_names), 1, 1))
    for side, sign in (("Right", 1.0), ("Left", -1.0)):
        turned = Rotation.from_euler("ZXY", [50.0, -10.0 * sign, 25.0 * sign], degrees=True).as_matrix()
        rotations[asset.bone(f"{side}UpLeg")] = turned
        lifted = Rotation.from_euler("ZXY", [30.0, 15.0 * sign, -20.0 * sign], degrees=True).as_matrix()
        rotations[asset.bone(f"{side}Arm")] = lifted
        for lower, bend in (("Leg", 70.0), ("ForeArm", 50.0)):
            hinge, _ = hinge_axes(asset, f"{side}{lower}")
            rotations[asset.bone(f"{side}{lower}")] = Rotation.from_rotvec(np.radians(bend) * hinge[0]).as_matrix()
    placed = body.bone_transforms(rotations, np.array([0.2, 0.9, -0.1]))
    heads = np.einsum("bij,bj->bi", placed[moving, :3, :3], body.bone_heads[moving]) + placed[moving, :3, 3]
    quaternion = Rotation.from_matrix(placed[moving, :3, :3]).as_quat(canonical=True, scalar_first=True)
    return body.joints(placed), BodyPose(0, 0.0, heads, quaternion, np.full(len(moving), 0.1))


def test_the_learnt_bodys_turns_about_long_axes_bring_ankles_and_wrists_to_their_places(osim, tmp_path):
    joints, pose = bent_body()
    results = write_true_results(tmp_path / "results", np.tile(joints, (3, 1, 1)))
    write_all_poses(results, [replace(pose, frame=row, time_s=float(times(3)[row])) for row in range(3)])
    export_results(results, BOTH, ExportConfig())
    model = osim.Model(str(results / "exports" / "trc" / "model.osim"))
    state, path = model.initSystem(), results / "exports" / "mot" / "motion.mot"
    off = np.linalg.norm(place_markers(osim, model, state, path, 1) - joints, axis=1)
    assert off[[column(f"{name}{side}") for name in ("Ankle", "Wrist") for side in ("Left", "Right")]].max() < 0.015
    inwards = [coordinate_column(osim, path, f"hip_rotation_{end}")[0] for end in "rl"]
    assert inwards == pytest.approx([25.0, 25.0], abs=8.0)  # the rest pose's thigh is not quite upright


def standing_with(moves: dict[str, tuple[float, float, float]]) -> np.ndarray:
    """The upright mean body (1, 21, 3) with joints moved."""
    joints = shape_body(load_body_asset(), np.zeros(0)).rest_joints()[None].copy()
    for name, move in moves.items():
        joints[0, column(name)] += move
    return joints


def coordinates_of(joints: np.ndarray) -> dict[str, float]:
    found = opensim_coordinates(joints, RAJAGOPAL)
    return {name: float(values[0]) for name, values in found.items()}


def test_pelvis_lumbar_and_ankle_are_zero_in_the_mean_body_that_stands_upright():
    zeros = coordinates_of(standing_with({}))
    for name in ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "lumbar_extension", "lumbar_bending"):
        assert zeros[name] == pytest.approx(0.0, abs=0.2)
    shank = standing_with({})[0, column("AnkleRight")] - standing_with({})[0, column("KneeRight")]
    leaning = np.degrees(np.arctan2(-shank[0], -shank[1]))  # the foot is flat, the shank is not quite upright
    assert zeros["ankle_angle_r"] == pytest.approx(leaning, abs=1.5)


@pytest.mark.parametrize(
    ("name", "sign", "moves"),
    [
        ("hip_flexion_r", 1, {"KneeRight": (0.1, 0, 0)}),
        ("hip_adduction_r", 1, {"KneeRight": (0, 0, -0.1)}),
        ("hip_adduction_l", 1, {"KneeLeft": (0, 0, 0.1)}),
        ("ankle_angle_l", 1, {"FootLeft": (0, 0.05, 0)}),
        ("arm_flex_l", 1, {"ElbowLeft": (0.1, 0, 0)}),
        ("arm_add_r", 1, {"ElbowRight": (0, 0, -0.1)}),
        ("elbow_flex_r", 1, {"WristRight": (0.05, 0.1, 0)}),
        ("lumbar_extension", -1, {"SpineShoulder": (0.1, 0, 0)}),
        ("lumbar_bending", 1, {"SpineShoulder": (0, 0, 0.1)}),
        ("pelvis_list", 1, {"HipRight": (0, -0.02, 0)}),
        ("pelvis_rotation", 1, {"HipRight": (0.02, 0, 0)}),
        ("pelvis_tilt", -1, {"SpineMid": (0.1, 0, 0)}),
    ],
)
def test_each_coordinate_goes_the_way_that_opensim_counts(name, sign, moves):
    change = coordinates_of(standing_with(moves))[name] - coordinates_of(standing_with({}))[name]
    assert sign * change > 3.0


# Our angle: the coordinate, its sign and what is added, in degrees; docs/export.md has the same table.
OURS = {
    **{
        f"{angle}_{side}": (f"{name}_{side[0]}", 1, added)
        for side in ("right", "left")
        for angle, name, added in (
            ("knee_flexion", "knee_angle", 0.0),
            ("elbow_flexion", "elbow_flex", 0.0),
            ("hip_pelvis_flexion", "hip_flexion", LOWER_SPINE_LEAN_DEG),
            ("hip_adduction", "hip_adduction", 0.0),
            ("ankle_dorsiflexion", "ankle_angle", 0.0),
        )
    },
    "pelvis_tilt": ("pelvis_tilt", -1, -LOWER_SPINE_LEAN_DEG),
    "pelvis_obliquity": ("pelvis_list", -1, 0.0),
    "pelvis_rotation": ("pelvis_rotation", 1, 0.0),
    "trunk_pelvis_flexion": ("lumbar_extension", -1, LOWER_SPINE_LEAN_DEG + UPPER_SPINE_LEAN_DEG),
    "trunk_pelvis_side_bend": ("lumbar_bending", 1, 0.0),
    "trunk_pelvis_rotation": ("lumbar_rotation", 1, 0.0),
}


def test_coordinates_follow_from_our_angles_as_the_docs_say(tmp_path):
    results = write_true_results(tmp_path / "results", true_joints())
    theirs = opensim_coordinates(true_joints(), RAJAGOPAL)
    compared = [name for name in angle_names(results) if name in OURS]
    assert {"knee_flexion_right", "knee_flexion_left", "elbow_flexion_right", "elbow_flexion_left"} <= set(compared)
    for name in compared:
        coordinate, sign, added = OURS[name]
        found, ours = theirs[coordinate], sign * angle_of(results, name) + added
        # the turns of pelvis and trunk are taken in another order than ours, which shows as far as they are combined
        tolerance = 2.0 if name.startswith(("pelvis", "trunk")) else 1e-6
        assert np.abs(found - ours)[np.isfinite(ours)].max() < tolerance, name


def test_a_mot_with_gaps_is_several_files_that_opensim_reads_whole(osim, tmp_path):
    lost = {row: ("WristRight", *(["KneeLeft"] if row in (30, 31, 33) else [])) for row in range(40)}
    files = sorted(exported(tmp_path, kind=Format.MOT, lost=lost).glob("*.mot"))
    assert [file.name for file in files] == ["motion_001.mot", "motion_002.mot"]
    rows = [osim.Storage(str(file)).getSize() for file in files]
    assert rows == [30, 41]  # frame 32 alone is no motion
    labels = list(osim.TimeSeriesTable(str(files[0])).getColumnLabels())
    assert "elbow_flex_r" not in labels  # known in less than half of the frames: left out, not zero
    assert "elbow_flex_l" in labels
    assert osim.TimeSeriesTable(str(files[1])).getIndependentColumn()[0] == times(75)[34]


def mot_table(path: Path) -> tuple[list[str], np.ndarray]:
    """Names, and the rows (n, c) as they stand in the file."""
    lines = path.read_text().splitlines()
    head = lines.index("endheader") + 1
    return lines[head].split("\t"), np.array([[float(cell) for cell in line.split("\t")] for line in lines[head + 1 :]])


def test_a_mot_goes_on_in_another_file_after_a_pause_of_the_recording(tmp_path):
    time_s = times(75) + np.where(np.arange(75) >= 40, 3.0, 0.0)
    time_s[60:] += 1.0 / 15.0  # one frame that was not recorded is a gap as well
    files = sorted(exported(tmp_path, kind=Format.MOT, time_s=time_s).glob("*.mot"))
    found = [mot_table(file)[1][:, 0] for file in files]
    assert [len(part) for part in found] == [40, 20, 15]
    assert np.concatenate(found) == pytest.approx(time_s, abs=1e-9)


def test_a_patient_who_turns_past_minus_x_turns_on_and_does_not_leap(osim, tmp_path):
    turned_deg = np.linspace(160.0, 205.0, 75)
    turn = Rotation.from_euler("y", turned_deg[:, None], degrees=True).as_matrix()
    joints = np.einsum("nij,nkj->nki", turn, true_joints("weight-shift"))
    results = write_true_results(tmp_path / "results", joints)
    export_results(results, BOTH, ExportConfig())
    names, rows = mot_table(results / "exports" / "mot" / "motion.mot")
    assert np.abs(np.diff(rows[:, 1:], axis=0)).max() < 30.0
    rotation = rows[:, names.index("pelvis_rotation")]
    assert np.abs(rotation - turned_deg).max() < 15.0
    assert rotation[-1] > 185.0
    straight = opensim_coordinates(joints, CoordinateModel.RAJAGOPAL)
    for name, values in straight.items():
        away = rows[:, names.index(name)] - values
        assert np.abs(away - 360.0 * np.rint(away / 360.0)).max() < 1e-5
    with inside(results / "exports" / "trc"):
        assert osim.InverseKinematicsTool("ik_setup.xml").run()
        solved = coordinate_column(osim, Path("ik_result.mot"), "pelvis_rotation")
    assert np.abs((solved - rotation + 180.0) % 360.0 - 180.0).max() < 5.0


def with_right_arm(direction: np.ndarray) -> np.ndarray:
    """Joints (n, 21, 3) of the upright mean body whose right arm has the direction (n, 3), in the axes of the trunk."""
    joints = np.repeat(standing_with({}), len(direction), axis=0)
    along = np.einsum("nij,nj->ni", torso_axes(joints), direction)
    for above, below in (("Shoulder", "Elbow"), ("Elbow", "Wrist"), ("Wrist", "Hand")):
        joints[:, column(f"{below}Right")] = joints[:, column(f"{above}Right")] + 0.25 * along
    return joints


def test_an_arm_that_circles_about_the_line_of_the_shoulders_collects_no_whole_turns(osim, tmp_path):
    lifted, turned = np.radians(np.minimum(np.arange(75) * 4.0, 80.0)), np.radians(np.arange(75) * 20.0)
    lifted[60:] = 0.0  # the arm hangs again
    flat = np.cos(lifted)
    direction = np.stack([flat * np.sin(turned), -flat * np.cos(turned), np.sin(lifted)], axis=1)
    direction[60:] = (0.0, -1.0, 0.0)
    results = write_true_results(tmp_path / "results", with_right_arm(direction))
    export_results(results, BOTH, ExportConfig())
    names, rows = mot_table(results / "exports" / "mot" / "motion.mot")
    assert rows[60:, names.index("arm_flex_r")] == pytest.approx(0.0, abs=1e-3)
    model = osim.Model(str(results / "exports" / "trc" / "model.osim"))
    for name, column_values in zip(names[1:], rows[:, 1:].T, strict=True):
        coordinate = model.getCoordinateSet().get(name)
        values = column_values if name in SHIFTS else np.radians(column_values)
        assert coordinate.getRangeMin() <= values.min() <= values.max() <= coordinate.getRangeMax(), name


def test_an_arm_lifted_past_the_vertical_makes_no_jump(tmp_path):
    lifted_deg = np.linspace(-60.0, 200.0, 75)
    direction = np.stack([np.sin(np.radians(lifted_deg)), -np.cos(np.radians(lifted_deg)), np.zeros(75)], axis=1)
    folder = exported(tmp_path, with_right_arm(direction), kind=Format.MOT)
    names, rows = mot_table(folder / "motion.mot")
    assert rows[:, names.index("arm_flex_r")] == pytest.approx(lifted_deg, abs=1e-3)


def test_without_a_bone_there_are_markers_but_no_model(tmp_path):
    lost = dict.fromkeys(range(75), ("FootLeft",))
    results = write_true_results(tmp_path / "results", true_joints(), lost=lost)
    ((folder, product),) = export_results(results, [Format.TRC], ExportConfig())
    assert sorted(path.name for path in folder.iterdir()) == ["export.json", "joints.trc"]
    assert "No model.osim" in product.notes[0]


def test_frames_that_opensim_cannot_solve_part_its_set_up_and_the_rest_is_solved(osim, tmp_path):
    joints, kept = true_joints(), np.delete(np.arange(75), [50, 51])
    lost = dict.fromkeys(range(20, 26), JOINT_NAMES) | {40: ("KneeLeft",)}
    results = write_true_results(tmp_path / "results", joints[kept], times(75)[kept], lost)
    ((folder, product),) = export_results(results, [Format.TRC], ExportConfig())
    setups = sorted(folder.glob("ik_setup*.xml"))
    assert [path.name for path in setups] == [f"ik_setup_{number:03d}.xml" for number in (1, 2, 3, 4)]
    spans = ((0, 20), (26, 40), (41, 50), (52, 75))
    for path, (first, last) in zip(setups, spans, strict=True):
        theirs = solved(osim, folder, path.name, "knee_angle_l")
        assert np.abs(theirs - knee_flexion(joints[first:last], "Left")).max() < 5.0
    assert any("66 of 73 frames" in note for note in product.notes)
