"""The work on one recording: simulate it, find its reference, cut its holes, and run every open task.

A method runs on segments in the paper's framework; this project's tracker runs on the whole recording.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np

from anchorpose.camera import transform_points
from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.recording.reader import open_recording, read_frames
from anchorpose.recording.recording import Recording
from anchorpose.research.experiment.clips import Clip, cut_holes, draw_hole_frames
from anchorpose.research.experiment.config import Scene
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.research.experiment.framework import (
    NoReference,
    Reference,
    follow_segment,
    from_arrays,
    in_its_world,
    make_reference,
    paper_run,
    start_at,
    to_arrays,
)
from anchorpose.research.experiment.matching import MatchErrors, Truth, Window, draw_some, score, take_window, truth_of
from anchorpose.research.experiment.method import Family, Method
from anchorpose.research.experiment.plan import Kind, Plan, Task, is_sampled, read, sampled_segments
from anchorpose.simulate.write import simulate_recording
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.run import Run


@dataclass(frozen=True, slots=True, eq=False)
class TrackedJoints:
    """frame (f,) positions in the recording; joints_m (f, 21, 3) world, NaN where lost; seconds on one core."""

    frame: np.ndarray
    joints_m: np.ndarray
    seconds: float


def segment_starts(frames: int, length: int, found: np.ndarray) -> list[int]:
    """The first frame of each whole segment in which the patient's pose is known."""
    return [start for start in range(0, frames - length + 1, length) if found[start]]


def track_segments(
    method: Method, setting: object, reference: Reference, run: Run, starts: Sequence[int], length: int
) -> TrackedJoints:
    """The method in the framework, started again at each start; the first frames themselves are left out."""
    if method.associate is None:
        raise ValueError(f"{method.key} has no association that the framework could use")
    began, frames, joints = time.process_time(), list[np.ndarray](), list[np.ndarray]()
    for start in starts:
        own = replace(run, config=method.configure(run.config, setting), associate=method.associate(setting))
        sets = list(read_frames(run.room.recording, start, start + length))
        tracker = start_at(start, sets[0], reference, own)
        joints.append(follow_segment(tracker, sets[1:]))
        frames.append(np.arange(start + 1, start + len(sets)))
    if not frames:
        return TrackedJoints(np.zeros(0, np.int64), np.zeros((0, 21, 3)), 0.0)
    return TrackedJoints(np.concatenate(frames), np.concatenate(joints), time.process_time() - began)


def track_whole(method: Method, setting: object, recording: Recording) -> TrackedJoints:
    """This project's tracker on the whole recording: it finds the patient and learns the body itself.

    The joints are those of its pose, also where it calls them lost.
    """
    began, frames = time.process_time(), np.arange(len(recording.streams[0].files))
    try:
        joints = make_reference(recording, method.configure(TrackConfig(), setting)).joints_m
    except NoReference:
        joints = np.full((len(frames), 21, 3), np.nan)
    return TrackedJoints(frames, joints, time.process_time() - began)


SURE = 1.0  # confidence of a reference joint that counts


def simulated_joints(truth: Path) -> np.ndarray:
    """(t, 21, 3) metres, world, of a truth.npz."""
    with np.load(truth) as file:
        joints: np.ndarray = file["joints"]
    return joints


def reference_joints(skeleton: Path, T_world_camera: np.ndarray) -> np.ndarray:
    """(t, 21, 3) metres, world, of a skeleton.npz (``names`` of our joints, ``xyz`` (t, m, 4)); NaN where uncertain.

    ``xyz``: camera x right, y up, z away, metres, and confidence; a joint at the origin is missing.
    Raises InputError where the file is not such a skeleton.
    """
    try:
        with np.load(skeleton, allow_pickle=False) as file:
            names, stored = [str(name) for name in file["names"]], np.asarray(file["xyz"], dtype=np.float64)
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            skeleton, f"is not a reference skeleton ({error})", "give names and xyz (t, joints, 4)"
        ) from None
    if stored.ndim != 3 or stored.shape[1:] != (len(names), 4) or not set(names) <= set(JOINT_INDEX):
        raise InputError(skeleton, "its names and xyz do not fit the 21 joints", "give names and xyz (t, joints, 4)")
    unknown = (stored[..., :3] == 0.0).all(axis=-1) | (stored[..., 3] < SURE)
    camera_m = np.where(unknown[..., None], np.nan, stored[..., :3] * [1.0, -1.0, 1.0])
    joints = np.full((len(stored), JOINT_COUNT, 3), np.nan)
    joints[:, [JOINT_INDEX[name] for name in names]] = transform_points(T_world_camera, camera_m)
    return joints


@dataclass(frozen=True, slots=True, eq=False)
class PreparedClip:
    """An opened recording with its reference.

    truth_m (t, 21, 3) world, NaN where unknown; in_hole (t,) bool: frames that lose data; starts: the frames whose pose
    is given; skin: the true surface, None for a real recording.
    """

    clip: Clip
    recording: Recording
    reference: Reference
    truth_m: np.ndarray
    in_hole: np.ndarray
    starts: tuple[int, ...]
    skin: Skin | None

    @property
    def seed(self) -> int:
        """The seed of all random draws for this recording, from its name."""
        return crc32(self.clip.drawn_by.encode())


def work_on(clip: Clip, plan: Plan) -> None:
    """Do all open tasks of a clip, one result file per task.

    Raises AnchorposeError where the patient or a world is not found in it.
    """
    open_tasks = [task for task in plan.tasks(clip) if not task.done]
    if not open_tasks:
        return
    with one_thread(), prepare_clip(clip, plan) as prepared:
        for hole_m in plan.holes(clip):
            tasks = [task for task in open_tasks if task.hole_m == hole_m]
            if tasks:
                with with_holes(prepared, hole_m) as (recording, cut):
                    _run_tasks(tasks, prepared, recording, cut, plan)


@contextmanager
def prepare_clip(clip: Clip, plan: Plan) -> Iterator[PreparedClip]:
    """The clip with its reference; a simulated recording is deleted afterwards, since it can be made again."""
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        if clip.simulation is not None:
            made = Path(folder) / "simulated"
            simulate_recording(made, clip.simulation)
            yield _prepare(clip, made / "recording", made / "truth" / "truth.npz", plan)
        elif clip.folder is not None:
            yield _prepare(clip, clip.folder, clip.folder / "skeleton.npz", plan)


def _prepare(clip: Clip, folder: Path, truth: Path, plan: Plan) -> PreparedClip:
    recording, kept = open_recording(folder), plan.reference(clip)
    if kept.is_file():
        reference = from_arrays(read(kept))
    else:
        reference = make_reference(recording, TrackConfig())
        plan.store.write(kept, to_arrays(reference))
    recording = in_its_world(recording, reference)
    frames, config = len(recording.streams[0].files), plan.config
    starts = segment_starts(frames, config.segment_frames, reference.found)
    if clip.simulation is None:
        joints, skin = reference_joints(truth, reference.T_world_camera[0]), None
        joints = joints[recording.streams[0].frame]
    else:
        joints, skin = simulated_joints(truth), Skin(clip.simulation)
    in_hole = draw_hole_frames(frames, config.hole_share, crc32(clip.drawn_by.encode()), starts)
    return PreparedClip(clip, recording, reference, joints, in_hole, tuple(starts), skin)


@contextmanager
def with_holes(prepared: PreparedClip, hole_m: float) -> Iterator[tuple[Recording, np.ndarray]]:
    """The recording with holes of a radius (0: itself), and (t,) bool: the frames that lost readings."""
    if hole_m == 0:
        yield prepared.recording, np.zeros(len(prepared.in_hole), bool)
        return
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        out = Path(folder) / prepared.recording.folder.name
        reference = prepared.reference
        cut = cut_holes(prepared.recording, out, reference.centre_m, prepared.in_hole, hole_m)
        yield in_its_world(open_recording(out), reference), cut


def _run_tasks(
    tasks: Sequence[Task], prepared: PreparedClip, recording: Recording, cut: np.ndarray, plan: Plan
) -> None:
    run = paper_run(recording, plan.movements, refined=prepared.clip.scene is not Scene.MATCHES)
    cache = _WindowCache(prepared, plan, run)
    for task in tasks:
        if task.kind is Kind.MATCHED:
            known = cache.windows(task.method.configure(run.config, task.setting))
            scores = [score(task.method, task.setting, window, truth) for window, truth in known]
            plan.store.write(task.path, _matched_arrays([window.frame for window, _ in known], scores, prepared, cut))
    length = plan.config.segment_frames
    for task in tasks:
        if task.kind is not Kind.TRACKED:
            continue
        if task.method.family is Family.TRACKER:
            track = _evaluated(track_whole(task.method, task.setting, recording), prepared, length)
        else:
            chosen = prepared.starts
            if is_sampled(task.method, prepared.clip):
                chosen = tuple(draw_some(chosen, sampled_segments(prepared.clip, plan.config), prepared.seed))
            track = track_segments(task.method, task.setting, prepared.reference, run, chosen, length)
        plan.store.write(task.path, _tracked_arrays(track, prepared, cut))


class _WindowCache:
    """The windows of a recording, shared by all methods with the same kind of mesh."""

    def __init__(self, prepared: PreparedClip, plan: Plan, run: Run) -> None:
        self.prepared, self.run = prepared, run
        self.frames = window_frames(prepared, plan)
        self.taken: dict[SurfaceConfig, list[tuple[Window, Truth]]] = {}

    def windows(self, config: TrackConfig) -> list[tuple[Window, Truth]]:
        """The windows on meshes of this configuration, with the true correspondence."""
        skin, run = self.prepared.skin, replace(self.run, config=replace(self.run.config, surface=config.surface))
        if skin is not None and config.surface not in self.taken:
            found = [take_window(frame, self.prepared.reference, run) for frame in self.frames]
            self.taken[config.surface] = [(window, truth_of(window, skin)) for window in found if window is not None]
        return self.taken.get(config.surface, [])


def window_frames(prepared: PreparedClip, plan: Plan) -> list[int]:
    """The first frames of the windows, the same for every size of hole; a hole, if cut, is in one of the two frames."""
    found, hole = prepared.reference.found, prepared.in_hole
    here = np.arange(len(found) - 1)
    touched = hole[:-1] | hole[1:] if prepared.clip.holes_are_cut else np.ones(len(here), bool)
    return draw_some(here[touched & found[:-1]].tolist(), plan.windows, prepared.seed)


def _evaluated(track: TrackedJoints, prepared: PreparedClip, length: int) -> TrackedJoints:
    """Only the frames that the other methods track: not their given frames, nor those after the last segment."""
    kept = np.zeros(len(prepared.truth_m), bool)
    for start in prepared.starts:
        kept[start + 1 : start + length] = True
    chosen = kept[track.frame]
    return TrackedJoints(track.frame[chosen], track.joints_m[chosen], track.seconds)


def _tracked_arrays(track: TrackedJoints, prepared: PreparedClip, cut: np.ndarray) -> dict[str, object]:
    error_mm = 1000.0 * np.linalg.norm(track.joints_m - prepared.truth_m[track.frame], axis=2)
    return {
        "frame": track.frame,
        "occluded": cut[track.frame],
        "error_mm": error_mm.astype(np.float32),
        "seconds": track.seconds,
    }


def _matched_arrays(
    frames: Sequence[int], scores: Sequence[MatchErrors], prepared: PreparedClip, cut: np.ndarray
) -> dict[str, object]:
    """The nodes of all windows one after another; window (m,): the window of each."""
    height_m = np.nan if prepared.skin is None else prepared.skin.clinic.patient.person.height_m
    each = ("region", "direct_mm", "tree_mm", "direct_skin_mm", "tree_skin_mm", "mirrored")
    return {
        **{name: np.concatenate([getattr(one, name) for one in scores]) for name in each if scores},
        "window": np.repeat(np.arange(len(scores)), [len(one.region) for one in scores]),
        "frame": np.array(frames, np.int64),
        "nodes": np.array([one.nodes for one in scores], np.int64),
        "describe_s": np.array([one.describe_s for one in scores]),
        "occluded": np.array([cut[frame : frame + 2].any() for frame in frames], bool),
        "body_m": height_m,
    }
