"""Many frames on a narrow page: no peak is lost, no gap is bridged, and axes hold what they must."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anchorpose.report.chart import Axis, envelope, make_axis, make_bins, round_step
from anchorpose.report.curves import band_path, line_paths, step_path
from anchorpose.report.motion_section import on_shortest_arc
from anchorpose.report.words import decimals_for, number

WHOLE = Axis(0.0, 1.0, ())


def bins_of(count: int, most: int = 600, time_s: np.ndarray | None = None):
    return make_bins(np.arange(count), np.arange(count) / 30.0 if time_s is None else time_s, most=most)


def starts(path: str) -> list[int]:
    return [int(x) for x in re.findall(r"M(-?\d+)", path)]


@given(st.integers(1, 400), st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_groups_hold_each_frame_once_and_their_envelope_every_known_value(count, most, seed):
    random = np.random.default_rng(seed)
    values = np.where(random.random(count) < 0.3, np.nan, random.normal(size=count))
    bins = bins_of(count, most)
    found = envelope(values, bins)
    assert bins.count == min(count, most)
    for k, (first, last) in enumerate(zip(bins.start, bins.last, strict=True)):
        known = values[first : last + 1][np.isfinite(values[first : last + 1])]
        if len(known):
            assert (found.low[k], found.high[k]) == (known.min(), known.max())
            members = values[first : last + 1].tolist()
            assert found.rising[k] == (members.index(known.min()) <= members.index(known.max()))
        else:
            assert np.isnan(found.low[k])
            assert np.isnan(found.high[k])


def test_a_peak_of_one_frame_in_ten_minutes_is_drawn_at_its_full_height():
    values = np.zeros(18_000)
    values[12_345] = 1.0
    bins = bins_of(18_000)
    assert envelope(values, bins).high.max() == 1.0
    seen, _ = line_paths(envelope(values, bins), np.ones(600, dtype=bool), bins, WHOLE)
    assert "-1000" in seen  # up by the whole height


def test_a_line_is_broken_where_values_are_missing():
    values = np.array([0.0, 1.0, np.nan, np.nan, 1.0, 0.0, np.nan, 0.5])
    bins = bins_of(8)
    seen, inferred = line_paths(envelope(values, bins), np.ones(8, dtype=bool), bins, WHOLE)
    assert (inferred, starts(seen), seen.count("z")) == ("", [0, 571, 1000], 0)


def test_a_line_is_broken_where_the_camera_paused_and_a_pause_is_no_column():
    time_s = np.concatenate([np.arange(5) / 30, 3.0 + np.arange(5) / 30])
    bins = bins_of(10, time_s=time_s)
    seen, _ = line_paths(envelope(np.zeros(10), bins), np.ones(10, dtype=bool), bins, WHOLE)
    assert len(starts(seen)) == 2
    band = band_path(np.zeros(10), np.ones(10), bins, WHOLE)
    assert band.count("z") == 2
    widths = [int(width) for width in re.findall(r"h(\d+)", step_path(np.ones(10), bins_of(10, time_s=time_s)))]
    assert sum(widths) < 150  # of 1000: eight thirtieths of some three seconds


def test_seen_and_inferred_stretches_meet_and_a_link_is_seen_where_both_ends_are():
    bins = bins_of(6)
    flags = np.array([True, True, False, False, True, True])
    seen, inferred = line_paths(envelope(np.full(6, 0.5), bins), flags, bins, WHOLE)
    assert (starts(seen), starts(inferred), inferred) == ([0, 800], [200], "M200 500l200 0 200 0 200 0")


@given(st.floats(-1e3, 1e3), st.floats(0.01, 1e3), st.floats(0.0, 1e3), st.floats(0.1, 50.0))
def test_an_axis_holds_all_values_and_has_round_ticks_inside(low, span, reach, least):
    values = (np.array([low]), np.array([low + span]))
    axis = make_axis([values], [(values[0] - reach, values[1] + reach)], least)
    assert axis.low <= low + 1e-9
    assert axis.high >= low + span - 1e-9
    assert axis.high - axis.low >= 0.999 * least
    assert axis.high - axis.low <= 2.001 * max(span, least)  # bands never press the values into less than half
    assert all(axis.low - 1e-6 <= tick <= axis.high + 1e-6 for tick in axis.ticks)
    assert len(axis.ticks) >= 2


@pytest.mark.parametrize(("least", "step"), [(0.3, 0.5), (1.0, 1.0), (1.01, 2.0), (7.0, 10.0), (0.00013, 0.0002)])
def test_steps_are_one_two_or_five(least, step):
    assert round_step(least) == pytest.approx(step)


@given(st.lists(st.floats(-180.0, 180.0), min_size=1, max_size=40), st.integers(0, 39))
def test_angles_stay_the_same_directions_on_the_shortest_arc(values, gap):
    degrees = np.array(values)
    degrees[gap % len(values)] = np.nan
    moved = on_shortest_arc(degrees)
    assert (np.isnan(moved) == np.isnan(degrees)).all()
    known, arc = degrees[np.isfinite(degrees)], moved[np.isfinite(degrees)]
    turns = (arc - known) / 360.0
    assert turns == pytest.approx(np.round(turns), abs=1e-12)
    if len(known):
        shortest = min(max((v if v >= first else v + 360.0) - first for v in known) for first in known)
        assert np.ptp(arc) == pytest.approx(shortest, abs=1e-9)
        assert -180.0 <= np.median(arc) <= 180.0


def test_angles_within_half_a_turn_are_not_moved():
    degrees = np.array([-40.0, np.nan, 130.0, 12.5])
    np.testing.assert_array_equal(on_shortest_arc(degrees), degrees)
    np.testing.assert_array_equal(on_shortest_arc(np.array([-179.0, 178.0, 179.0])), [181.0, 178.0, 179.0])


def test_turns_are_not_counted_and_a_curve_of_more_than_a_turn_jumps_as_the_page_states():
    turned = np.linspace(0.0, 400.0, 600)
    moved = on_shortest_arc((turned + 180.0) % 360.0 - 180.0)
    assert np.ptp(moved) <= 360.0
    jumps = np.diff(moved)[np.abs(np.diff(moved)) > 180.0]
    assert jumps == pytest.approx([-360.0], abs=1.0)


def test_numbers_have_the_digits_that_their_error_leaves():
    assert [decimals_for(error, 12.3456) for error in (0.012, 0.24, 2.9, 3.6, 31.0, None)] == [3, 2, 1, 0, 0, 1]
    assert (number(-0.2, 0), number(-1234.5, 1)) == ("0", "\u22121\u202f234.5")
