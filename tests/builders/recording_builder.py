"""Small recordings made on disk for the tests of what reads them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

WIDTH, HEIGHT, PERIOD_S = 32, 24, 0.1

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


BOX = {"name": "bar", "shape": "box", "center": [0.3, 0.5, 0], "size": [0.05, 0.1, 0.6]}
BOX |= {"rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}
POST = {"name": "post", "shape": "cylinder", "center": [0, 0.5, 0.4], "radius": 0.03, "length": 1, "axis": [0, 2, 0]}


def camera_entry(name: str) -> dict[str, Any]:
    intrinsics = {"fx": 30.0, "fy": 31.0, "cx": 15.5, "cy": 11.5, "distortion": [0, 0, 0, 0, 0]}
    pose = [[0, 0, -1, 2.5], [0, -1, 0, 1.2], [-1, 0, 0, 0.1], [0, 0, 0, 1]]
    size = {"width": WIDTH, "height": HEIGHT, "depth_scale": 0.001}
    return {"name": name, **size, "intrinsics": intrinsics, "camera_to_world": pose}


def depth_grey(frame: int) -> np.ndarray:
    grey = np.full((HEIGHT, WIDTH), 2000 + frame, np.uint16)
    grey[:2] = 0
    return grey


def write_picture(path: Path, grey: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    _, encoded = cv2.imencode(".png", grey)
    path.write_bytes(encoded.tobytes())


def write_timestamps(folder: Path, rows: list[tuple[int, float]]) -> None:
    lines = ["frame,time_s", *(f"{frame},{time_s:.6f}" for frame, time_s in rows)]
    (folder / "timestamps.csv").write_text("\n".join(lines) + "\n")


def write_recording(folder: Path, frames: int = 4, cameras: tuple[str, ...] = ("front",)) -> Path:
    """A recording folder of flat walls with an equipment model and a background a camera."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in cameras:
        for frame in range(frames):
            write_picture(folder / name / "depth" / f"{frame:06d}.png", depth_grey(frame))
        write_picture(folder / name / "background.png", depth_grey(0))
        write_timestamps(folder / name, [(frame, frame * PERIOD_S) for frame in range(frames)])
    document = {
        "format": "rgbd-recording",
        "version": 1,
        "cameras": [camera_entry(name) for name in cameras],
        "equipment": "equipment.json",
        "subject": {"height_m": 1.72},
    }
    (folder / "recording.json").write_text(json.dumps(document))
    equipment = {"format": "equipment-model", "version": 1, "parts": [BOX, POST]}
    (folder / "equipment.json").write_text(json.dumps(equipment))
    return folder


def edit_json(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
