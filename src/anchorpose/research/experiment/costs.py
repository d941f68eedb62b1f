"""How long the open tasks of an experiment take, measured on its first segments on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.matching import score, warm_up
from anchorpose.research.experiment.method import Family, Method
from anchorpose.research.experiment.methods.references import OWN_TRACKER
from anchorpose.research.experiment.plan import Kind, Plan, PlanSpec, Task
from anchorpose.research.experiment.work import (
    PreparedClip,
    Trial,
    open_trials,
    prepare_clip,
    track_segments,
    track_whole,
    windows_of,
)
from anchorpose.threads import one_thread

COST_FACTOR: Final = {Scene.CLINIC_FRONT: 1.5, Scene.CLINIC: 3.0}  # therapists; three cameras
USUAL_FORM_S: Final = 0.02  # of a frame in one form of the framework, without the method
USUAL_OWN_S: Final = 0.15
WARM_FRAMES: Final = 2  # of a segment, before it is timed
MAKING: Final = 2.0  # to simulate a frame and to track it for the reference, in multiples of ``own_s``


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds of this machine's time, of one core where all are busy.

    frame_s: per frame and method, in all forms and sizes of hole of the paper's scene, which share descriptors and
    matches; alone_s: in one form with one size; window_s: per pair of frames whose matches are compared, and method;
    own_s: per frame of this project's tracker, learning included.
    """

    frame_s: Mapping[str, float]
    alone_s: Mapping[str, float]
    window_s: Mapping[str, float]
    own_s: float

    def of(self, task: Task, config: ExperimentConfig) -> float:
        """Seconds of a task."""
        clip, method = task.clip, task.method
        factor = COST_FACTOR.get(clip.scene, 1.0)
        frames = 40 if clip.simulation is None else clip.simulation.frames  # a real recording is not open yet
        if task.kind is Kind.MATCHED:
            return factor * task.pairs * self.window_s[method.key]
        if method.family is Family.TRACKER:
            return factor * frames * self.own_s
        tracked = min(config.segments, frames // config.segment_frames) * config.segment_frames
        if clip.scene is Scene.PAPER:
            return tracked * self.frame_s[method.key] * len(task.forms) / _forms(config)
        return factor * tracked * self.alone_s[method.key] * len(task.forms)

    def making(self, clip: Clip) -> float:
        """Seconds to simulate a clip and to find its reference."""
        if clip.simulation is None:
            return 10.0
        return 5.0 + MAKING * self.own_s * clip.simulation.frames * clip.simulation.cameras


def _forms(config: ExperimentConfig) -> int:
    """Number of forms that a method runs in on a recording of the paper's scene, over all sizes of hole."""
    ends = min(len(config.holes_m), 2)
    return ends * len(config.forms) + len(config.holes_m) - ends


def usual_costs(methods: Sequence[Method], config: ExperimentConfig) -> Costs:
    """Return the costs on an idle core."""
    forms, method_s = _forms(config), {method.key: method.frame_ms / 1000.0 for method in methods}
    return Costs(
        {key: forms * USUAL_FORM_S + len(config.holes_m) * spent for key, spent in method_s.items()},
        {key: USUAL_FORM_S + spent for key, spent in method_s.items()},
        {key: 0.05 + 3.0 * spent for key, spent in method_s.items()},
        USUAL_OWN_S,
    )


def measure_costs(spec: PlanSpec, clips: Sequence[Clip], processes: int) -> Costs:
    """The mean costs on as many clips as there are processes, all at once, since they slow each other down.

    Raises AnchorposeError where the patient is not found in one of them.
    """
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        every = list(pool.map(partial(_measure, spec), clips[:processes]))
    return Costs(
        _means([one.frame_s for one in every]),
        _means([one.alone_s for one in every]),
        _means([one.window_s for one in every]),
        float(np.mean([one.own_s for one in every])),
    )


def _means(every: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {key: float(np.mean([one[key] for one in every])) for key in every[0]}


def _measure(spec: PlanSpec, clip: Clip) -> Costs:
    """On the first segment and the windows of a clip; a little of the same work is done before, to compile it."""
    plan = spec.plan()
    with one_thread(), prepare_clip(clip, plan) as prepared, open_trials(prepared, plan, plan.holes(clip)) as trials:
        if not prepared.starts:
            raise AnchorposeError(f"{clip.name}: the patient is not found in a whole segment of it.")
        methods = [method for method in plan.methods if method.associate is not None]

        def wanted(method: Method) -> list[Trial]:
            return [trial.within(plan.forms(clip, hole_m, method)) for hole_m, trial in trials.items()]

        alone = [trials[0.0].within([Form.REFINED])]
        alone_s = {method.key: _frame_s(method, plan, prepared, alone) for method in methods}
        frame_s = {method.key: _frame_s(method, plan, prepared, wanted(method)) for method in methods}
        window_s = {method.key: _window_s(method, plan, prepared, trials) for method in methods}
        own_s = _seconds(lambda: track_whole(OWN_TRACKER[0], None, prepared.recording)) / len(prepared.in_hole)
    return Costs(frame_s, alone_s, window_s, own_s)


def _frame_s(method: Method, plan: Plan, prepared: PreparedClip, trials: Sequence[Trial]) -> float:
    setting, starts, length = plan.settings[method.key], prepared.starts[:1], plan.config.segment_frames
    track_segments(method, setting, trials, starts, WARM_FRAMES)
    return _seconds(lambda: track_segments(method, setting, trials, starts, length)) / length


def _window_s(method: Method, plan: Plan, prepared: PreparedClip, trials: Mapping[float, Trial]) -> float:
    setting = plan.settings[method.key]
    known = windows_of(method, setting, prepared, trials[0.0], plan)
    for window, _ in known[:1]:
        warm_up(method, setting, window)
    return sum(_seconds(partial(score, method, setting, *one)) for one in known) / max(len(known), 1)


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def duration(seconds: float) -> str:
    """Format a duration for readers."""
    minutes = max(1, round(seconds / 60))
    return f"{minutes} minutes" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
