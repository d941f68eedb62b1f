"""Joint centres from markers and the sign of knees against known answers; files against another library."""

from pathlib import Path
from typing import Final

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from anchorpose.agreement.captured import read_captured
from anchorpose.agreement.marking import known_marking
from anchorpose.agreement.matching import with_knee_sign
from anchorpose.agreement.reference import functional_centre, harrington_hip, other_side, pelvis_frame, read_reference
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX
from anchorpose.options import HipCentre
from anchorpose.results.tables import AngleTable


def test_the_hip_is_where_harrington_puts_it_in_any_pose():
    """Pelvis 240 mm wide and 130 mm deep: -41.1, -82.9, 86.5 mm by the published equations."""
    assert 1000 * harrington_hip(0.240, 0.130) == pytest.approx([-41.1, -82.9, 86.5])
    rest = np.array([[0, 0, -0.12], [0, 0, 0.12], [-0.13, 0, -0.045], [-0.13, 0, 0.045]])
    turn, shift = Rotation.from_rotvec([0.3, 1.2, -0.5]), np.array([1.0, 0.5, -2.0])
    axes, middle, width, depth = pelvis_frame(*(turn.apply(marker)[None] + shift for marker in rest))
    assert (width, depth) == pytest.approx((0.24, 0.13))
    found = middle + axes[0] @ harrington_hip(width, depth)
    assert found[0] == pytest.approx(turn.apply([-0.0411, -0.0829, 0.0865]) + shift)


def test_a_functional_centre_is_the_point_that_markers_turn_about_and_a_plane_does_not_determine_it():
    rng, centre = np.random.default_rng(3), np.array([0.05, -0.02, 0.09])
    turns = Rotation.from_rotvec(rng.uniform(-0.6, 0.6, (300, 3)))
    markers = [centre + turns.apply(place) for place in ([0.05, -0.3, 0.04], [0.0, -0.4, 0.06])]
    found, swing = functional_centre(markers)
    assert found == pytest.approx(centre, abs=1e-9)
    assert swing > 0.1
    flat = Rotation.from_euler("z", rng.uniform(-0.6, 0.6, (300, 1)))
    assert functional_centre([centre + flat.apply([0.05, -0.3, 0.04])])[1] < 1e-6


def test_labels_in_common_use_are_understood():
    marking = known_marking(("LKNE", "LKNM", "RHJC", "left_ankle", "LASI", "RASI", "LPSI", "RPSI", "LTHI", "C7"))
    assert marking.midpoints == {"KneeLeft": ("LKNE", "LKNM")}
    assert marking.centres == {"AnkleLeft": "left_ankle", "HipRight": "RHJC"}
    assert marking.pelvis == ("LASI", "RASI", "LPSI", "RPSI")
    assert marking.thighs["Left"] == ("LTHI", "LKNE", "LKNM")
    assert known_marking(("C7", "T10")).empty
    assert [other_side(name) for name in ("KneeLeft", "hip_flexion_right", "Head")] == [
        "KneeRight",
        "hip_flexion_left",
        "Head",
    ]


@pytest.mark.parametrize(
    ("lateral", "medial"),
    [("R.Knee", "R.Knee.Medial"), ("R_KNEE", "R_KNEE_MED"), ("Right Knee", "Right Knee Medial"), ("R.Knee", "RKNM")],
)
def test_a_marker_with_the_joints_name_is_lateral_beside_a_medial_one(lateral, medial):
    """The names of Cortex: the medial marker was ignored, and knees were 30 mm off."""
    marking = known_marking((lateral, medial, "R.Thigh"))
    assert marking.midpoints == {"KneeRight": (lateral, medial)}
    assert marking.centres == {}
    assert marking.thighs["Right"] == ("R.Thigh", lateral, medial)
    for joint in ("Ankle", "Elbow", "Wrist"):
        pair = (f"L.{joint}", f"L.{joint}.Medial")
        assert known_marking(pair).midpoints == {f"{joint}Left": pair}


def test_a_joints_name_alone_is_taken_as_its_centre_with_a_note(tmp_path: Path):
    points = {"L.Knee": 0.5, "R Knee JC": 0.5, "KneeRight": 0.5, "L.Ankle.Medial": 0.1}
    marking = known_marking(tuple(points))
    assert marking.centres == {"KneeLeft": "L.Knee", "KneeRight": "KneeRight"}
    assert marking.assumed == {"KneeLeft"}
    (tmp_path / "a.trc").write_text(
        "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n15\t15\t2\t2\tm\n"
        "Frame#\tTime\tL.Knee\t\t\tR.Knee.JC\n\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n\n"
        "1\t0.0\t0.1\t0.5\t0\t0.3\t0.5\t0\n2\t0.1\t0.1\t0.5\t0\t0.3\t0.5\t0\n"
    )
    assert read_reference(tmp_path / "a.trc").notes == (
        "KneeLeft: L.Knee, taken as the joint's centre",
        "KneeRight: R.Knee.JC, as given",
    )


def test_a_c3d_written_by_ezc3d_is_read_with_its_gaps_units_and_angles(tmp_path: Path):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    points = np.ones((4, 3, 5))
    points[:3, 0] = np.arange(15).reshape(3, 5)
    points[:3, 0, 2] = np.nan
    points[0, 2] = np.arange(5) * 10.0
    for name, value in {
        "LABELS": ["Anna:LKJC", "*1", "Anna:LKneeAngles"],
        "UNITS": ["cm"],
        "RATE": [50.0],
        "DESCRIPTIONS": ["", "", ""],
    }.items():
        file["parameters"]["POINT"][name]["value"] = value
    file.add_parameter("POINT", "ANGLES", ["Anna:LKneeAngles"])
    file["data"]["points"] = points
    file.write(str(tmp_path / "a.c3d"))
    found = read_captured(tmp_path / "a.c3d")
    assert (found.points, found.angles) == (("LKJC",), ("LKneeAngles",))
    assert found.point_m[:, 0] == pytest.approx(0.01 * points[:3, 0].T, nan_ok=True)
    assert np.isnan(found.point_m[2]).all()
    assert np.diff(found.time_s) == pytest.approx(0.02)
    assert found.degrees[:, 0] == pytest.approx(np.arange(5) * 10.0)
    assert read_reference(tmp_path / "a.c3d").angles == ("knee_flexion_left",)


def test_points_of_a_c3d_beyond_its_labels_are_left_out(tmp_path: Path):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    for name, value in {"LABELS": ["LKJC"], "UNITS": ["m"], "RATE": [50.0], "DESCRIPTIONS": [""]}.items():
        file["parameters"]["POINT"][name]["value"] = value
    file["data"]["points"] = np.ones((4, 1, 5))
    file.write(str(tmp_path / "a.c3d"))
    # the label's name is in the file once; without it, its point has none
    content = (tmp_path / "a.c3d").read_bytes()
    (tmp_path / "b.c3d").write_bytes(content.replace(b"LABELS", b"LABELT"))
    with pytest.raises(InputError, match=r"b\.c3d"):
        read_captured(tmp_path / "b.c3d")


def _write_mot(path: Path, angles: dict[str, np.ndarray]) -> Path:
    """A MOT file with one angle per column, in degrees, at 10 Hz."""
    rows = np.column_stack([np.arange(len(next(iter(angles.values())))) / 10.0, *angles.values()]).tolist()
    head = ["m", "version=1", "inDegrees=yes", "endheader", "\t".join(["time", *angles])]
    path.write_text("\n".join([*head, *("\t".join(map(repr, row)) for row in rows)]) + "\n", encoding="utf-8")
    return path


def _knees(left_deg: np.ndarray, right_deg: np.ndarray) -> AngleTable:
    """The knees of results, all seen."""
    degrees = np.stack([left_deg, right_deg], axis=1)
    names = ("knee_flexion_left", "knee_flexion_right")
    frame, state_code = np.arange(len(degrees)), np.zeros(degrees.shape, np.int8)
    return AngleTable(frame, frame / 10.0, names, degrees, state_code, np.ones(degrees.shape))


SWAY: Final = np.sin(np.linspace(0.0, 20.0, 80))


def test_a_mot_in_radians_gives_degrees(tmp_path: Path):
    rows = "\n".join(f"{t / 10}\t{t / 10}\t0.9" for t in range(12))
    text = f"m\nversion=1\ninDegrees=no\nendheader\ntime\tknee_angle_r\tpelvis_ty\n{rows}\n"
    (tmp_path / "a.mot").write_text(text, encoding="utf-8")
    found = read_reference(tmp_path / "a.mot")
    assert (found.angles, found.labels) == (("knee_flexion_right",), ("knee_angle_r",))
    assert found.degrees[:, 0] == pytest.approx(np.degrees(np.arange(12) / 10))


def test_the_pelvis_angles_of_opensim_are_not_this_program_s_angles_of_the_same_names(tmp_path: Path):
    pelvis = dict.fromkeys(("pelvis_tilt", "pelvis_rotation"), SWAY)
    ours = read_reference(_write_mot(tmp_path / "ours.mot", pelvis))
    assert ours.angles == tuple(pelvis)
    found = read_reference(_write_mot(tmp_path / "a.mot", pelvis | {"pelvis_list": SWAY, "hip_flexion_r": SWAY}))
    assert found.angles == ("hip_pelvis_flexion_right",)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("left", "right"), [(13.0, 11.0), (30.0, 2.0), (-9.0, -7.0)])
def test_both_knees_of_a_file_get_the_sign_of_the_results(tmp_path: Path, sign: float, left: float, right: float):
    """In a standing frame, with one knee nearly straight, and with overstretched knees."""
    ours = _knees(left + 4.0 * SWAY, right + 2.0 * SWAY)
    in_file = {"knee_angle_r": sign * (right + 3.0 * SWAY), "hip_flexion_r": SWAY, "knee_angle_l": sign * (left + SWAY)}
    found = with_knee_sign(read_reference(_write_mot(tmp_path / "a.mot", in_file)), ours)
    assert found.angles == ("knee_flexion_right", "hip_pelvis_flexion_right", "knee_flexion_left")
    expected = [in_file["knee_angle_r"] * sign, SWAY, in_file["knee_angle_l"] * sign]
    assert found.degrees == pytest.approx(np.stack(expected, axis=1))
    how = "the sign as given" if sign > 0 else "the opposite sign"
    assert found.notes[-1].startswith(f"knee_angle_r and knee_angle_l: taken with {how}; ")


@pytest.mark.parametrize("off_deg", [-2.0, 2.0])
def test_knees_whose_sign_is_undecided_are_left_out_until_the_file_states_it(tmp_path: Path, off_deg: float):
    ours, straight = _knees(2.0 + 3.0 * SWAY, 1.0 + 3.0 * SWAY), {"l": off_deg + 3.0 * SWAY, "r": 3.0 * SWAY}
    path = _write_mot(tmp_path / "a.mot", {f"knee_angle_{side}": angle for side, angle in straight.items()})
    found = with_knee_sign(read_reference(path), ours)
    assert np.isnan(found.degrees).all()
    assert "left out, since the results do not show" in found.notes[-1]
    assert "name the angles knee_flexion_left and knee_flexion_right" in found.notes[-1]
    named = {"knee_flexion_left": straight["l"], "knee_flexion_right": straight["r"]}
    stated = read_reference(_write_mot(path, named))
    assert with_knee_sign(stated, ours) is stated
    lost = with_knee_sign(
        read_reference(_write_mot(path, {"knee_angle_l": 50.0 + SWAY})), _knees(SWAY * np.nan, 50.0 + SWAY)
    )
    assert np.isnan(lost.degrees).all()


def test_a_csv_has_points_and_angles_with_empty_cells(tmp_path: Path):
    text = "time_s,LKJC_x_mm,LKJC_y_mm,LKJC_z_mm,knee_flexion_left_deg\n0,1,2,3,10\n1,,,,11\n"
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    found = read_captured(tmp_path / "a.csv")
    assert found.point_m[0, 0] == pytest.approx([0.001, 0.002, 0.003])
    assert np.isnan(found.point_m[1]).all()
    assert found.degrees[:, 0] == pytest.approx([10.0, 11.0])


def test_a_functional_hip_that_walking_does_not_determine_is_refused_and_a_good_one_is_used(tmp_path: Path):
    """The thigh turns about Harrington's hip, once in all directions, once with a knee that slides as it swings."""
    rng, times = np.random.default_rng(6), 400
    bones = {"LASI": (0, 0, -0.12), "RASI": (0, 0, 0.12), "LPSI": (-0.15, 0, -0.05), "RPSI": (-0.15, 0, 0.05)}
    hip = harrington_hip(0.24, 0.15) * [1.0, 1.0, -1.0]
    turns = Rotation.from_rotvec(rng.uniform(-0.7, 0.7, (times, 3)) * [0.6, 0.2, 1.0])
    for slide_m, works in ((0.0, True), (0.15, False)):
        points = {name: np.repeat(np.array([place]), times, axis=0) for name, place in bones.items()}
        for name, place in (("LKNE", (0.0, -0.4, -0.05)), ("LKNM", (0.0, -0.4, 0.05)), ("LTHI", (0.05, -0.2, -0.06))):
            points[name] = hip + turns.apply(place)
            points[name][:, 1] += slide_m * np.abs(points[name][:, 0])
            points[f"R{name[1:]}"] = points[name] * [1.0, 1.0, -1.0]
        head = ["time_s", *(f"{name}_{axis}_m" for name in points for axis in "xyz")]
        rows = np.concatenate([np.arange(times)[:, None] / 50, *points.values()], axis=1)
        text = "\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())])
        (tmp_path / "a.csv").write_text(text, encoding="utf-8")
        if works:
            centres = read_reference(tmp_path / "a.csv", hip=HipCentre.FUNCTIONAL).centres
            assert centres.position_m[5, JOINT_INDEX["HipLeft"]] == pytest.approx(hip, abs=1e-6)
            assert "functional" in centres.origin[JOINT_INDEX["HipLeft"]]
        else:
            with pytest.raises(InputError, match="too little movement of the left thigh"):
                read_reference(tmp_path / "a.csv", hip=HipCentre.FUNCTIONAL)
