"""recording.json and equipment.json of a simulated clinic."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from anchorpose.camera import Camera
from anchorpose.recording.equipment_file import write_equipment
from anchorpose.simulate.clinic import Clinic

EQUIPMENT_FILE = "equipment.json"


def write_documents(recording: Path, clinic: Clinic) -> None:
    """Both files, the second only where there is equipment."""
    equipment = clinic.equipment
    document = {
        "format": "rgbd-recording",
        "version": 1,
        "cameras": [_camera_entry(camera, clinic.config.pose_known) for camera in clinic.cameras],
        "equipment": None if equipment is None else EQUIPMENT_FILE,
    }
    _write_json(recording / "recording.json", document)
    if equipment is not None:
        write_equipment(recording / EQUIPMENT_FILE, equipment)


def _camera_entry(camera: Camera, pose_known: bool) -> dict[str, Any]:
    lens = camera.intrinsics
    return {
        "name": camera.name,
        "width": camera.width,
        "height": camera.height,
        "depth_scale": camera.depth_scale,
        "intrinsics": {
            "fx": lens.fx,
            "fy": lens.fy,
            "cx": lens.cx,
            "cy": lens.cy,
            "distortion": list(lens.distortion),
        },
        "camera_to_world": camera.require_pose().tolist() if pose_known else None,
    }


def _write_json(path: Path, document: dict[str, Any]) -> None:
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
