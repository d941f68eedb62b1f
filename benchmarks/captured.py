"""Render the captured surface of a real body (not of a body model) with the simulator's cameras and sensors.

The surface stands in an empty room. Its file has ``vertices_tenth_mm`` (t, v, 3) int16, the same vertices in every
frame, X in the direction that the person faces, Y up; and ``faces`` (f, 3), wound outwards. The file does not state its
frame rate.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from recordings import DATA, Ready, digest_of, simulator_digest, write_once

from anchorpose.recording.recording_file import camera_document
from anchorpose.simulate.clinic import draw_clinic, random_stream
from anchorpose.simulate.config import SimulationConfig
from anchorpose.simulate.render import PATIENT, Figure, draw_figures
from anchorpose.simulate.shoot import Studio, set_up

SURFACE: Final = DATA / "foreign_bodies" / "samba.npz"
SEED: Final = 71000  # of the room, the cameras' places and the sensors' noise
RATE_HZ: Final = 30.0  # assumed, since the file does not state it


@dataclass(frozen=True, slots=True)
class CapturedBody:
    """A recording of the surface by one or three cameras whose poses are given. Its truth is the surface: skin_m
    (t, v, 3), the lowest vertex on the floor, and faces (f, 3)."""

    cameras: int

    @property
    def name(self) -> str:
        """Number of cameras."""
        return f"captured-body-{self.cameras}"

    def ready(self, cache: Path) -> Ready | None:
        """Draw the recording unless the cache holds it; None where the surface is absent."""
        if not SURFACE.is_file():
            return None
        digest = digest_of(simulator_digest(), self.name, str(SURFACE.stat().st_size))
        folder = write_once(cache / "recordings" / f"{self.name}-{digest}", self._draw)
        return Ready(self.name, folder / "recording", folder / "surface.npz", digest)

    def _draw(self, folder: Path) -> None:
        with np.load(SURFACE) as stored:
            skin_m, faces = stored["vertices_tenth_mm"] * np.float32(1e-4), stored["faces"].astype(np.int32)
        middle = skin_m.mean(axis=(0, 1))
        skin_m -= np.float32([middle[0], skin_m[..., 1].min(), middle[2]])
        np.savez(folder / "surface.npz", skin_m=skin_m, faces=faces)
        no_parts, seconds = np.zeros(len(faces), np.uint8), len(skin_m) / RATE_HZ
        empty = SimulationConfig(
            seed=SEED, seconds=seconds, fps=RATE_HZ, cameras=self.cameras, equipment="none", stool=False, therapists=0
        )  # the simulator's own patient is not rendered
        figures = [Figure(frame_m, faces, no_parts, PATIENT) for frame_m in skin_m]
        _record(folder / "recording", set_up(draw_clinic(empty)), figures)


def _record(folder: Path, studio: Studio, figures: list[Figure]) -> None:
    """Write a recording folder, one frame per figure."""
    cameras, config = studio.clinic.cameras, studio.clinic.config
    for index, camera in enumerate(cameras):
        (folder / camera.name / "depth").mkdir(parents=True)
        cv2.imwrite(str(folder / camera.name / "background.png"), studio.background_mm(index))
        stamps = "".join(f"{frame},{frame / RATE_HZ:.6f}\n" for frame in range(len(figures)))
        (folder / camera.name / "timestamps.csv").write_text(f"frame,time_s\n{stamps}", encoding="utf-8")
        for frame, figure in enumerate(figures):
            image = draw_figures(camera, studio.stills[index], (figure,))
            depth_mm = studio.readers[index].raw_mm(random_stream(config, "sensor", index, frame), image)
            cv2.imwrite(str(folder / camera.name / "depth" / f"{frame:06d}.png"), depth_mm)
    document = {"format": "rgbd-recording", "version": 1, "cameras": [camera_document(camera) for camera in cameras]}
    (folder / "recording.json").write_text(json.dumps({**document, "equipment": None}), encoding="utf-8")
