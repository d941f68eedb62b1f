"""Captured movements on the simulated patient: the subject's directions, the patient's lengths, feet on the floor."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from recording_builder import DATA

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_INDEX, LIMBS
from anchorpose.rotations import unit
from anchorpose.simulate.capture import lay_out
from anchorpose.simulate.captured_patient import GIVES_M, arms_within_m
from anchorpose.simulate.clinic import Clinic, draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.movement_file import CLIP_HZ, MOVEMENTS, NEEDED, read_clips
from anchorpose.simulate.person import draw_person
from anchorpose.simulate.retarget import CapturedActor, _Resampler, retarget
from anchorpose.simulate.shoot import set_up

TIMES_S = np.arange(0.0, 5.0, 0.1)
REST_M = {
    "Waist": (0, 0.9, 0),
    "Spine": (0, 1.15, 0),
    "Chest": (0, 1.4, 0),
    "Head": (0, 1.5, 0),
    "HeadTip": (0, 1.65, 0),
    "LUpperArm": (0.17, 1.38, 0),
    "LForearm": (0.25, 1.12, 0),
    "LHand": (0.28, 0.88, 0.06),
    "LUpperLeg": (0.08, 0.9, 0),
    "LLowerLeg": (0.10, 0.49, 0.02),
    "LFoot": (0.12, 0.09, 0),
    "LToes": (0.13, 0.03, 0.1),
}


def skeleton(raised: float, squat: float) -> dict[str, np.ndarray]:
    """A subject who raises the left arm sideways by an angle and comes down by ``squat`` metres, x to the left."""
    joints = {name: np.array(place, dtype=float) for name, place in REST_M.items()}
    joints |= {f"R{name[1:]}": place * [-1, 1, 1] for name, place in joints.items() if name.startswith("L")}
    shoulder, length = joints["LUpperArm"], 0.27
    way = np.array([np.sin(raised), -np.cos(raised), 0.0])
    joints["LForearm"], joints["LHand"] = shoulder + length * way, shoulder + 1.9 * length * way + [0, 0, 0.05]
    for name, place in joints.items():
        if name[1:] not in ("LowerLeg", "Foot", "Toes"):
            place[1] -= squat
    for side in "LR":
        joints[f"{side}LowerLeg"][2] += 1.2 * squat
    return joints


@pytest.fixture(scope="module")
def movement_file(tmp_path_factory) -> Path:
    """Two repetitions by subject 3: an arm is raised and the knees are bent."""
    clips = []
    for count in (60, 75):
        course = np.sin(np.pi * np.arange(count) / (count - 1)) ** 2
        clips.append([list(skeleton(0.2 + 1.3 * share, 0.2 * share).values()) for share in course])
    names = list(skeleton(0.0, 0.0))
    assert set(NEEDED) == set(names)
    path = tmp_path_factory.mktemp("movements") / "skeletons.npz"
    joints_mm = np.round(1000.0 * np.concatenate(clips)).astype(np.int16)
    repetitions = {"offsets": np.array([0, 60, 135]), "names": np.array(["c_m05_s03_e01", "c_m05_s03_e02"])}
    np.savez(path, joints_mm=joints_mm, **repetitions, joint_names=np.array(names))
    return path


@pytest.fixture(scope="module")
def actor(movement_file) -> CapturedActor:
    rng = np.random.default_rng(4)
    clips = read_clips(movement_file, "sit-to-stand", rng)
    return retarget(draw_person(rng, 0.009), lay_out(clips, 0, 0.4, -1.0, 6.0))


def joints_of(actor: CapturedActor, times_s: np.ndarray = TIMES_S) -> np.ndarray:
    return np.array([actor.person.body.joints(bones) for bones in actor.bones(times_s)])


def degrees_between(joints_m: np.ndarray, start: str, end: str, wanted: np.ndarray) -> np.ndarray:
    way = unit(joints_m[:, JOINT_INDEX[end]] - joints_m[:, JOINT_INDEX[start]])
    return np.degrees(np.arccos(np.clip((way * wanted).sum(axis=1), -1.0, 1.0)))


@pytest.mark.parametrize("rows", range(2, 40))
def test_the_time_of_the_last_row_belongs_to_the_movement_whatever_it_is_rounded_to(rows):
    """A patient who is lowest in the last row was refused, since its time came out a ten-billionth later."""
    capture = SimpleNamespace(start_s=-3.0, waist_m=np.zeros((rows, 3)))
    last_s = capture.start_s + (rows - 1) / CLIP_HZ
    at = _Resampler(capture, np.array([capture.start_s, last_s]))
    np.testing.assert_allclose(at.value(np.arange(float(rows))), [0.0, rows - 1.0], atol=1e-9)
    with pytest.raises(ValueError, match="lasts"):
        _Resampler(capture, np.array([last_s + 0.01]))


def test_bones_keep_the_patients_own_lengths(actor):
    joints = joints_of(actor)
    for start, end in LIMBS:
        length = np.linalg.norm(joints[:, start] - joints[:, end], axis=1)
        assert np.ptp(length) < 0.03 if {start, end} & {0, 2, 3} else np.ptp(length) < 1e-6


def test_limbs_point_where_the_subjects_did(actor):
    joints = joints_of(actor)
    rows = np.round((TIMES_S - actor.capture.start_s) * CLIP_HZ).astype(int)
    for side, name in enumerate(("Left", "Right")):
        for segment, (start, end) in enumerate((("Shoulder", "Elbow"), ("Elbow", "Wrist"))):
            wanted = actor.capture.arms[rows, side, segment]
            assert degrees_between(joints, start + name, end + name, wanted).max() < 8.0
        for segment, (start, end) in enumerate((("Hip", "Knee"), ("Knee", "Ankle"))):
            wanted = actor.capture.legs[rows, side, segment]
            assert degrees_between(joints, start + name, end + name, wanted).max() < 12.0


def test_left_is_left_and_standing_feet_stay_on_the_floor_and_do_not_slide(actor):
    joints = joints_of(actor)
    left, right = (joints[:, JOINT_INDEX[f"Wrist{side}"]] for side in ("Left", "Right"))
    assert left[:, 1].max() > right[:, 1].max() + 0.2, "the subject raises the left arm"
    assert left[:, 2].min() < -0.4, "to the left of a patient who faces +X"
    assert (joints[:, JOINT_INDEX["KneeLeft"], 0] > joints[:, JOINT_INDEX["AnkleLeft"], 0] - 0.02).all()
    for name in ("AnkleLeft", "AnkleRight"):
        assert np.ptp(joints[:, JOINT_INDEX[name]], axis=0).max() < 0.01
    lowest = [actor.person.skin(bones, 0.0)[:, 1].min() for bones in actor.bones(TIMES_S[::5])]
    assert np.abs(lowest).max() < 0.02


def test_a_movement_is_smooth_where_repetitions_meet_and_between_the_rows_of_the_file(actor):
    joints = joints_of(actor, np.arange(0.0, 5.0, 0.01))
    assert np.linalg.norm(np.diff(joints, 2, axis=0), axis=2).max() / 0.01**2 < 60.0  # m/s2


@pytest.mark.thorough
def test_the_same_seed_gives_the_same_recording(movement_file):
    config = captured(movement_file, equipment="parallel-bars", chest_pad=True, therapists=1, passers_by=1)
    first, again, other = (set_up(draw_clinic(replace(config, seed=seed))).shoot(3).depths_mm[0] for seed in (2, 2, 3))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def captured(path: Path, **more: object) -> SimulationConfig:
    base = SimulationConfig(seed=2, seconds=3.0, fps=5.0, cameras=1, therapists=0, equipment="none", stool=False)
    return replace(base, **{"movement_file": path, "movement": "sit-to-stand", **more})


EQUIPMENT = ("standing-frame", "parallel-bars", "walker", "wheelchair", "sling")


def depth_within_m(clinic: Clinic, skin_m: np.ndarray) -> float:
    return max(0.0, -min(float(part.distance_m(skin_m.astype(float)).min()) for part in clinic.equipment.parts))


@pytest.mark.thorough
@pytest.mark.parametrize("equipment", EQUIPMENT)
@pytest.mark.parametrize("source", ["captured", "drawn"])
def test_equipment_of_every_kind_leaves_room_for_the_trunk_of_the_standing_patient(movement_file, equipment, source):
    more = {} if source == "captured" else {"movement_file": None, "movement": None, "motions": ("weight-shift",)}
    config = captured(movement_file, equipment=equipment, chest_pad=equipment == "parallel-bars", **more)
    clinic = draw_clinic(config)
    person, bones = clinic.patient.person, clinic.patient.bones(np.arange(0.0, 3.0, 0.2))
    standing = bones[int(np.argmax(bones[:, 0, 1, 3]))]
    names = [person.body.asset.bone_names[bone] for bone in person.body.asset.main_bone()]
    trunk = np.array([not any(part in name for part in ("Arm", "Hand", "Thumb", "Finger")) for name in names])
    assert depth_within_m(clinic, person.skin(standing, 0.0)[trunk]) < 0.01
    highest = max(np.asarray(part.triangles()[0])[:, 1].max() for part in clinic.equipment.parts)
    assert 0.4 < highest < 2.7


def test_a_chest_pad_is_a_few_centimetres_before_the_sternum_and_a_seat_under_who_sits_on_it(movement_file):
    clinic = draw_clinic(captured(movement_file, equipment="parallel-bars", chest_pad=True))
    pad = next(part for part in clinic.equipment.parts if part.name == "chest-pad")
    bones = clinic.patient.bones(np.arange(0.0, 3.0, 0.1))
    gaps = [pad.distance_m(clinic.patient.person.skin(moment, 0.0).astype(float)).min() for moment in bones]
    assert 0.0 < min(gaps) < 0.07
    clinic = draw_clinic(captured(movement_file, equipment="wheelchair"))
    seat = next(part for part in clinic.equipment.parts if part.name == "seat")
    lowest = clinic.patient.person.skin(clinic.patient.bones(clinic.patient.lowest_s())[0], 0.0)
    assert abs(seat.distance_m(lowest.astype(float)).min()) < 0.03


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"movement": "cartwheel"}, "movement must be one of"),
        ({"movement": "hurdle-step", "equipment": "walker"}, "needs room"),
        ({"movement": "c_m03_s01_e01", "equipment": "parallel-bars", "chest_pad": True}, "needs room"),
        ({"movement": None}, "belong together"),
        ({"motions": ("squat",)}, "cannot follow motions"),
        ({"chest_pad": True}, "needs parallel bars"),
        ({"therapist_tasks": ("both knees from the front",)}, "therapist for each"),
        ({"therapist_tasks": ("a handstand",), "therapists": 1}, "therapist_tasks"),
        ({"away_s": ((1.0, 2.0),)}, "walk out"),
    ],
)
def test_what_cannot_be_simulated_is_refused(movement_file, wrong, why):
    with pytest.raises(ValueError, match=why):
        captured(movement_file, **wrong)


def test_a_file_without_movements_is_refused_and_a_clip_in_which_a_limb_was_lost_left_out(tmp_path, movement_file):
    rng = np.random.default_rng(0)
    with pytest.raises(InputError, match="there is no such file"):
        read_clips(tmp_path / "nothing.npz", "sit-to-stand", rng)
    np.savez(tmp_path / "other.npz", joints=np.zeros(3))
    with pytest.raises(InputError, match="not a file of captured movements"):
        read_clips(tmp_path / "other.npz", "sit-to-stand", rng)
    with pytest.raises(InputError, match="deep-squat"):
        read_clips(movement_file, "deep-squat", rng)
    with pytest.raises(InputError, match="sit-to-stand"):
        read_clips(movement_file, "sit-to-stand", rng, subjects=(1, 2))
    with np.load(movement_file) as file:
        arrays = dict(file)
    hand = list(arrays["joint_names"]).index("RHand")
    arrays["joints_mm"][20, hand] += 600
    np.savez(tmp_path / "lost.npz", **arrays)
    clips = read_clips(tmp_path / "lost.npz", "sit-to-stand", np.random.default_rng(0))
    assert clips.names == ("c_m05_s03_e02",)


UIPRMD = DATA / "uiprmd_kinect" / "skeletons.npz"


@pytest.mark.thorough
@pytest.mark.parametrize("movement", list(MOVEMENTS))
def test_every_real_movement_keeps_to_the_floor_with_the_arms_out_of_the_body(movement):
    if not UIPRMD.is_file():
        pytest.skip("the skeletons of UI-PRMD are not here")
    config = captured(UIPRMD, movement=movement, seconds=6.0, seed=11)
    patient = draw_clinic(config).patient
    bones = patient.bones(np.arange(0.0, 6.0, 0.25))
    assert arms_within_m(patient.person, bones).max() < 3.0 * GIVES_M
    lowest = np.array([patient.person.skin(moment, 0.0)[:, 1].min() for moment in bones])
    assert np.abs(lowest).max() < 0.02
    joints = np.array([patient.person.body.joints(moment) for moment in patient.bones(np.arange(0.0, 6.0, 1 / 15))])
    assert np.linalg.norm(np.diff(joints, axis=0), axis=2).max() * 15.0 < 5.0, "nobody moves faster than 5 m/s"
