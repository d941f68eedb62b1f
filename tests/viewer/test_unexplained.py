"""The worst frames of explained.parquet in the viewer: listed, in the timeline, and gone without the table."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from results_builder import explained_frames
from viewer_builder import FRAMES, LOST_FRAME, PERIOD_S, unpack, viewer_of, write_small_results, write_small_session
from viewer_page import opened, position

from anchorpose.errors import InputError
from anchorpose.results.explained import EXPLAINED_FILE
from anchorpose.viewer.payloads import overview_payload
from anchorpose.viewer.review import describe, open_review
from anchorpose.viewer.server import ViewerServer

pytestmark = pytest.mark.thorough

pytest_plugins = ("viewer_fixtures",)

BARE, THROUGH = 20, 36  # frames: surface without a limb, a limb that a camera sees past


def frames() -> list:
    """Frame 20 much uncovered, the leg off in frame 36, the patient lost in frame 30."""
    area = np.full(FRAMES, 10.0)
    area[BARE], area[LOST_FRAME] = 620.0, np.nan
    return explained_frames(area.tolist(), {(BARE, "arm_left"): 0.45, (THROUGH, "leg_right"): 0.62}, 1.0 / PERIOD_S)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return write_small_session(tmp_path_factory.mktemp("unexplained"), explained=frames())


@pytest.fixture
def explained_server(folders: tuple[Path, Path]) -> Iterator[ViewerServer]:
    with viewer_of(folders[0]) as running:
        yield running


def orange(page: Any, row: int) -> bool:
    """Whether the timeline has the colour of what is not explained in the column of a frame."""
    return bool(
        page.evaluate(
            """row => {
          const canvas = document.getElementById("timeline"), ratio = canvas.width / canvas.clientWidth;
          const times = anchorpose.motion.time_s, left = 136, wide = canvas.clientWidth - left;
          const x = left + (times[row] + 0.7 * (times[1] - times[0]) - times[0]) / (times.at(-1) - times[0]) * wide;
          const data = canvas.getContext("2d").getImageData(Math.round(x * ratio), 0, 1, canvas.height).data;
          return [...Array(canvas.height).keys()].map((row) => data.subarray(4 * row, 4 * row + 3))
            .some(([red, green, blue]) => red > 190 && green < 120 && blue < 30);
        }""",
            row,
        )
    )


def test_the_page_is_given_the_moments_and_how_well_each_frame_is_explained(folders: tuple[Path, Path]) -> None:
    review = open_review(folders[0], None)
    found = describe(review)["unexplained"]
    assert [(each["position"], each["reason"]) for each in found] == [
        (
            BARE,
            "620 cm² of the patient's surface is covered by no limb; "
            "the left arm lies in front of what a camera sees: 45 %",
        ),
        (THROUGH, "the right leg lies in front of what a camera sees: 62 %"),
    ]
    _, arrays = unpack(overview_payload(review))
    assert np.flatnonzero(arrays["unexplained"] >= 1.0).tolist() == [BARE, THROUGH]
    assert np.flatnonzero(np.isnan(arrays["unexplained"])).tolist() == [LOST_FRAME]
    assert arrays["unexplained"][BARE] == pytest.approx(620.0 / 80.0)


def test_a_table_of_other_frames_is_refused(folders: tuple[Path, Path], tmp_path: Path) -> None:
    results = write_small_results(tmp_path / "results", folders[1], explained=frames()[:-1])
    with pytest.raises(InputError, match=EXPLAINED_FILE):
        open_review(results, None)


def test_the_list_goes_to_the_worst_frames_first_and_w_goes_on(page: Any, explained_server: ViewerServer) -> None:
    opened(page, explained_server)
    page.keyboard.press("w")
    assert position(page) == BARE
    chosen = page.locator("#unexplained [aria-current=true]")
    assert chosen.inner_text().split("\n")[0] == "1"
    assert "covered by no limb" in chosen.inner_text()
    page.keyboard.press("w")
    assert position(page) == THROUGH
    page.keyboard.press("w")
    assert position(page) == LOST_FRAME  # the frames to check come after them
    assert page.locator("#unexplained [aria-current=true]").count() == 0
    page.locator("#unexplained button").nth(1).click()
    assert position(page) == THROUGH


def test_the_timeline_marks_them_and_a_click_on_a_number_goes_there(page: Any, explained_server: ViewerServer) -> None:
    opened(page, explained_server)
    assert [row for row in range(FRAMES - 1) if orange(page, row)] == [BARE, THROUGH]
    assert "2 frames that the body does not explain" in page.locator("#timeline").get_attribute("aria-label")
    canvas = page.locator("#timeline")
    x = 136 + BARE / (FRAMES - 1) * (canvas.bounding_box()["width"] - 136)
    canvas.click(position={"x": x + 5, "y": 18 + 15 + 7})
    assert position(page) == BARE
    assert page.locator("#panel-check").is_visible()
    assert page.locator("#unexplained [aria-current=true]").count() == 1
