"""Whether the cameras' poses are known, and agree with the floor and with each other."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration, DoubtSource, FloorResidual, PoseDoubt, PoseSource
from anchorpose.calibration.world import TILTED_RAD, WORST_FLOOR_TILT_RAD
from anchorpose.check.finding import Finding, Level, OfCamera, level_of, of_cameras
from anchorpose.check.material import Material
from anchorpose.tracker.given_poses import REMEDY, PosesAsked, ask_poses, remedy_of

SOURCES: Final = {PoseSource.FLOOR: "not given; found from floor and patient"}
UNEVEN_M: Final = 0.02  # floors are flat to that; cameras that smooth make waves


def check_poses(material: Material) -> list[Finding]:
    """Where poses come from, the floor, and whether two cameras show one room."""
    if material.settled is None:
        assert material.refusal is not None
        return [Finding("camera poses", Level.RED, material.refusal.problem, material.refusal.remedy)]
    calibration = material.settled.calibration
    asked = ask_poses(
        material.recording, calibration, material.settled.clocks, material.scenes, material.settled.samples
    )
    return [_poses(calibration, asked), _floor(material), *_agreement(asked)]


def _poses(calibration: Calibration, asked: PosesAsked) -> Finding:
    """Where each pose comes from, or what contradicts it but other cameras."""
    own = [doubt for doubt in asked.doubts if doubt.source is not DoubtSource.CAMERAS]
    parts = []
    for pose in calibration.poses:
        doubt = max((one for one in own if pose.camera in one.cameras), key=lambda one: one.refuted, default=None)
        if doubt is None:
            parts.append(OfCamera(pose.camera, Level.GREEN, SOURCES.get(pose.source, str(pose.source))))
        else:
            parts.append(OfCamera(pose.camera, _level(doubt), doubt.sentence, remedy_of(doubt)))
    return of_cameras("camera poses", parts)


def _level(doubt: PoseDoubt | None) -> Level:
    """As serious as what tracking does about it."""
    return Level.GREEN if doubt is None else Level.RED if doubt.refuted else Level.YELLOW


def _agreement(asked: PosesAsked) -> list[Finding]:
    """One finding over all pairs of cameras; none where no pair shares enough."""
    between = {doubt.cameras: doubt for doubt in asked.doubts if doubt.source is DoubtSource.CAMERAS}
    parts = [
        OfCamera(" and ".join(names := pair.past.cameras), _level(between.get(names)), pair.measured, REMEDY)
        for pair in asked.pairs
        if pair.measured
    ]
    return [of_cameras("cameras agree", parts)] if parts else []


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
