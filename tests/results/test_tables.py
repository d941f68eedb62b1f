"""joints.parquet: what goes in comes out, byte for byte the same each time, and nonsense does not go in."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from results_builder import make_frame, standing_joints

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.results.tables import JointFrame, read_joints, write_joints


def _write(path, frames):
    with write_joints(path) as joints:
        for frame in frames:
            joints.append(frame)
    return path


@st.composite
def joint_frames(draw):
    frames, rate_hz = [], draw(st.sampled_from([15, 30]))
    for number in range(draw(st.integers(1, 4))):
        state = draw(st.lists(st.sampled_from(list(JointState)), min_size=JOINT_COUNT, max_size=JOINT_COUNT))
        position = draw(hnp.arrays(np.float64, (JOINT_COUNT, 3), elements=st.floats(-9, 9)))
        sigma = draw(hnp.arrays(np.float64, JOINT_COUNT, elements=st.floats(1e-4, 1)))
        lost = np.array([s is JointState.LOST for s in state])
        position[lost], sigma[lost] = np.nan, np.nan
        frames.append(
            JointFrame(
                frame=number * 2, time_s=number / rate_hz, position_m=position, state=tuple(state), sigma_m=sigma
            )
        )
    return frames


@settings(max_examples=25, deadline=None)
@given(frames=joint_frames())
def test_frames_come_back_as_they_were_written(tmp_path_factory, frames):
    table = read_joints(_write(tmp_path_factory.mktemp("t") / "joints.parquet", frames))
    np.testing.assert_array_equal(table.frame, [frame.frame for frame in frames])
    np.testing.assert_array_equal(table.time_s, [frame.time_s for frame in frames])
    np.testing.assert_array_equal(table.position_m, [frame.position_m for frame in frames])
    np.testing.assert_array_equal(table.sigma_m, [frame.sigma_m for frame in frames])
    np.testing.assert_array_equal(table.state_code, [[STATE_CODE[state] for state in frame.state] for frame in frames])


SAME = ("frame", "time_s", "position_m", "state_code", "sigma_m")


def test_a_flipped_bit_is_refused_or_changes_no_number(tmp_path):
    rng, refused = np.random.default_rng(3), 0
    frames = [make_frame(n, n / 30, standing_joints() + rng.normal(scale=1e-3, size=(21, 3))) for n in range(30)]
    path = _write(tmp_path / "joints.parquet", frames)
    table, content = read_joints(path), path.read_bytes()
    footer = len(content) - 8 - int.from_bytes(content[-8:-4], "little")  # names and places of the columns
    bits = [*rng.integers(8 * len(content), size=800).tolist(), *range(8 * footer, 8 * len(content), 11)]
    for bit in bits:
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            found = read_joints(path)
        except InputError:  # and nothing else
            refused += 1
            continue
        for name in SAME:
            np.testing.assert_array_equal(getattr(found, name), getattr(table, name), f"bit {bit}")
    assert refused > len(bits) / 2


def test_the_columns_are_those_of_the_format_and_lost_joints_are_null(tmp_path):
    path = _write(tmp_path / "joints.parquet", [make_frame(5, 0.5, standing_joints(), lost=("WristLeft",))])
    table = pq.read_table(path)
    names = ["frame", "time_s", "joint", "x_m", "y_m", "z_m", "state", "sigma_m"]
    types = [pa.int32(), pa.float64(), pa.string(), *[pa.float64()] * 3, pa.string(), pa.float64()]
    assert (table.schema.names, table.schema.types) == (names, types)
    assert table["joint"].to_pylist() == list(JOINT_NAMES)
    row = table.to_pylist()[JOINT_INDEX["WristLeft"]]
    assert (row["x_m"], row["y_m"], row["z_m"], row["sigma_m"], row["state"]) == (None, None, None, None, "lost")
    assert table["x_m"].null_count == 1


def test_rows_in_another_order_are_the_same_table_and_a_shown_table_stays_as_it_was(tmp_path):
    path = _write(tmp_path / "joints.parquet", [make_frame(i, i / 30, standing_joints() + i) for i in range(4)])
    before, table = read_joints(path), pq.read_table(path)
    pq.write_table(table.take(np.random.default_rng(2).permutation(len(table))), path)
    after = read_joints(path)
    np.testing.assert_array_equal(before.position_m, after.position_m)
    np.testing.assert_array_equal(before.time_s, after.time_s)
    path = _write(tmp_path / "joints.parquet", [make_frame(i, i / 30, standing_joints()) for i in range(4)])
    shown = read_joints(path)
    _write(path, [make_frame(0, 0.0, standing_joints() + 1.0)])
    np.testing.assert_array_equal(shown.position_m[3], standing_joints())


@pytest.mark.parametrize(
    "change",
    [
        lambda p, s, state: p.__setitem__((3, 1), np.nan),
        lambda p, s, state: s.__setitem__(3, 0.0),
        lambda p, s, state: s.__setitem__(3, np.inf),
        lambda p, s, state: state.__setitem__(3, JointState.LOST),
        lambda p, s, state: state.pop(),
    ],
    ids=["position without a number", "no sigma", "endless sigma", "lost with a position", "too few states"],
)
def test_a_frame_that_contradicts_itself_cannot_be_made(change):
    position, sigma, state = standing_joints(), np.full(JOINT_COUNT, 0.02), [JointState.OBSERVED] * JOINT_COUNT
    change(position, sigma, state)
    with pytest.raises(ValueError, match="joint"):
        JointFrame(frame=0, time_s=0.0, position_m=position, state=tuple(state), sigma_m=sigma)


@pytest.mark.parametrize(
    ("spoil", "problem"),
    [
        (lambda table: table.slice(1), "21 joints"),
        (
            lambda table: table.set_column(2, "joint", pa.array(["Tail", *table["joint"].to_pylist()[1:]])),
            "unknown joint 'Tail'",
        ),
        (lambda table: table.drop_columns(["sigma_m"]), "columns are not"),
        (lambda table: table.slice(0, 0), "no rows"),
    ],
)
def test_a_table_that_is_not_ours_is_refused(tmp_path, spoil, problem):
    path = _write(tmp_path / "joints.parquet", [make_frame(0, 0.0, standing_joints())])
    pq.write_table(spoil(pq.read_table(path)), path)
    with pytest.raises(InputError, match=rf"joints\.parquet: .*{problem}"):
        read_joints(path)


def test_a_truncated_or_missing_table_is_refused(tmp_path):
    path = _write(tmp_path / "joints.parquet", [make_frame(0, 0.0, standing_joints())])
    path.write_bytes(path.read_bytes()[:-30])
    for bad, problem in ((path, "not a parquet table"), (tmp_path / "none.parquet", "no such file")):
        with pytest.raises(InputError, match=problem):
            read_joints(bad)
