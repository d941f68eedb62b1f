"""The world of the equipment: every camera's pose in Gamma_0, found where it is not given."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.equipment.moved import Moved, notice_movement
from anchorpose.calibration.equipment.pose import (
    Equipment,
    EquipmentPose,
    NoEquipmentPose,
    find_equipment,
    prepare_equipment,
    refit,
    standing_prior,
)
from anchorpose.calibration.equipment.refine import FloorPrior
from anchorpose.calibration.equipment.seen import EquipmentWorldConfig, SeenEquipment, common_floor, disagreement
from anchorpose.calibration.equipment.still import StillView, see_still, what_stays
from anchorpose.calibration.equipment.turns import TellFacing, resolve_symmetry
from anchorpose.calibration.equipment.verdict import NoPose
from anchorpose.calibration.floor import FloorConfig, NoFloor, find_floor
from anchorpose.calibration.noise import noise_per_m
from anchorpose.camera import Camera, invert_rigid
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording

REMEDY: Final = (
    "compare equipment.json with the room, add a background.png of the empty room, or give camera_to_world yourself"
)


@dataclass(frozen=True, slots=True, eq=False)
class EquipmentWorld:
    """cameras, all with a pose, and one record each; floor_height_m: Y of the floor; notes for people."""

    cameras: tuple[Camera, ...]
    poses: tuple[PoseRecord, ...]
    floor_height_m: float
    notes: tuple[str, ...]


def world_from_equipment(
    recording: Recording, sample_frames: Sequence[FrameSet], floor_config: FloorConfig, config: EquipmentWorldConfig,
    tell_facing: TellFacing | None = None,
) -> EquipmentWorld:  # fmt: skip
    """Poses in Gamma_0 of all cameras that have none; given poses are in Gamma_0 already.

    Each camera by itself first; then chi_0's symmetry is resolved between the cameras and by ``tell_facing``, all
    share one floor, and no two may contradict each other. Raises InputError where a pose is not to be trusted.
    """
    if recording.equipment is None:
        raise ValueError("the recording has no equipment to find the cameras from")
    equipment = prepare_equipment(recording.equipment)
    seen = [
        _find_in_camera(recording, index, sample_frames, equipment, floor_config, config)
        for index, camera in enumerate(recording.cameras)
        if camera.T_world_camera is None
    ]
    notes: list[str] = []
    cameras = resolve_symmetry(recording, sample_frames, seen, equipment, config, tell_facing, notes)
    prior = common_floor(seen, cameras, config)
    polished, moves = [], []
    for one in seen:
        moved = notice_movement(
            one.view, one.frames_m, invert_rigid(cameras[one.index].require_pose()), equipment, prior, config.pose,
            config.moved,
        )  # fmt: skip
        moves.append(moved)
        polished.append(_polish(one, cameras[one.index], moved, equipment, prior, config))
        cameras[one.index] = replace(cameras[one.index], T_world_camera=polished[-1].camera_to_world)
    notes += _moved_notes(seen, moves, len(cameras))
    _refuse_contradiction(recording, cameras, sample_frames, seen, prior, config)
    records = [PoseRecord(camera.name, PoseSource.GIVEN) for camera in cameras]
    for one, pose in zip(seen, polished, strict=True):
        records[one.index] = _record(cameras[one.index].name, pose)
    return EquipmentWorld(tuple(cameras), tuple(records), prior.height_m, tuple(notes))


def _find_in_camera(
    recording: Recording, index: int, sample_frames: Sequence[FrameSet], equipment: Equipment,
    floor_config: FloorConfig, config: EquipmentWorldConfig,
) -> SeenEquipment:  # fmt: skip
    """The equipment in one camera; if it cannot be found in all pictures together, in the first half of them."""
    camera, background = recording.cameras[index], recording.backgrounds_m[index]
    pairs = [(frame.time_s, depth) for frame in sample_frames if (depth := frame.depths_m[index]) is not None]
    frames, times = tuple(depth for _, depth in pairs), tuple(time for time, _ in pairs)
    if not frames:
        raise InputError(recording.folder / camera.name, "has no readable picture among the sampled ones", REMEDY)
    attempts: list[tuple[np.ndarray | None, tuple[np.ndarray, ...]]] = [(background, frames)]
    if background is not None:
        attempts.append((None, frames))
    elif len(frames) >= 4:
        attempts.append((None, frames[: len(frames) // 2]))
    first: NoEquipmentPose | None = None
    for picture, used in attempts:
        found = _attempt(camera, used, picture, equipment, floor_config, config)
        if not isinstance(found, NoEquipmentPose):
            return SeenEquipment(index, found[0], frames, times, found[1])
        first = first or found
    raise _refusal(recording, camera, first or NoEquipmentPose(NoPose.NOT_SEEN))


def _attempt(
    camera: Camera, frames_m: Sequence[np.ndarray], background_m: np.ndarray | None, equipment: Equipment,
    floor_config: FloorConfig, config: EquipmentWorldConfig,
) -> tuple[StillView, EquipmentPose] | NoEquipmentPose:  # fmt: skip
    try:
        noise = noise_per_m(frames_m)
    except ValueError:
        return NoEquipmentPose(NoPose.NOT_SEEN)
    still = background_m if background_m is not None else what_stays(np.stack(frames_m), noise)
    floor = find_floor(still, camera, noise, floor_config)
    if isinstance(floor, NoFloor):
        return NoEquipmentPose(NoPose.NO_FLOOR)
    view = see_still(camera, frames_m, background_m, noise, floor)
    pose = find_equipment(view, equipment, config.pose)
    return pose if isinstance(pose, NoEquipmentPose) else (view, pose)


def _refusal(recording: Recording, camera: Camera, why: NoEquipmentPose) -> InputError:
    part = f" ({why.part})" if why.part else ""
    problem = f"camera_to_world is null for {camera.name}, and this camera {why.why.value}{part}"
    return InputError(recording.folder / "recording.json", problem, REMEDY)


def _polish(
    one: SeenEquipment, camera: Camera, moved: Moved | None, equipment: Equipment, prior: FloorPrior,
    config: EquipmentWorldConfig,
) -> EquipmentPose:  # fmt: skip
    """The pose once more with the floor all cameras share, on the empty room and all frames that show it so."""
    before = one.frames_m if moved is None else one.frames_m[: moved.first]
    start = invert_rigid(camera.require_pose())
    own = one.view.frames_m if len(one.view.frames_m) == 1 or not before else np.stack(before)
    stacks = [np.concatenate([own, np.stack(before)])] if len(own) == 1 and before else []
    for stack in (*stacks, own):
        again = refit(replace(one.view, frames_m=stack), equipment, start, prior, config.pose)
        if isinstance(again, EquipmentPose):
            return again
    again = refit(one.view, equipment, start, standing_prior(prior.height_m, config.pose.refine), config.pose)
    return again if isinstance(again, EquipmentPose) else one.pose


def _refuse_contradiction(
    recording: Recording, cameras: Sequence[Camera], sample_frames: Sequence[FrameSet], seen: Sequence[SeenEquipment],
    prior: FloorPrior, config: EquipmentWorldConfig,
) -> None:  # fmt: skip
    """Raises InputError where two cameras, one of them newly found, see through what the other sees."""
    of_index = {one.index: one for one in seen}
    for a, b in product(range(len(cameras)), range(len(cameras))):
        if a == b or b not in of_index or (a in of_index and a > b):
            continue
        share = disagreement((cameras[a], cameras[b]), (a, b), sample_frames, of_index[b], config)
        if share is not None and share > config.most_disagreement:
            raise InputError(
                recording.folder / "recording.json",
                f"the poses found for {cameras[a].name} and {cameras[b].name} contradict each other: one sees through "
                f"{100 * share:.0f} % of what the other sees",
                REMEDY,
            )


def _moved_notes(seen: Sequence[SeenEquipment], moves: Sequence[Moved | None], count: int) -> list[str]:
    notes = []
    for one, moved in zip(seen, moves, strict=True):
        if moved is None:
            continue
        notes.append(moved_note(one.view.camera.name, moved, one.times_s))
    if len(notes) == 1 and count > 1 and len(seen) > 1:
        notes.append("only this camera saw that, so it may be the camera that was moved")
    return notes


def moved_note(camera: str, moved: Moved, times_s: Sequence[float]) -> str:
    """One sentence for people."""
    since = f"from about {times_s[moved.first]:.1f} s on"
    if moved.shift_m is None or moved.turn_rad is None:
        return f"camera {camera} no longer sees the equipment in its place {since}: what it hides there is not known"
    return (
        f"the equipment was moved as camera {camera} sees it: {since} it stands {1000 * moved.shift_m:.0f} mm and "
        f"{np.degrees(moved.turn_rad):.1f} degrees from where it stood; the world stays where it was"
    )


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
