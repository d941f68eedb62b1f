"""An hour's results: tables are read piece by piece, and run.json may name every depth image."""

from __future__ import annotations

import json
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT
from anchorpose.results.parquet import ROWS_AT_ONCE
from anchorpose.results.records import Contact
from anchorpose.results.run_document import read_run
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.stand_training.assistance import touch_of
from anchorpose.results.tables import ANGLES, JOINTS, AngleTable, JointTable
from anchorpose.results.unfinished import begin_journal

FRAMES = 3 * ROWS_AT_ONCE // JOINT_COUNT
INPUTS = {f"front/depth/{number:06d}.png": "ab" * 32 for number in range(200_000)}  # 18 MB


@pytest.fixture(scope="module")
def joints() -> JointTable:
    rng = np.random.default_rng(1)
    state_code = rng.integers(0, 7, (FRAMES, JOINT_COUNT)).astype(np.int8)
    position_m = np.where(state_code[..., None] == 6, np.nan, rng.normal(size=(FRAMES, JOINT_COUNT, 3)))
    sigma_m = np.where(state_code == 6, np.nan, 0.01)
    return JointTable(np.arange(FRAMES, dtype=np.int32), np.arange(FRAMES) / 30.0, position_m, state_code, sigma_m)


def same(found: JointTable, joints: JointTable) -> bool:
    return all(np.array_equal(getattr(found, name), getattr(joints, name), equal_nan=True) for name in joints.__slots__)


def test_a_table_of_many_pieces_comes_back_as_it_was(tmp_path, joints):
    JOINTS.write(tmp_path / JOINTS.file, joints)
    assert same(JOINTS.read(tmp_path / JOINTS.file), joints)


def test_a_table_in_one_row_group_and_in_another_order_is_the_same(tmp_path, joints):
    JOINTS.write(tmp_path / JOINTS.file, joints)
    table = pq.read_table(tmp_path / JOINTS.file)
    mixed = table.take(pa.array(np.random.default_rng(2).permutation(len(table))))
    pq.write_table(mixed, tmp_path / "mixed.parquet", row_group_size=len(mixed))
    assert same(JOINTS.read(tmp_path / "mixed.parquet"), joints)


def test_names_of_later_pieces_keep_their_place(tmp_path):
    names = tuple(f"angle_{number}" for number in range(ROWS_AT_ONCE + 5))
    values = np.arange(len(names), dtype=np.float64)[None]
    angles = AngleTable(
        np.array([4], np.int32), np.array([0.5]), names, values, np.zeros(values.shape, np.int8), values / 10
    )
    ANGLES.write(tmp_path / ANGLES.file, angles)
    found = ANGLES.read(tmp_path / ANGLES.file)
    assert found.names == names
    assert np.array_equal(found.degrees, values)


def test_a_wrong_text_in_the_last_piece_is_found(tmp_path, joints):
    JOINTS.write(tmp_path / JOINTS.file, joints)
    table = pq.read_table(tmp_path / JOINTS.file)
    states = table["state"].to_pylist()
    states[-1] = "asleep"
    place = table.column_names.index("state")
    wrong = table.set_column(place, table.schema.field("state"), pa.array(states))
    pq.write_table(wrong, tmp_path / "wrong.parquet")
    with pytest.raises(InputError, match="unknown state 'asleep'"):
        JOINTS.read(tmp_path / "wrong.parquet")


def test_reading_needs_little_more_than_the_arrays(tmp_path, joints):
    JOINTS.write(tmp_path / JOINTS.file, joints)
    JOINTS.read(tmp_path / JOINTS.file)
    pool, before = pa.default_memory_pool(), pa.total_allocated_bytes()
    tracemalloc.start()
    try:
        JOINTS.read(tmp_path / JOINTS.file)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    arrays = sum(getattr(joints, name).nbytes for name in joints.__slots__)
    assert peak < 2.0 * arrays  # times, frames and joints of each row, and a piece
    assert pool.bytes_allocated() - before < 0.1 * arrays


def test_contacts_are_counted_frame_by_frame():
    frame = np.array([3, 4, 7, 8, 9])
    first, second = contact(4, 8, 0.5), contact(5, 20, 0.75)
    touch = touch_of(frame, (first, second))
    assert touch.at_once.tolist() == [0, 1, 2, 2, 1]
    assert touch.seen.tolist() == [0.0, 0.5, 0.75, 0.75, 0.75]
    found = touch.where(np.array([True, True, False, True, True]))
    assert found.at_once.tolist() == [0, 1, 0, 2, 1]
    assert found.seen.tolist() == [0.0, 0.5, 0.0, 0.75, 0.75]


def contact(first: int, last: int, seen: float) -> Contact:
    return Contact(
        part="belly", person="person 1", first_frame=first, last_frame=last, start_s=0.0, end_s=1.0, seen_share=seen,
        area_cm2=1.0, gap_mm=1.0,
    )  # fmt: skip


RUN = {"format": "anchorpose-run", "version": 1, "recording": "ward 3", "cameras": []}


def test_a_run_of_an_hour_can_be_read_and_continued(tmp_path: Path):
    (tmp_path / RUN_FILE).write_text(json.dumps(RUN | {"inputs_sha256": INPUTS}))
    assert read_run(tmp_path / RUN_FILE)["inputs_sha256"] == INPUTS
    begin_journal(tmp_path, "one", INPUTS)
    begin_journal(tmp_path, "one", INPUTS)  # goes on
    with pytest.raises(InputError, match="was begun"):
        begin_journal(tmp_path, "another", INPUTS)
