"""The tracking framework of the paper, in which each method replaces the association (Section V), and its start.

Every method gets the patient's body and the pose in the frames that tracking starts in. The paper takes both from the
sensor's own tracker on unoccluded data; here they come from this project's tracker, on the recording before anything is
removed from it. No method sees the truth.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from anchorpose.association.hypotheses import GateConfig, HypothesisConfig
from anchorpose.body.belief import PoseBelief, vague_belief
from anchorpose.body.pose import Pose
from anchorpose.body.skin_points import FittedShape, body_points, build_body
from anchorpose.errors import AnchorposeError
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.reader import read_frames
from anchorpose.recording.recording import FrameSet, Recording
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.paper_tracker import PaperTracker, Way
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.config import FollowConfig, Method, TrackConfig
from anchorpose.tracker.following import follow_patient
from anchorpose.tracker.isolating import isolate_again, observe_first
from anchorpose.tracker.observation import observe
from anchorpose.tracker.passes import learn_on, plan_route
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room
from anchorpose.tracker.run import Run
from anchorpose.tracker.start import Start
from anchorpose.tracking.motion import MotionConfig, MotionRule
from anchorpose.tracking.motion_file import load_motions
from anchorpose.tracking.tree import TreeConfig

NEVER_M = 1000.0  # no branch of the tree is ever so far from its prediction that it is given up
ANYWHERE_M = 10.0  # every node may be matched with every other, as in the paper
ALL_NODES = (
    100_000  # the tree starts from every node: it takes all of them to distinguish a random method from a good one
)
PAPER_GATE = GateConfig(anchor_bound_m=0.05, surface_bound_per_m=0.01, search_radius_m=ANYWHERE_M)
"""The paper's bound on the anchors; the paper does not give its "linear function increasing with distance"."""


def paper_config(motions: Path, form: Form = Form.REFINED) -> TrackConfig:
    """Meshes of the depth images with their holes; prediction by the best sub-list; each part registered by itself.

    motions: the file of the training samples' movements.
    """
    return TrackConfig(
        method=Method.PARTS,
        tree=TreeConfig() if form.rejects else TreeConfig(missed_cost_m=NEVER_M),
        surface=SurfaceConfig(by_body=False),
        hypotheses=HypothesisConfig(trusted_only=False),
        gate=PAPER_GATE,
        motion=MotionConfig(rule=MotionRule.BEST_SUBLIST, displacement_weight=0.0),
        motions=str(motions),
        follow=FollowConfig(tree_nodes=ALL_NODES),
    )


def paper_room(recording: Recording, movements: Path) -> Room:
    """The room of a recording, which is the same in every form and at every stride."""
    return prepare_room(recording, paper_config(movements))


def run_in(room: Room, movements: Path, form: Form = Form.REFINED, stride: int = 1) -> Run:
    """All that is known before the first frame is tracked, with the configuration of ``paper_config``.

    stride: only every so many frames of the recording are looked at. Over more than one the patient is expected where
    they were: reference movements say nothing about a second ahead, and are too short at such a rate.
    """
    config = paper_config(movements, form)
    if stride > 1:
        config = replace(config, motion=MotionConfig(rule=MotionRule.STANDSTILL))
    return Run(room, config, load_motions(config.motion_file, room.recording.rate_hz, config.motion))


def paper_run(recording: Recording, movements: Path, form: Form = Form.REFINED, stride: int = 1) -> Run:
    """The same for a recording whose room is not known yet."""
    return run_in(paper_room(recording, movements), movements, form, stride)


def start_at(
    frame: int, frame_set: FrameSet, reference: Reference, run: Run, way: Way | None = None, stride: int = 1
) -> PaperTracker:
    """A tracker of the patient from a frame (position in the recording) on, in which the pose is given."""
    return track_from(frame, given_start(frame, frame_set, reference, run), reference, run, way, stride)


def given_start(frame: int, frame_set: FrameSet, reference: Reference, run: Run) -> Start:
    """The start in a frame in which the pose is given: who the patient is, and what is seen of them."""
    pose = reference.pose(frame)
    choice = PatientChoice(pose.root_m[[0, 2]], "was tracked before anything was removed", True)
    first = observe_first(frame_set, choice, 1.7, run)
    belief = _confident(vague_belief(pose))
    start = Start(first, reference.shape, belief, 1.0)
    unnamed = PaperTracker(run, start, Way())
    expected = unnamed.expect(pose)
    isolated = isolate_again(first, expected, first, run)
    return replace(start, observation=observe(frame_set, isolated, expected, unnamed.height_m, run))


def track_from(
    frame: int, start: Start, reference: Reference, run: Run, way: Way | None = None, stride: int = 1
) -> PaperTracker:
    """A tracker of the patient from a given start in a frame on.

    The joints in the frames before, every ``stride``-th, are given too, as far back as there is no gap: the motion
    dynamics need a past.
    """
    tracker = PaperTracker(run, start, way or Way())
    lost = np.flatnonzero(~reference.found[:frame])
    since = max(lost[-1] + 1 if len(lost) else 0, frame - stride * (run.config.follow.history - 1))
    tracker.history.extendleft(reference.joints_m[since:frame][::-1][stride - 1 :: stride])
    return tracker


class GivenStarts:
    """The frames of a recording and the given starts in them, made once for all methods and forms.

    The methods of an experiment differ in what follows an observation; only few have another mesh.
    """

    def __init__(self, room: Room, reference: Reference) -> None:
        self.room, self.reference = room, reference
        self._frames: dict[int, FrameSet] = {}
        self._starts: dict[tuple[int, TrackConfig], Start] = {}

    def frames(self, first: int, length: int) -> list[FrameSet]:
        """The frames of a segment."""
        if first not in self._frames or first + length - 1 not in self._frames:
            read = read_frames(self.room.recording, first, first + length)
            self._frames.update(enumerate(read, first))
        return [self._frames[first + number] for number in range(length)]

    def start(self, frame: int, run: Run) -> Start:
        """The given start in a frame, as a run in the same room observes it."""
        key = frame, _observing(run.config)
        if key not in self._starts:
            self._starts[key] = given_start(frame, self.frames(frame, 1)[0], self.reference, run)
        return self._starts[key]


def _observing(config: TrackConfig) -> TrackConfig:
    """The configuration without what comes after an observation: prediction, matches and tree."""
    follow = replace(config.follow, look_ahead=1, tree_nodes=1)
    return replace(config, tree=TreeConfig(), gate=GateConfig(), motion=MotionConfig(), follow=follow)


def follow_segment(tracker: PatientTracker, later: Sequence[FrameSet]) -> np.ndarray:
    """(n, 21, 3) metres, world: the joints in each of the later frames, also where the tracker calls them lost."""
    joints = []
    for frame_set in later:
        if tracker.step(frame_set) is not None:
            joints.append(tracker.history[-1])
    joints += [tracker.history[-1] for _ in tracker.finish()]
    return np.array(joints).reshape(-1, 21, 3)


def _confident(belief: PoseBelief) -> PoseBelief:
    """A tenth of the standard deviation: the pose was tracked."""
    return PoseBelief(belief.pose, belief.covariance / 100.0, belief.information * 100.0)


class NoReference(AnchorposeError):
    """The patient was not found in the original recording, so no method can start."""


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """What all methods start from.

    T_world_camera (k, 4, 4): poses of the cameras, given or found, so that all methods share one world. Over t frames:
    rotations (t, b, 3, 3) and root_m (t, 3) of the pose, joints_m (t, 21, 3) and centre_m (t, 3), the mean of the
    visible body, world; NaN where the patient was lost. shape: the learnt body.
    """

    T_world_camera: np.ndarray
    shape: FittedShape
    rotations: np.ndarray
    root_m: np.ndarray
    joints_m: np.ndarray
    centre_m: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """(t,) bool: the patient was found."""
        return np.isfinite(self.root_m).all(axis=1)

    def pose(self, frame: int) -> Pose:
        """The pose in a frame in which the patient was found."""
        return Pose(self.rotations[frame], self.root_m[frame])


def make_reference(recording: Recording, config: TrackConfig) -> Reference:
    """Track the original recording. Raises NoReference where nobody is found, InputError without a world frame."""
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
    for side in (route.backward, route.forward):
        estimates = follow_patient(run, route.frames(side), learnt.shape)
        for position, estimate in zip(side, estimates, strict=True):
            if estimate.belief is None or estimate.observation is None or len(estimate.observation.surface) == 0:
                continue
            pose = estimate.belief.pose
            rotations[position], root[position] = pose.rotations, pose.root_m
            joints[position] = body.joints(pose)
            centre[position] = estimate.observation.surface.points_m.mean(axis=0, dtype=np.float64)
    poses = np.array([camera.require_pose() for camera in room.cameras])
    return Reference(poses, learnt.shape, rotations, root, joints, centre)


def in_its_world(recording: Recording, reference: Reference) -> Recording:
    """The recording, or its copy with holes, with the reference's camera poses as given poses."""
    cameras = tuple(
        replace(camera, T_world_camera=T) for camera, T in zip(recording.cameras, reference.T_world_camera, strict=True)
    )
    return replace(recording, cameras=cameras)


def to_arrays(reference: Reference) -> dict[str, np.ndarray]:
    """The reference as arrays, for a file."""
    return {
        "T_world_camera": reference.T_world_camera,
        "coefficients": reference.shape.coefficients,
        "offset_m": reference.shape.offset_m,
        "rotations": reference.rotations,
        "root_m": reference.root_m,
        "joints_m": reference.joints_m,
        "centre_m": reference.centre_m,
    }


def from_arrays(arrays: Mapping[str, np.ndarray]) -> Reference:
    """The reference that ``to_arrays`` took apart."""
    shape = FittedShape(arrays["coefficients"], arrays["offset_m"])
    names = ("rotations", "root_m", "joints_m", "centre_m")
    return Reference(arrays["T_world_camera"], shape, *(arrays[name] for name in names))
