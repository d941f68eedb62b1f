"""A calibration as people and ``track --calibration`` read it: calibration.json and a picture a camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from anchorpose import __version__
from anchorpose.calibration.calibration import Calibration
from anchorpose.calibration.equipment_pose_render import EquipmentCaster
from anchorpose.camera import Camera, invert_rigid
from anchorpose.recording.calibration_file import CALIBRATION_FILE, CALIBRATION_FORMAT
from anchorpose.results.overlay import draw_axes, encode, enlarge, shade

CALIBRATION_MARKS: Final = (CALIBRATION_FILE,)
_OUTLINE: Final = (0, 159, 230)  # Okabe and Ito's orange: the equipment's colour in every picture


def write_calibration(folder: Path, recording: str, calibration: Calibration) -> None:
    """``folder``/calibration.json; sigma is null where a pose was given or its accuracy is not known."""
    document = {
        "format": CALIBRATION_FORMAT,
        "version": 1,
        "versions": {"anchorpose": __version__},
        "recording": recording,
        "cameras": [
            {
                "name": camera.name,
                "camera_to_world": camera.require_pose().tolist(),
                "method": pose.source.value,
                "sigma_m": pose.sigma_m,
                "sigma_deg": None if pose.sigma_rad is None else float(np.degrees(pose.sigma_rad)),
                "residuals": [{"what": f.what, "value": float(f.value), "unit": f.unit} for f in pose.figures],
            }
            for camera, pose in zip(calibration.cameras, calibration.poses, strict=True)
        ],
        "floor_height_m": calibration.floor_height_m,
        "notes": list(calibration.notes),
    }
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / CALIBRATION_FILE).write_text(text + "\n", encoding="utf-8")


def draw_calibration(camera: Camera, depth_m: np.ndarray, caster: EquipmentCaster | None) -> bytes:
    """PNG of a depth picture (height, width) with every part's outline where the pose puts it, and the world's axes."""
    picture, scale = enlarge(shade(depth_m, None), camera)
    rendering = None if caster is None else caster.render(camera, invert_rigid(camera.require_pose()))
    if rendering is not None:
        part = np.full(depth_m.shape, -1)
        part[rendering.window] = rendering.part
        for number in np.unique(part[part >= 0]):
            mask = cv2.resize(
                (part == number).astype(np.uint8), None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR
            )
            contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(picture, contours, -1, _OUTLINE, 1, cv2.LINE_AA)
    draw_axes(picture, camera, scale)
    return encode(picture)


def calibration_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """One row of texts a camera: name, method, sigma in mm, sigma in degrees, rms of surface (mm) and outline (px)."""
    rows: list[tuple[str, ...]] = []
    for pose in calibration.poses:
        figures: dict[str, Any] = {figure.unit: figure.value for figure in reversed(pose.figures)}
        rows.append(
            (
                pose.camera,
                pose.source.value,
                "–" if pose.sigma_m is None else f"{1000 * pose.sigma_m:.1f}",
                "–" if pose.sigma_rad is None else f"{np.degrees(pose.sigma_rad):.2f}",
                f"{1000 * figures['m']:.1f}" if "m" in figures else "–",
                f"{figures['px']:.2f}" if "px" in figures else "–",
            )
        )
    return rows
