"""Draw ``docs/figures/overview.png``, the README's picture: python tools/draw_overview.py [OUT].

A simulated clinic is recorded and tracked; the picture has the front camera's depth as it was recorded, and what the
tracker made of it in the front and in the left camera.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np

from anchorpose.pipeline import track_recording
from anchorpose.simulate.config import clinic
from anchorpose.simulate.write import simulate_recording
from anchorpose.tracker.config import TrackConfig

SEED, SECONDS = 5, 3.0
FRAME = 27  # of the report's pictures the nearest to it: both therapists are there, one beside the knee
ROWS, COLUMNS = (0.12, 0.92), (0.26, 0.80)  # shares of a picture: the people, not the room
PANEL_HEIGHT = 430


def shade(depth: np.ndarray) -> np.ndarray:
    """A 16-bit depth picture as grey, near is light, no reading is black."""
    seen = depth > 0
    near, far = np.percentile(depth[seen], [1, 99])
    grey = np.where(seen, 235.0 - 190.0 * np.clip((depth - near) / (far - near), 0.0, 1.0), 0.0)
    return cv2.cvtColor(grey.astype(np.uint8), cv2.COLOR_GRAY2BGR)


def panel(picture: np.ndarray) -> np.ndarray:
    """The middle of a picture at the panels' height."""
    (top, bottom), (left, right) = (
        (round(share * size) for share in shares)
        for shares, size in zip((ROWS, COLUMNS), picture.shape[:2], strict=True)
    )
    scale = PANEL_HEIGHT / (bottom - top)
    size = round(scale * (right - left)), PANEL_HEIGHT
    return cv2.resize(picture[top:bottom, left:right], size, interpolation=cv2.INTER_AREA)


def draw(folder: Path) -> np.ndarray:
    """Simulate, track and put the three panels side by side."""
    simulated, results = folder / "simulated", folder / "results"
    simulate_recording(simulated, clinic(SEED, SECONDS))
    results.mkdir()
    track_recording(simulated / "recording", results, TrackConfig(), lambda done, total: None)
    kept = (results / "pictures").glob("*_front.png")
    frame = min((path.name.removesuffix("_front.png") for path in kept), key=lambda name: abs(int(name) - FRAME))
    front = results / "pictures" / f"{frame}_front.png"
    depth = cv2.imread(str(simulated / "recording" / "front" / "depth" / f"{frame}.png"), cv2.IMREAD_UNCHANGED)
    drawn = [cv2.imread(str(front.with_name(f"{frame}_{camera}.png"))) for camera in ("front", "left")]
    gap = np.full((PANEL_HEIGHT, 6, 3), 255, np.uint8)
    return np.hstack([panel(shade(depth)), gap, panel(drawn[0]), gap, panel(drawn[1])])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(__file__).resolve().parents[1] / "docs" / "figures" / "overview.png"
    parser.add_argument("out", type=Path, nargs="?", default=default)
    out = parser.parse_args().out
    with TemporaryDirectory() as folder:
        picture = draw(Path(folder))
    out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(out), picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])


if __name__ == "__main__":
    main()
