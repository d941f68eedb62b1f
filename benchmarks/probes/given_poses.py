"""Measure whether wrong poses of cameras are refused, noted, or not noticed.

Copies of a recording by three cameras with right poses are made wrong: one camera is shifted or turned, two cameras'
folders are exchanged, one camera is upside down, or the equipment is elsewhere than equipment.json states. Each copy is
checked as ``track`` checks it, with all cameras and with the wrong camera alone. noted_mm: measured displacement.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import cv2
import numpy as np
from probe import Row, Scene, answer
from scipy.spatial.transform import Rotation

from anchorpose.calibration.clocks import Clocks, settle_clocks
from anchorpose.errors import InputError
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import align_clocks
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import agreeing_poses
from anchorpose.tracker.preparation import Settled, calibrate, sample_recording, scenes_of

SPOILT: Final = 1  # the camera that is off
BESIDE_M: Final = np.array([0.10, 0.0, 0.08])  # from where equipment.json has the equipment to where it stands
Document = dict[str, Any]
Spoil = Callable[[Path, Document], None]
"""Changes a recording's folder and the document of its recording.json."""


def moved(shift_m: float = 0.0, turn_deg: float = 0.0, axis: str = "up") -> Spoil:
    """Return a function that shifts or turns a camera: about ``up`` is yaw, ``sideways`` pitch, ``towards`` roll."""

    def spoil(folder: Path, document: Document) -> None:
        camera = _camera(document)
        T = np.array(camera["camera_to_world"])
        up, view = np.array([0.0, 1.0, 0.0]), T[:3, 2] * [1.0, 0.0, 1.0]
        view /= np.linalg.norm(view)
        along = {"up": up, "towards": view, "sideways": np.cross(up, view)}[axis]
        T[:3, 3] += shift_m * along
        T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg) * along).as_matrix() @ T[:3, :3]
        camera["camera_to_world"] = T.tolist()

    return spoil


def published(folder: Path, document: Document) -> None:
    """Put every camera 2 cm and 0.7 degrees off, with a focal length 1.5 % wrong, as in published data sets."""
    rng = np.random.default_rng(len(document["cameras"]))
    for camera in document["cameras"]:
        T = np.array(camera["camera_to_world"])
        shift, axis = rng.normal(size=(2, 3))
        T[:3, 3] += 0.02 * shift / np.linalg.norm(shift)
        T[:3, :3] = Rotation.from_rotvec(np.radians(0.7) * axis / np.linalg.norm(axis)).as_matrix() @ T[:3, :3]
        camera["camera_to_world"] = T.tolist()
        for name in ("fx", "fy"):
            camera["intrinsics"][name] *= 1.0 + rng.choice([-0.015, 0.015])


def exchanged(folder: Path, document: Document) -> None:
    """Exchange the folders of the first two cameras."""
    one, other = (folder / camera["name"] for camera in document["cameras"][:2])
    one.rename(folder / "other")
    other.rename(one)
    (folder / "other").rename(other)


def upside_down(folder: Path, document: Document) -> None:
    """Turn the wrong camera's images by 180 degrees, also its image of the empty room."""
    own = folder / _camera(document)["name"]
    for path in [*own.glob("depth/*.png"), *own.glob("background.png")]:
        grey = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), np.ascontiguousarray(grey[::-1, ::-1]))


def equipment_elsewhere(folder: Path, document: Document) -> None:
    """Write another place of the equipment into equipment.json, without changing the images."""
    path = folder / "equipment.json"
    if path.exists():
        equipment = json.loads(path.read_text(encoding="utf-8"))
        for part in equipment["parts"]:
            part["center"] = (np.array(part["center"]) + BESIDE_M).tolist()
        path.write_text(json.dumps(equipment), encoding="utf-8")


def _camera(document: Document) -> Document:
    cameras: list[Document] = document["cameras"]
    return cameras[min(SPOILT, len(cameras) - 1)]


SPOILS: Final[dict[str, Spoil]] = {
    "nothing": moved(),
    "all cameras 2 cm and 0.7 degrees off, focal lengths 1.5 %": published,
    "a camera shifted 2 cm sideways": moved(0.02, axis="sideways"),
    "5 cm sideways": moved(0.05, axis="sideways"),
    "20 cm towards the patient": moved(0.20, axis="towards"),
    "a camera turned by 1 degree, yaw": moved(turn_deg=1.0),
    "5 degrees, yaw": moved(turn_deg=5.0),
    "5 degrees, pitch": moved(turn_deg=5.0, axis="sideways"),
    "5 degrees, roll": moved(turn_deg=5.0, axis="towards"),
    "two cameras' folders exchanged": exchanged,
    "a camera upside down": upside_down,
    "equipment 13 cm from where equipment.json has it": equipment_elsewhere,
}


def spoilt_copy(recording: Path, out: Path, spoil: Spoil, alone: bool = False) -> Path:
    """Write a copy of a recording and make it wrong. alone: copy only the wrong camera."""
    shutil.copytree(recording, out)
    document = json.loads((out / "recording.json").read_text(encoding="utf-8"))
    if alone:
        document["cameras"] = document["cameras"][SPOILT : SPOILT + 1]
    spoil(out, document)
    (out / "recording.json").write_text(json.dumps(document), encoding="utf-8")
    return out


def ask(folder: Path, clocks: Clocks) -> dict[str, float]:
    """Check the poses as ``track`` does before it looks for the patient. clocks: as found with the right poses."""
    config = TrackConfig()
    try:  # images of exchanged cameras may have another size, which is refused when they are read
        recording = open_recording(folder)
        timed = align_clocks(recording, clocks.clocks[: len(recording.cameras)])
        chosen, samples = sample_recording(timed, config)
        calibration = calibrate(timed, samples, config)
        scenes = scenes_of(Settled(timed, clocks, calibration, tuple(chosen), tuple(samples)))
        doubts = agreeing_poses(timed, calibration, clocks, scenes, samples).doubts
    except InputError:
        return {"refused": 1.0, "noted": 0.0, "not_noticed": 0.0}
    off_mm = [1e3 * doubt.off_m for doubt in doubts if np.isfinite(doubt.off_m)]
    noted = {"noted": float(bool(doubts)), "not_noticed": float(not doubts)}
    return {"refused": 0.0, **noted, "noted_mm": max(off_mm, default=float("nan"))}


def measure(scene: Scene) -> Iterator[Row]:
    """Make copies of the recording wrong in every way, and check them."""
    opened = open_recording(scene.recording)
    clocks = settle_clocks(opened, opened.cameras, TrackConfig().clocks)[1]
    for name, spoil in SPOILS.items():
        for alone in (False, True) if spoil is not exchanged else (False,):
            with TemporaryDirectory() as work:
                copy = spoilt_copy(scene.recording, Path(work) / "spoilt", spoil, alone)
                yield f"{name}{', that camera alone' * alone}", ask(copy, clocks)


if __name__ == "__main__":
    answer(measure)
