"""Draw the pictures of report, comparison and viewer in ``docs/figures``: python tools/draw_gallery.py [OUT].

Two simulated sessions of one patient in a clinic are tracked, and opened in this machine's Chromium. Needs the extra
``dev``.
"""

from __future__ import annotations

import argparse
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import sync_playwright

from anchorpose.pipeline import track_recording
from anchorpose.report.comparison import write_comparison
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig
from anchorpose.viewer.server import open_viewer

SEED, SECONDS = 5, 12.0
WEBP_QUALITY = 82
SHOWN_S = 4.0  # what the viewer shows: a therapist crouches beside the knee


def track_session(folder: Path, seconds: float) -> Path:
    """A session of the same patient; a longer one shows more of the training."""
    simulate_recording(folder / "simulated", clinic(SEED, seconds))
    (folder / "results").mkdir()
    track_recording(folder / "simulated/recording", folder / "results", TrackConfig(), lambda done, total: None)
    return folder / "results"


@contextmanager
def browser() -> Iterator[Any]:
    """The machine's Chromium."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(
            executable_path=program, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        yield opened
        opened.close()


def shoot(page: Any, out: Path) -> None:
    """What the page shows, as WebP."""
    picture = cv2.imdecode(np.frombuffer(page.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    cv2.imwrite(str(out), picture, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])


def draw_page(opened: Any, file: Path, out: Path, width: int, height: int, scheme: str) -> None:
    """The top of a page."""
    page = opened.new_page(viewport={"width": width, "height": height}, color_scheme=scheme, device_scale_factor=1.5)
    page.goto(file.resolve().as_uri())
    page.wait_for_timeout(500)
    shoot(page, out)
    page.close()


def draw_viewer(opened: Any, results: Path, recording: Path, out: Path) -> None:
    """The viewer with all cameras' points, the body and the curves."""
    with open_viewer(results, recording, None, "", "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = opened.new_page(viewport={"width": 1440, "height": 860})
        page.goto(server.address)
        page.wait_for_selector("html[data-ready]", timeout=60_000)
        page.evaluate("(s) => anchorpose.playback.seek(anchorpose.playback.times.findIndex((t) => t >= s))", SHOWN_S)
        while page.evaluate("anchorpose.frames.missing"):
            page.wait_for_timeout(100)
        page.wait_for_timeout(1000)
        shoot(page, out)
        page.close()
        server.shutdown()


def draw_all(folder: Path, out: Path) -> None:
    """Every picture of the gallery that shows a page."""
    first, later = track_session(folder / "march", 8.0), track_session(folder / "april", SECONDS)
    write_comparison([first, later], folder / "comparison.html", ["March", "April"])
    with browser() as opened:
        draw_page(opened, later / "report.html", out / "report.webp", 1200, 1500, "light")
        draw_page(opened, later / "report.html", out / "report-phone.webp", 390, 844, "dark")
        draw_page(opened, folder / "comparison.html", out / "comparison.webp", 1200, 1100, "light")
        draw_viewer(opened, later, folder / "april/simulated/recording", out / "viewer.webp")


def main() -> None:
    """Writes the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[1] / "docs" / "figures"
    parser.add_argument("out", type=Path, nargs="?", default=default)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory() as folder:
        draw_all(Path(folder), out)


if __name__ == "__main__":
    main()
