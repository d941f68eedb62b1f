"""Who touches the patient where: distances in one frame, contacts over time, their table and their evaluation."""

from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
from body_builder import FRONT, adult, adult_body, asset, before_wall, photograph, points, skin_in, standing
from session_builder import contact

from anchorpose.body.config import VisibilityConfig
from anchorpose.body.contact_regions import (
    REGION_BONES,
    REGIONS,
    Nearness,
    area_of_point,
    find_nearness,
    region_of_points,
)
from anchorpose.body.hands_on_patient import HAND_M
from anchorpose.body.skin_points import build_body, pose_points
from anchorpose.errors import InputError
from anchorpose.isolation.bystander_memory import BystanderMemory, empty_memory
from anchorpose.isolation.view import PixelLabel
from anchorpose.joints import JOINT_INDEX
from anchorpose.results.contact_intervals import ContactConfig, ContactIntervals
from anchorpose.results.contact_scores import evaluate_contacts
from anchorpose.results.records import Contact, read_contacts, write_contacts
from anchorpose.results.truth import TrueTouch, read_true_touch

POSE = standing(LeftArm=(-20.0, 0.0, 0.0), RightArm=(20.0, 0.0, 0.0))
POSED = pose_points(adult_body(), POSE)
REGION, AREA_M2 = region_of_points(points()), area_of_point(adult_body())
FPS = 10.0


def region(name: str) -> np.ndarray:
    """The skin points of a part."""
    return np.flatnonzero(np.isin(REGION, REGIONS.index(name)))


def memory_at(place_m: np.ndarray, label: int = PixelLabel.OTHER_PERSON, age_s: float = 0.0) -> BystanderMemory:
    count = len(place_m)
    return BystanderMemory(
        place_m.astype(np.float32), np.full(count, label, np.uint8), np.full(count, age_s, np.float32), 9
    )


def near_in(memory: BystanderMemory) -> Nearness:
    view = before_wall(photograph(skin_in(POSE, adult_body()), FRONT), FRONT)
    return find_nearness(adult_body(), POSED, memory, (view,), (FRONT,), VisibilityConfig())


def held(
    skin: np.ndarray, distance_m: float = 0.02, label: int = 5, remembered: bool = False, shown: bool = True
) -> Nearness:
    """One person so near to these skin points, all of the patient in view or none."""
    count = len(skin)
    return Nearness(
        np.full(count, label, np.uint8),
        skin.astype(np.int32),
        np.full(count, distance_m, np.float32),
        np.full(count, remembered),
        np.full(len(REGION), shown),
        AREA_M2,
    )


def nothing(shown: bool = True) -> Nearness:
    return held(np.zeros(0, int), shown=shown)


def contacts_of(frames: list[Nearness | None], config: ContactConfig | None = None) -> list[Contact]:
    intervals, found = ContactIntervals(REGION, config or ContactConfig()), []
    for frame, near in enumerate(frames):
        found += intervals.push(frame, frame / FPS, near)
    return found + list(intervals.finish())


def span(contact: Contact) -> tuple[str, str, int, int]:
    return contact.part, contact.person, contact.first_frame, contact.last_frame


KNEE, CHEST = region("knee_left")[:12], region("chest")[:12]


def test_every_bone_belongs_to_a_part_and_the_skin_points_stand_for_the_skin_of_an_adult():
    assert {bone for bones in REGION_BONES.values() for bone in bones} == set(asset().bone_names)
    assert set(REGION) == set(range(len(REGIONS)))
    left = [name for name in REGIONS if name.endswith("_left")]
    for name in left:
        other = name.replace("_left", "_right")
        assert len(region(name)) == pytest.approx(len(region(other)), rel=0.25, abs=4)
    assert 1.5 < AREA_M2 * len(REGION) < 2.2  # square metres (Du Bois and Du Bois 1916)


def test_distances_are_those_of_plain_search():
    rng = np.random.default_rng(3)
    place = POSED.points_m[rng.choice(len(REGION), 60)] + rng.normal(0.0, 0.1, (60, 3))
    near = near_in(memory_at(place))
    plain = np.linalg.norm(POSED.points_m[:, None] - place.astype(np.float32), axis=2).min(axis=1)
    expected = np.flatnonzero(plain < HAND_M)
    np.testing.assert_array_equal(near.point, expected)
    np.testing.assert_allclose(near.distance_m, plain[expected], atol=1e-6)


def test_people_are_distinguished_and_the_patient_does_not_touch_the_patient():
    hands = [memory_at(POSED.points_m[region(name)], label) for name, label in (("knee_left", 5), ("hand_right", 7))]
    both = BystanderMemory(
        *(
            np.concatenate([getattr(hand, name) for hand in (*hands, memory_at(POSED.points_m, 4))])
            for name in ("points_m", "owner", "age_s")
        ),
        9,
    )
    near = near_in(both)
    assert set(near.person) == {5, 7}
    for label, name in ((5, "knee_left"), (7, "hand_right")):
        on_skin = near.point[(near.person == label) & (near.distance_m < 1e-4)]
        np.testing.assert_array_equal(np.sort(on_skin), region(name))


def test_only_skin_that_faces_the_camera_is_shown():
    shown = near_in(empty_memory()).shown
    front = POSED.normals[:, 0] > 0.7
    assert shown[front].mean() > 0.7
    assert not shown[POSED.normals[:, 0] < 0.0].any()


def test_a_hold_is_one_contact_from_its_first_frame_to_its_last():
    found = contacts_of([nothing()] * 3 + [held(KNEE)] * 5 + [nothing()] * 6)
    assert [span(contact) for contact in found] == [("knee_left", "person 1", 3, 7)]
    assert (found[0].start_s, found[0].end_s) == pytest.approx((0.3, 0.7))
    assert found[0].area_cm2 == pytest.approx(12e4 * AREA_M2)
    assert (found[0].gap_mm, found[0].state) == (pytest.approx(20.0, abs=0.01), "seen")


FEW = KNEE[:2]


@pytest.mark.parametrize(
    ("frames", "spans"),
    [
        pytest.param([held(KNEE)] * 4 + [nothing()] * 3 + [held(KNEE)] * 4, [(0, 10)], id="a short gap is bridged"),
        pytest.param([held(KNEE)] * 4 + [nothing()] * 5 + [held(KNEE)] * 4, [(0, 3), (9, 12)], id="a long one ends it"),
        pytest.param([nothing(), held(KNEE), nothing()], [], id="a brush past"),
        pytest.param([held(FEW)] * 8, [], id="too little skin to begin"),
        pytest.param([held(KNEE)] * 3 + [held(FEW)] * 7, [(0, 9)], id="enough skin to go on"),
        pytest.param([held(KNEE, distance_m=0.07)] * 8, [], id="out of reach"),
        pytest.param([held(KNEE)] * 3 + [held(KNEE, distance_m=0.15)] * 7, [(0, 2)], id="the skin is seen again"),
        pytest.param([held(KNEE)] * 3 + [nothing(shown=False)] * 7, [(0, 2)], id="its owner has gone"),
    ],
)
def test_when_a_contact_begins_and_ends(frames, spans):
    assert [span(contact)[2:] for contact in contacts_of(frames)] == spans


def test_a_hold_that_goes_out_of_sight_goes_on_as_inferred_as_are_remembered_hands():
    unseen = held(KNEE, distance_m=0.07, shown=False)
    (contact,) = contacts_of([held(KNEE)] * 3 + [unseen] * 7 + [nothing()] * 5)
    assert span(contact)[2:] == (0, 9)
    assert (contact.seen_share, contact.state) == (pytest.approx(0.3), "inferred")
    let_go = held(KNEE, distance_m=0.12, shown=False)
    (contact,) = contacts_of([held(KNEE)] * 3 + [let_go] * 7)
    assert span(contact)[2:] == (0, 2)
    (contact,) = contacts_of([held(KNEE, remembered=True)] * 5)
    assert (contact.state, contact.seen_share) == ("inferred", 0.0)


def test_people_and_parts_are_counted_apart_and_nobody_is_known_while_the_patient_is_lost():
    both = held(np.concatenate([KNEE, CHEST]), label=9)
    found = contacts_of([both] * 4 + [held(KNEE, label=6)] * 9)
    assert [span(contact) for contact in found] == [
        ("chest", "person 1", 0, 3),
        ("knee_left", "person 1", 0, 3),
        ("knee_left", "person 2", 4, 12),
    ]
    found = contacts_of([held(KNEE)] * 4 + [None] + [held(KNEE)] * 4)
    assert [span(contact) for contact in found] == [("knee_left", "person 1", 0, 3), ("knee_left", "person 2", 5, 8)]


@pytest.mark.parametrize("wrong", [{"keep_m2": 0.0}, {"keep_m2": 0.1}, {"reach_m": 0.0}, {"release_s": -1.0}])
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ValueError, match=r"must|should be"):
        ContactConfig(**wrong)


CONTACT = replace(contact("knee_left", "person 1", 2, 5, 0.9), area_cm2=80.0, gap_mm=12.0)


def test_the_table_gives_back_what_was_written_and_refuses_an_unknown_part(tmp_path):
    written = (CONTACT, replace(CONTACT, part="chest", seen_share=0.1))
    for name in ("a", "b"):
        with write_contacts(tmp_path / name) as table:
            for contact in written:
                table.append(contact)
    assert read_contacts(tmp_path / "a") == written
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert pq.read_table(tmp_path / "a")["state"].to_pylist() == ["seen", "inferred"]
    with write_contacts(tmp_path / "t") as table:
        table.append(replace(CONTACT, part="wing"))
    with pytest.raises(InputError, match="wing"):
        read_contacts(tmp_path / "t")


NAMES = asset().bone_names


def truth_of(*bones: str, frames: slice = slice(2, 6), count: int = 10) -> TrueTouch:
    touched = np.zeros((count, len(NAMES)), dtype=bool)
    touched[frames, [[NAMES.index(bone)] for bone in bones]] = True
    return TrueTouch(touched, NAMES)


@pytest.mark.parametrize(
    ("part", "truth", "precision", "recall"),
    [
        pytest.param("chest", truth_of("Spine"), 1.0, 1.0, id="as the truth has it"),
        pytest.param("knee_left", truth_of("LeftUpLeg", "LeftLeg"), 1.0, 1.0, id="a knee is thigh and shank"),
        pytest.param("knee_left", truth_of("LeftLeg", frames=slice(4, 10)), 2 / 4, 2 / 6, id="late"),
        pytest.param("knee_left", truth_of("RightLeg"), 0.0, 0.0, id="the other side"),
        pytest.param("knee_left", truth_of(), 0.0, None, id="nothing is touched"),
        pytest.param(None, truth_of("Spine"), None, 0.0, id="nothing is reported"),
    ],
)
def test_contacts_are_held_to_the_truth(part, truth, precision, recall):
    reported = [replace(CONTACT, part=part)] if part else []
    found = evaluate_contacts(reported, np.arange(10), truth)
    assert (found.overall.precision, found.overall.recall) == (precision, recall)


def test_seen_and_inferred_contacts_are_also_held_to_the_truth_apart():
    reported = [
        replace(CONTACT, part="chest"),
        replace(CONTACT, part="chest", first_frame=6, last_frame=9, seen_share=0.1),
    ]
    found = evaluate_contacts(reported, np.arange(10), truth_of("Spine"))
    apart = {state: (score.reported, score.precision, score.recall) for state, score in found.per_state}
    assert apart == {"seen": (4, 1.0, 1.0), "inferred": (4, 0.0, 0.0)}
    assert (found.overall.precision, found.overall.recall) == (0.5, 1.0)


def test_a_truth_without_contacts_says_nothing_and_a_mismatch_is_refused(tmp_path):
    np.savez(tmp_path / "plain.npz", time=np.arange(3.0))
    assert read_true_touch(tmp_path / "plain.npz") is None
    np.savez(tmp_path / "odd.npz", time=np.arange(3.0), touched=np.zeros((2, 1), bool), part_names=["Spine"])
    with pytest.raises(InputError, match="touched"):
        read_true_touch(tmp_path / "odd.npz")


@pytest.mark.parametrize(
    ("missing", "gone"), [("shank_left", ("shank_left", "foot_left")), ("foot_left", ("foot_left",))]
)
def test_nobody_touches_a_part_that_the_patient_lacks(missing, gone):
    """A palm below the stump: all skin of the missing part lies in the joint where it would begin."""
    body = build_body(points(), replace(adult(), missing=(missing,)))
    joint = "KneeLeft" if missing == "shank_left" else "AnkleLeft"
    palm = body.joints(POSE)[JOINT_INDEX[joint]] + [0.0, -0.06, 0.0] + np.mgrid[-4:5, 0:1, -4:5].reshape(3, -1).T * 0.01
    view = before_wall(photograph(skin_in(POSE, body), FRONT), FRONT)
    near = find_nearness(body, pose_points(body, POSE), memory_at(palm), (view,), (FRONT,), VisibilityConfig())
    touched = {REGIONS[number] for number in np.unique(REGION[near.point]).tolist()}
    assert touched
    assert not touched & set(gone)


def test_a_child_has_less_skin_than_an_adult():
    """By the square of the stature, as bodies of the same form have it."""
    adult_m2, child_m2 = (area_of_point(adult_body(height)) for height in (1.75, 1.5))
    assert child_m2 / adult_m2 == pytest.approx((1.5 / 1.75) ** 2, rel=0.12)
