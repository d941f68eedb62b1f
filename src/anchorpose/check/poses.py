"""Whether the cameras' poses are known, and agree with the floor and with each other."""

from __future__ import annotations

from itertools import combinations
from typing import Final

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
APART_M, FAR_APART_M = 0.03, 0.08  # between surfaces two cameras see: a limb is 0.08 m thick
SAME_M: Final = 0.25  # readings that differ by more show different things
LEAST_SHARED: Final = 500  # pixels that both cameras see
POINTS: Final = 20000


def check_poses(material: Material) -> list[Finding]:
    """Where poses come from, the floor, and how far the surfaces of two cameras are apart."""
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
    """Median distance between the empty rooms of two cameras where they see the same; None where they share little.

    From a point of the first to the nearest of what the second shows around it: along the ray, slanted surfaces such as
    the floor would seem farther apart than they are.
    """
    points = one.camera.back_project(one.background.depth_m).reshape(-1, 3)
    points = points[np.isfinite(points[:, 2])].astype(np.float64)
    points = points[:: max(1, len(points) // POINTS)]
    world = transform_points(one.camera.require_pose(), points)
    seen = transform_points(invert_rigid(other.camera.require_pose()), world)
    column, row, inside = other.camera.pixel_of(seen)
    shown = other.camera.back_project(other.background.depth_m)
    away_m = np.full(len(seen), np.inf)
    for down in (-2, 0, 2):
        for right in (-2, 0, 2):
            r = np.clip(row + down, 0, other.camera.height - 1)
            c = np.clip(column + right, 0, other.camera.width - 1)
            away_m = np.fmin(away_m, np.linalg.norm(shown[r, c] - seen, axis=1))
    shared = away_m[inside & (away_m < SAME_M)]
    if len(shared) < LEAST_SHARED:
        return None
    apart_m = float(np.median(shared))
    remedy = "a camera was moved: run 'anchorpose calibrate' with --ignore-given, and look at its pictures"
    names = f"{one.camera.name} and {other.camera.name}"
    return OfCamera(names, level_of(apart_m, APART_M, FAR_APART_M), f"{100 * apart_m:.1f} cm apart", remedy)
