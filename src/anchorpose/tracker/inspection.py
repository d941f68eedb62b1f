"""Run a single frame through all stages, as the command ``track`` does, and keep every intermediate result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.body.skin_points import FittedShape
from anchorpose.camera import Camera
from anchorpose.errors import InputError
from anchorpose.isolation.scene import Scene
from anchorpose.motion.prediction import load_motions
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.track_tree.global_hypothesis import GlobalHypothesis
from anchorpose.track_tree.hypotheses import Hypotheses
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import follow_openly
from anchorpose.tracker.initial_frame import rank_initial_frames
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import observe_first
from anchorpose.tracker.passes import Route, learn_on, plan_route, start_of
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.prior_shape import ORDINARY_HEIGHT_M, ordinary_height_m
from anchorpose.tracker.room import InitialFrame, Room, Run
from anchorpose.tracker.sighting import sight_people

# maximum number of frames from the recording's initial frame to the inspected frame; tracking so many frames takes
# about 30 s. If the recording's initial frame is farther away, tracking starts at a frame nearer to the inspected frame
MOST_FOLLOWED = 60
# number of frames next to the inspected frame, on the side of the recording's initial frame, in which tracking may
# start; and the number of these frames that are examined
NEARBY, NEARBY_SAMPLES = 45, 10


@dataclass(frozen=True, slots=True, eq=False)
class Next:
    """The frame after the inspected frame, and the matches between the nodes of both frames."""

    observation: Observation
    links: Hypotheses  # possible matches of each node of the inspected frame in the next frame
    # the best branches of the track tree (chains of matches over several frames), and the matches that follow from them
    hypothesis: GlobalHypothesis


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The results of every stage for one frame."""

    room: Room
    frame_set: FrameSet
    observation: Observation | None  # results of the stages before registration; None if no patient was searched for
    estimate: Estimate | None  # None if the patient was not found
    next: Next | None  # None if the recording ends here or the patient was not found
    height_m: float  # m, the patient's height; the expected distances between anchors are proportional to this height
    account: tuple[str, ...]  # sentences for the user about the steps taken and the reasons for missing results


@dataclass(frozen=True, slots=True, eq=False)
class InspectedCamera:
    """One camera of an inspection: its number, and its depth image (height, width) in metres."""

    inspection: Inspection
    number: int
    depth_m: np.ndarray
    config: TrackConfig

    @property
    def camera(self) -> Camera:
        """Return the camera with the pose that tracking uses."""
        return self.inspection.room.cameras[self.number]

    @property
    def time_s(self) -> float:
        """Return the time of the depth image on the reference clock."""
        return self.inspection.frame_set.time_s

    @property
    def scene(self) -> Scene:
        """Return the camera's scene: its empty room and the equipment, as learnt before tracking."""
        return self.inspection.room.scenes[self.number]


@dataclass(frozen=True, slots=True, eq=False)
class _Reached:
    """The patient as tracked up to the inspected frame."""

    estimate: Estimate
    next: Next | None
    height_m: float


def position_of(recording: Recording, frame: int) -> int:
    """Return the position of a frame number in the first camera's stream; raises InputError for an unknown number."""
    numbers = recording.streams[0].frame
    found = np.flatnonzero(numbers == frame)
    if not len(found):
        problem = f"has no frame {frame} (its frames are {numbers[0]} to {numbers[-1]})"
        raise InputError(recording.folder, problem, "choose one of these; the number is that of the depth image's file")
    return int(found[0])


def inspect_frame(
    recording: Recording, frame: int, config: TrackConfig, as_tracked: bool, tick: Callable[[], None]
) -> Inspection:
    """Return the results of all stages for the frame with the number ``frame``.

    as_tracked: learn the body and follow the patient from the initial frame, as ``track`` does. Learning and following
    take as long as ``track`` does, and give exactly the joints of ``track``. If ``as_tracked`` is False, tracking
    starts at a nearby frame, with a first guess of the body. config.patient_xz_m: place of the patient in the initial
    frame if as_tracked, otherwise in the inspected frame. tick: function that is called for every frame that is read.
    Raises InputError if the recording has no frame with this number.
    """
    position, room = position_of(recording, frame), prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))
    route = plan_route(room, config, tick)
    if position not in {*route.forward, *route.backward}:
        problem = f"frame {frame} is outside of the frames that the settings track"
        raise InputError(recording.folder, problem, "change start and stop in the settings")
    frame_set = next(route.frames([position]))
    if room.initial_frame is None:
        why = "Nobody was seen in the frames that were sampled, so there is no patient to look for."
        return Inspection(room, frame_set, None, None, None, ORDINARY_HEIGHT_M, (why,))
    reached, account = (_as_tracked if as_tracked else _from_nearby)(route, position, run)
    if reached is not None:
        return Inspection(
            room, frame_set, reached.estimate.observation, reached.estimate, reached.next, reached.height_m, account
        )
    height_m = ordinary_height_m(recording)
    here = _choose(route, [position], room, config)
    choice = here[0].choice if here else room.initial_frame.choice
    seen = observe_first(frame_set, choice, height_m, run)
    return Inspection(room, frame_set, seen, None, None, height_m, account)


def _as_tracked(route: Route, position: int, run: Run) -> tuple[_Reached | None, tuple[str, ...]]:
    learnt = learn_on(route, run)
    if learnt is None or run.room.initial_frame is None:
        return None, ("No body could be fitted to this person, so track finds no joint in any frame.",)
    room = learnt.where_found(run.room)
    run = replace(run.with_learnt(learnt.belief), room=room)
    initial = replace(room.initial_frames[0], start=start_of(route, run, learnt))
    reached = _follow(route, initial, position, learnt.shape, run)
    if reached is None:
        return None, ("The patient is lost in this frame: track gives no joint here either.",)
    return reached, (f"As in track: the body was learnt, and followed from frame {_number(room, initial.frame)}.",)


def _from_nearby(route: Route, position: int, run: Run) -> tuple[_Reached | None, tuple[str, ...]]:
    """Track as ``track`` does, but from a nearby frame and with a first guess of the body. Also return sentences for
    the user about these steps.
    """
    for initial in _initial_frames_nearby(route, position, run.room, run.config):
        reached = _follow(route, initial, position, None, run)
        if reached is not None:
            return reached, (
                "The body here is a first guess from the height; track learns it over four seconds "
                "(--as-tracked does the same, and takes as long).",
                f"The patient was looked for in frame {_number(run.room, initial.frame)} and followed from there.",
            )
    return None, (
        "No body explains what is seen where the patient should be, so there are no joints in this frame.",
        "If track finds the patient in other frames, --as-tracked follows the patient from there; "
        "if the wrong person is blue, give the patient's place with --patient x,z.",
    )


def _initial_frames_nearby(route: Route, position: int, room: Room, config: TrackConfig) -> list[InitialFrame]:
    """Return the frames where tracking may start, in the order in which they are tried. The recording's initial frame
    comes first if it is near. Otherwise, the best of some frames near the inspected frame comes first; these frames lie
    on the side of the recording's initial frame. The inspected frame comes last. If the user gave the patient's place,
    only the inspected frame is returned.
    """
    here = _choose(route, [position], room, config)
    if config.patient_xz_m is not None or room.initial_frame is None:
        return here
    distance = position - room.initial_frame.frame
    if abs(distance) <= MOST_FOLLOWED:
        return [room.initial_frame, *here]
    before = np.linspace(position - np.sign(distance) * NEARBY, position, NEARBY_SAMPLES).astype(int)
    return [*_choose(route, before.tolist(), room, config), *here]


def _choose(route: Route, positions: Sequence[int], room: Room, config: TrackConfig) -> list[InitialFrame]:
    """Choose the best initial frame among some frames, as ``track`` does; an empty list if no patient is seen."""
    sightings = [sight_people(frame_set, room.scenes) for frame_set in route.frames(positions)]
    equipment, place = room.recording.equipment, config.patient_xz_m
    return list(rank_initial_frames(positions, sightings, equipment, place, room.cameras)[:1])


def _follow(route: Route, initial: InitialFrame, position: int, shape: FittedShape | None, run: Run) -> _Reached | None:
    """Follow the patient from an initial frame to the frame at ``position``; None if the patient is not found there."""
    frames = route.frames(_course(initial.frame, position, route, run))
    for estimate, tracker in follow_openly(run, frames, initial.choice, shape, initial.start):
        if tracker is None and shape is None:
            return None  # searching every frame is slow without a learnt shape, so the next initial frame is tried
        if estimate.frame_set.frame == _number(run.room, position):
            if tracker is None or estimate.belief is None:
                return None
            return _Reached(estimate, _what_comes_next(tracker, frames), tracker.height_m)
    return None


def _course(first: int, position: int, route: Route, run: Run) -> Sequence[int]:
    """Return the positions of the frames to track: from ``first`` to the inspected frame and the frames of its
    look-ahead, within the tracked range.
    """
    initial = run.room.initial_frame.frame if run.room.initial_frame else position
    direction = 1 if position >= initial else -1
    low, high = min([*route.forward, *route.backward]), max([*route.forward, *route.backward])
    last = int(np.clip(position + direction * run.config.follow.look_ahead, low, high))
    return range(int(np.clip(first, low, high)), last + direction, direction)


def _what_comes_next(tracker: PatientTracker, frames: Iterator[FrameSet]) -> Next | None:
    """Return the frame after the inspected frame and its matches; None if the recording ends or this frame does not
    show the patient. The following frames are first added to the tracker's window, up to the whole look-ahead.
    """
    while len(tracker.window) <= tracker.config.follow.look_ahead:
        frame_set = next(frames, None)
        if frame_set is None:
            break
        tracker.step(frame_set, only_look=True)
    hypothesis = tracker.next_hypothesis()
    return None if hypothesis is None else Next(tracker.window[1], tracker.window.matchers()[0].all(), hypothesis)


def _number(room: Room, position: int) -> int:
    return int(room.recording.streams[0].frame[position])
