"""The world frame and every camera's pose in it (paper, Section III: tau_0,i; first form).

Given poses against what is seen: equipment that stands elsewhere than they say, or that is moved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from anchorpose.calibration.calibration import Calibration, FloorResidual, PoseRecord, PoseSource
from anchorpose.calibration.equipment.moved import notice_movement
from anchorpose.calibration.equipment.pose import Equipment, prepare_equipment
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.seen import EquipmentWorldConfig
from anchorpose.calibration.equipment.still import StillView, see_still
from anchorpose.calibration.equipment.turns import TellFacing
from anchorpose.calibration.equipment.world import moved_note, world_from_equipment
from anchorpose.calibration.floor import FloorConfig, FloorPlane, NoFloor, find_floor
from anchorpose.calibration.noise import noise_per_m
from anchorpose.calibration.people.camera_to_camera import CameraToCameraConfig, NoCameraToCamera, find_camera_to_camera
from anchorpose.calibration.start import start_of_patient
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording


def watch_given_poses(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    floor_config: FloorConfig,
    floor_height_m: float | None,
    config: EquipmentWorldConfig,
) -> list[str]:
    """Notes on cameras whose given pose puts the equipment where it is not seen; given poses are used all the same."""
    if recording.equipment is None or floor_height_m is None:
        return []
    equipment = prepare_equipment(recording.equipment)
    notes = []
    for index in range(len(recording.cameras)):
        notes += _watch_one(recording, index, sample_frames, equipment, floor_config, floor_height_m, config)
    return notes


def _watch_one(
    recording: Recording, index: int, sample_frames: Sequence[FrameSet], equipment: Equipment,
    floor_config: FloorConfig, floor_height_m: float, config: EquipmentWorldConfig,
) -> list[str]:  # fmt: skip
    pairs = [(frame.time_s, depth) for frame in sample_frames if (depth := frame.depths_m[index]) is not None]
    view = _view(recording, index, [depth for _, depth in pairs], floor_config)
    if view is None:
        return []
    camera = recording.cameras[index]
    refine = config.pose.refine
    prior = FloorPrior(np.array([0.0, 1.0, 0.0]), floor_height_m, refine.standing_sigma_m, refine.standing_sigma_rad)
    moved = notice_movement(
        view, [depth for _, depth in pairs], invert_rigid(camera.require_pose()), equipment, prior, config.pose,
        config.moved,
    )  # fmt: skip
    if moved is None:
        return []
    if moved.first > 0:
        return [moved_note(camera.name, moved, [time for time, _ in pairs])]
    if moved.shift_m is None or moved.turn_rad is None:
        return [f"the given pose of camera {camera.name} puts the equipment where this camera sees through it"]
    return [
        f"the given pose of camera {camera.name} puts the equipment {1000 * moved.shift_m:.0f} mm and "
        f"{np.degrees(moved.turn_rad):.1f} degrees from where this camera sees it; the given pose is used"
    ]


def _view(
    recording: Recording, index: int, frames_m: Sequence[np.ndarray], floor_config: FloorConfig
) -> StillView | None:
    """What this camera sees over time; None where it sees no floor or nothing at all."""
    if not frames_m:
        return None
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return None
    camera = replace(recording.cameras[index], T_world_camera=None)
    still = recording.backgrounds_m[index]
    floor = find_floor(
        still if still is not None else np.median(np.stack(frames_m), axis=0), camera, noise, floor_config
    )
    return None if isinstance(floor, NoFloor) else see_still(camera, frames_m, still, noise, floor)


WORST_FLOOR_TILT_RAD = 0.09  # five degrees between a measured floor and a given world's: one of them is wrong


def find_world(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    config: FloorConfig,
    equipment_config: EquipmentWorldConfig | None = None,
    tell_facing: TellFacing | None = None,
    placing: CameraToCameraConfig | None = None,
) -> Calibration:
    """Poses of all cameras: as given, from the equipment, or from the floor and the people.

    sample_frames: spread over the recording, in the order of time. With equipment the world is Gamma_0. Without, found
    worlds have Y up, the origin on the floor below the patient's start, and X from him towards the camera: he is taken
    to face it, and a note says so; other cameras are placed against the first by the people they see (``placing``).
    Raises InputError where poses are missing and cannot be found.
    """
    missing = [camera.name for camera in recording.cameras if camera.T_world_camera is None]
    settings = equipment_config or EquipmentWorldConfig()
    if missing and recording.equipment is not None:
        found = world_from_equipment(recording, sample_frames, config, settings, tell_facing)
        floors = _floors(recording, sample_frames, config)
        checked = _checked(found.cameras, floors, [f"the poses of {', '.join(missing)} were found from the equipment"])
        return replace(
            checked, floor_height_m=found.floor_height_m, poses=found.poses, notes=checked.notes + found.notes
        )
    if not missing:
        checked = _checked(
            recording.cameras, _floors(recording, sample_frames, config), ["the cameras' given poses are used"]
        )
        if recording.equipment is None:
            return checked
        watched = watch_given_poses(recording, sample_frames, config, checked.floor_height_m, settings)
        return replace(checked, notes=(*checked.notes, *watched))
    if 0 < len(missing) < len(recording.cameras):
        raise InputError(
            recording.folder / "recording.json",
            f"camera_to_world is null for {', '.join(missing)}, and nothing ties them to the others' world",
            "give every camera_to_world, or none",
        )
    floors = _floors(recording, sample_frames, config)
    world = _from_one_camera(recording, sample_frames, floors[0])
    if len(recording.cameras) == 1:
        return world
    return _with_other_cameras(recording, world, floors, placing or CameraToCameraConfig())


def _floors(recording: Recording, sample_frames: Sequence[FrameSet], config: FloorConfig) -> list[FloorPlane | NoFloor]:
    return [_floor_of(recording, index, sample_frames, config) for index in range(len(recording.cameras))]


def _floor_of(
    recording: Recording, index: int, sample_frames: Sequence[FrameSet], config: FloorConfig
) -> FloorPlane | NoFloor:
    """The floor in the empty room's picture or, without one, in the median of the sampled frames."""
    pictures = [depth for frame in sample_frames if (depth := frame.depths_m[index]) is not None]
    background = recording.backgrounds_m[index]
    if background is None and not pictures:
        return NoFloor.NO_READINGS
    room = background if background is not None else np.median(np.stack(pictures), axis=0).astype(np.float32)
    try:
        noise = noise_per_m(pictures or [room])
    except ValueError:
        return NoFloor.NO_READINGS
    return find_floor(room, recording.cameras[index], noise, config)


def _checked(
    cameras: tuple[Camera, ...], floors: Sequence[FloorPlane | NoFloor], first_notes: Sequence[str]
) -> Calibration:
    """Cameras with poses, and what their floors say of these."""
    residuals, heights, notes = [], [], list(first_notes)
    for camera, floor in zip(cameras, floors, strict=True):
        if isinstance(floor, NoFloor):
            notes.append(f"camera {camera.name} sees no floor: {floor.value}")
            continue
        T_world_camera = camera.require_pose()
        up = T_world_camera[:3, :3] @ floor.up
        tilt = float(np.arccos(np.clip(up[1], -1.0, 1.0)))
        residuals.append(FloorResidual(camera.name, floor.residual_m, floor.inlier_share, tilt))
        if tilt > WORST_FLOOR_TILT_RAD:
            notes.append(f"the floor camera {camera.name} sees is tilted by {np.degrees(tilt):.1f} degrees: not used")
            continue
        # The floor's height where the camera looks: below the camera a small tilt would be a lever.
        ahead = floor.height_m / max(0.2, float(-floor.up @ [0.0, 0.0, 1.0])) * np.array([0.0, 0.0, 1.0])
        on_floor = ahead - (floor.up @ ahead + floor.height_m) * floor.up
        heights.append(float(transform_points(T_world_camera, on_floor)[1]))
    records = tuple(PoseRecord(camera.name, PoseSource.GIVEN) for camera in cameras)
    height = float(np.median(heights)) if heights else None
    return Calibration(cameras, height, tuple(residuals), tuple(notes), records)


def _from_one_camera(
    recording: Recording, sample_frames: Sequence[FrameSet], floor: FloorPlane | NoFloor
) -> Calibration:
    camera = recording.cameras[0]
    notes, residuals = [], []
    if isinstance(floor, FloorPlane):
        up, height = floor.up, floor.height_m
        residuals.append(FloorResidual(camera.name, floor.residual_m, floor.inlier_share, 0.0))
        notes.append(f"the world stands on the floor camera {camera.name} sees, {height:.2f} m below it")
    else:
        up, height = np.array([0.0, -1.0, 0.0]), None
        notes.append(f"no floor was found ({floor.value}): Y is the camera's up, and the floor's height is unknown")
    start = start_of_patient(camera, sample_frames, recording.backgrounds_m[0], up, height)
    notes.append(start.reason)
    notes.append("the patient is taken to face the camera: X points from his start towards it")
    T_world_camera = _world_at(start.point_camera_m, up)
    posed = replace(camera, T_world_camera=T_world_camera)
    record = PoseRecord(camera.name, PoseSource.FLOOR)
    return Calibration((posed,), None if height is None else 0.0, tuple(residuals), tuple(notes), (record,))


def _with_other_cameras(
    recording: Recording,
    world: Calibration,
    floors: Sequence[FloorPlane | NoFloor],
    placing: CameraToCameraConfig,
) -> Calibration:
    """The other cameras placed against the first, which has found the world."""
    found = find_camera_to_camera(recording, floors, placing)
    if isinstance(found, NoCameraToCamera):
        remedy = "give every camera_to_world, record people who walk in view of all cameras, or keep one camera"
        names = ", ".join(camera.name for camera in recording.cameras)
        raise InputError(
            recording.folder / "recording.json",
            f"camera_to_world is null for {names}, and the cameras cannot be placed against each other: {found.value}",
            remedy,
        )
    T_world_first = world.cameras[0].require_pose()
    cameras = tuple(
        replace(camera, T_world_camera=T_world_first @ T_first_camera)
        for camera, T_first_camera in zip(recording.cameras, found.T_first_camera, strict=True)
    )
    notes = tuple(
        f"camera {cameras[link.second].name} was placed against camera {cameras[link.first].name} by the people both "
        f"see: {link.fit.sentence}"
        for link in found.links
    )
    records = tuple(PoseRecord(camera.name, PoseSource.PEOPLE) for camera in cameras[1:])
    return replace(world, cameras=cameras, notes=(*world.notes, *notes), poses=(*world.poses, *records))


def _world_at(origin_camera_m: np.ndarray, up_camera: np.ndarray) -> np.ndarray:
    """T_world_camera (4, 4) with the origin at a camera point, Y along ``up_camera``, X level towards the camera."""
    towards = -origin_camera_m + (up_camera @ origin_camera_m) * up_camera
    forward = towards / np.linalg.norm(towards)
    R_world_camera = np.stack([forward, up_camera, np.cross(forward, up_camera)])
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = R_world_camera
    T_world_camera[:3, 3] = -R_world_camera @ origin_camera_m
    return T_world_camera
