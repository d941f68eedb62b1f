"""The order of an experiment: movements, settings, every recording, then what readers see.

plan -> movements -> tuning -> clips in parallel (``work``) -> outcome -> publish
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError, InputError
from anchorpose.experiments.answers import Answer, Brief, Kind, Plan
from anchorpose.experiments.clips import Clip, plan_clips
from anchorpose.experiments.config import ExperimentConfig
from anchorpose.experiments.framework import paper_config
from anchorpose.experiments.method import Method, load_methods
from anchorpose.experiments.methods.own_tracker import ABLATED
from anchorpose.experiments.outcome import Matched, Outcome, PaperTimes, Tracked, Tried
from anchorpose.experiments.paper_times import measure
from anchorpose.experiments.pictures.album import write_pictures
from anchorpose.experiments.publish import write_outcome
from anchorpose.experiments.store import read
from anchorpose.experiments.training import training_clips, write_movements
from anchorpose.experiments.tuning import choose, worth_mm
from anchorpose.experiments.work import Subject, pierced, subject_of, work_on
from anchorpose.threads import one_thread
from anchorpose.tracker.preparation import prepare_room

MAKING_S: Final = 0.35  # of one core for a frame of one camera: simulated, and tracked for the reference
CACHE: Final = "cache"
POLL_S: Final = 0.5
Progress = Callable[[float, float], None]
"""Called with seconds of one core done, and to do in all, about."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Clips and what is asked about them."""

    brief: Brief
    clips: tuple[Clip, ...]

    def answers(self) -> list[Answer]:
        """Of all clips."""
        plan = self.brief.plan()
        return [answer for clip in self.clips for answer in plan.answers(clip)]


def run_experiment(
    out: Path, config: ExperimentConfig, real: Path | None, processes: int, progress: Progress,
    tell: Callable[[str], None],
) -> Outcome:  # fmt: skip
    """The whole experiment into a folder, which may hold an earlier run: what it answered is not asked again.

    real: a folder of recordings with reference skeletons, or None. tell: is given sentences on where the work stands.
    Raises InputError where the folder is somebody else's, a method is unknown or ``real`` holds no recording.
    """
    _claim(out)
    methods, clips = load_methods(config.methods), plan_clips(config, real)
    if real is not None and not any(clip.folder for clip in clips):
        raise InputError(real, "holds no recording with a skeleton.npz beside its recording.json", "check the folder")
    trainers = tuple(training_clips(config))
    movements, digest = _movements(out / CACHE, trainers, config)
    first = Brief(config=config, wanted=config.methods, chosen=(), movements=movements, movements_digest=digest,
                  cache=out / CACHE, training=True)  # fmt: skip
    rough = replace(first, training=False)
    training, testing = Job(first, trainers if config.tuned else ()), Job(rough, tuple(clips))
    left_s = _left_s(training) + _left_s(testing)
    tell(f"About {_spoken(left_s / processes)} on {processes} cores.")
    failed = _do(training, processes, progress, left_s)
    tried = _tried(training, methods)
    chosen = tuple((key, next(n for n, t in enumerate(rows) if t.chosen)) for key, rows in tried)
    testing = Job(replace(rough, chosen=chosen), tuple(clips))
    failed += _do(testing, processes, progress, _left_s(testing))
    tell("Putting tables, figures and the page together.")
    tracked, matched = _collect(testing.answers())
    showing = replace(testing.brief, training=False).plan()
    outcome = Outcome(
        config, (*methods, *(ABLATED if config.ablation else ())), tried, tracked, matched,
        _show(out, showing, trainers), tuple(failed), real,
    )  # fmt: skip
    write_outcome(outcome, out)
    return outcome


def _claim(out: Path) -> None:
    """The folder is new, empty, or one of ours."""
    if out.exists() and (not out.is_dir() or (any(out.iterdir()) and not (out / CACHE).is_dir())):
        raise InputError(out, "exists and is no experiment", "choose another folder; nothing in it was touched")
    try:
        (out / CACHE).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(out, f"cannot be made ({error.strerror})", "choose a place that you may write to") from None


def _movements(cache: Path, trainers: Sequence[Clip], config: ExperimentConfig) -> tuple[Path, str]:
    path = cache / "movements.npz"
    partial = path.with_suffix(".partial.npz")
    write_movements(partial, list(trainers), config.training_samples)
    partial.replace(path)
    with np.load(path) as file:
        digest = hashlib.sha256(b"".join(file[name].tobytes() for name in sorted(file.files))).hexdigest()
    return path, digest


def _left_s(job: Job) -> float:
    """Of one core: what is asked and not answered, and the recordings that this takes."""
    by_clip: dict[str, float] = {}
    for answer in job.answers():
        if not answer.there:
            by_clip[answer.clip.name] = by_clip.get(answer.clip.name, _making_s(answer.clip)) + answer.cost_s
    return sum(by_clip.values())


def _making_s(clip: Clip) -> float:
    return 10.0 if clip.simulation is None else 5.0 + MAKING_S * clip.simulation.frames * clip.simulation.cameras


def _do(job: Job, processes: int, progress: Progress, total_s: float) -> list[str]:
    """Answers everything, clips side by side; a sentence for each clip that could not be used."""
    answers = job.answers()
    open_clips = {answer.clip.name for answer in answers if not answer.there}
    clips = sorted((c for c in job.clips if c.name in open_clips), key=_making_s, reverse=True)
    if not clips:
        return []
    failed = list[str]()
    executor = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    try:
        pending = {executor.submit(_work, clip, job.brief) for clip in clips}
        while pending:
            done, pending = wait(pending, timeout=POLL_S, return_when=FIRST_COMPLETED)
            failed += [sentence for future in done if (sentence := future.result())]
            progress(total_s - sum(a.cost_s for a in answers if not a.there), total_s)
    except BaseException:
        for child in active_children():
            child.terminate()
        raise
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
    return failed


def _work(clip: Clip, brief: Brief) -> str | None:
    """One clip; the other recordings are still worth comparing on, so what was wrong with it is told, not raised."""
    try:
        work_on(clip, brief.plan())
    except AnchorposeError as error:
        return f"{clip.name}: {error}"
    return None


def _tried(training: Job, methods: Sequence[Method]) -> tuple[tuple[str, tuple[Tried, ...]], ...]:
    """Every method's settings with their scores on the training recordings."""
    windows: dict[tuple[str, object], list[np.ndarray]] = {}
    for answer in training.answers():
        if answer.there:
            windows.setdefault((answer.method.key, repr(answer.setting)), []).append(read(answer.path)["tree_mm"])
    return tuple(
        (m.key, choose(m.settings, [worth_mm(windows.get((m.key, repr(setting)), [])) for setting in m.settings]))
        for m in methods
    )


def _collect(answers: Sequence[Answer]) -> tuple[tuple[Tracked, ...], tuple[Matched, ...]]:
    tracked, matched = list[Tracked](), list[Matched]()
    for answer in answers:
        if not answer.there:
            continue
        arrays, who = read(answer.path), (answer.clip.scene, answer.clip.name, answer.hole_m, answer.method.key)
        if answer.kind is Kind.TRACKED:
            seconds = float(arrays["seconds"])
            tracked.append(Tracked(*who, arrays["frame"], arrays["occluded"], arrays["error_mm"], seconds))
            continue
        matched += _windows_of(answer, arrays)
    return tuple(tracked), tuple(matched)


def _windows_of(answer: Answer, arrays: dict[str, np.ndarray]) -> Iterator[Matched]:
    """A method's matches, window by window."""
    for number, frame in enumerate(arrays["frame"].tolist()):
        own = arrays["window"] == number
        yield Matched(
            answer.clip.scene,
            answer.clip.name,
            answer.hole_m,
            answer.method.key,
            frame,
            bool(arrays["occluded"][number]) and answer.hole_m > 0,
            region=arrays["region"][own],
            direct_mm=arrays["direct_mm"][own],
            tree_mm=arrays["tree_mm"][own],
            direct_skin_mm=arrays["direct_skin_mm"][own],
            tree_skin_mm=arrays["tree_skin_mm"][own],
            mirrored=arrays["mirrored"][own].astype(bool),
            nodes=int(arrays["nodes"][number]),
            describe_s=float(arrays["describe_s"][number]),
            body_m=float(arrays["body_m"]),
        )


def _show(out: Path, plan: Plan, trainers: Sequence[Clip]) -> PaperTimes | None:
    """Pictures of a training recording, and how long the paper's steps take on it, None where nobody is found in it."""
    config, middle = paper_config(plan.movements), sorted(plan.config.holes_m)[len(plan.config.holes_m) // 2]
    with one_thread(), subject_of(trainers[-1], plan) as subject, pierced(subject, middle) as holed:
        times = measure(subject.starts[0], prepare_room(subject.recording, config), subject.reference, config)
        frame = _moving_frame(subject)
        if subject.skin is not None and frame is not None and middle > 0:
            write_pictures(
                out, subject.recording, holed, subject.reference, subject.skin, frame, plan.methods, plan.settings,
                plan.movements,
            )  # fmt: skip
    return times


def _moving_frame(subject: Subject) -> int | None:
    """Of the frames with a hole whose frame before has none, the one that the body has moved most to."""
    found, hole = subject.reference.found, subject.in_hole
    fits = np.flatnonzero(hole[1:-3] & ~hole[:-4] & found[1:-3] & found[:-4]) + 1
    if len(fits) == 0:
        return None
    moved = np.linalg.norm(np.diff(subject.reference.joints_m, axis=0), axis=2).mean(axis=1)
    return int(fits[np.argmax(moved[fits - 1])])


def _spoken(seconds: float) -> str:
    minutes = max(1, round(seconds / 60))
    return f"{minutes} minutes" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
