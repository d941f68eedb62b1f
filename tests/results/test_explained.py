"""explained.parquet: what goes in comes out, unknown stays unknown, and the worst moments are found and worded."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from results_builder import explained_frames

from anchorpose.body.explanation import Explanation
from anchorpose.body.pose import PARTS
from anchorpose.results.explained import (
    EXPLAINED_FILE,
    UNCOVERED_CM2,
    ExplainedFrame,
    ExplainedTable,
    explained_frame,
    read_explained,
    summarise,
    unexplained,
    worst_moments,
    write_explained,
)

FPS = 10.0


def written(path: Path, frames: list[ExplainedFrame]) -> Path:
    with write_explained(path) as table:
        for frame in frames:
            table.append(frame)
    return path


def table_of(uncovered_cm2: list[float], past: dict[tuple[int, str], float] | None = None) -> ExplainedTable:
    frames = explained_frames(uncovered_cm2, past or {}, FPS)
    return ExplainedTable(
        np.array([each.frame for each in frames]),
        np.array([each.time_s for each in frames]),
        np.array([each.uncovered_cm2 for each in frames]),
        np.array([each.seen_past for each in frames]),
    )


def explanation(uncovered_m2: float, past: np.ndarray, nodes: int = 40) -> Explanation:
    return Explanation(np.arange(nodes), np.arange(0), 1.0, uncovered_m2, past, np.zeros(3, bool))


def test_frames_come_back_as_they_were_written(tmp_path):
    rng = np.random.default_rng(4)
    frames = [ExplainedFrame(3 * k, k / 30, rng.uniform(0, 900), rng.uniform(0, 1, PARTS)) for k in range(20)]
    table = read_explained(written(tmp_path / EXPLAINED_FILE, frames))
    np.testing.assert_array_equal(table.frame, [each.frame for each in frames])
    np.testing.assert_array_equal(table.time_s, [each.time_s for each in frames])
    np.testing.assert_array_equal(table.uncovered_cm2, np.float32([each.uncovered_cm2 for each in frames]))
    np.testing.assert_array_equal(table.seen_past, np.float32([each.seen_past for each in frames]))


def test_the_columns_are_those_of_the_format_and_a_lost_frame_is_null(tmp_path):
    past = np.array([0.1, np.nan, 0.3, 0.4, 0.5])
    frames = [explained_frame(7, 0.5, explanation(0.0123, past)), explained_frame(8, 0.6, None)]
    table = pq.read_table(written(tmp_path / EXPLAINED_FILE, frames))
    names = [
        "trunk_seen_past",
        "arm_left_seen_past",
        "leg_left_seen_past",
        "arm_right_seen_past",
        "leg_right_seen_past",
    ]
    assert table.schema.names == ["frame", "time_s", "uncovered_cm2", *names]
    assert table.schema.types == [pa.int32(), pa.float64(), *[pa.float32()] * 6]
    first, second = table.to_pylist()
    assert first["uncovered_cm2"] == pytest.approx(123.0)
    assert [first[name] for name in names] == [pytest.approx(0.1), None, *map(pytest.approx, (0.3, 0.4, 0.5))]
    assert second == {"frame": 8, "time_s": 0.6, **dict.fromkeys(["uncovered_cm2", *names])}


def test_where_nothing_of_the_patient_is_seen_the_area_is_unknown_and_not_zero():
    assert np.isnan(explained_frame(0, 0.0, explanation(0.0, np.full(PARTS, np.nan), nodes=0)).uncovered_cm2)
    assert explained_frame(0, 0.0, explanation(0.0, np.full(PARTS, np.nan))).uncovered_cm2 == 0.0


def test_the_limit_is_where_tracking_looks_for_a_limb_elsewhere():
    found = unexplained(table_of([0.0, UNCOVERED_CM2, 160.0, np.nan], {(0, "leg_left"): 0.15, (1, "trunk"): 0.6}))
    np.testing.assert_allclose(found, [0.5, 2.0, 2.0, np.nan])


def test_the_worst_moments_are_apart_and_say_why_in_words():
    uncovered = [0.0] * 40
    uncovered[10], uncovered[12], uncovered[20], uncovered[30] = 620.0, 600.0, 79.0, 100.0
    past = {(10, "arm_left"): 0.45, (25, "leg_right"): 0.62, (35, "trunk"): 0.29}
    found = worst_moments(table_of(uncovered, past))
    assert [(each.frame, each.time_s) for each in found] == [(10, 1.0), (25, 2.5), (30, 3.0)]
    assert [each.reason for each in found] == [
        "620 cm² of the patient's surface is covered by no limb; "
        "the left arm lies in front of what a camera sees: 45 %",
        "the right leg lies in front of what a camera sees: 62 %",
        "100 cm² of the patient's surface is covered by no limb",
    ]


def test_the_summary_counts_known_frames_only():
    summary = summarise(table_of([100.0, 0.0, 0.0, np.nan], {(1, "arm_left"): 0.9}))
    assert (summary.known_frames, summary.uncovered_share) == (3, pytest.approx(1 / 3))
    assert [each.frame for each in summary.worst] == [1]  # 3 limits; frame 0, with 1.25, is too close to it
    never = summarise(table_of([np.nan, np.nan]))
    assert (never.known_frames, never.uncovered_share, never.worst) == (0, None, ())
