"""Whether the cameras' poses are known, and agree with the floor and with each other."""

from __future__ import annotations

from itertools import combinations
from typing import Final

import cv2
import numpy as np

from anchorpose.calibration.calibration import FloorResidual, PoseSource
from anchorpose.calibration.world import WORST_FLOOR_TILT_RAD
from anchorpose.camera import invert_rigid, transform_points
from anchorpose.check.finding import Finding, Level, OfCamera, level_of, of_cameras
from anchorpose.check.material import Material
from anchorpose.isolation.scene import Scene

SOURCES: Final = {PoseSource.FLOOR: "not given; found from floor and patient"}
TILTED_RAD: Final = 0.035  # two degrees: a metre away a foot is 3.5 cm off the floor
UNEVEN_M: Final = 0.02  # floors are flat to that; cameras that smooth make waves
SOME_PAST, MUCH_PAST = 0.08, 0.40  # 0.01 with right poses; a camera 5 cm too high 0.2, 10 cm 0.45
SAME_M: Final = 0.08  # a limb's thickness, along the ray
LEAST_SHARED: Final = 500  # pixels that both cameras see
POINTS: Final = 20000


def check_poses(material: Material) -> list[Finding]:
    """Where poses come from, the floor, and whether two cameras show one room."""
    if material.settled is None:
        assert material.refusal is not None
        return [Finding("camera poses", Level.RED, material.refusal.problem, material.refusal.remedy)]
    calibration = material.settled.calibration
    poses = [
        OfCamera(pose.camera, Level.GREEN, SOURCES.get(pose.source, str(pose.source))) for pose in calibration.poses
    ]
    found = [of_cameras("camera poses", poses), _floor(material)]
    shared = [_apart(one, other) for one, other in combinations(material.scenes, 2)]
    if any(shared):
        found.append(of_cameras("cameras agree", [part for part in shared if part]))
    return found


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


def _apart(one: Scene, other: Scene) -> OfCamera | None:
    """How much of the empty room that one camera shows the other sees past; None where they share little.

    What stands in between hides a surface; nothing lets a camera see through it but a wrong pose.
    """
    shares = [_seen_past(one, other), _seen_past(other, one)]
    if not np.isfinite(shares).any():
        return None
    past = float(np.nanmax(shares))
    remedy = "a camera was moved: run 'anchorpose calibrate' with --ignore-given, and look at its pictures"
    measured = f"see past {100 * past:.0f} % of what the other shows"
    return OfCamera(
        f"{one.camera.name} and {other.camera.name}", level_of(past, SOME_PAST, MUCH_PAST), measured, remedy
    )


def _seen_past(one: Scene, other: Scene) -> float:
    """Share of one camera's surface points, of those in the other's view and not hidden there; NaN for few points."""
    points = one.camera.back_project(one.background.depth_m).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])].astype(np.float64)
    points = points[:: max(1, len(points) // POINTS)]
    world = transform_points(one.camera.require_pose(), points)
    seen = transform_points(invert_rigid(other.camera.require_pose()), world)
    column, row, inside = other.camera.pixel_of(seen)
    read = np.where(other.background.depth_m > 0, other.background.depth_m, np.float32(1e3))
    nearest_m = cv2.erode(read, np.ones((3, 3), np.uint8))[row, column]
    known = inside & (nearest_m < 1e3) & (nearest_m > seen[:, 2] - SAME_M)
    if np.count_nonzero(known) < LEAST_SHARED:
        return float("nan")
    return float(np.mean(nearest_m[known] > seen[known, 2] + SAME_M))
