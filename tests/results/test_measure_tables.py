"""posture, episodes and measures: what is written is read back, missing stays missing, other files are refused."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from anchorpose import __version__
from anchorpose.errors import InputError
from anchorpose.joints import JointState
from anchorpose.results.records import (
    DEFINITION_KEY,
    MEASURES,
    Definition,
    Episode,
    Measure,
    read_definition,
    read_episodes,
    read_measures,
    write_episodes,
    write_measures,
)
from anchorpose.results.tables import PostureTable, read_posture, write_posture


def _posture() -> PostureTable:
    com = np.array([[0.0, 1.0, 0.1], [np.nan] * 3, [0.0, 0.9, 0.1]])
    sigma = np.array([0.004, np.nan, 0.006])
    upright, state_code = np.array([1, -1, 0], np.int8), np.array([0, 6, 3], np.int8)
    return PostureTable(np.arange(3, dtype=np.int32), np.arange(3) / 15, com, sigma, upright, state_code)


def test_posture_comes_back_with_its_unknown_frames_unknown(tmp_path):
    write_posture(tmp_path / "posture.parquet", _posture())
    back = read_posture(tmp_path / "posture.parquet")
    for name in PostureTable.__slots__:
        np.testing.assert_array_equal(getattr(back, name), getattr(_posture(), name))


def test_episodes_come_back_in_the_order_of_time_and_an_unknown_kind_is_refused(tmp_path):
    late = Episode(kind="upright", first_frame=9, last_frame=12, start_s=0.6, end_s=0.8, state=JointState.OBSERVED)
    early = Episode(kind="sit_to_stand", first_frame=1, last_frame=9, start_s=0.1, end_s=0.6, state=JointState.HIDDEN)
    write_episodes(tmp_path / "episodes.parquet", [late, early])
    assert read_episodes(tmp_path / "episodes.parquet") == (early, late)
    assert late.seconds == pytest.approx(0.2)
    odd = Episode(kind="upright", first_frame=0, last_frame=1, start_s=0.0, end_s=0.1, state=JointState.OBSERVED)
    write_episodes(tmp_path / "episodes.parquet", [odd])
    table = pq.read_table(tmp_path / "episodes.parquet")
    column = table.column_names.index("kind")
    pq.write_table(table.set_column(column, table.schema.field("kind"), [["flying"]]), tmp_path / "odd.parquet")
    with pytest.raises(InputError, match="flying"):
        read_episodes(tmp_path / "odd.parquet")


def test_measures_come_back_with_a_value_or_a_reason_for_none(tmp_path):
    known = Measure(measure="upright_time", value=3.2, unit="s", sigma=0.1, frames=48, inferred_share=0.25)
    unknown = Measure(measure="sway_path", value=None, unit="mm", frames=0, why="no upright bout of 5 s")
    touch = Measure(measure="assistance_time", part="knee_left", person="b", value=1.0, unit="s", frames=15)
    write_measures(tmp_path / "measures.parquet", [known, unknown, touch], {})
    assert read_measures(tmp_path / "measures.parquet") == (known, unknown, touch)
    for value, why in ((None, None), (1.0, "because")):
        with pytest.raises(ValueError, match="upright_time"):
            Measure(measure="upright_time", value=value, unit="s", frames=1, why=why)


def test_measures_tell_by_which_version_and_thresholds_they_were_computed(tmp_path):
    path, config = tmp_path / "measures.parquet", {"upright": {"thigh_enter_deg": 40.0}}
    write_measures(path, [], config)
    assert read_definition(path) == Definition(__version__, config)
    pq.write_table(MEASURES.schema.empty_table(), path)
    assert read_definition(path) is None
    for text in ("no JSON", "[]", '{"anchorpose": "0.1.0"}'):
        pq.write_table(MEASURES.schema.with_metadata({DEFINITION_KEY: text}).empty_table(), path)
        with pytest.raises(InputError, match=r"measures\.parquet"):
            read_definition(path)


@pytest.mark.parametrize("read", [read_posture, read_episodes, read_measures])
def test_another_table_is_refused_by_name(tmp_path, read):
    path = tmp_path / "other.parquet"
    write = {read_posture: lambda: write_measures(path, [], {})}.get(read, lambda: write_posture(path, _posture()))
    write()
    with pytest.raises(InputError, match=r"other\.parquet"):
        read(path)
