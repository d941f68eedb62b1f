"""Find the world frame, and the pose of every camera in it (tau_0,i in Section III of the paper, for camera i)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import (
    Calibration,
    DoubtSource,
    FloorResidual,
    PoseDoubt,
    PoseRecord,
    PoseSource,
)
from anchorpose.calibration.camera_to_camera import NoCameraToCamera, PlacingConfig, find_camera_to_camera
from anchorpose.calibration.equipment_agreement import ChooseHeading
from anchorpose.calibration.equipment_pose import EquipmentPoseConfig
from anchorpose.calibration.equipment_world import check_given_poses, world_from_equipment
from anchorpose.calibration.first_frames import (
    USUAL_DISTANCE_M,
    FloorPlane,
    NoFloor,
    floor_of_room,
    is_upside_down,
    start_of_patient,
)
from anchorpose.camera import Camera, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording, depths_of
from anchorpose.rotations import rigid

# rad (two degrees); if the floor that a camera sees is tilted by more than this in the world, a doubt about the
# camera's pose is noted. A tilt of two degrees displaces a point 1 m away by 3.5 cm
TILTED_RAD: Final = 0.035
# rad (four degrees); if the floor that a camera sees is tilted by more than this in the world, the camera's pose is
# wrong: floors are level to one degree, and lenses bend the seen floor by one degree more
WORST_FLOOR_TILT_RAD: Final = 0.07
# m, limits of the difference between the heights at which two cameras see the same floor; each height is known to 2 cm.
# If two heights differ by more than the first limit, a doubt about a pose is noted. If two heights differ by more than
# the second limit, tracking is refused, since at least one of the two heights then has an error of 7 cm or more
UNEVEN_M, WORST_UNEVEN_M = 0.03, 0.15


def find_world(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    equipment_config: EquipmentPoseConfig | None = None,
    placing: PlacingConfig | None = None,
    choose_heading: ChooseHeading | None = None,
    rough_clocks: bool = False,
) -> Calibration:
    """Find the poses of all cameras: as given, from the equipment, or from the floor and the people.

    sample_frames: frames spread over the recording, in the order of time. With equipment, the world is the equipment's
    frame (Gamma_0). Without equipment, the world has Y up, the origin on the floor below the place where the patient is
    first seen, and X from the patient towards the camera: the patient is assumed to face the camera, and a note states
    this assumption. Other cameras are placed relative to the first by the people that both see (``placing``).
    rough_clocks: whether the clocks are known only to 50 ms, so that these placements may be less accurate. Raises
    InputError if poses are missing and cannot be found.
    """
    missing = [camera.name for camera in recording.cameras if camera.T_world_camera is None]
    equipment_config = equipment_config or EquipmentPoseConfig()
    if not missing:
        return _given_world(recording, sample_frames, equipment_config)
    if recording.equipment is not None:
        return _equipment_world(recording, sample_frames, equipment_config, choose_heading)
    if len(missing) < len(recording.cameras):
        raise InputError(
            recording.folder / "recording.json",
            f"camera_to_world is null for {', '.join(missing)}, and nothing ties them to the others' world",
            "give every camera_to_world, or none",
        )
    floors = _floors(recording, sample_frames)
    upside_down = _upside_down(recording, sample_frames, floors)
    world = replace(_from_one_camera(recording, sample_frames, floors[0]), doubts=upside_down)
    if len(recording.cameras) == 1:
        return world
    return _with_other_cameras(recording, world, floors, placing or PlacingConfig(), rough_clocks)


def _given_world(recording: Recording, sample_frames: Sequence[FrameSet], config: EquipmentPoseConfig) -> Calibration:
    """Return the given poses, with doubts and notes where the floor or the equipment contradicts them."""
    floors = _floors(recording, sample_frames)
    world = _checked(recording.cameras, floors, "the cameras' given poses are used")
    upside_down = _upside_down(recording, sample_frames, floors)
    if world.floor_height_m is None:
        return replace(world, doubts=(*upside_down, *world.doubts))
    doubts, notes = check_given_poses(recording, sample_frames, floors, world.floor_height_m, config)
    return replace(world, notes=(*world.notes, *notes), doubts=(*upside_down, *doubts, *world.doubts))


def _equipment_world(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    config: EquipmentPoseConfig,
    choose_heading: ChooseHeading | None,
) -> Calibration:
    missing = [camera.name for camera in recording.cameras if camera.T_world_camera is None]
    found = world_from_equipment(recording, sample_frames, config, choose_heading)
    note = f"the poses of {', '.join(missing)} were found from the equipment"
    checked = _checked(found.cameras, _floors(recording, sample_frames), note)
    given = [doubt for doubt in checked.doubts if not set(missing) & set(doubt.cameras)]
    notes = (*checked.notes, *found.notes, *(doubt.sentence for doubt in checked.doubts if doubt not in given))
    return replace(checked, floor_height_m=found.floor_height_m, poses=found.poses, notes=notes, doubts=tuple(given))


def _floors(recording: Recording, sample_frames: Sequence[FrameSet]) -> list[FloorPlane | NoFloor]:
    """Find the floor that each camera sees in the image of the empty room or, without such an image, in the sampled
    frames.
    """
    return [
        floor_of_room(camera, recording.backgrounds_m[index], depths_of(sample_frames, index))
        for index, camera in enumerate(recording.cameras)
    ]


def _upside_down(
    recording: Recording, sample_frames: Sequence[FrameSet], floors: Sequence[FloorPlane | NoFloor]
) -> tuple[PoseDoubt, ...]:
    """Return a doubt about each camera whose pose would make people stand upside down on a floor above the camera."""
    found = []
    for index, (camera, floor) in enumerate(zip(recording.cameras, floors, strict=True)):
        if is_upside_down(floor, camera, recording.backgrounds_m[index], depths_of(sample_frames, index)):
            by = "its images" if camera.T_world_camera is None else "its given pose"
            sentence = f"camera {camera.name} is upside down: by {by}, people stand on a floor above it"
            found.append(PoseDoubt(DoubtSource.UPSIDE_DOWN, (camera.name,), sentence, float("nan"), True))
    return tuple(found)


def _checked(cameras: tuple[Camera, ...], floors: Sequence[FloorPlane | NoFloor], first_note: str) -> Calibration:
    """Return the calibration of cameras with poses, with residuals of the floors that the cameras see, and doubts about
    poses that disagree with these floors.
    """
    residuals, heights, notes, doubts = [], dict[str, float](), [first_note], list[PoseDoubt]()
    for camera, floor in zip(cameras, floors, strict=True):
        if isinstance(floor, NoFloor):
            notes.append(f"camera {camera.name} sees no floor: {floor.value}")
            continue
        T_world_camera = camera.require_pose()
        up = T_world_camera[:3, :3] @ floor.up
        tilt = float(np.arccos(np.clip(up[1], -1.0, 1.0)))
        residuals.append(FloorResidual(camera.name, floor.residual_m, tilt))
        if tilt > TILTED_RAD:
            sentence = (
                f"the floor that camera {camera.name} sees is tilted by {np.degrees(tilt):.1f} degrees by its pose"
            )
            refuted, off_m = tilt > WORST_FLOOR_TILT_RAD, USUAL_DISTANCE_M * tilt
            doubts.append(PoseDoubt(DoubtSource.FLOOR, (camera.name,), sentence, off_m, refuted))
        if tilt > WORST_FLOOR_TILT_RAD:
            continue
        # The floor's height is measured at the patient's usual distance from the camera. At another place on the floor
        # (below the camera, or where a level camera's optical axis meets the floor behind the wall), a small error of
        # the tilt would change the measured height more.
        ahead = np.array([0.0, 0.0, USUAL_DISTANCE_M])
        on_floor = ahead - (floor.up @ ahead + floor.height_m) * floor.up
        heights[camera.name] = float(transform_points(T_world_camera, on_floor)[1])
    records = tuple(PoseRecord(camera.name, PoseSource.GIVEN) for camera in cameras)
    height = float(np.median(list(heights.values()))) if heights else None
    doubts += _uneven(heights)
    return Calibration(cameras, height, tuple(residuals), tuple(notes), records, tuple(doubts))


def _uneven(heights_m: Mapping[str, float]) -> list[PoseDoubt]:
    """Return a doubt if the cameras disagree on the floor's height: about the camera whose height differs most from the
    median, or about both cameras if only two see the floor.
    """
    if len(heights_m) < 2:
        return []
    values = np.array(list(heights_m.values()))
    off_m = float(np.ptp(values))
    if off_m <= UNEVEN_M:
        return []
    names = list(heights_m)
    away_m = np.abs(values - np.median(values))
    odd = tuple(names) if len(names) == 2 else (names[int(away_m.argmax())],)
    sentence = f"cameras see one floor at heights that differ by {1000 * off_m:.0f} mm by their poses"
    sentence += "" if len(odd) > 1 else f"; {odd[0]} is the odd one"
    return [PoseDoubt(DoubtSource.FLOOR, odd, sentence, off_m, off_m > WORST_UNEVEN_M)]


def _from_one_camera(
    recording: Recording, sample_frames: Sequence[FrameSet], floor: FloorPlane | NoFloor
) -> Calibration:
    """Return the world that is defined by the floor in the first camera and by the place where the patient is first
    seen.
    """
    camera = recording.cameras[0]
    notes, residuals = [], []
    if isinstance(floor, FloorPlane):
        up, height = floor.up, floor.height_m
        residuals.append(FloorResidual(camera.name, floor.residual_m, 0.0))
        notes.append(f"the world stands on the floor that camera {camera.name} sees, {height:.2f} m below it")
    else:
        up, height = np.array([0.0, -1.0, 0.0]), None
        notes.append(f"no floor was found ({floor.value}): Y is the camera's up, and the floor's height is unknown")
    origin_m, reason = start_of_patient(camera, sample_frames, up, height)
    notes.append(reason)
    notes.append("the patient is assumed to face the camera: X points from the patient's start towards it")
    posed = replace(camera, T_world_camera=_world_at(origin_m, up))
    record = PoseRecord(camera.name, PoseSource.FLOOR)
    return Calibration((posed,), None if height is None else 0.0, tuple(residuals), tuple(notes), (record,))


def _with_other_cameras(
    recording: Recording,
    world: Calibration,
    floors: Sequence[FloorPlane | NoFloor],
    placing: PlacingConfig,
    rough_clocks: bool,
) -> Calibration:
    """Place the other cameras relative to the first, whose world is known."""
    found = find_camera_to_camera(recording, floors, placing, rough_clocks)
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
    """Return T_world_camera (4, 4): origin at a point given in the camera frame, Y along ``up_camera``, X level towards
    the camera.
    """
    towards = -origin_camera_m + (up_camera @ origin_camera_m) * up_camera
    forward = towards / np.linalg.norm(towards)
    R_world_camera = np.stack([forward, up_camera, np.cross(forward, up_camera)])
    return rigid(R_world_camera, -R_world_camera @ origin_camera_m)
