"""Simulated people: their shapes, their postures, and how patients and therapists meet."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from anchorpose.body.asset import ADULT_COMPONENTS
from anchorpose.body.kinematics import BodyMesh, missing_joints
from anchorpose.joints import JOINT_INDEX, LIMBS
from anchorpose.rotations import turns
from anchorpose.simulate import config as presets
from anchorpose.simulate.bodies import BUILDS, MOST_ASYMMETRIC, SHOE_M, SOLE_M, OtherBody, Scales, rescale, with_brace
from anchorpose.simulate.choices import Build
from anchorpose.simulate.clinic import draw_clinic
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.holds import TASKS, choose_hold
from anchorpose.simulate.patient import resting_channels
from anchorpose.simulate.person import Person, draw_other_person, draw_person
from anchorpose.simulate.posture import SIDES, pose_bones
from anchorpose.simulate.timeline import CHANNEL_INDEX, HandGoals, posture_from, stand

SEEDS = (0, *(pytest.param(seed, marks=pytest.mark.thorough) for seed in range(1, 4)))
TURNING = {
    frozenset({JOINT_INDEX[a], JOINT_INDEX[b]})
    for a, b in (("SpineBase", "SpineMid"), ("SpineShoulder", "ShoulderLeft"), ("SpineShoulder", "ShoulderRight"))
}
RIGID_LIMBS = [limb for limb in LIMBS if frozenset(limb) not in TURNING]
# the lower back and the collarbones turn between their joints


def act(config: SimulationConfig):
    clinic = draw_clinic(config)
    return clinic, clinic.act(clinic.true_times_s(0))


def flexion_degrees(joints, start, middle, end):
    first = joints[:, JOINT_INDEX[middle]] - joints[:, JOINT_INDEX[start]]
    second = joints[:, JOINT_INDEX[end]] - joints[:, JOINT_INDEX[middle]]
    cosine = (first * second).sum(1) / np.linalg.norm(first, axis=1) / np.linalg.norm(second, axis=1)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


def on_hand(person, side):
    names = np.array(person.body.asset.bone_names)[person.body.asset.main_bone()]
    return np.array([name.startswith(SIDES[side]) and ("Hand" in name or "Finger" in name) for name in names])


@pytest.mark.thorough
def test_people_are_as_tall_as_asked_and_use_every_coefficient():
    people = [draw_person(np.random.default_rng(seed), 0.0) for seed in range(40)]
    heights = [person.height_m for person in people]
    assert min(heights) < 1.6
    assert max(heights) > 1.8
    assert all(np.ptp(p.body.vertices[:, 1]) == pytest.approx(p.height_m, abs=0.012) for p in people)
    coefficients = np.array([p.coefficients for p in people])
    assert (coefficients[:, :ADULT_COMPONENTS].std(axis=0) > 0.3).all()
    assert not coefficients[:, ADULT_COMPONENTS:].any()  # these are of children


def test_clothes_stand_off_the_dressed_skin_and_leave_hands_and_head_bare():
    person = draw_person(np.random.default_rng(4), 0.009)
    bare = draw_person(np.random.default_rng(4), 0.0)
    bones = np.tile(np.eye(4), (31, 1, 1))
    outward = ((person.skin(bones, 1.0) - bare.skin(bones, 1.0)) * person.normals).sum(axis=1)
    dressed = person.clothes.cover > 0.01
    assert 0.005 < outward[dressed].mean() < 0.012
    assert outward[dressed].std() > 0.005, "the gap differs from place to place"
    assert outward[dressed].max() < 0.08
    hands = on_hand(person, 0) | on_hand(person, 1)
    assert (person.clothes.cover[hands] < 0.01).mean() > 0.9, "a sleeve ends at the wrist"
    assert np.abs(outward[person.clothes.cover < 0.01]).max() < 4e-4
    later = ((person.skin(bones, 3.0) - person.skin(bones, 1.0)) * person.normals).sum(axis=1)
    assert np.abs(later[dressed]).max() > 0.002, "folds move"
    assert np.abs(later).max() < 0.018, "wide clothes have no higher folds"


def test_skinning_agrees_with_the_plain_version():
    person = draw_person(np.random.default_rng(5), 0.0)
    rng = np.random.default_rng(6)
    bones = person.body.bone_transforms(turns(rng.normal(0, 0.4, (31, 3))), np.array([0.1, 0.9, 0.2]))
    assert person.skin(bones, 0.0) == pytest.approx(person.body.skin(bones), abs=2e-6)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("equipment", ["standing-frame", "none"])
def test_bones_keep_their_length_and_joints_bend_the_human_way(seed, equipment):
    config = SimulationConfig(seed=seed, seconds=8, fps=6, cameras=1, therapists=0, equipment=equipment)
    joints = act(config)[1].joints_m()
    lengths = np.array([np.linalg.norm(joints[:, a] - joints[:, b], axis=1) for a, b in RIGID_LIMBS])
    assert np.ptp(lengths, axis=1).max() < 1e-9
    for side in SIDES:
        assert flexion_degrees(joints, f"Hip{side}", f"Knee{side}", f"Ankle{side}").max() < 135
        assert flexion_degrees(joints, f"Shoulder{side}", f"Elbow{side}", f"Wrist{side}").max() < 150
        knee_ahead = joints[:, JOINT_INDEX[f"Knee{side}"]] - 0.5 * (
            joints[:, JOINT_INDEX[f"Hip{side}"]] + joints[:, JOINT_INDEX[f"Ankle{side}"]]
        )
        assert knee_ahead[:, 0].min() > 0, "knees bend forwards"


@pytest.mark.parametrize("motion", ["squat", "weight-shift", "trunk", "sit-to-stand"])
def test_planted_feet_stay_where_they_are_with_their_soles_on_the_floor(motion):
    config = SimulationConfig(seed=7, seconds=6, fps=5, cameras=1, therapists=0, equipment="none", motions=(motion,))
    _, performance = act(config)
    joints = performance.joints_m()
    feet = [JOINT_INDEX[name] for name in ("AnkleLeft", "FootLeft", "AnkleRight", "FootRight")]
    assert np.ptp(joints[:, feet], axis=0).max() < 1e-9
    assert np.ptp(joints[:, JOINT_INDEX["SpineBase"]], axis=0).max() > 0.03, "the rest of the body moves"
    soles = [performance.figures(frame)[0].skin_m[:, 1].min() for frame in range(0, 30, 5)]
    assert np.abs(soles).max() < 0.002


def test_nobody_sinks_into_the_floor_or_floats_while_walking():
    config = SimulationConfig(seed=11, seconds=6, fps=4, cameras=1, therapists=3, equipment="none")
    _, performance = act(config)
    lowest = [[figure.skin_m[:, 1].min() for figure in performance.figures(frame)] for frame in range(24)]
    assert np.min(lowest) > -0.002
    assert np.max(lowest) < 0.03


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [1, 4, 6])
def test_therapists_hands_are_on_the_skin_beside_the_joint_they_hold(seed):
    clinic, performance = act(presets.clinic(seed, seconds=8.0, fps=3.0))
    joints = performance.joints_m()
    checked = 0
    for index, therapist in enumerate(clinic.therapists):
        held = performance.held_joints()[:, index]
        pulls = [
            therapist.actor.channels(performance.times_s)[CHANNEL_INDEX[f"pull_{side}"]] for side in ("left", "right")
        ]
        assert (held.T >= 0)[np.array(pulls) > 0.9999].mean() > 0.9, "a therapist who holds on keeps hold"
        for frame in np.flatnonzero((held >= 0).any(axis=1)):
            figures = performance.figures(frame)
            skin = cKDTree(figures[0].skin_m)
            for side in (0, 1):
                hand = figures[1 + index].skin_m[on_hand(therapist.actor.person, side)]
                distance, nearest = skin.query(hand)
                assert distance.min() < 0.03
                touched = figures[0].skin_m[nearest[distance.argmin()]]
                assert np.linalg.norm(touched - joints[frame, held[frame, side]]) < 0.3
                checked += 1
    assert checked > 20


@pytest.mark.parametrize("missing", ["leg_left", "leg_right"])
def test_no_therapist_holds_a_knee_that_the_patient_lacks(missing):
    for seed in range(1, 4):
        config = presets.clinic(seed, seconds=2.0, fps=1.0)
        tasks = ("both knees from the front",)
        clinic = draw_clinic(replace(config, body=OtherBody(missing=(missing,)), therapist_tasks=tasks))
        asset = clinic.patient.person.body.asset
        gone = missing_joints(asset, (missing,))
        for hold in (therapist.hold for therapist in clinic.therapists if therapist.hold is not None):
            assert not gone[hold.joints].any()
            names = {asset.bone_names[bone] for bone in asset.main_bone()[hold.vertices].tolist()}
            assert not any(name.startswith(("Head", "Neck")) for name in names)


def test_a_hold_without_skin_to_hold_is_refused():
    patient = draw_clinic(replace(presets.clinic(1, seconds=1.0), body=OtherBody(missing=("leg_left",)))).patient
    with pytest.raises(ValueError, match="no skin that a hand at KneeLeft could hold"):
        choose_hold(patient, TASKS[1], np.array([1.0, 0.0, 0.0]), 0.0)


def test_hands_on_the_rails_stay_on_them_while_the_trunk_moves():
    config = SimulationConfig(seed=8, seconds=6, fps=5, cameras=1, therapists=0, motions=("squat",))
    _, performance = act(config)
    joints = performance.joints_m()
    assert np.ptp(joints[:, [JOINT_INDEX["WristLeft"], JOINT_INDEX["WristRight"]]], axis=0).max() < 1e-6
    assert np.ptp(joints[:, JOINT_INDEX["SpineShoulder"], 1]) > 0.05


def test_a_hand_goal_within_reach_is_reached_exactly():
    person = draw_person(np.random.default_rng(9), 0.0)
    base = resting_channels(person, in_frame=True)
    feet = stand(np.zeros(2), 0.0, 0.26)
    goals = HandGoals(np.array([[[0.2, 1.15, -0.3], [0.25, 1.2, 0.3]]]), np.tile(np.eye(3), (1, 2, 1, 1)))
    bones = pose_bones(person.body, posture_from(person.body, base[:, None], feet, np.zeros(1), goals))
    wrists = person.body.joints(bones[0])[[JOINT_INDEX["WristLeft"], JOINT_INDEX["WristRight"]]]
    assert wrists == pytest.approx(goals.wrist_m[0], abs=1e-9)


@pytest.mark.parametrize(
    ("channel", "joint", "way"),
    [
        ("elbow_right", "WristRight", (1, 1, 0)),
        ("shoulder_flex_left", "WristLeft", (1, 1, 0)),
        ("shoulder_abduct_left", "WristLeft", (0, 1, -1)),
        ("shoulder_abduct_right", "WristRight", (0, 1, 1)),
        ("trunk_flex", "Head", (1, -1, 0)),
        ("trunk_side", "Head", (0, -1, 1)),
        ("trunk_turn", "ShoulderRight", (1, 0, 0)),
        ("head_flex", "Head", (1, -1, 0)),
        ("knee_out_left", "KneeLeft", (0, 0, -1)),
        ("pelvis_right", "SpineBase", (0, 0, 1)),
    ],
)
def test_a_positive_angle_moves_the_body_the_way_its_name_says(channel, joint, way):
    person = draw_person(np.random.default_rng(12), 0.0, 1.7)
    base = resting_channels(person, in_frame=False)
    base[CHANNEL_INDEX["pelvis_up"]] = -0.1
    bent = base.copy()
    bent[CHANNEL_INDEX[channel]] += 0.6 if "pelvis" not in channel else 0.05
    feet = stand(np.zeros(2), 0.0, 0.26)
    posture = posture_from(person.body, np.stack([base, bent], axis=1), feet, np.zeros(2), HandGoals.none(2))
    before, after = (person.body.joints(bones)[JOINT_INDEX[joint]] for bones in pose_bones(person.body, posture))
    moved = (after - before) * way
    assert (moved[np.array(way) != 0] > 0.005).all()


@pytest.mark.parametrize("seed", range(1201, 1207))
def test_a_stool_stands_under_the_buttocks_and_not_under_the_heels(seed):
    """The feet of a small person are drawn back under the seat (seed 1203)."""
    clinic = draw_clinic(presets.scene(presets.single(seed, 6.0), "sits"))
    (seat,) = [part for part in clinic.equipment.parts if part.name == "seat"]
    assert 0.3 < seat.center_m[1] < 0.6


LIMB_BONES = [f"{side}{part}" for side in ("Left", "Right") for part in ("UpLeg", "Leg", "Arm", "ForeArm")]
LEGS = [name for name in LIMB_BONES if name.endswith("Leg")]


def other(seed: int, build: Build, height_m: float | None = None, **more) -> Person:
    return draw_other_person(np.random.default_rng(seed), OtherBody(build=build, **more), 0.006, height_m)


def limb_lengths_m(body: BodyMesh) -> np.ndarray:
    """From the head of each of ``LIMB_BONES`` to that of the next bone."""
    bones = np.array([body.asset.bone(name) for name in LIMB_BONES])
    return np.linalg.norm(body.bone_heads[bones + 1] - body.bone_heads[bones], axis=1)


def from_axis_m(body: BodyMesh, name: str, vertices: np.ndarray | None = None) -> np.ndarray:
    """(v,) how far skin is from the line through a bone."""
    bone = body.asset.bone(name)
    along = (body.bone_tails[bone] - body.bone_heads[bone]) / np.linalg.norm(
        body.bone_tails[bone] - body.bone_heads[bone]
    )
    out = (body.vertices if vertices is None else vertices) - body.bone_heads[bone]
    return np.linalg.norm(out - np.outer(out @ along, along), axis=1)


def share_of(body: BodyMesh, *names: str) -> np.ndarray:
    """(v,) share of some bones in what moves each vertex."""
    bones = [body.asset.bone(name) for name in names]
    return (body.asset.skin_weights * np.isin(body.asset.skin_bones, bones)).sum(axis=1)


def girth_m(body: BodyMesh, name: str) -> float:
    """Mean distance of a segment's own skin from its axis."""
    return float(from_axis_m(body, name)[share_of(body, name) > 0.9].mean())


def test_known_scales_give_limbs_of_exactly_these_lengths_and_girths():
    plain = draw_person(np.random.default_rng(2), 0.0).body
    rng, count = np.random.default_rng(3), len(plain.asset.bone_names)
    scales = Scales(rng.uniform(0.9, 1.1, count), np.repeat(rng.uniform(0.8, 1.2, (count, 1)), 2, axis=1))
    found = rescale(plain, scales)
    bones = [plain.asset.bone(name) for name in LIMB_BONES]
    np.testing.assert_allclose(limb_lengths_m(found), scales.length[bones] * limb_lengths_m(plain), rtol=1e-12)
    for bone, name in zip(bones, LIMB_BONES, strict=True):
        own = share_of(plain, name) > 1.0 - 1e-12
        assert own.sum() > 20
        np.testing.assert_allclose(
            from_axis_m(found, name)[own], scales.girth[bone, 0] * from_axis_m(plain, name)[own], rtol=1e-9
        )


@pytest.mark.parametrize("build", BUILDS)
@pytest.mark.parametrize("seed", SEEDS)
def test_other_people_are_as_tall_as_asked_without_shoes_and_stand_on_the_floor(build, seed):
    height_m = 1.25 if build == "child" else 1.65
    person = other(seed, build, height_m)
    assert (person.height_m, person.body.vertices[:, 1].min()) == (height_m, pytest.approx(0.0, abs=1e-12))
    shoes_m = np.ptp(person.body.vertices[:, 1]) - height_m
    if abs(shoes_m) > 1e-9:
        assert SOLE_M[0] < shoes_m < SOLE_M[1] + SHOE_M[1]
        assert build != "ordinary"
    left, right = limb_lengths_m(person.body).reshape(2, 4)
    assert (np.abs(left - right) / (0.5 * (left + right))).max() < MOST_ASYMMETRIC + 0.003  # the asset's own 0.3 %
    assert person.body.bone_heads[person.body.asset.bone("Head"), 1] > 0.8 * height_m
    np.testing.assert_allclose(np.linalg.norm(person.normals, axis=1), 1.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_wasted_legs_are_thinner_than_the_same_persons_varied_ones(seed):
    varied, wasted = other(seed, "varied"), other(seed, "wasted-legs")
    for name in LEGS:
        assert girth_m(wasted.body, name) < 0.95 * girth_m(varied.body, name)


@pytest.mark.parametrize("name", ["LeftLeg", "RightUpLeg"])
def test_a_brace_is_a_shell_that_stands_off_what_it_covers(name):
    body = draw_person(np.random.default_rng(7), 0.0).body
    braced, covered = with_brace(body, (name,), 0.012)
    np.testing.assert_allclose(covered, share_of(body, name), atol=1e-12)
    np.testing.assert_array_equal(braced.vertices[covered == 0.0], body.vertices[covered == 0.0])
    whole = covered > 1.0 - 1e-12
    off = from_axis_m(body, name, braced.vertices)[whole] - from_axis_m(body, name)[whole]
    assert off.min() > 0.012 - 1e-9  # nowhere nearer than so
    radius = from_axis_m(body, name, braced.vertices)[whole]
    widest = np.percentile(from_axis_m(body, name)[covered > 0.9], 90)
    assert radius.min() == pytest.approx(widest + 0.012)  # and stiff: as wide over thin parts as over thick ones
    assert np.ptp(radius) < np.ptp(from_axis_m(body, name)[whole])
