"""Results of many frames in the viewer: thinned where they are drawn, exact where a value is read."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_results_builder import repeat_results
from viewer_builder import unpack, viewer_of, write_small_recording, write_small_results
from viewer_page import opened, position, until

from anchorpose.joints import JOINT_NAMES
from anchorpose.results.tables import read_angles, read_joints
from anchorpose.viewer.payloads import INTERVALS, KEPT, MOST_ROWS, curves_payload, motion_payload, thinned
from anchorpose.viewer.review import open_review
from anchorpose.viewer.server import ViewerServer

pytestmark = pytest.mark.thorough

pytest_plugins = ("viewer_fixtures",)

LONG = 6030  # frames


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("long")
    short = write_small_results(folder / "short", write_small_recording(folder / "recording"))
    repeat_results(short, folder / "long", LONG)
    return folder / "long"


@pytest.fixture
def long_server(long: Path) -> Iterator[ViewerServer]:
    with viewer_of(long) as running:
        yield running


def test_no_peak_no_gap_and_no_inferred_frame_is_lost_by_thinning() -> None:
    rng = np.random.default_rng(8)
    degrees = np.cumsum(rng.normal(size=(50_123, 3)), axis=0)
    state_code = np.zeros(degrees.shape, np.int8)
    degrees[31_234, 1], degrees[40_001, 2], state_code[777, 0] = 500.0, np.nan, 3
    sigma_deg = np.where(np.isnan(degrees), np.nan, 2.0)
    for angle, rows in enumerate(thinned(degrees[100:50_000], sigma_deg[100:50_000], state_code[100:50_000])):
        row = 100 + rows
        assert len(row) <= (INTERVALS + 9) * KEPT
        assert (np.diff(row) > 0).all()
        assert row[0] >= 100
        assert row[-1] < 50_000
        for begin in range(100, 50_000 - 62, 62):  # 62 frames in an interval
            inside = row[(row >= begin) & (row < begin + 62)]
            for extreme in (np.nanmin, np.nanmax):
                assert extreme(degrees[inside, angle]) == extreme(degrees[begin : begin + 62, angle])
        assert ((777, 31_234, 40_001)[angle]) in row


def test_few_frames_are_drawn_as_they_are_and_an_answer_does_not_grow_with_the_recording(long: Path) -> None:
    review, whole = open_review(long, None), read_angles(long / "angles.parquet")
    _, arrays = unpack(curves_payload(review, 50, 1000))
    count = len(whole.names)
    assert np.array_equal(arrays["row"].reshape(count, 1000), np.tile(np.arange(50, 1050), (count, 1)))
    expected = whole.degrees[50:1050].T.astype(np.float32)
    assert np.array_equal(arrays["degrees"].reshape(count, 1000), expected, equal_nan=True)
    review = open_review(long, None)
    assert len(curves_payload(review, 0, LONG)) < 14 * len(review.angles.names) * KEPT * (INTERVALS + 9)
    with pytest.raises(ValueError, match="there are no frames"):
        motion_payload(review, 0, MOST_ROWS + 1)


def test_every_frame_has_its_own_values_however_far_it_is(page: Any, long: Path, long_server: ViewerServer) -> None:
    opened(page, long_server)
    angles, joints = read_angles(long / "angles.parquet"), read_joints(long / "joints.parquet")
    column, knee = angles.names.index("knee_flexion_left"), JOINT_NAMES.index("KneeLeft")
    page.evaluate(f"anchorpose.mover.choose({knee})")
    for row in (LONG - 1, 3 * MOST_ROWS, 3 * MOST_ROWS - 1, 2500, 10):
        page.evaluate(f"anchorpose.playback.seek({row})")
        until(page, lambda: not page.evaluate("anchorpose.frames.missing"))
        shown = page.locator(".chart", has_text="knee flexion").text_content()
        assert f"left {angles.degrees[row, column]:.0f}°" in shown
        assert f"{joints.position_m[row, knee, 0]:.3f}" in page.locator("#joint-card").inner_text()
        assert position(page) == row
    assert page.evaluate("anchorpose.rows.chunks.held.size") <= 12


def test_a_seek_across_the_recording_shows_nothing_of_another_frame_meanwhile(
    page: Any, long_server: ViewerServer
) -> None:
    opened(page, long_server)
    page.evaluate("() => { anchorpose.rows.chunks.load = () => new Promise(() => {}); }")  # no answer ever comes
    page.evaluate(f"anchorpose.playback.seek({LONG - 1})")
    assert page.evaluate("anchorpose.frames.missing")
    assert not page.evaluate("anchorpose.frames.skeleton.group.visible")
    assert "…" in page.locator(".chart").first.text_content()
