"""The hypotheses of a frame in the viewer: worked out in another process, drawn, and given up when asked to."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from viewer_builder import unpack, viewer_of, write_small_session
from viewer_page import opened, until

from anchorpose.pipeline import track_recording
from anchorpose.recording.reader import open_recording
from anchorpose.simulate.config import single
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import inspect_frame
from anchorpose.viewer.hypotheses import HypothesisWorker, Progress
from anchorpose.viewer.server import ViewerServer

PATIENCE_S = 240.0


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """One camera, one second."""
    folder = tmp_path_factory.mktemp("tracked")
    simulate_recording(folder, replace(single(3, 1.0, 15.0), motions=("squat",)), lambda done, total: None)
    results = folder / "results"
    results.mkdir()
    track_recording(folder / "recording", results, TrackConfig(), lambda done, total: None)
    return results, folder / "recording"


@pytest.fixture
def server(tracked: tuple[Path, Path]) -> Iterator[ViewerServer]:
    with viewer_of(*tracked) as running:
        yield running


def finished(worker: HypothesisWorker) -> Progress:
    end = time.monotonic() + PATIENCE_S
    while worker.status.progress is Progress.WORKING:
        assert time.monotonic() < end
        time.sleep(0.05)
    return worker.status.progress


@pytest.mark.slow
def test_what_is_drawn_is_what_inspection_finds(server: ViewerServer, tracked: tuple[Path, Path]) -> None:
    position = 6
    server.api.post("hypotheses/start", {"position": position})
    assert finished(server.api.worker) is Progress.DONE
    meta, arrays = unpack(server.api.get("hypotheses/found", {}).content)
    place = server.api.review.joints.position_m[position, 0]
    config = replace(TrackConfig(), patient_xz_m=(float(place[0]), float(place[2])))
    found = inspect_frame(open_recording(tracked[1]), 6, config, False, lambda: None)
    links = found.next.links
    assert (meta["frames"], len(meta["subsets"])) == ([6, 7], links.match.shape[1])
    assert np.allclose(arrays["nodes"], found.observation.surface.points_m, atol=1e-6)
    node, subset = np.argwhere(links.match >= 0)[100]
    there = found.next.observation.surface.points_m[links.match[node, subset]]
    assert np.allclose(arrays["reached"][node, subset], there, atol=1e-6)
    assert np.array_equal(np.isnan(arrays["reached"][..., 0]), links.match < 0)
    assert (arrays["best"][arrays["asked"] == 0] == -1).all()
    moved_m = np.linalg.norm(arrays["reached"] - arrays["nodes"][:, None], axis=2)
    assert np.nanmedian(moved_m) < 0.1  # in a fifteenth of a second


@pytest.mark.slow
def test_the_page_asks_waits_and_draws_them(page: Any, server: ViewerServer) -> None:
    opened(page, server)
    for _ in range(6):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("h")
    until(page, lambda: page.evaluate("anchorpose.hypotheses.position") == 6, PATIENCE_S)
    assert page.evaluate("anchorpose.hypotheses.group.visible")
    assert (
        page.evaluate("anchorpose.hypotheses.lines.reduce((n, l) => n + l.geometry.attributes.position.count, 0)") > 200
    )
    assert "found" in page.locator("#hypotheses-legend").inner_text()
    page.keyboard.press("ArrowRight")
    assert not page.evaluate("anchorpose.hypotheses.group.visible")  # they belong to another frame


@pytest.mark.thorough
def test_the_work_can_be_given_up_and_begun_again(tmp_path: Path) -> None:
    with viewer_of(*write_small_session(tmp_path)) as server:
        worker = server.api.worker
        for position in (3, 9):  # the second ends the first
            server.api.post("hypotheses/start", {"position": position})
            assert worker.status.progress is Progress.WORKING
            assert worker.status.position == position
        server.api.post("hypotheses/cancel", {})
        assert worker.status.progress is Progress.CANCELLED
        with pytest.raises(ValueError, match="no hypotheses yet"):
            server.api.get("hypotheses/found", {})


@pytest.mark.thorough
def test_a_frame_without_the_patient_says_why_there_are_none(tmp_path: Path) -> None:
    """The small recording's paper figure is nobody whom a body fits."""
    with viewer_of(*write_small_session(tmp_path)) as server:
        server.api.post("hypotheses/start", {"position": 4})
        assert finished(server.api.worker) is Progress.FAILED
        assert server.api.worker.status.messages
