"""What stands in a simulated clinic: the room, cameras, and a standing frame, parallel bars or a stool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.camera import Camera, Intrinsics
from anchorpose.recording.equipment import Box, Cylinder, EquipmentPart
from anchorpose.simulate.sensor import SENSORS

CAMERA_NAMES = ("front", "left", "right", "behind")
AZIMUTH_RAD = (0.0, np.radians(57.0), np.radians(-57.0), np.pi)  # left of the patient is positive
AZIMUTH_SPREAD_RAD = (0.08, 0.2, 0.2, 0.3)
WALL_M = 2.7


def place_cameras(rng: np.random.Generator, sensor: str, count: int) -> tuple[Camera, ...]:
    """Cameras on tripods around the patient, who stands at the origin and faces +X."""
    spec = SENSORS[sensor]
    cameras = []
    for index in range(count):
        azimuth = AZIMUTH_RAD[index] + rng.uniform(-1.0, 1.0) * AZIMUTH_SPREAD_RAD[index]
        distance_m = rng.uniform(2.25, 2.85)
        position = np.array([distance_m * np.cos(azimuth), rng.uniform(1.1, 1.5), -distance_m * np.sin(azimuth)])
        target = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.82, 0.95), rng.uniform(-0.08, 0.08)])
        intrinsics = Intrinsics(fx=spec.focal_px, fy=spec.focal_px, cx=spec.width / 2.0, cy=spec.height / 2.0)
        cameras.append(
            Camera(
                name=CAMERA_NAMES[index],
                width=spec.width,
                height=spec.height,
                depth_scale=0.001,
                intrinsics=intrinsics,
                T_world_camera=look_at(position, target),
            )
        )
    return tuple(cameras)


def look_at(position_m: np.ndarray, target_m: np.ndarray) -> np.ndarray:
    """T_world_camera (4, 4) of a level camera at ``position_m`` that looks at ``target_m``."""
    away = (target_m - position_m) / np.linalg.norm(target_m - position_m)
    right = np.cross(away, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.stack([right, np.cross(away, right), away], axis=1)
    T_world_camera[:3, 3] = position_m
    return T_world_camera


def room_triangles(rng: np.random.Generator, camera_behind: bool) -> np.ndarray:
    """(n, 3, 3) floor, back wall and side walls; the ceiling is out of every camera's view."""
    back = -rng.uniform(3.1, 3.5) if camera_behind else -rng.uniform(1.7, 2.4)
    left, right, front = -rng.uniform(2.6, 3.2), rng.uniform(2.6, 3.2), rng.uniform(3.2, 3.8)
    quads = [
        [[back, 0, left], [front, 0, left], [front, 0, right], [back, 0, right]],
        [[back, 0, left], [back, 0, right], [back, WALL_M, right], [back, WALL_M, left]],
        [[back, 0, left], [back, WALL_M, left], [front, WALL_M, left], [front, 0, left]],
        [[back, 0, right], [front, 0, right], [front, WALL_M, right], [back, WALL_M, right]],
        [[front, 0, left], [front, WALL_M, left], [front, WALL_M, right], [front, 0, right]],
    ]
    return np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])


@dataclass(frozen=True, slots=True, eq=False)
class StandingFrame:
    """Posts, rails to hold, a cross-bar before the belly, a bar before the knees, runners on the floor.

    grip_m (2, 3): where the left and the right hand hold a rail's top.
    """

    parts: tuple[EquipmentPart, ...]
    grip_m: np.ndarray


def fit_standing_frame(
    rng: np.random.Generator, pelvis_m: float, knee_m: float, front_m: float, half_width_m: float
) -> StandingFrame:
    """A frame set up for a patient at the origin.

    pelvis_m, knee_m: heights of pelvis and knees; front_m: x of the foremost of belly and knees; half_width_m: room
    that the arms need beside the trunk.
    """
    bar_height_m = rng.uniform(0.05, 0.09)
    bar_depth_m = rng.uniform(0.03, 0.05)
    x = front_m + bar_depth_m / 2.0 + rng.uniform(0.04, 0.08)
    half_m = max(half_width_m, 0.40) + rng.uniform(0.0, 0.06)
    tube_m = rng.uniform(0.035, 0.05)
    rail_m = pelvis_m + rng.uniform(-0.06, 0.04)
    cross_m = rail_m + rng.uniform(0.05, 0.13)
    parts: list[EquipmentPart] = []
    for side, z in (("left", -half_m), ("right", half_m)):
        parts += [
            _tube(rng, f"post-{side}", (x, (cross_m + 0.05) / 2.0, z), tube_m, cross_m + 0.05, 1),
            _tube(rng, f"rail-{side}", (x - 0.35, rail_m, z), tube_m, 0.75, 0),
            _box(f"base-{side}", (x - 0.3, 0.03, z), (1.0, 0.06, 0.06)),
        ]
    parts.append(_box("cross-bar", (x + 0.02, cross_m, 0.0), (0.04, 0.05, 2.0 * half_m)))
    knee_bar_m = knee_m + rng.uniform(-0.06, 0.02)
    parts.append(_box("knee-bar", (x, knee_bar_m, 0.0), (bar_depth_m, bar_height_m, 2.0 * half_m - tube_m)))
    grip_x, top_m = x - rng.uniform(0.08, 0.18), rail_m + tube_m / 2.0
    return StandingFrame(tuple(parts), np.array([[grip_x, top_m, -half_m], [grip_x, top_m, half_m]]))


def fit_parallel_bars(rng: np.random.Generator, pelvis_m: float, half_width_m: float) -> StandingFrame:
    """Two rails on four posts around a patient at the origin, the same from both ends."""
    rail_m = pelvis_m + rng.uniform(-0.06, 0.04)
    half_m = max(half_width_m, 0.32) + rng.uniform(0.0, 0.05)
    tube_m, length_m = rng.uniform(0.035, 0.045), rng.uniform(1.6, 2.2)
    parts: list[EquipmentPart] = []
    for side, z in (("left", -half_m), ("right", half_m)):
        parts.append(_tube(rng, f"rail-{side}", (0.0, rail_m, z), tube_m, length_m, 0))
        for end, x in (("front", 0.4 * length_m), ("back", -0.4 * length_m)):
            post = np.array([x, (rail_m - tube_m / 2.0) / 2.0, z])
            up = np.array([0.0, 1.0, 0.0])
            parts.append(Cylinder(f"post-{side}-{end}", post, up, tube_m / 2.0, rail_m - tube_m / 2.0))
    top_m = rail_m + tube_m / 2.0
    return StandingFrame(tuple(parts), np.array([[0.12, top_m, -half_m], [0.12, top_m, half_m]]))


def build_stool(rng: np.random.Generator, center_m: tuple[float, float], height_m: float) -> tuple[EquipmentPart, ...]:
    """A round or square stool whose top is at ``height_m``, centred at (x, z)."""
    x, z = center_m
    if rng.random() < 0.5:
        up = np.array([0.0, 1.0, 0.0])
        column_m = height_m - 0.06
        return (
            Cylinder("seat", np.array([x, height_m - 0.03, z]), up, 0.18, 0.06),
            Cylinder("column", np.array([x, column_m / 2.0, z]), up, 0.03, column_m),
        )
    leg_m = height_m - 0.05
    legs = [
        _box(f"leg-{number}", (x + dx, leg_m / 2.0, z + dz), (0.03, leg_m, 0.03))
        for number, (dx, dz) in enumerate([(-0.15, -0.16), (-0.15, 0.16), (0.15, -0.16), (0.15, 0.16)])
    ]
    return (_box("seat", (x, height_m - 0.025, z), (0.36, 0.05, 0.38)), *legs)


def _box(name: str, center_m: tuple[float, float, float], size_m: tuple[float, float, float]) -> Box:
    return Box(name, np.array(center_m), np.array(size_m), np.eye(3))


def _tube(
    rng: np.random.Generator,
    name: str,
    center_m: tuple[float, float, float],
    tube_m: float,
    length_m: float,
    axis: int,
) -> EquipmentPart:
    """A round or a square tube along axis 0, 1 or 2."""
    along = np.eye(3)[axis]
    if rng.random() < 0.5:
        return Cylinder(name, np.array(center_m), along, tube_m / 2.0, length_m)
    return Box(name, np.array(center_m), np.where(along > 0, length_m, tube_m), np.eye(3))
