"""How smoothly ``anchorpose view`` plays in this machine's Chromium, and what a frame costs the server.

    python benchmarks/viewer.py RESULTS RECORDING

Plays the whole recording with different layers, at recorded speed and twice as fast, and prints drawings per second,
complete frames shown per second, and the frames per second of the recording. Needs the extra ``dev`` and a Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from anchorpose.viewer.payloads import points_payload, surface_payload
from anchorpose.viewer.review import open_review

PLAY = """
(speed) => new Promise((done) => {
  const { playback, view, frames } = window.anchorpose, complete = new Set();
  const began = performance.now(), before = view.drawn;
  let turns = 0;
  playback.setSpeed(speed);
  playback.play(1);
  const look = () => {
    turns += 1;
    if (!frames.missing) complete.add(playback.position);
    if (playback.playing) return requestAnimationFrame(look);
    const seconds = (performance.now() - began) / 1000;
    return done([turns / seconds, complete.size / seconds, playback.times.length / seconds]);
  };
  requestAnimationFrame(look);
})"""

RUNS = (
    ("skeleton, anchors, points, equipment: first time", "", 1),
    ("the same again", "", 1),
    ("the same, twice as fast", "", 2),
    ("with body, surface and room: first time", "bfr", 1),
    ("the same again", "", 1),
    ("the same, twice as fast", "", 2),
)


def server_ms(results: Path, recording: Path) -> tuple[float, float]:
    """Time of one core a frame: points, surface."""
    depth_frames = open_review(results, recording).depth_frames
    assert depth_frames is not None
    surface_payload(depth_frames, 0, 1)  # compiles
    costs = []
    for make in (lambda k: points_payload(depth_frames, k, 8, False), lambda k: surface_payload(depth_frames, k, 8)):
        began = time.process_time()
        for first in (0, 8, 16):
            make(first)
        costs.append(1000.0 * (time.process_time() - began) / 24)
    return costs[0], costs[1]


def play_all(page: Any, address: str) -> None:
    """One line a run."""
    page.goto(address)
    page.wait_for_selector("html[data-ready]", timeout=60_000)
    for name, keys, speed in RUNS:
        page.evaluate("anchorpose.playback.seek(0)")
        for key in keys:
            page.keyboard.press(key)
        page.wait_for_timeout(200)
        while page.evaluate("anchorpose.frames.missing"):
            page.wait_for_timeout(50)
        drawn, complete, recorded = page.evaluate(PLAY, speed)
        print(f"{name:52s} {drawn:5.1f} drawings/s, {complete:5.1f} of {recorded:5.1f} frames/s")


def main(results: Path, recording: Path) -> None:
    """Prints the table."""
    points_ms, surface_ms = server_ms(results, recording)
    print(f"server, one core: points {points_ms:.1f} ms a frame, surface {surface_ms:.1f} ms a frame")
    verb = "import sys\nfrom anchorpose.cli import main\nif __name__ == '__main__': sys.exit(main(sys.argv[1:]))"
    viewer = subprocess.Popen(
        [sys.executable, "-c", verb, "view", str(results), str(recording), "--no-browser"],
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        assert viewer.stdout is not None
        address = viewer.stdout.readline().split()[-1]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(
                executable_path=shutil.which("chromium"), args=["--no-sandbox", "--enable-unsafe-swiftshader"]
            )
            play_all(browser.new_page(viewport={"width": 1280, "height": 800}), address)
            browser.close()
    finally:
        viewer.terminate()
        viewer.wait()


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
