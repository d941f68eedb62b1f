"""Find the clocks and poses of the cameras, the empty room and the patient, from frames spread over the recording.

If the equipment looks the same from two sides, the side that the patient faces is its front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from anchorpose.body.constraints import thin
from anchorpose.calibration.calibration import Calibration, PoseRecord, PoseSource
from anchorpose.calibration.clocks import Clocks, clocks_of_results, settle_clocks
from anchorpose.calibration.world import find_world
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.background import BackgroundModel
from anchorpose.isolation.empty_room import has_moved, is_outdated, learn_background
from anchorpose.isolation.other_place import usual_share, without_other_places
from anchorpose.isolation.scene import Scene, set_scene
from anchorpose.isolation.view import PixelLabel
from anchorpose.recording.depth_image import read_stream_image
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import FrameSet, Recording, align_clocks
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.given_poses import agreeing_poses
from anchorpose.tracker.initial_frame import ranked_by_view, with_best_initial_frame
from anchorpose.tracker.look import Look, look_around
from anchorpose.tracker.observing import isolate_first
from anchorpose.tracker.patient_choice import GIVEN_M, named_patient
from anchorpose.tracker.resting_objects import with_resting_objects
from anchorpose.tracker.room import NO_REVIEW, InitialFrame, Review, Room, Run
from anchorpose.tracker.sighting import rough_body_of, sight_people

# factor on the number of sampled frames if a camera has no image of the empty room. Without such an image, the empty
# room is composed from sampled frames in which people hide different parts of it
BLIND_SAMPLES = 3
# number of frames that are examined on each side of the frame in which the user gave the patient's place. In this
# number of frames, a person walks only half a step
AROUND: Final = 6
OUTDATED: Final = "the camera or its room has moved since the depth image of the empty room was recorded"
MOVED: Final = "moved during the recording, or its depth drifted: positions from before and after do not fit together"
LOOKS: Final = 3  # maximum number of frames from which the direction in which the patient faces is found


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """A recording with one clock and one world frame for all cameras, and the sampled frames from which they were
    found. chosen: positions of these frames in the recording.
    """

    recording: Recording
    clocks: Clocks
    calibration: Calibration
    chosen: tuple[int, ...]
    samples: tuple[FrameSet, ...]


def prepare_room(recording: Recording, config: TrackConfig, review: Review = NO_REVIEW) -> Room:
    """Return the clocks, camera poses, backgrounds and possible initial frames, before tracking.

    Raises InputError if camera poses cannot be found, or if given poses cannot be correct (``given_poses``).
    """
    settled = settle(recording, config, review)
    scenes = scenes_of(settled)
    return with_best_initial_frame(furnish_room(agreeing(settled, scenes), config, review, scenes), config)


def agreeing(settled: Settled, scenes: Sequence[Scene]) -> Settled:
    """Return the settled recording with notes on minor contradictions between camera poses; raises InputError if a
    given pose cannot be correct. scenes: one per camera, as from ``scenes_of``.
    """
    poses = agreeing_poses(settled.recording, settled.calibration, settled.clocks, scenes, settled.samples)
    return replace(settled, calibration=poses)


def settle(recording: Recording, config: TrackConfig, review: Review = NO_REVIEW) -> Settled:
    """Find the clocks and poses of all cameras. Known poses make the clocks more precise, and known clocks make poses
    that are found from people more precise, so clocks and poses are found in turn.

    The clocks and the floor height of reviewed results (``review``) are used unchanged. A depth image of the empty room
    that does not fit the recording is not used, and a note of the calibration states this. Raises InputError if a pose
    cannot be found.
    """
    recording, notes = _without_outdated_rooms(recording, config)
    settled = _settled_in_turn(recording, config, review)
    calibration = settled.calibration
    return replace(settled, calibration=replace(calibration, notes=(*calibration.notes, *notes)))


def _without_outdated_rooms(recording: Recording, config: TrackConfig) -> tuple[Recording, tuple[str, ...]]:
    """Return the recording without outdated depth images of the empty room, and a sentence on each camera that had such
    an image. An image is outdated if the camera or its room has moved since the image was recorded.
    """
    if all(room is None for room in recording.backgrounds_m):
        return recording, ()
    rooms, notes = list(recording.backgrounds_m), []
    for number, (camera, room) in enumerate(zip(recording.cameras, recording.backgrounds_m, strict=True)):
        frames = [] if room is None else _own_images(recording, number, config)
        if room is not None and frames and is_outdated(room, frames, camera):
            rooms[number] = None
            notes.append(f"camera {camera.name}: {OUTDATED}, so this image is not used; record the empty room again")
    return replace(recording, backgrounds_m=tuple(rooms)), tuple(notes)


def _own_images(recording: Recording, camera: int, config: TrackConfig) -> list[np.ndarray]:
    """Return depth images of one camera, spread over the tracked range. They are not paired with images of the other
    cameras, whose clocks are not known yet.
    """
    tracked = range(len(recording.streams[0].files))[config.start : config.stop]
    if not tracked:
        return []
    scale = (len(recording.streams[camera].files) - 1) / max(len(recording.streams[0].files) - 1, 1)
    chosen = np.linspace(tracked[0] * scale, tracked[-1] * scale, config.follow.samples)
    images = (read_stream_image(recording, camera, k).depth_m for k in np.unique(np.rint(chosen).astype(int)).tolist())
    return [image for image in images if image is not None]


def _settled_in_turn(recording: Recording, config: TrackConfig, review: Review) -> Settled:
    """Find the clocks and poses as ``settle`` does, using all depth images of the empty room that ``recording`` still
    has.
    """
    unplaced = len(recording.cameras) > 1 and any(camera.T_world_camera is None for camera in recording.cameras)
    by_people = unplaced and recording.equipment is None
    if not unplaced:
        return _settled(recording, recording.cameras, config, review)
    settled = _settled(recording, recording.cameras, config, rough_clocks=by_people)
    if by_people:
        return _settled(recording, settled.calibration.cameras, config)
    timed, clocks = settle_clocks(recording, settled.calibration.cameras, config.clocks)
    chosen, samples = sample_recording(timed, config)
    return Settled(timed, clocks, settled.calibration, tuple(chosen), tuple(samples))


def _settled(
    recording: Recording,
    cameras: Sequence[Camera],
    config: TrackConfig,
    review: Review = NO_REVIEW,
    rough_clocks: bool = False,
) -> Settled:
    """Find the clocks with the known camera poses, then find the poses that are not known."""
    if config.clocks.estimate and all(camera.name in review.clocks for camera in cameras):
        clocks = clocks_of_results(cameras, review.clocks)
        timed = align_clocks(recording, clocks.clocks)
    else:
        timed, clocks = settle_clocks(recording, cameras, config.clocks)
    chosen, samples = sample_recording(timed, config)
    calibration = calibrate(timed, samples, config, rough_clocks)
    if review.floor_height_m is not None:
        calibration = replace(calibration, floor_height_m=review.floor_height_m)
    return Settled(timed, clocks, calibration, tuple(chosen), tuple(samples))


def calibrate(
    recording: Recording, samples: Sequence[FrameSet], config: TrackConfig, rough_clocks: bool = False
) -> Calibration:
    """Find all camera poses that are not given. If the equipment looks the same from two sides, its front is the side
    that the patient faces; a body is fitted to the patient to find this side.

    The place that the user gave for the patient is not used here. It refers to the world frame of an earlier run, so
    this run must get the same world frame with and without that place.
    """
    anybody = replace(config, patient_xz_m=None, patient_frame=None)

    def choose_heading(cameras: tuple[Camera, ...], floor_m: float, headings: Sequence[np.ndarray]) -> int | None:
        records = tuple(PoseRecord(camera.name, PoseSource.EQUIPMENT) for camera in cameras)
        posed = replace(recording, cameras=cameras)
        provisional = Calibration(cameras, floor_m, (), (), records)
        # clocks are not needed, since each sample already has the frames of all cameras
        timeless = Clocks((), None)
        settled = Settled(posed, timeless, provisional, tuple(range(len(samples))), tuple(samples))
        return heading_of_patient(furnish_room(settled, anybody, NO_REVIEW), samples, headings, config)

    return find_world(recording, samples, config.equipment_pose, config.placing, choose_heading, rough_clocks)


def sample_recording(recording: Recording, config: TrackConfig) -> tuple[list[int], list[FrameSet]]:
    """Sample frames spread over the tracked range; return their positions and the frames."""
    first, count = config.start, len(recording.streams[0].time_s[config.start : config.stop])
    wanted = config.follow.samples * (1 if all(room is not None for room in recording.backgrounds_m) else BLIND_SAMPLES)
    chosen = np.unique(np.linspace(first, first + count - 1, min(wanted, count)).astype(int)).tolist()
    return chosen, [read_frame(recording, k) for k in chosen]


def furnish_room(
    settled: Settled, config: TrackConfig, review: Review, scenes: tuple[Scene, ...] | None = None
) -> Room:
    """Find the background of every camera, and the patient, from the sampled frames.

    scenes: one per camera, None to find them here. Tracking does not begin in a frame that a reviewer marked as
    unusable, unless all frames are marked.
    """
    recording, calibration = settled.recording, settled.calibration
    scenes = scenes_of(settled) if scenes is None else scenes
    if config.patient_frame is not None:
        initial = _frames_of_named(recording, scenes, config, config.patient_frame, review)
        if not initial:
            raise nobody_named(recording, scenes, config)
        return Room(recording, settled.clocks, calibration, scenes, initial, review)
    look = look_for_patient(settled, config, review, scenes)
    scenes, initial = look.scenes, look.initial_frames
    return Room(recording, settled.clocks, calibration, scenes, initial, review, notes=look.notes)


def look_for_patient(
    settled: Settled, config: TrackConfig, review: Review = NO_REVIEW, scenes: tuple[Scene, ...] | None = None
) -> Look:
    """Find all people in the sampled frames that no reviewer marked as unusable, and choose the patient.

    scenes: one per camera, None to find them here.
    """
    scenes = scenes_of(settled) if scenes is None else scenes
    samples = settled.samples
    usable = [k for k, frame_set in enumerate(samples) if review.why_unusable(frame_set.frame) is None]
    usable = usable or list(range(len(samples)))
    # only some of the samples are used, since fewer are needed to find the patient than to learn the empty room
    usable = [usable[k] for k in thin(len(usable), config.follow.samples)]
    positions = [settled.chosen[k] for k in usable]
    frames = [without_other_places(samples[k], scenes) for k in usable]
    return look_around(positions, frames, scenes, settled.recording.equipment, config)


def _frames_of_named(
    recording: Recording, scenes: Sequence[Scene], config: TrackConfig, frame: int, review: Review
) -> tuple[InitialFrame, ...]:
    """Return the possible initial frames for a patient whose place in one frame is given: this frame, and frames just
    before and after it, within the tracked range.

    The result is empty if no person stands at the given place in this frame. Raises InputError if the tracked range
    has no frame ``frame``.
    """
    here, tracked = _position(recording, frame), range(len(recording.streams[0].files))[config.start : config.stop]
    if here not in tracked:
        first, last = (recording.streams[0].frame[tracked[k]] for k in (0, -1))
        problem = f"is tracked from frame {first} to {last}, but the patient's place is given in frame {frame}"
        raise InputError(recording.folder, problem, "give a frame of this range after the @, or track more frames")
    positions = range(max(here - AROUND, tracked.start), min(here + AROUND + 1, tracked.stop))
    sightings = [sight_people(without_other_places(read_frame(recording, k), scenes), scenes) for k in positions]
    named = named_patient(sightings, here - positions.start, np.array(config.patient_xz_m))
    if named is None:
        return ()
    there = [k for k, one in enumerate(named.seen) if one is not None]
    free = [k for k in there if review.why_unusable(sightings[k].frame) is None] or there
    return ranked_by_view(named, [positions[k] for k in free], [sightings[k] for k in free], free)


def _position(recording: Recording, frame: int) -> int:
    found = np.flatnonzero(recording.streams[0].frame == frame)
    if not len(found):
        raise InputError(recording.folder, f"has no frame {frame}", "give a frame of the recording after the @")
    return int(found[0])


def nobody_named(recording: Recording, scenes: Sequence[Scene], config: TrackConfig) -> InputError:
    """Return the error to raise if no person stands at the place that the user gave for the patient. The error states
    where people are in the frame for which the place was given; if no frame was given, in the first tracked frame.
    """
    frame, (x, z) = config.patient_frame, config.patient_xz_m or (np.nan, np.nan)
    position = config.start if frame is None else _position(recording, frame)
    people = sight_people(read_frame(recording, position), scenes).people
    seen = " and ".join(f"{x:.2f},{z:.2f}" for x, z in (one.place_xz_m for one in people))
    when = "in the sampled frames" if frame is None else f"in frame {frame}"
    where = f"in frame {recording.streams[0].frame[position]}, {f'people are at {seen}' if seen else 'nobody is seen'}"
    problem = f"shows nobody within {GIVEN_M} m of x {x:.2f}, z {z:.2f} {when}; {where}"
    return InputError(recording.folder, problem, "give another place, or another frame: --patient x,z@frame")


def scenes_of(settled: Settled) -> tuple[Scene, ...]:
    """Learn every camera's empty room; return one scene per camera."""

    def scene_of(number: int, camera: Camera) -> Scene:
        empty = set_scene(camera, _background(settled, number), settled.recording.equipment)
        return with_resting_objects(empty, number, settled.samples)

    return tuple(scene_of(number, camera) for number, camera in enumerate(settled.calibration.cameras))


def _background(settled: Settled, number: int) -> BackgroundModel:
    recording, camera = settled.recording, settled.calibration.cameras[number]
    frames = [depth for sample in settled.samples if (depth := sample.depths_m[number]) is not None]
    if not frames:
        where = recording.folder / camera.name
        raise InputError(where, "none of the sampled depth images can be read", "record or copy this camera again")
    floor_m, equipment = settled.calibration.floor_height_m, recording.equipment
    model = learn_background(recording.backgrounds_m[number], frames, camera, floor_m, equipment)
    share = usual_share(model.depth_m, model.sigma_m, frames)
    return replace(model, usual_share=share, moved=has_moved(model, frames))


def heading_of_patient(
    room: Room, samples: Sequence[FrameSet], headings: Sequence[np.ndarray], config: TrackConfig
) -> int | None:
    """Return the index of the heading (a horizontal unit vector, (3,)) that is nearest to the patient's facing; None if
    the examined frames disagree, or if no frame shows the facing.

    room: its initial frames are numbered by their index in ``samples``, not by their position in the recording. Several
    frames are used, because in a single frame another person may be mistaken for a part of the patient.
    """
    looks = [one for one in room.initial_frames if one.choice.sure][:LOOKS]
    faced = [facing for look in looks if (facing := _facing(room, samples[look.frame], look, config)) is not None]
    nearest = {int(np.argmax([facing @ heading for heading in headings])) for facing in faced}
    return nearest.pop() if len(nearest) == 1 else None


def _facing(room: Room, frame_set: FrameSet, look: InitialFrame, config: TrackConfig) -> np.ndarray | None:
    """Return the horizontal direction (3,) in which the patient faces; None if too little of the patient is seen."""
    isolated = isolate_first(frame_set, look.choice, Run(room, config))
    body = rough_body_of(isolated.views, room.cameras, PixelLabel.PATIENT)
    return None if body is None else np.array([body.facing_xz[0], 0.0, body.facing_xz[1]])
