"""A calibration as people and ``track --calibration`` read it: calibration.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose import __version__
from anchorpose.calibration.calibration import Calibration
from anchorpose.recording.recording_file import CALIBRATION_FILE, CALIBRATION_FORMAT
from anchorpose.results.folder import FolderKind

CALIBRATION: Final = FolderKind((CALIBRATION_FILE,), (CALIBRATION_FILE, "*.png"))


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


def calibration_rows(calibration: Calibration) -> list[tuple[str, ...]]:
    """One row of texts per camera: name, method, sigma in mm and degrees, rms of surface (mm) and outline (px)."""
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
