"""Contacts with the equipment: when they begin, go on and end, what is claimed of hidden skin, table and evaluation."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from body_builder import adult_body, asset, points
from session_builder import contact, support

from anchorpose.body.contact_regions import REGIONS, Nearness, area_of_point, region_of_points
from anchorpose.body.equipment_gaps import EquipmentGaps
from anchorpose.errors import InputError
from anchorpose.results.contact_intervals import ContactConfig, ContactIntervals
from anchorpose.results.contact_scores import evaluate_contacts
from anchorpose.results.records import (
    PERSON,
    Contact,
    read_contacts,
    read_equipment_names,
    with_equipment,
    with_people,
    write_contacts,
)
from anchorpose.results.truth import read_true_support

REGION, AREA_M2 = region_of_points(points()), area_of_point(adult_body())
PARTS = ("rail-left", "knee-pad")
FPS = 10.0


def nobody() -> Nearness:
    none = np.zeros(0)
    return Nearness(
        none.astype(np.uint8),
        none.astype(np.int32),
        none.astype(np.float32),
        none.astype(bool),
        np.ones(len(REGION), bool),
        AREA_M2,
    )


def gap(
    gap_m: float, sigma_m: float = 0.01, shown: float = 1.0, region: str = "hand_left", part: int = 0
) -> EquipmentGaps:
    single = (np.array([value], np.float32) for value in (gap_m, sigma_m, 0.01, shown))
    return EquipmentGaps(np.array([part], np.int16), np.array([REGIONS.index(region)], np.uint8), *single)


def contacts_of(frames: list[EquipmentGaps | None], config: ContactConfig | None = None) -> list[Contact]:
    intervals, found = ContactIntervals(REGION, config or ContactConfig(), PARTS), []
    for frame, gaps in enumerate(frames):
        found += intervals.push(frame, frame / FPS, nobody(), gaps)
    return found + list(intervals.finish())


def spans(frames: list[EquipmentGaps | None]) -> list[tuple[int, int]]:
    return [(each.first_frame, each.last_frame) for each in contacts_of(frames)]


FAR = gap(0.10)


def test_a_hand_on_the_rail_is_one_contact_with_the_name_of_the_rail():
    (found,) = contacts_of([FAR] * 3 + [gap(0.0)] * 5 + [FAR] * 6)
    assert (found.part, found.with_, found.person, found.toucher) == ("hand_left", "rail-left", None, "rail-left")
    assert (found.first_frame, found.last_frame, found.state) == (3, 7, "seen")
    assert (found.area_cm2, found.gap_mm) == (pytest.approx(100.0), pytest.approx(0.0))


@pytest.mark.parametrize(
    ("frames", "expected"),
    [
        pytest.param([gap(0.02)] * 8, [], id="2 cm begins nothing"),
        pytest.param([gap(0.0)] * 3 + [gap(0.02, sigma_m=0.05)] * 8, [(0, 2)], id="2 cm ends it, however uncertain"),
        pytest.param([gap(0.0)] * 3 + [FAR] * 8, [(0, 2)], id="10 cm ends it"),
        pytest.param([gap(0.0)] * 3 + [FAR] * 3 + [gap(0.0)] * 3, [(0, 8)], id="a short gap is bridged"),
        pytest.param([FAR, gap(0.0)] + [FAR] * 8, [], id="a single frame"),
        pytest.param([gap(0.0)] * 3 + [None] * 8, [(0, 2)], id="the hand is lost"),
        pytest.param([gap(0.0, shown=0.0, sigma_m=0.05)] * 8, [], id="hidden and too uncertain"),
        pytest.param([gap(0.0, sigma_m=0.05)] * 8, [(0, 7)], id="uncertain, and seen there"),
    ],
)
def test_when_a_contact_with_equipment_begins_and_ends(frames, expected):
    assert spans(frames) == expected


def test_what_is_hidden_and_certain_enough_is_inferred():
    (found,) = contacts_of([gap(0.0, shown=0.0)] * 8)
    assert (found.state, found.seen_share) == ("inferred", 0.0)
    (found,) = contacts_of([gap(0.0)] * 2 + [gap(0.0, sigma_m=0.06, shown=0.0)] * 6)
    assert (found.state, found.last_frame, found.seen_share) == ("inferred", 7, pytest.approx(0.25))


def test_parts_and_regions_are_counted_apart_and_nothing_is_known_while_the_patient_is_lost():
    both = [gap(0.0), gap(0.0, region="knee_left", part=1)]
    columns = (np.concatenate([getattr(each, name) for each in both]) for name in EquipmentGaps.__slots__)
    found = contacts_of([EquipmentGaps(*columns)] * 4)
    assert {(each.part, each.with_) for each in found} == {("hand_left", "rail-left"), ("knee_left", "knee-pad")}
    intervals, found = ContactIntervals(REGION, ContactConfig(), PARTS), []
    for frame in range(9):
        near = None if frame == 4 else nobody()
        found += intervals.push(frame, frame / FPS, near, None if frame == 4 else gap(0.0))
    assert intervals.touched_now(by_equipment=True) == {"hand_left": True}
    assert intervals.touched_now(by_equipment=False) == {}
    assert [(each.first_frame, each.last_frame) for each in (*found, *intervals.finish())] == [(0, 3), (5, 8)]


@pytest.mark.parametrize("wrong", [{"equipment_touch_m": 0.0}, {"equipment_sigma_m": -1.0}])
def test_settings_that_cannot_work_are_refused(wrong):
    with pytest.raises(ValueError, match="should be"):
        ContactConfig(**wrong)


def test_the_table_keeps_who_and_what_touched_and_which_equipment_was_looked_at(tmp_path):
    written = (contact("knee_left", "person 1", 2, 5), support("hand_left", "rail-left", 3, 9))
    with write_contacts(tmp_path / "c.parquet", PARTS) as table:
        for each in written:
            table.append(each)
    read = read_contacts(tmp_path / "c.parquet")
    assert read == written
    assert (with_people(read), with_equipment(read)) == (written[:1], written[1:])
    assert read_equipment_names(tmp_path / "c.parquet") == PARTS
    columns = pq.read_table(tmp_path / "c.parquet")
    assert columns["with"].to_pylist() == [PERSON, "rail-left"]
    assert columns["person"].to_pylist() == ["person 1", None]


def test_a_table_of_an_earlier_version_is_read_as_contacts_with_people(tmp_path):
    written = (contact("knee_left", "person 1", 2, 5),)
    with write_contacts(tmp_path / "new.parquet", PARTS) as table:
        table.append(written[0])
    old = pq.read_table(tmp_path / "new.parquet").drop_columns(["with"]).replace_schema_metadata(None)
    pq.write_table(old, tmp_path / "old.parquet")
    assert read_contacts(tmp_path / "old.parquet") == written
    assert read_equipment_names(tmp_path / "old.parquet") == ()
    pq.write_table(old.drop_columns(["gap_mm"]), tmp_path / "odd.parquet")
    with pytest.raises(InputError, match="columns"):
        read_contacts(tmp_path / "odd.parquet")


@pytest.mark.parametrize("text", [b"{", b'{"a": 1}', b"[1]"])
def test_a_damaged_list_of_parts_is_refused(tmp_path, text):
    pq.write_table(pa.table({"a": [1]}).replace_schema_metadata({b"equipment_parts": text}), tmp_path / "c.parquet")
    with pytest.raises(InputError, match="equipment's parts"):
        read_equipment_names(tmp_path / "c.parquet")


NAMES = asset().bone_names


def test_the_truth_joins_all_parts_of_the_equipment_and_leaves_out_feet(tmp_path):
    touched = np.zeros((10, 2, len(NAMES)), dtype=bool)
    touched[2:6, 0, NAMES.index("LeftHand")] = touched[4:8, 1, NAMES.index("LeftHand")] = True
    touched[:, 1, NAMES.index("LeftFoot")] = True
    np.savez(tmp_path / "t.npz", time=np.arange(10.0), on_equipment=touched, part_names=NAMES)
    truth = read_true_support(tmp_path / "t.npz")
    assert truth is not None
    found = evaluate_contacts([support("hand_left", "rail-left", 3, 8)], np.arange(10), truth).overall
    assert (found.touched, found.precision, found.recall) == (6, pytest.approx(5 / 6), pytest.approx(5 / 6))


def test_a_truth_without_equipment_says_nothing_and_a_mismatch_is_refused(tmp_path):
    np.savez(tmp_path / "plain.npz", time=np.arange(3.0), part_names=NAMES)
    assert read_true_support(tmp_path / "plain.npz") is None
    np.savez(tmp_path / "odd.npz", time=np.arange(3.0), part_names=NAMES, on_equipment=np.zeros((3, 1, 2), bool))
    with pytest.raises(InputError, match="on_equipment"):
        read_true_support(tmp_path / "odd.npz")
