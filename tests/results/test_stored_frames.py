"""A table of which some frames are read has in them what the whole table has."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from results_builder import make_frame, standing_joints

from anchorpose.errors import InputError
from anchorpose.results.frame_table import FRAMES_PER_ROW_GROUP
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.stored_frames import open_frames
from anchorpose.results.tables import ANGLES, JOINTS, read_joints, write_angles, write_joints

FRAMES = 2 * FRAMES_PER_ROW_GROUP + 100


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder, rng = tmp_path_factory.mktemp("stored"), np.random.default_rng(4)
    with write_joints(folder / JOINTS.file) as rows:
        for k in range(FRAMES):
            place = standing_joints() + rng.normal(scale=0.01, size=(21, 3))
            rows.append(make_frame(3 * k, 0.1 * k, place, lost=("HandLeft",) if k % 7 == 0 else ()))
    write_angles(folder / ANGLES.file, joint_angles(read_joints(folder / JOINTS.file)))
    return folder


def same(some: object, whole: object, rows: slice) -> bool:
    pairs = [(getattr(some, each.name), getattr(whole, each.name)) for each in fields(some)]  # type: ignore[arg-type]
    return all(
        a == b if isinstance(a, tuple) else a.dtype == b.dtype and np.array_equal(a, b[rows], equal_nan=True)
        for a, b in pairs
    )


@pytest.mark.parametrize("table", [JOINTS, ANGLES])
def test_any_frames_are_those_of_the_whole_table(folder: Path, table) -> None:
    stored, whole = open_frames(table, folder / table.file), table.read(folder / table.file)
    assert stored.whole is None
    assert np.array_equal(stored.frame, whole.frame)
    assert np.array_equal(stored.time_s, whole.time_s)
    edges = (0, 1, FRAMES_PER_ROW_GROUP - 1, FRAMES_PER_ROW_GROUP, FRAMES_PER_ROW_GROUP + 1, FRAMES - 1)
    for first in edges:
        for stop in (first + 1, min(first + 600, FRAMES), FRAMES):
            assert same(stored.rows(first, stop), whole, slice(first, stop))
    parts = list(stored.blocks(500))
    assert [rows.stop - rows.start for rows, _ in parts] == [500, 500, FRAMES - 1000]
    assert all(same(part, whole, rows) for rows, part in parts)


def test_a_table_in_another_order_is_read_all_the_same(folder: Path, tmp_path: Path) -> None:
    mixed = pq.read_table(folder / JOINTS.file).take(np.random.default_rng(1).permutation(FRAMES * 21))
    pq.write_table(mixed, tmp_path / "joints.parquet")
    whole = read_joints(folder / JOINTS.file)
    assert same(open_frames(JOINTS, tmp_path / "joints.parquet").rows(30, 50), whole, slice(30, 50))


def test_a_table_that_lacks_a_joint_or_has_no_frame_is_refused(folder: Path, tmp_path: Path) -> None:
    table = pq.read_table(folder / JOINTS.file)
    for rows, words in ((21 * 50 - 1, "without exactly 21 joints"), (0, "has no rows; track")):
        pq.write_table(table.slice(0, rows), tmp_path / "some.parquet")
        with pytest.raises(InputError, match=words):
            open_frames(JOINTS, tmp_path / "some.parquet")


def test_a_table_that_is_replaced_meanwhile_is_noticed(folder: Path, tmp_path: Path) -> None:
    table, path = pq.read_table(folder / JOINTS.file), tmp_path / "joints.parquet"
    pq.write_table(table, path)
    stored = open_frames(JOINTS, path)
    later = table.set_column(0, table.schema.field(0), pa.array(table["frame"].to_numpy() + np.int32(1)))
    for other in (later, table.slice(0, 21 * 100)):
        pq.write_table(other, path)
        with pytest.raises(InputError, match="was changed while it was read"):
            stored.rows(10, 20)
