"""Extension, sway, symmetry and assistance: figures that can be worked out by hand, and laws of motion and mirror."""

import numpy as np
import pytest
from results_builder import make_frame, standing_joints, write_results
from scipy.spatial.transform import Rotation
from session_builder import RATE, contact, measured, squatting_joints, table, value, why

from anchorpose.cli import main
from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.results.records import read_episodes, read_measures
from anchorpose.results.tables import read_posture, read_processed_angles
from anchorpose.results.uncertainty import ANGLE_SHARE, sigma_of_mean

ABOVE = [row for row, name in enumerate(JOINT_NAMES) if not name.startswith(("Ankle", "Foot"))]


def swaying(ahead_m: float, aside_m: float, hz: float, seconds: float, noise_m: float = 0.0) -> np.ndarray:
    """Everything sways as one along an ellipse, so its centre of mass does."""
    time_s = np.arange(round(seconds * RATE)) / RATE
    joints = np.repeat(standing_joints()[None], len(time_s), axis=0)
    joints[:, :, 0] += ahead_m * np.cos(2 * np.pi * hz * time_s)[:, None]
    joints[:, :, 2] += aside_m * np.sin(2 * np.pi * hz * time_s)[:, None]
    return joints + noise_m * np.random.default_rng(1).normal(size=joints.shape)


def test_sway_along_an_ellipse_has_its_path_its_spread_and_its_area():
    ahead, aside, seconds = 0.03, 0.01, 40.0
    found = measured(table(swaying(ahead, aside, 0.25, seconds)))[1]
    u = np.linspace(0, 2 * np.pi, 20001)
    around = np.hypot(np.diff(ahead * np.cos(u)), np.diff(aside * np.sin(u))).sum()
    turns = 0.25 * (seconds - 1 / RATE)
    assert value(found, "sway_path") == pytest.approx(1000 * around * turns, rel=0.01)
    assert value(found, "sway_velocity") == pytest.approx(1000 * around * 0.25, rel=0.01)
    assert value(found, "sway_rms_ap") == pytest.approx(1000 * ahead / np.sqrt(2), rel=0.01)
    assert value(found, "sway_rms_ml") == pytest.approx(1000 * aside / np.sqrt(2), rel=0.01)
    assert value(found, "sway_ellipse_area") == pytest.approx(np.pi * 5.991 * 100 * ahead * 100 * aside / 2, rel=0.01)
    assert value(found, "sway_path_noise") < 0.01 * value(found, "sway_path")
    assert value(found, "sway_time") == pytest.approx(seconds - 1 / RATE)


def test_jitter_is_not_reported_as_sway_and_does_not_add_to_it():
    assert "noise" in why(measured(table(swaying(0.0, 0.0, 0.25, 40.0, noise_m=0.004)))[1], "sway_path")
    clean, shaken = (
        value(measured(table(swaying(0.02, 0.01, 0.25, 40.0, noise_m=n)))[1], "sway_path") for n in (0.0, 0.002)
    )
    assert shaken == pytest.approx(clean, rel=0.1)


def test_a_spread_that_noise_may_have_made_is_not_given_and_one_that_noise_enlarges_is_as_uncertain():
    """Errors of 4 mm that all joints share and that last too long to be filtered away, and nothing else."""
    found = {}
    for sway_m in (0.0, 0.012):
        joints = swaying(sway_m, sway_m, 0.25, 240.0)
        walk = np.repeat(np.random.default_rng(6).normal(size=(len(joints) // 20, 1, 3)), 20, axis=0)
        joints = joints + 0.004 * walk * [1.0, 0.0, 1.0]
        found[sway_m] = measured(table(joints, sigma_m=0.012))[1]
    for name in ("sway_rms_ap", "sway_rms_ml", "sway_ellipse_area"):
        assert "noise" in why(found[0.0], name)
    for name in ("sway_rms_ap", "sway_rms_ml"):
        row = found[0.012][name, None, None, None]
        assert abs(row.value - 12.0 / np.sqrt(2)) < 1.96 * row.sigma
        assert row.value > 12.0 / np.sqrt(2)


def test_sway_of_short_bouts_and_of_slow_cameras_is_not_given():
    assert why(measured(table(swaying(0.02, 0.01, 0.25, 4.0)))[1], "sway_path")
    joints = table(swaying(0.02, 0.01, 0.25, 60.0))
    slow = type(joints)(*(getattr(joints, name)[::5] for name in type(joints).__slots__))
    assert "6 frames a second" in why(measured(slow)[1], "sway_path")


def test_extension_while_upright_is_that_of_the_frames_in_which_the_patient_stood_and_may_be_negative():
    thighs = np.concatenate([np.full(100, 5.0), np.full(100, 15.0), np.full(60, 80.0)])
    found = measured(table(squatting_joints(thighs)))[1]
    for side in ("left", "right"):
        assert value(found, "knee_flexion_upright_mean", side) == pytest.approx(10.0)
        assert value(found, "knee_flexion_upright_least", side) == pytest.approx(5.0)
        assert value(found, "knee_flexion_upright_greatest", side) == pytest.approx(15.0)
        assert value(found, "hip_flexion_upright_mean", side) == pytest.approx(10.0)
        assert value(found, "knee_straight_time", side) == pytest.approx(5.0)
    assert value(found, "knee_flexion_difference") == pytest.approx(0.0, abs=1e-9)
    row = found["knee_flexion_upright_mean", "left", None, None]
    assert (row.frames, row.inferred_share) == (200, 0.0)
    found = measured(table(squatting_joints(np.concatenate([np.full(100, -15.0), np.full(100, -5.0)]))))[1]
    for side in ("left", "right"):
        assert value(found, "knee_flexion_upright_mean", side) == pytest.approx(-10.0)
        assert value(found, "knee_flexion_upright_least", side) == pytest.approx(-15.0)
        assert value(found, "knee_straight_time", side) == pytest.approx(5.0)


def test_the_way_up_is_neither_standing_with_bent_knees_nor_sway():
    """85 degrees to straight in 2 s, then still: all that moves is the rise."""
    rise = 85 * (0.5 + 0.5 * np.cos(np.linspace(0, np.pi, 40)))
    found = measured(table(squatting_joints(np.concatenate([np.full(80, 85.0), rise, np.zeros(200)]))))[1]
    assert value(found, "knee_flexion_upright_greatest", "left") < 1.0
    assert value(found, "hip_flexion_upright_greatest", "left") < 1.0
    assert value(found, "sway_time") == pytest.approx(
        9.5, abs=0.15
    )  # the last twentieth of the rise is within the second after it
    assert value(found, "sway_path_noise") < 0.5
    row = found["sway_path", None, None, None]
    assert row.value is None or row.value < 2.0
    assert value(found, "upright_time") > 10.2  # the way counts as upright time all the same


def test_a_mean_over_many_frames_is_hardly_more_certain_than_one_frame():
    short, long = (
        measured(table(squatting_joints(np.full(n, 12.0))))[1]["knee_flexion_upright_mean", "left", None, None].sigma
        for n in (20, 2000)
    )
    assert 0.7 * short < long < short
    sigma = np.full(10, 2.0)
    assert sigma_of_mean(sigma, np.full(10, 1e9), ANGLE_SHARE) == pytest.approx(2.0 * np.sqrt(ANGLE_SHARE))
    assert sigma_of_mean(sigma, np.full(10, 1e-3), ANGLE_SHARE) == pytest.approx(2.0)


def test_leaning_over_one_foot_loads_it_and_beyond_the_feet_there_is_no_share():
    joints = np.repeat(standing_joints()[None], 40, axis=0)
    middle = measured(table(joints))[1]
    assert value(middle, "load_share", "left") == pytest.approx(0.5, abs=1e-9)
    joints[:, ABOVE, 2] += 0.045  # half of the way to the right foot
    right = measured(table(joints))[1]
    assert value(right, "load_share", "right") == pytest.approx(0.75, abs=0.02)
    assert value(right, "load_share", "left") + value(right, "load_share", "right") == pytest.approx(1.0)
    together = np.repeat(standing_joints()[None], 40, axis=0)
    together[:, [JOINT_INDEX["AnkleLeft"], JOINT_INDEX["AnkleRight"]], 2] = [-0.03, 0.03]
    assert why(measured(table(together))[1], "load_share", "left")
    joints = np.repeat(standing_joints()[None], 40, axis=0)
    joints[:20, ABOVE, 2] += 0.15  # beyond the right ankle: a person or a thing holds the patient
    row = measured(table(joints))[1]["load_share", "right", None, None]
    assert (row.value, row.frames) == (pytest.approx(0.5, abs=1e-9), 20)
    joints[:, ABOVE, 2] += 0.15
    assert "between" in why(measured(table(joints))[1], "load_share", "right")


def test_measures_do_not_depend_on_where_the_room_is_and_a_mirror_exchanges_the_sides():
    rng = np.random.default_rng(8)
    joints = swaying(0.02, 0.01, 0.2, 12.0, noise_m=0.001) + 0.02 * rng.normal(size=(1, 21, 3))
    turned = joints @ Rotation.from_euler("y", 2.0).as_matrix().T + [1.0, 0.0, -3.0]
    swap = [name.replace("Left", "*").replace("Right", "Left").replace("*", "Right") for name in JOINT_NAMES]
    mirrored = (joints * [1, 1, -1])[:, [JOINT_INDEX[name] for name in swap]]
    here, there, over = (measured(table(j))[1] for j in (joints, turned, mirrored))
    other = {"left": "right", "right": "left", None: None}
    for key, row in here.items():
        name, side, part, person = key
        assert there[key].value == pytest.approx(row.value), name
        sign = -1.0 if name.endswith("_difference") else 1.0
        twin = over[name, other[side], part, person].value
        assert twin == pytest.approx(None if row.value is None else sign * row.value, abs=1e-6), name


TOUCHED = (
    contact("knee_left", "person 1", 0, 99),
    contact("knee_left", "person 2", 50, 149),
    contact("pelvis", "person 2", 80, 119, seen=0.2),
)


def test_assistance_is_given_by_part_and_person_without_counting_a_moment_twice():
    joints = table(squatting_joints(np.concatenate([np.zeros(160), np.full(40, 80.0)])))
    found = measured(joints, TOUCHED)[1]
    assert (value(found, "assistance_time"), value(found, "contacts")) == (pytest.approx(7.5), 3.0)
    assert found["assistance_time", "left", "knee_left", None].value == pytest.approx(7.5)
    assert found["assistance_time", None, None, "person 2"].value == pytest.approx(5.0)
    assert found["assistance_time", "left", "knee_left", "person 1"].value == pytest.approx(5.0)
    assert found["assistance_time", None, "pelvis", None].value == pytest.approx(2.0)
    assert found["assistance_time", None, "pelvis", None].inferred_share == pytest.approx(0.8)
    assert ("assistance_time", None, "pelvis", "person 1") not in found
    assert value(found, "assistance_share_upright") == pytest.approx(150 / 160)
    assert value(found, "hands_free_upright_time") == pytest.approx(0.5)
    assert value(found, "hands_on_at_once_most") == 3.0
    assert value(found, "hands_on_at_once_mean") == pytest.approx((100 + 100 + 40) / 160)


SEEN = (1.0, 0.9, 0.6, 0.4, 0.1, 0.0)


def test_a_contact_that_was_half_seen_is_half_inferred():
    joints = table(squatting_joints(np.zeros(200)))
    sigmas = []
    for seen in SEEN:
        found = measured(joints, (contact("pelvis", "a", 20, 119, seen=seen),))[1]
        row = found["assistance_time", None, None, None]
        assert (row.value, row.inferred_share) == pytest.approx((5.0, 1.0 - seen))
        assert found["hands_free_upright_time", None, None, None].inferred_share is None
        sigmas.append(row.sigma or 0.0)
    # no jump where ``state`` changes: the unseen part over root 12, and half a frame or so at either end
    edges = np.sqrt(2) / RATE
    assert sigmas == pytest.approx([np.hypot(edges, (1 - s) * 5.0 / np.sqrt(12)) for s in SEEN])


def test_no_contacts_are_another_thing_than_contacts_unknown_and_not_sure_to_any_figure():
    joints = table(squatting_joints(np.zeros(40)))
    assert value(measured(joints, ())[1], "hands_free_upright_share") == 1.0
    assert "contacts.parquet" in why(measured(joints, None)[1], "hands_free_upright_share")
    found = measured(table(squatting_joints(np.zeros(40))), ())[1]
    for name in ("assistance_time", "hands_free_upright_time", "hands_free_upright_share"):
        assert found[name, None, None, None].sigma is None


def test_who_touches_is_reported_only_for_the_time_in_which_the_patient_is_found():
    lost = {name: slice(None) for name in JOINT_NAMES}
    found = measured(table(squatting_joints(np.zeros(60)), lost=lost))[1]
    assert value(found, "found_time") == 0.0
    for name in ("assistance_time", "contacts", "hands_free_upright_time", "sit_to_stand_count", "stand_to_sit_count"):
        assert why(found, name), name
    joints = table(squatting_joints(np.zeros(400)), lost={name: slice(160, 400) for name in JOINT_NAMES})
    found = measured(joints, (contact("pelvis", "a", 100, 299),))[1]
    assert (value(found, "found_time"), value(found, "assistance_time")) == pytest.approx((8.0, 3.0))
    assert value(measured(joints, ())[1], "assistance_time") == 0.0


def test_who_never_stood_has_no_extension_sway_or_symmetry_but_reasons():
    found = measured(table(squatting_joints(np.full(40, 85.0))), (contact("knee_left", "a", 0, 10),))[1]
    assert value(found, "upright_time") == 0.0
    for (name, *_), row in found.items():
        if name.startswith(("knee", "hip", "sway", "load", "hands")) or name == "assistance_share_upright":
            assert row.value is None, name
            assert row.why


@pytest.fixture
def results(tmp_path):
    frames = [make_frame(i, i / 20, standing_joints(), lost=("HipLeft",) if i in (30, 31) else ()) for i in range(120)]
    return write_results(tmp_path / "results", frames)


def test_the_verb_writes_all_tables_the_same_twice_and_prints_a_table(results, capsys):
    names = ("angles.parquet", "axes.parquet", "posture.parquet", "episodes.parquet", "measures.parquet")
    assert main(["measure", str(results)]) == 0
    first = [(results / name).read_bytes() for name in names]
    assert "upright" in capsys.readouterr().out
    assert main(["measure", str(results)]) == 0
    assert [(results / name).read_bytes() for name in names] == first
    assert {path.name for path in results.iterdir() if path.name.startswith(".")} <= {".log.jsonl.lock"}
    assert (read_posture(results / "posture.parquet").upright == -1).sum() == 2
    assert len(read_episodes(results / "episodes.parquet")) == 1  # a moment without a hip ends no bout
    rows = {row.measure: row for row in read_measures(results / "measures.parquet")}
    assert rows["upright_time"].value == pytest.approx(5.9)
    assert "contacts.parquet" in (rows["contacts"].why or "")


def test_processing_is_written_beside_the_measured_angles_and_goes_when_it_is_not_asked_for(results, capsys):
    assert main(["measure", str(results)]) == 0
    plain = (results / "angles.parquet").read_bytes()
    assert main(["measure", str(results), "--smooth", "butterworth", "--fill", "linear"]) == 0
    assert "2 filled" in " ".join(capsys.readouterr().out.split())
    assert (results / "angles.parquet").read_bytes() == plain
    marks = read_processed_angles(results / "angles_processed.parquet")
    assert (marks.processing[30, marks.column("hip_flexion_left")], marks.processing.max()) == (2, 2)
    assert main(["measure", str(results)]) == 0
    assert not (results / "angles_processed.parquet").exists()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--cutoff", "3"], "--smooth butterworth"),
        (["--longest-gap", "1"], "--fill linear"),
        (["--smooth", "butterworth", "--cutoff", "9.5"], "too high for 20 frames"),
        (["--smooth", "median"], "smooth"),
    ],
)
def test_the_verb_refuses_what_does_not_fit_and_writes_nothing(results, capsys, options, said):
    before = {path.name: path.read_bytes() for path in results.iterdir() if path.is_file()}
    assert main(["measure", str(results), *options]) == 2
    told = capsys.readouterr()
    assert said in " ".join((told.out + told.err).split())
    assert {path.name: path.read_bytes() for path in results.iterdir() if path.is_file()} == before
