"""Depth images that are measurements of a room, and such as no sensor that works delivers; recordings of them."""

from pathlib import Path

import numpy as np
from recording_builder import edit_json, write_picture, write_recording

ROWS, COLUMNS = 120, 160
RNG = np.random.default_rng(8)


def room(sigma_per_m: float = 0.002) -> np.ndarray:
    """A wall, a floor that slants towards the camera, and a box before them, in millimetres."""
    row = np.repeat(np.arange(ROWS)[:, None], COLUMNS, axis=1)
    depth_m = np.minimum(4.0, 60.0 / np.maximum(row - 40, 1))
    depth_m[30:90, 60:90] = 2.0
    return (1000 * (depth_m + RNG.normal(0.0, sigma_per_m * depth_m**2))).astype(np.uint16)


def noise(low: int = 0, high: int = 65536) -> np.ndarray:
    return RNG.integers(low, high, (ROWS, COLUMNS)).astype(np.uint16)


def scattered(share: float) -> np.ndarray:
    return np.where(RNG.random((ROWS, COLUMNS)) < share, room(), 0).astype(np.uint16)


BAD = {
    "saturated": (np.full((ROWS, COLUMNS), 65535, np.uint16), "saturated"),
    "beyond every room": (np.full((ROWS, COLUMNS), 40_000, np.uint16), "saturated"),
    "empty": (np.zeros((ROWS, COLUMNS), np.uint16), "no readings"),
    "single readings": (scattered(0.02), "no readings"),
    "clipped": (np.minimum(room(), 500), "same value"),
    "noise over all values": (noise(), "noise"),
    "noise over a room": (noise(500, 8000), "noise"),
    "every second reading": (scattered(0.4), "noise"),
    "noise in half of the image": (np.where(np.arange(COLUMNS) < COLUMNS // 2, noise(500, 8000), room()), "noise"),
}


def large_recording(folder: Path, cameras: tuple[str, ...] = ("front", "left"), frames: int = 6) -> Path:
    write_recording(folder, frames=frames, cameras=cameras)
    edit_json(folder / "recording.json", lambda d: [c.update(width=COLUMNS, height=ROWS) for c in d["cameras"]])
    for name in cameras:
        write_picture(folder / name / "background.png", room())
        for frame in range(frames):
            write_picture(folder / name / "depth" / f"{frame:06d}.png", room())
    return folder
