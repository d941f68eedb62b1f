"""Provide the data that every method of the experiment is given: the body, the pose at the start, and the patient's
pixels.

In the paper, body, pose and pixels come from the sensor's own tracker on unoccluded data. In this experiment, they come
from this project's tracker on the recording without holes. No method sees the truth.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import FittedShape, body_points, build_body
from anchorpose.errors import AnchorposeError
from anchorpose.geodesics.anchors import no_anchors
from anchorpose.isolation.bystander_memory import empty_memory
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.motion.prediction import load_motions
from anchorpose.recording.reader import read_frame
from anchorpose.recording.recording import Clock, FrameSet, Recording
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.bystanders import Bystanders
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.observation import Expectation, Isolated, Observation, SeenSurface, Start
from anchorpose.tracker.observing import gather, see_anchors, see_surface
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room, Run


class NoReference(AnchorposeError):
    """The error that is raised if the patient is not found in a recording, so that no method can start."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """The data of t frames that every method is given, found by this project's tracker before holes were cut into the
    depth images.

    Poses are NaN in frames in which the patient was lost.
    """

    T_world_camera: np.ndarray  # (k, 4, 4), the cameras' poses, given or found, so that all methods share one world
    shape: FittedShape  # the learnt body
    rotations: np.ndarray  # (t, b, 3, 3), rotations of the b bones in the pose
    root_m: np.ndarray  # (t, 3), position of the body's root in the pose
    joints_m: np.ndarray  # (t, 21, 3), world
    centre_m: np.ndarray  # (t, 3), mean position of the patient's visible surface, world
    # one array per camera, (t, height, width) uint8 of ``PixelLabel``; a frame that was not labelled has only
    # ``NO_READING``; the tuple is empty if labels were not requested
    labels: tuple[np.ndarray, ...]
    clocks: tuple[Clock, ...]  # clocks of the cameras, by which images of the same time are paired

    @property
    def found(self) -> np.ndarray:
        """Return (t,) bool: frames in which the patient was found."""
        return np.isfinite(self.root_m).all(axis=1)

    def pose(self, frame: int) -> Pose:
        """Return the pose in a frame in which the patient was found."""
        return Pose(self.rotations[frame], self.root_m[frame])


def make_reference(recording: Recording, config: TrackConfig, labelled: bool = True) -> Reference:
    """Track a recording by this project's tracker, and return the results as a reference; the reference that methods
    are given is made from the recording without holes.

    labelled: whether to include the labels of pixels.

    Raises NoReference if no patient is found, and InputError if the cameras' poses in the world cannot be found.
    """
    room = prepare_room(recording, config)
    run = Run(room, config, load_motions(config.motion_file, recording.rate_hz, config.motion))
    route = plan_route(room, config, lambda: None)
    learnt = learn_on(route, run)
    if learnt is None:
        raise NoReference(f"{recording.folder.name}: nobody was found in it, so no method can start.")
    body = build_body(body_points(), learnt.shape)
    frames, bones = len(recording.streams[0].files), len(body.points.asset.bone_names)
    rotations, root = np.full((frames, bones, 3, 3), np.nan), np.full((frames, 3), np.nan)
    joints, centre = np.full((frames, 21, 3), np.nan), np.full((frames, 3), np.nan)
    cameras = room.cameras if labelled else ()
    labels = tuple(np.zeros((frames, camera.height, camera.width), np.uint8) for camera in cameras)
    for side in (route.backward, route.forward):
        estimates = follow_patient(run, route.frames(side), learnt.shape)
        for position, estimate in zip(side, estimates, strict=True):
            if estimate.observation is None:
                continue
            for of_camera, view in zip(labels, estimate.observation.evidence.views, strict=labelled):
                if view is not None:
                    of_camera[position] = view.labels
            if estimate.belief is None or len(estimate.observation.surface) == 0:
                continue
            pose = estimate.belief.pose
            rotations[position], root[position] = pose.rotations, pose.root_m
            joints[position] = body.joints(pose)
            centre[position] = estimate.observation.surface.points_m.mean(axis=0, dtype=np.float64)
    poses = np.array([camera.require_pose() for camera in room.cameras])
    return Reference(poses, learnt.shape, rotations, root, joints, centre, labels, room.clocks.clocks)


def in_its_world(recording: Recording, reference: Reference) -> Recording:
    """Return the recording (or its copy with holes) in the reference's world: with the reference's camera poses."""
    cameras = tuple(
        replace(camera, T_world_camera=T) for camera, T in zip(recording.cameras, reference.T_world_camera, strict=True)
    )
    return replace(recording, cameras=cameras)


def to_arrays(reference: Reference) -> dict[str, np.ndarray]:
    """Return the reference as arrays, for a file."""
    return {
        "T_world_camera": reference.T_world_camera,
        "coefficients": reference.shape.coefficients,
        "offset_m": reference.shape.offset_m,
        "missing": np.array(reference.shape.missing, np.str_),
        "clocks": np.array([(clock.ahead_s, clock.drift, clock.at_s) for clock in reference.clocks]),
        "rotations": reference.rotations,
        "root_m": reference.root_m,
        "joints_m": reference.joints_m,
        "centre_m": reference.centre_m,
        **{f"labels_{number}": of_camera for number, of_camera in enumerate(reference.labels)},
    }


def from_arrays(arrays: Mapping[str, np.ndarray]) -> Reference:
    """Return the reference from the arrays of ``to_arrays``."""
    shape = FittedShape(arrays["coefficients"], arrays["offset_m"], tuple(arrays["missing"].tolist()))
    poses = arrays["T_world_camera"]
    labels = tuple(arrays[f"labels_{number}"] for number in range(len(poses)))
    clocks = tuple(Clock(ahead_s=ahead_s, drift=drift, at_s=at_s) for ahead_s, drift, at_s in arrays["clocks"].tolist())
    rotations, root_m, joints_m, centre_m = (arrays[name] for name in ("rotations", "root_m", "joints_m", "centre_m"))
    return Reference(poses, shape, rotations, root_m, joints_m, centre_m, labels, clocks)


class GivenFrames:
    """The frames of a recording with the patient's pixels, which are given, and the surfaces that these pixels show.

    Frames and surfaces are made once for all methods and all forms of the paper's framework, which therefore use the
    same data. Only methods that close holes in the mesh with the predicted body use another surface. uncut: the same
    recording without holes; frames that lost no readings, and their surfaces, are taken from it.
    """

    def __init__(
        self, room: Room, reference: Reference, uncut: GivenFrames | None = None, cut: np.ndarray | None = None
    ):
        """Store the frames. cut (t,) bool: the frames that lost readings; None = all frames."""
        self.room, self.reference = room, reference
        self._starts: dict[tuple[int, Hashable], Start] = {}
        self._uncut = uncut
        self._cut = np.ones(len(self), bool) if cut is None or uncut is None else cut
        self._frames: dict[int, FrameSet] = {}
        self._surfaces: dict[tuple[int, SurfaceConfig], SeenSurface] = {}
        self._position = {int(frame): position for position, frame in enumerate(room.recording.streams[0].frame)}

    def __len__(self) -> int:
        return len(self.room.recording.streams[0].files)

    def _same_as_uncut(self, position: int) -> GivenFrames | None:
        """Return ``uncut`` if the frame at this position lost no readings to a hole, else None."""
        return None if self._cut[position] else self._uncut

    def start(self, position: int, observing: Hashable, make: Callable[[], Start]) -> Start:
        """Return the start of tracking in the frame at a position, made only once for all runs with equal
        ``observing``.

        observing: the settings on which the observation of a frame depends.
        """
        same, key = self._same_as_uncut(position), (position, observing)
        if same is not None:
            return same.start(position, observing, make)
        if key not in self._starts:
            self._starts[key] = make()
        return self._starts[key]

    def frame(self, position: int) -> FrameSet:
        """Return the frame at a position in the recording."""
        same = self._same_as_uncut(position)
        if same is not None:
            return same.frame(position)
        if position not in self._frames:
            self._frames[position] = read_frame(self.room.recording, position)
        return self._frames[position]

    def observe(
        self, frame_set: FrameSet, expected: Expectation | None, height_m: float, run: Run, anchored: bool
    ) -> Observation:
        """Return the observation of the patient in a frame: the surface of the given pixels, and the anchors (tips of
        head, hands and feet) on it.

        expected: the place and pose that the method expects, by which each anchor is assigned to head, hand or foot.
        height_m: the patient's height. anchored: False if the method uses no anchors, so that none are searched.
        """
        surface = self._surface(self._position[frame_set.frame], expected, run)
        anchors = see_anchors(surface, expected, height_m, run) if anchored else no_anchors()
        return gather(frame_set, expected, _isolated(surface.evidence.views), surface, anchors, run)

    def _surface(self, position: int, expected: Expectation | None, run: Run) -> SeenSurface:
        same, config = self._same_as_uncut(position), run.config.surface
        if same is not None:
            return same._surface(position, expected, run)
        if config.by_body:
            return see_surface(_isolated(self._views(position)), expected, run)
        key = position, config
        if key not in self._surfaces:
            self._surfaces[key] = see_surface(_isolated(self._views(position)), None, run)
        return self._surfaces[key]

    def _views(self, position: int) -> tuple[View | None, ...]:
        """Return each camera's depth frame with the given label of each pixel. Pixels whose reading a hole removed have
        no label.
        """
        before = None if self._uncut is None else self._uncut.frame(position)
        views = list[View | None]()
        for number, depth_m in enumerate(self.frame(position).depths_m):
            if depth_m is None:
                views.append(None)
                continue
            labels, whole = self.reference.labels[number][position], None if before is None else before.depths_m[number]
            taken = np.zeros_like(depth_m, bool) if whole is None else (whole > 0) & (depth_m == 0)
            labels = np.where(taken, np.uint8(PixelLabel.NO_READING), labels)
            views.append(View(np.where(labels == PixelLabel.NO_READING, np.float32(0.0), depth_m), labels))
        return tuple(views)


def _isolated(views: tuple[View | None, ...]) -> Isolated:
    """Return the cameras' labelled depth frames in the form in which the stage ``isolation`` returns them, but without
    other people: neither remembered people nor bystanders' bodies.
    """
    return Isolated((None,) * len(views), views, empty_memory(), Bystanders())
