"""Whether the cameras' poses are known, and agree with the floor and with each other."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.calibration.calibration import FloorResidual, PoseSource
from anchorpose.calibration.world import WORST_FLOOR_TILT_RAD
from anchorpose.check.agreement import check_agreement
from anchorpose.check.finding import Finding, Level, OfCamera, level_of, of_cameras
from anchorpose.check.material import Material

SOURCES: Final = {PoseSource.FLOOR: "not given; found from floor and patient"}
TILTED_RAD: Final = 0.035  # two degrees: a metre away a foot is 3.5 cm off the floor
UNEVEN_M: Final = 0.02  # floors are flat to that; cameras that smooth make waves


def check_poses(material: Material) -> list[Finding]:
    """Where poses come from, the floor, and whether two cameras show one room."""
    if material.settled is None:
        assert material.refusal is not None
        return [Finding("camera poses", Level.RED, material.refusal.problem, material.refusal.remedy)]
    calibration = material.settled.calibration
    poses = [
        OfCamera(pose.camera, Level.GREEN, SOURCES.get(pose.source, str(pose.source))) for pose in calibration.poses
    ]
    agree = check_agreement(material.scenes, material.samples)
    return [of_cameras("camera poses", poses), _floor(material), *agree]


def _floor(material: Material) -> Finding:
    """How even the floor is, and how upright the world stands on it."""
    assert material.settled is not None
    calibration = material.settled.calibration
    if not calibration.residuals:
        remedy = "tilt a camera so that a metre of floor before the patient is in view: the floor gives the vertical"
        return Finding("floor", Level.YELLOW, "no camera sees it", remedy)
    return of_cameras("floor", [_one_floor(floor) for floor in calibration.residuals])


def _one_floor(floor: FloorResidual) -> OfCamera:
    tilted = level_of(floor.tilt_rad, TILTED_RAD, WORST_FLOOR_TILT_RAD)
    uneven = level_of(floor.residual_m, UNEVEN_M, np.inf)
    measured, remedies = f"seen, even to {1000 * floor.residual_m:.0f} mm", list[str]()
    if tilted > Level.GREEN:
        measured += f", {np.degrees(floor.tilt_rad):.1f} degrees off the given pose"
        remedies.append("correct camera_to_world and the lens, or set camera_to_world to null to have it found")
    if uneven > Level.GREEN:
        remedies.append("switch the camera's smoothing off")
    return OfCamera(floor.camera, max(tilted, uneven), measured, "; ".join(remedies))
