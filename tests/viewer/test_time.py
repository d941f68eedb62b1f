"""The viewer plays, scrubs and jumps, and its curves keep in step."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_builder import edit_json
from viewer_builder import FRAMES, LOST_FRAME, PERIOD_S, UNSURE_FRAME, viewer_of, write_small_session
from viewer_page import opened, position, scene_picture, until

pytestmark = pytest.mark.thorough

pytest_plugins = ("viewer_fixtures",)


def test_it_plays_at_recorded_speed_and_stops_at_the_end(viewer: Any) -> None:
    viewer.select_option("#speed", "0.5")
    viewer.locator("#scene").focus()
    viewer.keyboard.press("Space")
    began = viewer.evaluate("[performance.now(), anchorpose.motion.time_s[anchorpose.playback.position]]")
    viewer.wait_for_timeout(1500)
    now = viewer.evaluate("[performance.now(), anchorpose.motion.time_s[anchorpose.playback.position]]")
    passed = (now[0] - began[0]) / 1000.0
    assert now[1] - began[1] == pytest.approx(0.5 * passed, abs=0.12)
    assert viewer.locator("#play").get_attribute("aria-label") == "Pause"
    viewer.keyboard.press("l")  # faster
    assert viewer.locator("#speed").input_value() == "1"
    until(viewer, lambda: position(viewer) == FRAMES - 1)
    assert viewer.locator("#play").get_attribute("aria-label") == "Play"


def test_every_frame_can_be_reached_by_keyboard(viewer: Any) -> None:
    steps = [
        ("ArrowRight", 1),
        ("ArrowRight", 2),
        ("ArrowLeft", 1),
        ("Shift+ArrowRight", 11),
        ("End", FRAMES - 1),
        ("Shift+ArrowLeft", FRAMES - 11),
        ("Home", 0),
        ("ArrowLeft", 0),
    ]
    for key, expected in steps:
        viewer.keyboard.press(key)
        assert position(viewer) == expected
    viewer.keyboard.press("End")
    viewer.keyboard.press("j")
    until(viewer, lambda: position(viewer) < FRAMES - 3)
    viewer.keyboard.press("k")
    assert not viewer.evaluate("anchorpose.playback.playing")
    assert "frame" in viewer.locator("#scrub").get_attribute("aria-valuetext")


def test_scrubbing_moves_everything_in_step(viewer: Any) -> None:
    viewer.locator("#scrub").fill("22")
    assert position(viewer) == 22
    assert f"{22 * PERIOD_S:.2f} of" in viewer.locator("#clock").inner_text()
    before = viewer.locator("#charts .cursor").evaluate("e => e.style.transform")
    viewer.locator("#scrub").fill("40")
    assert viewer.locator("#charts .cursor").evaluate("e => e.style.transform") != before
    knee = viewer.evaluate("anchorpose.rows.at(40).angles[anchorpose.description.angles.indexOf('knee_flexion_left')]")
    shown = viewer.locator(".chart", has_text="knee flexion").inner_text()
    assert f"left {knee:.0f}°" in shown


@pytest.mark.parametrize(
    ("more", "stated", "first_s"),
    [
        ({"recorded": {"first_s": -300.0, "end_s": 9.0}, "config": {"start": 4500}}, "the first frame", -300.0),
        ({"config": {"start": 4500}}, "the first tracked frame", 0.0),  # results of an older release
        ({"recorded": {"first_s": None, "end_s": 9.0}}, "the first tracked frame", 0.0),  # a dead first camera
        ({"recorded": None}, "the first frame", 0.0),
    ],
)
def test_clock_lists_and_ticks_count_from_the_same_frame(
    page: Any, tmp_path: Path, more: dict[str, Any], stated: str, first_s: float
) -> None:
    results, _ = write_small_session(tmp_path)
    edit_json(results / "run.json", lambda run: run.update(more))
    with viewer_of(results) as server:
        server.api.corrections.add(
            {"first_frame": LOST_FRAME, "last_frame": LOST_FRAME, "reason": "a curtain", "who": "AB"}
        )
        page.add_init_script(TICKS)
        opened(page, server)
        page.keyboard.press("w")
        time = f"{LOST_FRAME * PERIOD_S - first_s:.2f}"
        assert page.locator("#clock").inner_text().startswith(f"{time} of {(FRAMES - 1) * PERIOD_S - first_s:.2f} s")
        assert page.locator("#worst [aria-current=true] time").inner_text() == f"{time} s"
        page.click("#tab-correct")
        assert page.locator("#corrections").inner_text().startswith(f"{time} s unusable to {time} s")
        assert f"{1 - first_s:.0f} s" in page.evaluate("ticks")
        assert page.locator("#time-origin").inner_text() == f"Times: seconds since {stated} of the recording."


TICKS = (  # keeps the words that are drawn on canvases
    "const fill = CanvasRenderingContext2D.prototype.fillText; window.ticks = [];"
    " CanvasRenderingContext2D.prototype.fillText = function (text, ...place)"
    " { window.ticks.push(String(text)); return fill.call(this, text, ...place); };"
)


def test_a_click_on_a_curve_or_the_timeline_goes_there(viewer: Any) -> None:
    for name in (".chart canvas", "#timeline"):
        viewer.keyboard.press("Home")
        canvas = viewer.locator(name).first
        box, left = canvas.bounding_box(), 34 if name != "#timeline" else 136
        canvas.click(position={"x": left + 0.75 * (box["width"] - left), "y": 20})
        assert position(viewer) == pytest.approx(0.75 * (FRAMES - 1), abs=1)


def test_a_lost_angle_and_an_angle_without_a_value_in_this_pose_are_told_apart(viewer: Any) -> None:
    plane = viewer.locator(".chart", has_text="shoulder plane")
    assert plane.inner_text().count("no value") == 2  # the arms hang
    viewer.locator("#scrub").fill(str(LOST_FRAME))
    assert "left lost" in plane.inner_text()
    assert "no value" not in plane.inner_text()


def test_lines_bands_and_strips_end_where_a_curve_is_broken(viewer: Any) -> None:
    """Six points: an inferred one in the middle, a break after the third, all drawn on a context that keeps places."""
    drawn = viewer.evaluate(
        "() => { const points = { row: [0, 10, 20, 30, 40, 50], degrees: [1, 1, 1, 1, 1, 1],"
        " sigma: [1, 1, 1, 1, 1, 1], state: [0, 0, 2, 0, 0, 0], broken: [0, 0, 0, 1, 0, 0] };"
        " const found = { lines: [], strips: [] };"
        " const context = { beginPath() { found.lines.push([]); }, lineTo(x) { found.lines.at(-1).push(x); },"
        " stroke() {}, fill() {}, fillRect(x, y, width) { found.strips.push([x, width]); } };"
        " const same = (value) => value, { curves } = anchorpose;"
        " curves.line(context, points, same, same, true); curves.line(context, points, same, same, false);"
        " curves.band(context, points, same, same); curves.inferredStrip(context, points, same, 0); return found; }"
    )
    assert drawn["lines"] == [[0, 10], [30, 40, 50], [10, 20], [0, 10, 20, 20, 10, 0], [30, 40, 50, 50, 40, 30]]
    assert drawn["strips"] == [[20, 1.5]]  # a dot


def test_the_worst_frame_comes_first_and_w_goes_on(viewer: Any) -> None:
    viewer.keyboard.press("w")
    assert position(viewer) == LOST_FRAME
    assert viewer.locator("#worst [aria-current=true]").inner_text().endswith("all joints lost")
    viewer.locator("#worst button", has_text="HandRight").click()
    assert position(viewer) == UNSURE_FRAME
    assert "HandRight" in viewer.locator("#joint-card").inner_text()
    assert "200 mm" in viewer.locator("#joint-card").inner_text()
    viewer.keyboard.press("Shift+W")
    assert position(viewer) != UNSURE_FRAME


def test_without_a_recording_skeleton_body_and_curves_are_there(page: Any, small: tuple[Path, Path]) -> None:
    with viewer_of(small[0]) as server:
        opened(page, server)
        assert "No recording was given" in page.locator("#notice").inner_text()
        assert page.locator("#hypotheses-start").is_disabled()
        with_body = scene_picture(page)
        page.keyboard.press("b")
        assert (np.abs(scene_picture(page) - with_body).sum(axis=2) > 30).sum() > 2000
        page.keyboard.press("ArrowRight")
        assert position(page) == 1
