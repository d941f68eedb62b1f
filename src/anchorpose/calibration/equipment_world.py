"""The world of the equipment: every camera's pose in Gamma_0, found where it is not given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.calibration.calibration import PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.equipment_agreement import (
    REMEDY,
    ChooseHeading,
    EquipmentInputs,
    SeenEquipment,
    common_floor,
    refuse_contradiction,
    resolve_symmetry,
)
from anchorpose.calibration.equipment_model import prepare_equipment
from anchorpose.calibration.equipment_moved import Moved, moved_note, notice_movement
from anchorpose.calibration.equipment_pose import (
    EquipmentPose,
    EquipmentPoseConfig,
    NoEquipmentPose,
    find_equipment,
    refit,
)
from anchorpose.calibration.equipment_refine import FloorPrior, standing_prior
from anchorpose.calibration.equipment_residuals import StillView, see_still
from anchorpose.calibration.equipment_verdict import NoPose
from anchorpose.calibration.floor import NoFloor, find_floor
from anchorpose.calibration.noise import noise_per_m, what_stays
from anchorpose.camera import Camera, invert_rigid
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentWorld:
    """cameras, all with a pose, and one record each; floor_height_m: Y of the floor; notes for people."""

    cameras: tuple[Camera, ...]
    poses: tuple[PoseRecord, ...]
    floor_height_m: float
    notes: tuple[str, ...]


def world_from_equipment(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    config: EquipmentPoseConfig,
    choose_heading: ChooseHeading | None = None,
) -> EquipmentWorld:
    """Poses in Gamma_0 of all cameras that have none; given poses are in Gamma_0 already.

    Each camera by itself first; then chi_0's symmetry is resolved between the cameras and by ``choose_heading``, all
    share one floor, and no two may contradict each other. Raises InputError where a pose is not accepted.
    """
    if recording.equipment is None:
        raise ValueError("the recording has no equipment to find the cameras from")
    inputs = EquipmentInputs(recording, sample_frames, prepare_equipment(recording.equipment), config)
    missing = [index for index, camera in enumerate(recording.cameras) if camera.T_world_camera is None]
    seen = [_find_in_camera(inputs, index) for index in missing]
    cameras, notes = resolve_symmetry(inputs, seen, choose_heading)
    prior = common_floor(seen, cameras)
    records = [PoseRecord(camera.name, PoseSource.GIVEN) for camera in cameras]
    moves = []
    for one in seen:
        start = invert_rigid(cameras[one.index].require_pose())
        moves.append(notice_movement(one.view, one.frames_m, start, inputs.equipment, prior, config))
        pose = _polish(inputs, one, start, moves[-1], prior)
        cameras[one.index] = replace(cameras[one.index], T_world_camera=pose.camera_to_world)
        records[one.index] = _record(cameras[one.index].name, pose)
    notes += _moved_notes(seen, moves, len(cameras))
    refuse_contradiction(inputs, cameras, seen)
    return EquipmentWorld(tuple(cameras), tuple(records), prior.height_m, tuple(notes))


def _find_in_camera(inputs: EquipmentInputs, index: int) -> SeenEquipment:
    """The equipment in one camera; if it cannot be found in all frames together, in the first half of them."""
    recording = inputs.recording
    camera, background = recording.cameras[index], recording.backgrounds_m[index]
    frames, times = inputs.frames_of(index)
    if not frames:
        raise InputError(recording.folder / camera.name, "has no readable depth image among the sampled ones", REMEDY)
    attempts: list[tuple[np.ndarray | None, tuple[np.ndarray, ...]]] = [(background, frames)]
    if background is not None:
        attempts.append((None, frames))
    elif len(frames) >= 4:
        attempts.append((None, frames[: len(frames) // 2]))
    first: NoEquipmentPose | None = None
    for room, used in attempts:
        found = _attempt(inputs, camera, used, room)
        if not isinstance(found, NoEquipmentPose):
            return SeenEquipment(index, found[0], frames, times, found[1])
        first = first or found
    raise _refusal(recording, camera, first or NoEquipmentPose(NoPose.NOT_SEEN))


def _attempt(
    inputs: EquipmentInputs, camera: Camera, frames_m: Sequence[np.ndarray], background_m: np.ndarray | None
) -> tuple[StillView, EquipmentPose] | NoEquipmentPose:
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    still = background_m if background_m is not None else what_stays(np.stack(frames_m), noise)
    floor = find_floor(still, camera, noise)
    if isinstance(floor, NoFloor):
        return NoEquipmentPose(NoPose.NO_FLOOR)
    view = see_still(camera, frames_m, background_m, noise, floor)
    pose = find_equipment(view, inputs.equipment, inputs.config)
    return pose if isinstance(pose, NoEquipmentPose) else (view, pose)


def _refusal(recording: Recording, camera: Camera, why: NoEquipmentPose) -> InputError:
    part = f" ({why.part})" if why.part else ""
    problem = f"camera_to_world is null for {camera.name}, and this camera {why.why.value}{part}"
    return InputError(recording.folder / "recording.json", problem, REMEDY)


def _polish(
    inputs: EquipmentInputs, one: SeenEquipment, start: np.ndarray, moved: Moved | None, prior: FloorPrior
) -> EquipmentPose:
    """The pose again with the floor all cameras share, on the empty room and all frames that show it so."""
    before = one.frames_m if moved is None else one.frames_m[: moved.first]
    own = one.view.frames_m if len(one.view.frames_m) == 1 or not before else np.stack(before)
    stacks = [np.concatenate([own, np.stack(before)])] if len(own) == 1 and before else []
    attempts = [(stack, prior) for stack in (*stacks, own)]
    for stack, floor in (*attempts, (one.view.frames_m, standing_prior(prior.height_m))):
        pose = refit(replace(one.view, frames_m=stack), inputs.equipment, start, floor, inputs.config)
        if isinstance(pose, EquipmentPose):
            return pose
    return one.pose


def _moved_notes(seen: Sequence[SeenEquipment], moves: Sequence[Moved | None], count: int) -> list[str]:
    notes = [
        moved_note(one.view.camera.name, moved, one.times_s)
        for one, moved in zip(seen, moves, strict=True)
        if moved is not None
    ]
    if len(notes) == 1 and count > 1 and len(seen) > 1:
        notes.append("only this camera saw that, so it may be the camera that was moved")
    return notes


def _record(name: str, pose: EquipmentPose) -> PoseRecord:
    fit, evidence = pose.fit, pose.evidence
    figures = (
        PoseFigure("equipment, rms distance of the readings to its surface", fit.surface_rms_m, "m"),
        PoseFigure("equipment, rms distance of its outline", fit.outline_rms_px, "px"),
        PoseFigure("equipment, share of the surface that is seen", evidence.seen_share, "1"),
        PoseFigure("equipment, share of the unhidden surface that is seen through", evidence.through_share, "1"),
        PoseFigure("equipment, standard deviation of its place", pose.sigma_m, "m"),
        PoseFigure("equipment, standard deviation of its direction", float(np.degrees(pose.sigma_rad)), "degree"),
    )
    return PoseRecord(name, PoseSource.EQUIPMENT, pose.sigma_m, pose.sigma_rad, figures)
