"""Find every camera's pose in Gamma_0, the world of the equipment, and detect equipment that is moved."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np

from anchorpose.calibration.calibration import Calibration, DoubtSource, PoseDoubt, PoseFigure, PoseRecord, PoseSource
from anchorpose.calibration.equipment_agreement import (
    REMEDY,
    ChooseHeading,
    EquipmentInputs,
    SeenEquipment,
    common_floor,
    refuse_contradiction,
    resolve_symmetry,
)
from anchorpose.calibration.equipment_model import Equipment, prepare_equipment
from anchorpose.calibration.equipment_pose import (
    EquipmentPose,
    EquipmentPoseConfig,
    NoEquipmentPose,
    NoPose,
    angle_between,
    find_equipment,
    refit,
)
from anchorpose.calibration.equipment_refine import FloorPrior, StillView, see_still, standing_prior
from anchorpose.calibration.first_frames import NOISE_GATE, FloorPlane, NoFloor, find_floor, noise_per_m, what_stays
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.errors import InputError
from anchorpose.recording.recording import FrameSet, Recording

# share of the sampled frames, at the end of the recording, in which the equipment is searched again
LATE_SHARE: Final = 0.34
LEAST_FRAMES: Final = 3
MOVED_SIGMAS: Final = 5.0  # standard deviations of the pose; if the pose changes by more, the equipment was moved
# m, minimum shift that counts as a movement; twice the accuracy that a calibration must have
LEAST_SHIFT_M: Final = 0.008
LEAST_TURN_RAD: Final = 0.0105  # rad (0.6 degrees), minimum turn that counts as a movement of the equipment
# if the camera reads something behind more than this share of the equipment that nothing hides, the equipment is not in
# the assumed place, and is searched for on the whole floor
DOUBT_SHARE: Final = 0.2
# if more than this share of the unhidden equipment is seen through, the equipment counts as gone
GONE_SHARE: Final = 0.4
# m and rad (3 degrees); tracking is refused if the equipment is seen farther than this from the place where it should
# be according to a given pose. A given pose that is wrong by 3 cm and 1 degree puts equipment at a distance of 2.5 m
# only 7 cm from its true place.
REFUTED_M, REFUTED_RAD = 0.10, 0.052
# minimum number of pixels that show the equipment or see through it; with fewer, frames are no evidence
LEAST_PIXELS: Final = 100


@dataclass(frozen=True, slots=True, eq=False)
class Moved:
    """A movement of the equipment. first: index of the first frame that shows it elsewhere; shift_m, turn_rad: size of
    the movement, None if the new pose was not found.
    """

    first: int
    shift_m: float | None = None
    turn_rad: float | None = None


def check_given_poses(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    floors: Sequence[FloorPlane | NoFloor],
    floor_height_m: float,
    config: EquipmentPoseConfig,
) -> tuple[list[PoseDoubt], list[str]]:
    """Return doubts about given poses that put the equipment where it is not seen, and notes on moved equipment.

    floors: one per camera.
    """
    doubts, notes = list[PoseDoubt](), list[str]()
    if recording.equipment is None:
        return doubts, notes
    inputs = EquipmentInputs(recording, sample_frames, prepare_equipment(recording.equipment), config)
    prior = standing_prior(floor_height_m)
    for index, (camera, floor) in enumerate(zip(recording.cameras, floors, strict=True)):
        moved = None if isinstance(floor, NoFloor) else _where_given_pose_has_none(inputs, index, floor, prior)
        if moved is None:
            continue
        if moved.first > 0:
            notes.append(moved_note(camera.name, moved, inputs.frames_of(index)[1]))
        else:
            doubts.append(_doubt(camera.name, moved))
    return doubts, notes


def _where_given_pose_has_none(
    inputs: EquipmentInputs, index: int, floor: FloorPlane, prior: FloorPrior
) -> Moved | None:
    """Return, in the form of a movement, how far the equipment is seen from the place that follows from the camera's
    given pose; None if the frames do not contradict the given pose.
    """
    frames, _ = inputs.frames_of(index)
    if not frames:
        return None
    camera, background = inputs.recording.cameras[index], inputs.recording.backgrounds_m[index]
    view = see_still(replace(camera, T_world_camera=None), frames, background, noise_per_m(frames), floor)
    return notice_movement(view, frames, invert_rigid(camera.require_pose()), inputs.equipment, prior, inputs.config)


def _doubt(camera: str, moved: Moved) -> PoseDoubt:
    if moved.shift_m is None or moved.turn_rad is None:
        sentence = f"the given pose of camera {camera} puts the equipment where this camera sees through it"
        return PoseDoubt(DoubtSource.EQUIPMENT, (camera,), sentence, float("nan"), False)
    sentence = (
        f"the given pose of camera {camera} puts the equipment {1000 * moved.shift_m:.0f} mm and "
        f"{np.degrees(moved.turn_rad):.1f} degrees from where this camera sees it"
    )
    refuted = moved.shift_m > REFUTED_M or moved.turn_rad > REFUTED_RAD
    return PoseDoubt(DoubtSource.EQUIPMENT, (camera,), sentence, moved.shift_m, refuted)


def moved_note(camera: str, moved: Moved, times_s: Sequence[float]) -> str:
    """Return a sentence for users that describes how the equipment was moved."""
    since = f"from about {times_s[moved.first]:.1f} s on"
    if moved.shift_m is None or moved.turn_rad is None:
        return f"camera {camera} no longer sees the equipment in its place {since}: what it hides there is unknown"
    return (
        f"the equipment was moved as camera {camera} sees it: {since} it stands {1000 * moved.shift_m:.0f} mm and "
        f"{np.degrees(moved.turn_rad):.1f} degrees from where it stood; the world stays where it was"
    )


def notice_movement(
    view: StillView,
    frames_m: Sequence[np.ndarray],
    T_camera_model: np.ndarray,
    equipment: Equipment,
    prior: FloorPrior,
    config: EquipmentPoseConfig,
) -> Moved | None:
    """Return how the equipment has moved by the end of ``frames_m``, which are in the order of time; None if the
    equipment did not move.

    Only the camera's noise and floor are taken from ``view``. A shift within a bar's width is found by fitting the pose
    again. A larger shift is found because the camera sees through the places where the equipment was.
    """
    count = round(LATE_SHARE * len(frames_m))
    if count < LEAST_FRAMES:
        return None
    late_view = replace(view, frames_m=np.stack(frames_m[-count:]))
    counts = partial(_pixel_counts, view, equipment, config.tolerance_m)
    now = refit(late_view, equipment, T_camera_model, prior, config)
    if not isinstance(now, EquipmentPose):
        through = _through_share(counts(T_camera_model, frames_m[-count:]))
        if through < DOUBT_SHARE:
            return None
        now = find_equipment(late_view, equipment, config)
        if not isinstance(now, EquipmentPose):
            return Moved(_first_gone(counts(T_camera_model, frames_m))) if through >= GONE_SHARE else None
    centre, T_now = equipment.samples.centre_m, _nearest_symmetric(now.fit.T_camera_model, T_camera_model, equipment)
    shift = float(np.linalg.norm(transform_points(T_now, centre) - transform_points(T_camera_model, centre)))
    turn = angle_between(T_now, T_camera_model)
    far = shift > max(LEAST_SHIFT_M, MOVED_SIGMAS * now.sigma_m)
    turned = turn > max(LEAST_TURN_RAD, MOVED_SIGMAS * now.sigma_rad)
    if not far and not turned:
        return None
    return Moved(_first_elsewhere(counts(T_camera_model, frames_m), counts(T_now, frames_m)), shift, turn)


def _nearest_symmetric(T_now: np.ndarray, T_before: np.ndarray, equipment: Equipment) -> np.ndarray:
    """Return, among poses that are equivalent by the equipment's symmetry, the pose nearest to the earlier pose."""
    choices = [T_now, *(T_now @ turn for turn in equipment.symmetry.same)]
    return min(choices, key=lambda T: angle_between(T, T_before))


def _pixel_counts(
    view: StillView,
    equipment: Equipment,
    tolerance_m: float,
    T_camera_model: np.ndarray,
    frames_m: Sequence[np.ndarray],
) -> np.ndarray:
    """Return (n, 2) int: how many pixels of each frame show the equipment at a pose, and how many see through it."""
    rendering = equipment.caster.render(view.camera, T_camera_model)
    if rendering is None:
        return np.zeros((len(frames_m), 2), dtype=np.int64)
    surface = np.isfinite(rendering.depth_m)
    expected = np.where(surface, rendering.depth_m, 0)
    gate, counts = tolerance_m + NOISE_GATE * view.noise_per_m * expected**2, []
    for frame in frames_m:
        seen = frame[rendering.window]
        there, off = surface & (seen > 0), seen - expected
        counts.append([np.count_nonzero(there & mask) for mask in (np.abs(off) < gate, off > gate)])
    return np.array(counts)


def _through_share(counts: np.ndarray) -> float:
    on, through = counts.sum(axis=0)
    return float(through / (on + through)) if on + through >= LEAST_PIXELS else 0.0


def _first_gone(counts: np.ndarray) -> int:
    """Return the index of the first frame after the last frame that shows the equipment in its place."""
    total = counts.sum(axis=1)
    shown = np.flatnonzero((total >= LEAST_PIXELS) & (counts[:, 1] < GONE_SHARE * total))
    return min(int(shown[-1]) + 1, len(counts) - 1) if len(shown) else 0


def _first_elsewhere(before: np.ndarray, now: np.ndarray) -> int:
    """Return the index of the first frame after the movement: the index that best separates the frames that show the
    equipment at the earlier pose from the frames that show it at the later pose.
    """
    gain = (now[:, 0] - now[:, 1]) - (before[:, 0] - before[:, 1])
    return int(np.argmax(np.append(np.cumsum(gain[::-1])[::-1], 0)))


def world_from_equipment(
    recording: Recording,
    sample_frames: Sequence[FrameSet],
    config: EquipmentPoseConfig,
    choose_heading: ChooseHeading | None = None,
) -> Calibration:
    """Find the poses of all cameras that have none, in the equipment's frame Gamma_0; given poses are in this frame
    already.

    First each camera is placed separately. Then symmetries of the equipment are resolved, by comparing cameras and by
    ``choose_heading``. Finally all cameras get a common floor. Raises InputError if a pose is not accepted, or if two
    cameras contradict each other.
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
    return Calibration(tuple(cameras), prior.height_m, (), tuple(notes), tuple(records))


def _find_in_camera(inputs: EquipmentInputs, index: int) -> SeenEquipment:
    """Find the equipment in one camera: in the image of the empty room or, if this fails, in all frames. Without such
    an image, all frames are tried first, then only the first half of the frames. Raises InputError if the equipment is
    not found.
    """
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
    reasons = list[NoEquipmentPose]()
    for room, used in attempts:
        found = _attempt(inputs, camera, used, room)
        if not isinstance(found, NoEquipmentPose):
            return SeenEquipment(index, found[0], frames, times, found[1])
        reasons.append(found)
    part = f" ({reasons[0].part})" if reasons[0].part else ""
    problem = f"camera_to_world is null for {camera.name}, and this camera {reasons[0].why.value}{part}"
    raise InputError(recording.folder / "recording.json", problem, REMEDY)


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


def _polish(
    inputs: EquipmentInputs, one: SeenEquipment, start: np.ndarray, moved: Moved | None, prior: FloorPrior
) -> EquipmentPose:
    """Refine the pose again with all cameras' common floor, on all frames that show the equipment in this place and, if
    the equipment was found in it, the frame of the empty room. If the refined pose is not accepted, try again on the
    frame of the empty room alone (if it was used), then on the frames in which the equipment was found, with the floor
    of ``standing_prior``, which has larger sigmas than the common floor. If no refined pose is accepted, return the
    earlier pose.
    """
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
