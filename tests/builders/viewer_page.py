"""The viewer's page in Chromium, for the tests: opened, waited for, looked at."""

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from anchorpose.results.corrections import Corrections, read_corrections
from anchorpose.viewer.server import ViewerServer


def opened(page: Any, server: ViewerServer) -> Any:
    page.goto(server.address)
    page.wait_for_selector("html[data-ready]", timeout=20_000)
    until(page, lambda: page.evaluate("!anchorpose.frames.missing"))
    return page


def until(page: Any, test: Callable[[], Any], seconds: float = 10.0) -> None:
    """Waits for something; the page's policy forbids playwright's own way."""
    end = time.monotonic() + seconds
    while not test():
        assert time.monotonic() < end, "that did not come true in time"
        page.wait_for_timeout(30)


def position(page: Any) -> int:
    return int(page.evaluate("anchorpose.playback.position"))


def nameless(page: Any) -> list[str]:
    """The controls that a screen reader could not name."""
    return page.evaluate(
        "[...document.querySelectorAll('button, input, select, canvas')].filter((e) => !(e.textContent.trim()"
        " || e.getAttribute('aria-label') || e.labels?.length)).map((e) => e.outerHTML)"
    )


def scene_picture(page: Any) -> np.ndarray:
    """(h, w, 3) int RGB of the three-dimensional view, everything over it hidden."""
    for name in ("layers", "presets", "notice", "joint-card"):
        page.evaluate("name => { document.getElementById(name).hidden = true }", name)
    page.wait_for_timeout(150)
    data = page.locator("#scene").screenshot()
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return picture[..., ::-1].astype(int)


def is_bluish(picture: np.ndarray) -> np.ndarray:
    """(h, w) bool: the patient's colour, whichever way the skin faces."""
    red, green, blue = picture[..., 0], picture[..., 1], picture[..., 2]
    return (blue > 40) & (blue > green) & (blue - red > 0.4 * blue)


def bluish(picture: np.ndarray) -> int:
    """Pixels of the patient's colour."""
    return int(is_bluish(picture).sum())


def file_of(server: ViewerServer) -> Corrections:
    return read_corrections(server.api.corrections.path)


def sign(page: Any, reason: str, who: str | None = "AB") -> None:
    page.fill("#sign-reason", reason)
    if who is not None:
        page.fill("#sign-who", who)
    page.press("#sign-reason", "Enter")
    until(page, lambda: page.locator("#status").inner_text() == "Saved.")
