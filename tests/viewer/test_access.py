"""The viewer by keyboard alone, and on other screens."""

from typing import Any

import pytest
from viewer_page import nameless

pytestmark = pytest.mark.thorough

pytest_plugins = ("viewer_fixtures",)


def test_everything_is_reached_by_tab_and_has_a_name(viewer: Any) -> None:
    seen = list[str]()
    viewer.evaluate("document.activeElement.blur()")
    for _ in range(60):
        viewer.keyboard.press("Tab")
        seen.append(
            viewer.evaluate(
                "() => { const e = document.activeElement, own = e.id || e.textContent.trim();"
                " return own || e.parentElement.textContent.trim(); }"
            )
        )
    for name in ("scene", "help-button", "tab-curves", "scrub", "play", "speed", "span", "worst-next", "forward"):
        assert name in seen
    assert any("learnt body" in name for name in seen)
    assert nameless(viewer) == []


@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1024, 768), (820, 1180)])
def test_nothing_is_cut_off_on_a_laptop_and_a_tablet(viewer: Any, width: int, height: int) -> None:
    viewer.set_viewport_size({"width": width, "height": height})
    viewer.wait_for_timeout(100)
    assert viewer.evaluate("document.documentElement.scrollWidth") <= width
    for name in ("#scene", "#play", "#scrub", "#timeline", "#tab-correct", "#help-button"):
        box = viewer.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width + 1
    assert viewer.locator("#scene").bounding_box()["height"] > 0.3 * height
