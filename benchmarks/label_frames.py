"""Draw frames of MSR Action3D at random and render them for labelling: python benchmarks/label_frames.py DATA OUT.

DATA holds the sequences, ``aAA_sSS_eEE``. Twelve sequences of each subject are drawn with a fixed seed, and of each a
frame between a sixth and five sixths of its length. OUT gets a picture ``SEQUENCE_FRAME.png`` for each: the left half
is shaded grey, the right half coloured by distance, red near, blue far; grid lines every 10 pixels of the depth image,
with numbers every 20. The same data gives the same frames: ``labels/README.md`` says what was labelled in them.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import cv2
import numpy as np

from anchorpose.recording.reader import open_recording, read_frame
from anchorpose.recording.recording import Recording

SEED: Final = 2611
PER_SUBJECT: Final = 12
SCALE: Final = 6
ROUND_PX: Final = 8  # of the background around the person
LEFT_PX, TOP_PX, REST_PX = 40, 30, 10  # margins of a picture, for the numbers
LIGHT: Final = np.array([-0.4, -0.5, -0.77])
DARK: Final = 40

Box = tuple[int, int, int, int]
"""First and last-but-one column and row of what a picture shows."""


def draw_frames(data: Path) -> list[tuple[str, int]]:
    """Sequence and frame number of what is to be labelled."""
    sequences = sorted(folder.parent.name for folder in data.glob("a*_s*_e*/recording.json"))
    rng, drawn = np.random.default_rng(SEED), list[tuple[str, int]]()
    for subject in sorted({_subject(name) for name in sequences}):
        own = [name for name in sequences if _subject(name) == subject]
        for index in rng.permutation(len(own))[:PER_SUBJECT]:
            frames = open_recording(data / own[index]).streams[0].frame
            sixth = len(frames) // 6
            drawn.append((own[index], int(frames[rng.integers(sixth, len(frames) - sixth)])))
    return drawn


def _subject(sequence: str) -> str:
    return sequence.split("_")[1]


def depth_of(recording: Recording, frame: int) -> np.ndarray:
    """Depth image of a frame of the first camera, metres."""
    depth = read_frame(recording, int(np.flatnonzero(recording.streams[0].frame == frame)[0])).depths_m[0]
    assert depth is not None, (recording.folder, frame)
    return depth


def render(depth_m: np.ndarray, focal_px: float) -> tuple[np.ndarray, Box]:
    """The two halves as one picture, and what it shows of the depth image."""
    seen, box = depth_m > 0, _box(depth_m > 0)
    light = _shade(depth_m, focal_px)
    low, high = np.percentile(depth_m[seen], [2, 98])
    near = 1.0 - np.clip((depth_m - low) / max(high - low, 1e-3), 0.0, 1.0)
    colour = cv2.applyColorMap((255 * near).astype(np.uint8), cv2.COLORMAP_TURBO) * (0.35 + 0.65 * light)[..., None]
    grey = (60 + 195 * light)[..., None] * np.ones(3)
    halves = [np.where(seen[..., None], half, DARK).astype(np.uint8) for half in (grey, colour)]
    return np.hstack([_with_grid(half, box) for half in halves]), box


def in_picture(place: Iterable[float], box: Box) -> tuple[int, int]:
    """Where a column and row of the depth image lie in the left half."""
    column, row = place
    return round(LEFT_PX + (column + 0.5 - box[0]) * SCALE), round(TOP_PX + (row + 0.5 - box[2]) * SCALE)


def _box(seen: np.ndarray) -> Box:
    rows, columns = np.where(seen)
    left, top = max(columns.min() - ROUND_PX, 0), max(rows.min() - ROUND_PX, 0)
    right, bottom = min(columns.max() + ROUND_PX, seen.shape[1]), min(rows.max() + ROUND_PX, seen.shape[0])
    return int(left), int(right), int(top), int(bottom)


def _shade(depth_m: np.ndarray, focal_px: float) -> np.ndarray:
    """Brightness 0 to 1 by the direction of a smoothed surface."""
    seen = (depth_m > 0).astype(np.float32)
    blurred = cv2.GaussianBlur(depth_m.astype(np.float32), (0, 0), 1.2)
    smooth = blurred / np.maximum(cv2.GaussianBlur(seen, (0, 0), 1.2), 1e-6)
    right, down = (cv2.Sobel(smooth, cv2.CV_32F, *way) / 8 for way in ((1, 0), (0, 1)))
    pixel_m = np.median(depth_m[depth_m > 0]) / focal_px
    normal = np.dstack([-right, -down, np.full_like(right, -pixel_m)])
    return np.clip(normal / np.linalg.norm(normal, axis=2, keepdims=True) @ LIGHT, 0.0, 1.0)


def _with_grid(picture: np.ndarray, box: Box) -> np.ndarray:
    left, right, top, bottom = box
    large = cv2.resize(picture[top:bottom, left:right], None, fx=SCALE, fy=SCALE, interpolation=cv2.INTER_NEAREST)
    large = cv2.copyMakeBorder(large, TOP_PX, REST_PX, LEFT_PX, REST_PX, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    for column in range((left + 9) // 10 * 10, right, 10):
        x = in_picture((column, 0), box)[0]
        _line(large, (x, TOP_PX - 4), (x, large.shape[0] - REST_PX), column)
        if column % 20 == 0:
            cv2.putText(large, str(column), (x - 14, TOP_PX - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    for row in range((top + 9) // 10 * 10, bottom, 10):
        y = in_picture((0, row), box)[1]
        _line(large, (LEFT_PX - 4, y), (large.shape[1] - REST_PX, y), row)
        if row % 20 == 0:
            cv2.putText(large, str(row), (4, y + 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    return large


def _line(picture: np.ndarray, start: tuple[int, int], end: tuple[int, int], number: int) -> None:
    cv2.line(picture, start, end, (255, 255, 255) if number % 50 == 0 else (110, 110, 110), 1)


def main() -> None:
    """Writes the pictures and prints their names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    for sequence, frame in draw_frames(chosen.data):
        recording = open_recording(chosen.data / sequence)
        picture, _ = render(depth_of(recording, frame), recording.cameras[0].intrinsics.fx)
        cv2.imwrite(str(chosen.out / f"{sequence}_{frame:06d}.png"), picture)
        print(f"{sequence} {frame}")


if __name__ == "__main__":
    main()
