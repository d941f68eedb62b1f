"""Do the work on one recording: simulate the recording, make its reference by tracking, cut holes, and run the tasks
that have no result yet.

In the paper's framework, a method runs on segments (short pieces) of the recording. This project's tracker runs on the
whole recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from zlib import crc32

import numpy as np

from anchorpose.joints import JOINT_COUNT
from anchorpose.recording.reader import open_recording
from anchorpose.recording.recording import Recording
from anchorpose.research.experiment.clips import Clip, cut_holes, draw_hole_frames, reference_joints, simulated_joints
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.research.experiment.framework import follow_segment, paper_config, paper_room, run_in, start_at
from anchorpose.research.experiment.given import (
    GivenFrames,
    NoReference,
    Reference,
    from_arrays,
    in_its_world,
    make_reference,
    to_arrays,
)
from anchorpose.research.experiment.matching import (
    MatchErrors,
    Truth,
    Window,
    draw_some,
    score,
    take_window,
    truth_of,
    warm_up,
)
from anchorpose.research.experiment.method import Family, Method, associate_once
from anchorpose.research.experiment.paper_tracker import Way
from anchorpose.research.experiment.plan import Kind, Plan, Task, read
from anchorpose.simulate.write import simulate_recording
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import Run


@dataclass(frozen=True, slots=True, eq=False)
class TrackedJoints:
    """Tracked joints in f frames of a recording, in one or several forms (variants) of the paper's framework."""

    frame: np.ndarray  # (f,), positions of the frames in the recording
    joints_m: np.ndarray  # (forms, f, 21, 3), world, NaN in frames in which the patient was lost


def segment_starts(frames: int, length: int, found: np.ndarray) -> list[int]:
    """Return the first frames of the segments (``length`` frames) in which the patient was found in every frame.

    found: (frames,) bool. Other segments are left out, since the patient's pixels, which methods need, are unknown
    there.
    """
    return [start for start in range(0, frames - length + 1, length) if found[start : start + length].all()]


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A recording with holes of one size in its depth images, and the forms (variants) of the paper's framework in
    which methods run on it.
    """

    recording: Recording  # the recording as read from its folder, before the cameras' clocks are aligned
    given: GivenFrames
    cut: np.ndarray  # (t,) bool, frames that lost readings
    runs: Mapping[Form, Run]
    # windows (``matching.Window``) taken so far, by the settings with which their meshes were made
    windows: dict[SurfaceConfig, list[tuple[Window, Truth]]] = field(default_factory=dict)

    def within(self, forms: Sequence[Form]) -> Trial:
        """Return the trial with the runs of these forms only; a form is a variant of the paper's tracker (``Form``)."""
        return replace(self, runs={form: self.runs[form] for form in forms})


def track_segments(
    method: Method, setting: object, trials: Sequence[Trial], starts: Sequence[int], length: int
) -> list[TrackedJoints]:
    """Track the segments that begin at ``starts`` by one method, in each trial (recording with holes of one size) and
    in each of the trial's forms of the paper's framework.

    Tracking restarts in each segment. The segment's first frame, whose pose is given, is left out of the result. For
    frames into which no hole was cut, all trials share the descriptors and matches.
    """
    associate = associate_once(method, setting)
    joints = [{form: [np.zeros((0, JOINT_COUNT, 3))] for form in trial.runs} for trial in trials]
    for start in starts:
        for trial, found in zip(trials, joints, strict=True):
            later = [trial.given.frame(position) for position in range(start + 1, start + length)]
            for form, run in trial.runs.items():
                own = replace(run, config=method.configure(run.config, setting), associate=associate)
                way = Way(form=form, anchored=method.anchored, update=method.update, own_surface=method.own_surface)
                found[form].append(follow_segment(start_at(start, trial.given, own, way), later))
    frames = np.concatenate([np.zeros(0, np.int64), *(np.arange(start + 1, start + length) for start in starts)])
    together = (np.stack([np.concatenate(of_form) for of_form in found.values()]) for found in joints)
    return [TrackedJoints(frames, joints_m) for joints_m in together]


def track_whole(method: Method, setting: object, recording: Recording) -> TrackedJoints:
    """Track the whole recording with this project's tracker, which finds the patient and learns the body itself.

    This tracker does not run in the paper's framework, so the result does not depend on the form of the framework.
    Joints are taken from the pose, even if the tracker reports them as lost.
    """
    frames = np.arange(len(recording.streams[0].files))
    try:
        joints = make_reference(recording, method.configure(TrackConfig(), setting), labelled=False).joints_m
    except NoReference:
        joints = np.full((len(frames), JOINT_COUNT, 3), np.nan)
    return TrackedJoints(frames, joints[None])


@dataclass(frozen=True, slots=True, eq=False)
class PreparedClip:
    """An opened recording with its reference."""

    clip: Clip
    recording: Recording
    reference: Reference
    truth_m: np.ndarray  # (t, 21, 3), true joints, world, NaN = unknown
    in_hole: np.ndarray  # (t,) bool, frames that were drawn to get a hole
    starts: tuple[int, ...]  # first frames of the segments, whose poses are given
    skin: Skin | None  # the patient's true surface; None for a real recording

    @property
    def seed(self) -> int:
        """Return the seed of all random draws for this recording, from its name."""
        return crc32(self.clip.name.encode())


def work_on(clip: Clip, plan: Plan) -> None:
    """Do all tasks of a clip (recording) that have no result yet, and write one result file per task.

    Raises AnchorposeError if the patient or a world frame is not found in the clip.
    """
    open_tasks = [task for task in plan.tasks(clip) if not task.done]
    if not open_tasks:
        return
    with one_thread(), prepare_clip(clip, plan) as prepared:
        holes_m = sorted({task.hole_m for task in open_tasks})
        one_camera = len(prepared.recording.cameras) == 1
        # cutting holes raises an error if there are several cameras, so tasks without a hole are done and stored first
        for together in [holes_m] if one_camera else [[hole_m] for hole_m in holes_m]:
            tasks = [task for task in open_tasks if task.hole_m in together]
            with open_trials(prepared, plan, together) as trials:
                _run_tasks(tasks, prepared, trials, plan)


@contextmanager
def prepare_clip(clip: Clip, plan: Plan) -> Iterator[PreparedClip]:
    """Yield the clip (recording) with its reference, the data that all methods are given; a simulated recording is
    deleted afterwards, since it can be made again.
    """
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
    in_hole = draw_hole_frames(frames, config.hole_share, crc32(clip.name.encode()), starts)
    return PreparedClip(clip, recording, reference, joints, in_hole, tuple(starts), skin)


@contextmanager
def with_holes(prepared: PreparedClip, hole_m: float) -> Iterator[tuple[Recording, np.ndarray]]:
    """Yield the recording with holes of the radius ``hole_m`` in its depth images (0 = no holes), and the frames (t,)
    bool that lost readings.
    """
    if hole_m == 0:
        yield prepared.recording, np.zeros(len(prepared.in_hole), bool)
        return
    with TemporaryDirectory(prefix="anchorpose-") as folder:
        out = Path(folder) / prepared.recording.folder.name
        reference = prepared.reference
        cut = cut_holes(prepared.recording, out, reference.centre_m, prepared.in_hole, hole_m)
        yield in_its_world(open_recording(out), reference), cut


@contextmanager
def open_trials(prepared: PreparedClip, plan: Plan, holes_m: Sequence[float]) -> Iterator[dict[float, Trial]]:
    """Yield, for each of these sizes of hole, a trial (the recording with such holes, and what methods need to run on
    it). Raises InputError as ``cut_holes`` does.
    """
    with ExitStack() as stack:
        room = paper_room(prepared.recording, prepared.reference, plan.movements)
        uncut, trials = GivenFrames(room, prepared.reference), {}
        for hole_m in holes_m:
            recording, cut = stack.enter_context(with_holes(prepared, hole_m))
            holed = replace(room, recording=recording) if hole_m else room
            given = GivenFrames(holed, prepared.reference, uncut, cut) if hole_m else uncut
            trials[hole_m] = Trial(recording, given, cut, {form: run_in(holed, plan.movements, form) for form in Form})
        yield trials


def _run_tasks(tasks: Sequence[Task], prepared: PreparedClip, trials: Mapping[float, Trial], plan: Plan) -> None:
    for task in tasks:
        if task.kind is Kind.MATCHED:
            _match(task, prepared, trials[task.hole_m], plan)
    for trial in trials.values():
        trial.windows.clear()
    tracked = [task for task in tasks if task.kind is Kind.TRACKED]
    for key in dict.fromkeys(task.method.key for task in tracked):
        _track([task for task in tracked if task.method.key == key], prepared, trials, plan)


def _match(task: Task, prepared: PreparedClip, trial: Trial, plan: Plan) -> None:
    known = windows_of(task.method, task.setting, prepared, trial, plan)
    for window, _ in known[:1]:
        warm_up(task.method, task.setting, window)
    scores = [score(task.method, task.setting, window, truth) for window, truth in known]
    arrays = _matched_arrays([window for window, _ in known], scores, prepared, trial.cut, plan)
    plan.store.write(task.path, arrays)


def _track(tasks: Sequence[Task], prepared: PreparedClip, trials: Mapping[float, Trial], plan: Plan) -> None:
    """Run the tracking tasks of one method on a recording. The tasks differ in the radius of the hole that is cut into
    the depth images (``Task.hole_m``).
    """
    method, setting, length = tasks[0].method, tasks[0].setting, plan.config.segment_frames
    starts, of_tasks = _segments(prepared, plan), [trials[task.hole_m] for task in tasks]
    if method.family is Family.TRACKER:
        whole = [track_whole(method, setting, trial.recording) for trial in of_tasks]
        tracks = [_evaluated(track, starts, length) for track in whole]
    else:
        wanted = [trial.within(task.forms) for task, trial in zip(tasks, of_tasks, strict=True)]
        tracks = track_segments(method, setting, wanted, starts, length)
    for task, trial, track in zip(tasks, of_tasks, tracks, strict=True):
        plan.store.write(task.path, _tracked_arrays(track, prepared, trial.cut))


def _segments(prepared: PreparedClip, plan: Plan) -> list[int]:
    """Return the first frames of the segments (pieces of the recording) on which every method runs, drawn at random."""
    return draw_some(prepared.starts, plan.config.segments, prepared.seed)


def windows_of(
    method: Method, setting: object, prepared: PreparedClip, trial: Trial, plan: Plan
) -> list[tuple[Window, Truth]]:
    """Return the windows in which the matches of a method are compared, gap by gap, with the true correspondence.

    A real recording has no windows, since its truth is unknown. Methods with the same mesh settings share windows.
    """
    skin, taken = prepared.skin, trial.windows
    surface = method.configure(paper_config(plan.movements), setting).surface
    if skin is not None and surface not in taken:
        found = [window for gap_s in plan.gaps_s for window in _windows_over(gap_s, surface, prepared, trial, plan)]
        taken[surface] = [(window, truth_of(window, skin)) for window in found]
    return taken.get(surface, [])


def _windows_over(
    gap_s: float, surface: SurfaceConfig, prepared: PreparedClip, trial: Trial, plan: Plan
) -> Iterator[Window]:
    stride = plan.config.stride(gap_s)
    run = run_in(trial.given.room, plan.movements, stride=stride)
    run = replace(run, config=replace(run.config, surface=surface))
    for frame in window_frames(prepared, plan, stride):
        window = take_window(frame, trial.given, run, stride)
        if window is not None:
            yield window


def window_frames(prepared: PreparedClip, plan: Plan, stride: int = 1) -> list[int]:
    """Return the first frames of the windows (pieces of the recording in which matches are compared), drawn at random,
    but the same for every size of hole.

    stride: number of frames from the first to the second frame of a window. If holes are cut in the recording, at least
    one of these two frames is a frame with a hole.
    """
    found, hole = prepared.reference.found, prepared.in_hole
    here = np.arange(max(len(found) - stride, 0))
    touched = hole[:-stride] | hole[stride:] if prepared.clip.holes_are_cut else np.ones(len(here), bool)
    return draw_some(here[touched & found[:-stride]].tolist(), plan.windows, prepared.seed)


def _evaluated(track: TrackedJoints, starts: Sequence[int], length: int) -> TrackedJoints:
    """Return the tracked joints only in the frames in which the other methods have tracked joints, too: all frames of
    the segments, except the first frame of each segment.
    """
    kept = np.zeros(len(track.frame), bool)
    for start in starts:
        kept[start + 1 : start + length] = True
    return TrackedJoints(track.frame[kept], track.joints_m[:, kept])


def _tracked_arrays(track: TrackedJoints, prepared: PreparedClip, cut: np.ndarray) -> dict[str, object]:
    error_mm = 1000.0 * np.linalg.norm(track.joints_m - prepared.truth_m[track.frame], axis=3)
    return {"frame": track.frame, "occluded": cut[track.frame], "error_mm": error_mm.astype(np.float32)}


def _matched_arrays(
    windows: Sequence[Window], scores: Sequence[MatchErrors], prepared: PreparedClip, cut: np.ndarray, plan: Plan
) -> dict[str, object]:
    """Return the arrays to be stored for a task, with the nodes of all windows, one window after another; the array
    ``window`` has the number of each node's window.
    """
    height_m = np.nan if prepared.skin is None else prepared.skin.clinic.patient.person.height_m
    gap_of = {plan.config.stride(gap_s): gap_s for gap_s in plan.gaps_s}
    return {
        **{name: np.concatenate([getattr(one, name) for one in scores]) for name in PER_NODE if scores},
        "window": np.repeat(np.arange(len(scores)), [len(one.region) for one in scores]),
        "frame": np.array([window.frame for window in windows], np.int64),
        "gap_s": np.array([gap_of[window.stride] for window in windows]),
        "nodes": np.array([one.nodes for one in scores], np.int64),
        "describe_s": np.array([one.describe_s for one in scores]),
        "occluded": np.array([cut[[window.frame, window.frame + window.stride]].any() for window in windows], bool),
        "body_m": height_m,
    }


PER_NODE = ("region", "moved_mm", "direct_mm", "tree_mm", "every_mm", "direct_skin_mm", "tree_skin_mm", "mirrored")
"""Arrays with an entry per compared node in the stored result of a task about matches."""
