"""Run all steps of an experiment: choice of settings, every recording, then tables, figures and the page.

Settings are chosen on training recordings, which are not used for testing. The reference movements, by which poses are
predicted, also come from the training recordings.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.motion.database import ReferenceClips, write_motions
from anchorpose.recording.document import read_json
from anchorpose.recording.writable import check_place, new_folder
from anchorpose.research.experiment.clip_jobs import Part, Progress, do
from anchorpose.research.experiment.clips import Clip, plan_clips, simulation_of
from anchorpose.research.experiment.config import ExperimentConfig, Scene
from anchorpose.research.experiment.costs import duration, usual_costs
from anchorpose.research.experiment.method import Method, load_methods
from anchorpose.research.experiment.methods.references import ABLATED
from anchorpose.research.experiment.page.page import write_results
from anchorpose.research.experiment.pictures.album import show, shown_before
from anchorpose.research.experiment.pictures.canvas import default_style
from anchorpose.research.experiment.plan import Kind, PlanSpec, Task, experiment_code, read
from anchorpose.research.experiment.results import (
    ExperimentResults,
    Matched,
    Tracked,
    TriedSetting,
    capped_mean_mm,
    choose,
)
from anchorpose.research.experiment.work import PER_NODE
from anchorpose.results.folder import write_text_whole
from anchorpose.simulate.choices import Speed
from anchorpose.simulate.clinic import draw_clinic

KINDS: Final[tuple[tuple[str, tuple[str, ...], Speed], ...]] = (
    ("upper body, slow", ("reach", "arm-raise", "head"), "slow"),
    ("lower body, slow", ("squat", "weight-shift", "trunk", "steps"), "slow"),
    ("upper body, fast", ("reach", "arm-raise", "head"), "fast"),
    ("lower body, fast", ("squat", "weight-shift", "trunk", "steps"), "fast"),
)
"""Name, movements and speed of the kinds of training recording, as in the paper's samples: "upper and lower body
movements", "slow, normal to fast".
"""


def training_clips(config: ExperimentConfig) -> list[Clip]:
    """Return the training recordings, each with one kind of movement and another body.

    Together, the training recordings have at least ``training_samples`` frames.
    """
    seconds = max(config.training_samples / config.training_recordings, config.segment_frames + 1) / config.fps
    clips = []
    for number in range(config.training_recordings):
        name, motions, speed = KINDS[number % len(KINDS)]
        seed = config.training_seed + number
        simulation = replace(simulation_of(Scene.PAPER, seed, config), seconds=seconds, motions=motions, speed=speed)
        clips.append(Clip(f"training-{seed} ({name})", Scene.PAPER, simulation))
    return clips


def write_movements(path: Path, clips: list[Clip], samples: int) -> None:
    """Write the joints of the training recordings as reference movements, ``samples`` frames in total.

    In the paper, the joints of the reference movements come from the sensor's skeleton on unoccluded data; here, they
    are the simulator's true joints.
    """
    joints, names, rates, left = list[np.ndarray](), list[str](), list[float](), samples
    for clip in clips:
        if clip.simulation is None:
            raise ValueError(f"{clip.name} is not simulated")
        clinic = draw_clinic(clip.simulation)
        moved = clinic.act(clinic.true_times_s(0)).joints_m()[: max(left, 0)]
        if len(moved):
            joints.append(moved)
            names.append(clip.name)
            rates.append(clip.simulation.fps)
        left -= len(moved)
    write_motions(path, ReferenceClips(tuple(joints), tuple(names), tuple(rates)))


CACHE: Final = "cache"
MARK_FILE: Final = "experiment.json"
FORMAT: Final = "anchorpose-experiment"
AllTried = tuple[tuple[str, tuple[TriedSetting, ...]], ...]
"""For each method with several settings: its key, and the settings that were tried."""


def run_experiment(
    out: Path,
    config: ExperimentConfig,
    real: Path | None,
    processes: int,
    progress: Progress,
    report: Callable[[str], None],
) -> ExperimentResults:
    """Run the whole experiment into a folder; stored results of an earlier run in this folder are used again.

    real: a folder of recordings with reference skeletons, or None. report: function that is called with sentences on
    the state of the work. Raises InputError if ``out`` has files but no earlier run, a method is unknown or ``real``
    contains no recording, and MissingPackage without matplotlib.
    """
    _require_matplotlib()
    check_place(out, real)
    _require_own_folder(out)
    methods, clips = load_methods(config.methods), plan_clips(config, real)
    if real is not None and not any(clip.folder for clip in clips):
        raise InputError(real, "contains no recording folder with a skeleton.npz", "check the folder")
    _make_own_folder(out)
    trainers = tuple(training_clips(config))
    spec = _untuned_plan(out / CACHE, trainers, config)
    costs = usual_costs(methods, config)
    training = Part(replace(spec, training=True), trainers if config.tuned else (), costs)
    testing = Part(replace(spec, chosen=_chosen(_tried(training, methods))), tuple(clips), costs)
    left_s = training.left_s() + testing.left_s()
    report(f"About {duration(left_s / processes + AROUND_S)} on {processes} idle cores.")
    failed = do(training, processes, progress, testing.left_s())
    tried = _tried(training, methods)
    testing = Part(replace(spec, chosen=_chosen(tried)), tuple(clips), costs)
    beside = partial(show, out, testing.spec, trainers) if config.pictures else None
    more = do(testing, processes, progress, 0.0, beside)
    report("Writing tables, figures and the page.")
    tracked, matched = _collect(testing.tasks())
    times, not_shown = shown_before(out, testing.spec.plan(), trainers) or (None, ())
    ablated = ABLATED if any(run.method == ABLATED[0].key for run in tracked) else ()
    sentences = (*failed, *more, *_undone(testing), *not_shown)
    results = ExperimentResults(config, (*methods, *ablated), tried, tracked, matched, times, sentences, real)
    write_results(results, out)
    return results


# Estimated seconds of computing in addition to the tasks: kernels are compiled or loaded in every process, and pictures
# and page are made.
AROUND_S: Final = 240.0


def _require_matplotlib() -> None:
    """Raise MissingPackage without matplotlib, at once and not after hours of computing."""
    with default_style():
        pass


def _chosen(tried: AllTried) -> tuple[tuple[str, int], ...]:
    return tuple((key, next(n for n, one in enumerate(rows) if one.chosen)) for key, rows in tried)


def _undone(job: Part) -> list[str]:
    """Return a sentence for each clip (recording) without all of its results, whatever the reason."""
    missing = Counter(task.clip.name for task in job.tasks() if not task.done)
    return [f"{name}: {count} results are missing." for name, count in missing.items()]


def _require_own_folder(out: Path) -> None:
    """Raise InputError if the folder has files but is not the folder of an earlier experiment."""
    mark = out / MARK_FILE
    is_own = mark.is_file() and read_json(mark).get("format") == FORMAT
    if out.exists() and not is_own and (not out.is_dir() or any(out.iterdir())):
        raise InputError(out, "exists and is not an experiment", "choose another folder; nothing in it was changed")


def _make_own_folder(out: Path) -> None:
    with new_folder(out.resolve(), out):
        write_text_whole(out / MARK_FILE, json.dumps({"format": FORMAT, "version": 1}) + "\n")
    with new_folder(out.resolve() / CACHE, out):
        pass


def _untuned_plan(cache: Path, trainers: Sequence[Clip], config: ExperimentConfig) -> PlanSpec:
    """Write the file of reference movements; return the plan with this file and the first setting of each method."""
    path = cache / "movements.npz"
    partial = path.with_suffix(".partial.npz")
    write_movements(partial, list(trainers), config.training_samples)
    partial.replace(path)
    with np.load(path) as file:
        digest = hashlib.sha256(b"".join(file[name].tobytes() for name in sorted(file.files))).hexdigest()
    return PlanSpec(
        config=config,
        wanted=config.methods,
        chosen=(),
        movements=path,
        movements_digest=digest,
        cache=cache,
        code=experiment_code(),
    )


def _tried(training: Part, methods: Sequence[Method]) -> AllTried:
    """Return the settings of every method that has several, with their scores on the training recordings."""
    windows: dict[tuple[str, object], list[np.ndarray]] = {}
    for task in training.tasks():
        if task.done:
            windows.setdefault((task.method.key, repr(task.setting)), []).append(read(task.path)["tree_mm"])
    return tuple(
        (m.key, choose(m.settings, [capped_mean_mm(windows.get((m.key, repr(setting)), [])) for setting in m.settings]))
        for m in methods
        if training.clips and len(m.settings) > 1
    )


def _collect(tasks: Sequence[Task]) -> tuple[tuple[Tracked, ...], tuple[Matched, ...]]:
    tracked, matched = list[Tracked](), list[Matched]()
    for task in tasks:
        if not task.done:
            continue
        arrays, who = read(task.path), (task.clip.scene, task.clip.name, task.hole_m, task.method.key)
        if task.kind is Kind.TRACKED:
            for form, error_mm in zip(task.forms, arrays["error_mm"], strict=True):
                tracked.append(Tracked(*who, arrays["frame"], arrays["occluded"], error_mm, form))
            continue
        matched += _windows_of(task, arrays)
    return tuple(tracked), tuple(matched)


def _windows_of(task: Task, arrays: dict[str, np.ndarray]) -> Iterator[Matched]:
    """Yield a method's matches from a task's stored arrays, one pair of frames at a time."""
    for number, frame in enumerate(arrays["frame"].tolist()):
        own = arrays["window"] == number
        yield Matched(
            task.clip.scene,
            task.clip.name,
            task.hole_m,
            task.method.key,
            frame,
            bool(arrays["occluded"][number]) and task.hole_m > 0,
            **{name: arrays[name][own] for name in PER_NODE},
            nodes=int(arrays["nodes"][number]),
            describe_s=float(arrays["describe_s"][number]),
            body_m=float(arrays["body_m"]),
            gap_s=float(arrays["gap_s"][number]),
        )
