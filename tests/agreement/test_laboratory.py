"""A simulated laboratory is evaluated without its clock and frame, and files that do not fit are refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from laboratory_builder import Laboratory, make_laboratory, missed

from anchorpose.agreement import evaluating
from anchorpose.agreement.captured import read_captured
from anchorpose.agreement.evaluating import ALL, AS_MEASURED, OFFSET_REMOVED, agreement_rows, compare_with_reference
from anchorpose.agreement.matching import Match, match_results
from anchorpose.agreement.reference import exchanged, read_reference
from anchorpose.agreement.writing import methods_sentences
from anchorpose.camera import transform_points
from anchorpose.cli import main
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX
from anchorpose.options import ReferenceSettings
from anchorpose.results.joint_angles import joint_angles
from anchorpose.results.tables import JOINTS_FILE, read_joints


@pytest.fixture(scope="module")
def lab(tmp_path_factory) -> Laboratory:
    return make_laboratory(tmp_path_factory.mktemp("laboratory"), seed=207, seconds=45.0)


@pytest.fixture(scope="module")
def match(lab) -> Match:
    return match_results(lab.results, read_reference(lab.reference))


def test_clock_and_frame_are_found_from_the_movement(lab, match):
    off = missed(lab, match)
    assert off.time_ms < 5.0
    assert off.translation_mm < 3.0
    assert off.rotation_deg < 0.2
    assert abs(match.clock.drift - lab.drift) < 3.0 * match.clock.drift_sigma


def test_statistics_are_those_of_the_true_clock_and_frame_within_their_intervals(lab, match):
    """The same rows with the laboratory's joints put where they truly were."""
    found, true = match.placement.T_world_reference, lab.T_world_reference
    exact = replace(match, theirs_m=transform_points(true, transform_points(np.linalg.inv(found), match.theirs_m)))
    checked = 0
    for row, best in zip(agreement_rows([match], ["a"]), agreement_rows([exact], ["a"]), strict=True):
        if row.kind == "joint" and row.state == ALL and row.offset == AS_MEASURED:
            off = 5.0  # of the frame: 3 mm, and 0.2 degrees over the length of an arm
            assert abs(row.bias - best.bias) < off
            assert row.upper_low - off < best.upper < row.upper_high + off
            assert row.lower_low - off < best.lower < row.lower_high + off
            checked += 1
        if row.kind == "angle" and row.name.startswith("knee") and row.state == ALL and row.offset == OFFSET_REMOVED:
            assert row.bias_low < best.bias < row.bias_high
            assert row.upper_low < best.upper < row.upper_high
            checked += 1
    assert checked >= 32


def test_folders_whose_people_are_not_named_count_as_one_person(lab, match, monkeypatch):
    knee = [each for each in evaluating.quantities([match]) if each.name == "KneeLeft"]
    monkeypatch.setattr(evaluating, "match_results", lambda *given: match)
    monkeypatch.setattr(evaluating, "quantities", lambda matches: knee)
    monkeypatch.setattr(evaluating, "distance_rows", lambda *given: [])
    three = [lab.results] * 3, [lab.reference] * 3
    unnamed = compare_with_reference(*three, [], ReferenceSettings())
    assert {row.repeated for row in unnamed.rows} == {"stretch of time"}
    assert "subjects whose number was not stated" in methods_sentences(unnamed)[0]
    named = compare_with_reference(*three, ["a", "b", "c"], ReferenceSettings())
    assert {row.repeated for row in named.rows} == {"subject"}
    assert "of 3 subject(s)" in methods_sentences(named)[0]


@pytest.mark.thorough
def test_a_difference_of_definition_is_separated_from_error(lab, match, tmp_path):
    """The reference's left knee is put 30 mm farther down the thigh: its offset says so, and the errors stay."""
    reference = read_reference(lab.reference)
    place = reference.centres.position_m.copy()
    hip, knee = (JOINT_INDEX[name] for name in ("HipLeft", "KneeLeft"))
    along = place[:, knee] - place[:, hip]
    place[:, knee] += 0.03 * along / np.linalg.norm(along, axis=1, keepdims=True)
    other = match_results(lab.results, replace(reference, centres=replace(reference.centres, position_m=place)))
    change = other.placement.offset_m - match.placement.offset_m
    assert change[knee, 1] == pytest.approx(0.03, abs=0.008)  # the frame takes up a part
    assert np.nanmax(np.abs(np.delete(change, knee, axis=0))) < 0.008
    before, after = (
        next(
            row
            for row in agreement_rows([each], ["a"])
            if (row.name, row.axis, row.state, row.offset) == ("KneeLeft", "y", ALL, OFFSET_REMOVED)
        )
        for each in (match, other)
    )
    assert after.rmse == pytest.approx(before.rmse, abs=3.0)


def _edited(lab: Laboratory, path: Path, change) -> Path:
    lines = lab.reference.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(change(lines)) + "\n", encoding="utf-8")
    return path


def test_knees_that_bend_backwards_in_the_file_are_compared_with_the_sign_of_the_results(lab, tmp_path):
    ours = joint_angles(read_joints(lab.results / JOINTS_FILE))
    names = ("knee_flexion_left", "knee_flexion_right")
    bent = ours.degrees[:, [ours.column(name) for name in names]]
    rows = np.column_stack([ours.time_s, -bent]).tolist()
    text = "\n".join(["time_s,knee_angle_l_deg,knee_angle_r_deg", *(",".join(map(repr, row)) for row in rows)])
    (tmp_path / "angles.csv").write_text(text, encoding="utf-8")
    found = match_results(lab.results, read_reference(tmp_path / "angles.csv"))
    assert found.reference.angles == names
    assert np.nanmedian(np.abs(found.given_deg - bent)) < 0.1
    assert "opposite sign" in found.reference.notes[-1]


def test_left_and_right_exchanged_are_found_and_said(lab, tmp_path):
    def exchange(lines):
        cells = [{"L": "R", "R": "L"}.get(c[:1], "") + c[1:] if c[1:].isupper() else c for c in lines[3].split("\t")]
        return [*lines[:3], "\t".join(cells), *lines[4:]]

    path = _edited(lab, tmp_path / "exchanged.trc", exchange)
    with pytest.raises(InputError, match="left and right are exchanged"):
        match_results(lab.results, read_reference(path))
    settings = ReferenceSettings(exchange_sides=True)
    assert compare_with_reference([lab.results], [path], [], settings).matches[0].clock.correlation > 0.9


def _mirrored(lines):
    """The same markers in left-handed axes: every z, the last of three columns, with the other sign."""
    rows = [line.split("\t") for line in lines]
    for row in rows[5:]:
        row[4::3] = [cell and str(-float(cell)) for cell in row[4::3]]
    return ["\t".join(row) for row in rows]


@pytest.mark.thorough
def test_mirrored_axes_are_found_and_stated(lab, tmp_path):
    path = _edited(lab, tmp_path / "mirrored.trc", _mirrored)
    with pytest.raises(
        InputError, match=r"mirrored\.trc: is mirrored: .* instead of \d+ mm; .*the sign of one of its axes"
    ):
        match_results(lab.results, read_reference(path))
    with pytest.raises(InputError, match=r"is mirrored, and left and right are exchanged"):
        match_results(lab.results, exchanged(read_reference(path)))


@pytest.mark.parametrize(
    ("time_s", "place_m", "words"),
    [
        ("1e9", "0.1", "lasts 1e\\+09 s by its times; give its times in seconds"),
        ("1", "1e300", "points over 10000 m away"),
    ],
)
def test_values_that_nothing_can_have_are_refused(tmp_path, time_s, place_m, words):
    (tmp_path / "a.csv").write_text(f"time_s,Head_x_m,Head_y_m,Head_z_m\n0,0,0,0\n{time_s},{place_m},0,0\n")
    with pytest.raises(InputError, match=words):
        read_captured(tmp_path / "a.csv")


@pytest.mark.thorough
def test_another_unit_is_found_and_said(lab, tmp_path):
    path = _edited(lab, tmp_path / "unit.trc", lambda lines: [line.replace("\tmm\t", "\tm\t") for line in lines])
    with pytest.raises(InputError, match=r"in another unit.*--unit mm"):
        match_results(lab.results, read_reference(path))
    assert match_results(lab.results, read_reference(path, unit="mm")).clock.correlation > 0.9


def test_another_movement_is_refused(lab, tmp_path):
    other = make_laboratory(tmp_path / "other", seed=311, seconds=20.0)
    with pytest.raises(InputError, match="shares no movement"):
        match_results(lab.results, read_reference(other.reference))


@pytest.mark.thorough
def test_the_verb_writes_tables_sentences_and_a_page(lab, tmp_path, capsys):
    out = tmp_path / "agreement"
    command = ["evaluate", str(lab.results), "--reference", str(lab.reference), "-o", str(out)]
    assert main(command) == 0
    assert "standard error" in capsys.readouterr().out
    names = {"agreement.csv", "offsets.csv", "alignment.json", "methods.txt", "agreement.html"}
    assert {path.name for path in out.iterdir()} == names
    page = (out / "agreement.html").read_text(encoding="utf-8")
    assert page.count("<svg") >= 4
    assert "doi:10.1080/10543400701329422" in (out / "methods.txt").read_text(encoding="utf-8")
    assert main(command) == 2  # an earlier comparison is not replaced unasked
    assert main([*command, "--overwrite"]) == 0


def test_knees_whose_sign_is_undecided_and_nothing_else_are_refused_with_the_remedy(lab, tmp_path):
    rows = "\n".join(f"{t / 10}\t{np.sin(t)}" for t in range(200))
    (tmp_path / "a.mot").write_text(
        f"m\nversion=1\ninDegrees=yes\nendheader\ntime\tknee_angle_r\n{rows}\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"sign .*; name the angles knee_flexion_left"):
        match_results(lab.results, read_reference(tmp_path / "a.mot"))


@pytest.mark.parametrize(
    ("name", "text", "problem"),
    [
        ("a.trc", "PathFileType\t4\na\tb\nc\td\nFrame#\tTime\n\n\n", "no markers|unit"),
        ("a.csv", "time_s,x\n0,1\n1,2\n", "holds no markers"),
        ("a.csv", "time_s,Knee_x,Knee_y,Knee_z\n0,1,2,3\n1,2,3,4\n", "--unit"),
        ("a.csv", "time_s,Knee_x_mm\n0,eleven\n", "not a number"),
        ("a.csv", "time_s,A_x_mm,A_y_mm,A_z_mm\n0,1,2,3\n0,1,2,3\n", "do not increase"),
        ("a.mot", "name\nendheader\n", "not a MOT file"),
        ("a.c3d", "no c3d", "cannot be read as C3D"),
        ("a.xyz", "", "ends in '.xyz'"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_sentence(tmp_path, name, text, problem):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=problem):
        read_captured(path)


def test_labels_that_mean_nothing_are_listed(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time_s,Q1_x_mm,Q1_y_mm,Q1_z_mm\n0,1,2,3\n1,2,3,4\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"Q1.*--names"):
        read_reference(path)
    (tmp_path / "names.csv").write_text("joint,label\nKneeLeft,Q1\n", encoding="utf-8")
    assert read_reference(path, names=tmp_path / "names.csv").centres.joints == ("KneeLeft",)
