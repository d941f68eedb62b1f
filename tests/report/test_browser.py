"""The report as people use it in Chromium: with a mouse, by keyboard, and over ten minutes."""

import re
from pathlib import Path

import pytest

pytest_plugins = ("report_fixtures",)


def test_the_slider_reads_all_curves_by_keyboard(page, knee, address):
    page.goto(address)
    slider = knee.get_by_role("slider")
    slider.focus()
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    told = knee.locator(".readout").text_content()
    assert told.startswith("0.167 s (frame 5): left ")
    assert re.search(r"left [\d.\u2212]+ ± [\d.]+°, seen; right [\d.\u2212]+ ± [\d.]+°, seen$", told)
    assert slider.get_attribute("aria-valuetext") == told
    assert page.locator("#timeline input").input_value() == "5"
    page.keyboard.press("End")
    assert knee.locator(".readout").text_content().startswith("3.967 s (frame 119)")


def test_the_value_that_is_read_is_that_of_the_csv_link(page, knee, address):
    page.goto(address)
    knee.get_by_role("slider").fill("60")
    with page.expect_download() as download:
        knee.locator("a.csv").click()
    assert download.value.suggested_filename == "angle-knee_flexion.csv"
    head, *lines = Path(download.value.path()).read_text(encoding="utf-8").splitlines()
    cells = dict(zip(head.split(","), lines[60].split(","), strict=True))
    told = knee.locator(".readout").text_content()
    assert f"left {cells['knee_flexion_left_lowest_deg']} ± " in told
    assert "left" in told
    assert "hidden by a person; right" in told


def test_pointing_and_clicking_move_the_cursor_of_all_charts(page, knee, address):
    page.goto(address)
    plots = knee.locator(".plot").first
    plots.scroll_into_view_if_needed()
    box = plots.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert re.match(r"(1\.9|2\.0)\d\d s \(frame (59|60)\)", knee.locator(".readout").text_content())
    cursor = page.locator("#angle-hip_flexion .cursor").first.bounding_box()
    assert cursor["x"] == pytest.approx(box["x"] + box["width"] / 2, abs=box["width"] / 100)
    page.mouse.click(box["x"] + 2, box["y"] + 5)
    assert knee.get_by_role("slider").evaluate("e => e === document.activeElement")


def test_everything_that_can_be_used_is_reached_by_tab_and_shows_it(page, address):
    page.goto(address)
    usable = "a[href], input, summary, [tabindex='0']"
    wanted = page.evaluate(
        f"() => [...document.querySelectorAll({usable!r})].filter(e => e.checkVisibility())"
        ".map((e, i) => e.dataset.n = i).length"
    )
    page.evaluate(
        "() => { window.reached = []; document.addEventListener('focusin', event => window.reached.push("
        "[event.target.dataset.n, getComputedStyle(event.target).outlineStyle])); }"
    )
    for _ in range(wanted):
        page.keyboard.press("Tab")
    reached = page.evaluate("window.reached")
    assert len({number for number, _ in reached} - {None}) == wanted > 50
    assert [number for number, outline in reached if outline == "none"] == []


def test_each_session_of_a_comparison_has_a_clock_of_its_own(page, comparison):
    page.goto(comparison)
    page.locator("#timeline-s1 input").focus()
    page.keyboard.press("End")
    assert page.locator("#timeline-s1 .readout").text_content().startswith("2.967 s (frame 89)")
    assert page.locator("#timeline-s2 input").input_value() == "0"
