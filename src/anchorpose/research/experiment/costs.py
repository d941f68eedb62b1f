"""How long the open tasks of an experiment take, measured on its first segment on this machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import ExperimentConfig, Form, Scene
from anchorpose.research.experiment.framework import GivenStarts, paper_run
from anchorpose.research.experiment.matching import Window, score, take_window, truth_of
from anchorpose.research.experiment.method import Family, Method, cached_per_pair
from anchorpose.research.experiment.plan import Kind, Plan, Task
from anchorpose.research.experiment.work import prepare_clip, track_segments
from anchorpose.threads import one_thread
from anchorpose.tracker.run import Run

COST_FACTOR: Final = {Scene.CLINIC_FRONT: 1.5, Scene.CLINIC: 3.0}  # therapists; three cameras
USUAL_FRAME_S: Final = 0.035  # in the framework without the method, on an idle core
MEASURED_FRAMES: Final = 5  # of a segment
WINDOW_FRAMES: Final = 4.0  # each with a descriptor, and matches with the next


@dataclass(frozen=True, slots=True)
class Costs:
    """Seconds of this machine's time.

    frame_s: per frame in the framework without the method; window_s: per pair of frames whose matches are compared,
    likewise, on meshes that all methods share; own_s: per frame of this project's tracker, learning included;
    making_s: to simulate a frame of a camera and to track the reference; method_s: per frame and method.
    """

    frame_s: float
    window_s: float
    own_s: float
    making_s: float
    method_s: Mapping[str, float]

    def of(self, task: Task, config: ExperimentConfig) -> float:
        """Seconds of a task."""
        clip, method = task.clip, task.method
        factor, own_s = COST_FACTOR.get(clip.scene, 1.0), self.method_s.get(method.key, 0.0)
        frames = 40 if clip.simulation is None else clip.simulation.frames  # a real recording is not open yet
        if task.kind is Kind.MATCHED:
            return factor * task.pairs * (self.window_s + WINDOW_FRAMES * own_s)
        if method.family is Family.TRACKER:
            return factor * frames * self.own_s
        tracked = min(config.segments, frames // config.segment_frames) * config.segment_frames
        times = len(task.forms) if method.own_surface else 1  # its mesh depends on the pose, so forms share nothing
        return factor * tracked * (len(task.forms) * self.frame_s + times * own_s)

    def making(self, clip: Clip) -> float:
        """Seconds to simulate a clip and to find its reference."""
        if clip.simulation is None:
            return 10.0
        return 5.0 + self.making_s * clip.simulation.frames * clip.simulation.cameras


def usual_costs(methods: Sequence[Method], slower: float = 1.0) -> Costs:
    """On an idle core, or on a machine that takes ``slower`` times as long."""
    each = {method.key: slower * method.frame_ms / 1000.0 for method in methods}
    return Costs(slower * USUAL_FRAME_S, slower * 0.05, slower * 0.15, slower * 0.35, each)


def measure_costs(plan: Plan, clip: Clip) -> Costs:
    """The costs of every method on the first segment of a clip; all work is done once before, to compile it.

    Raises AnchorposeError where the patient is not found in it.
    """
    with one_thread(), prepare_clip(clip, plan) as prepared:
        if not prepared.starts or prepared.skin is None:
            return usual_costs(plan.methods)
        run = paper_run(prepared.recording, plan.movements)
        none = next((m for m in plan.methods if m.family is Family.NONE), plan.methods[0])
        given = GivenStarts(run.room, prepared.reference)
        frame_s = _second_s(lambda: _track_some(none, plan, given, run, prepared.starts[:1])) / MEASURED_FRAMES
        usual = usual_costs(plan.methods, frame_s / USUAL_FRAME_S)
        window = take_window(prepared.starts[0], prepared.reference, run)
        if window is None or len(window.observations) < 3:
            return usual
        truth = truth_of(window, prepared.skin)
        window_s = _second_s(lambda: score(none, plan.settings[none.key], window, truth))
        each = {m.key: _method_s(m, plan.settings[m.key], window) for m in plan.methods}
    return replace(usual, window_s=window_s, method_s=each)


def _track_some(method: Method, plan: Plan, given: GivenStarts, run: Run, starts: Sequence[int]) -> None:
    track_segments(method, plan.settings[method.key], given, {Form.REFINED: run}, starts, MEASURED_FRAMES + 1)


def _second_s(work: Callable[[], object]) -> float:
    """Seconds of the second time: the first compiles."""
    work()
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def _method_s(method: Method, setting: object, window: Window) -> float:
    """Seconds per frame: one descriptor, and its matches with the frame before."""
    if method.associate is None:
        return 0.0
    config, (first, second, third) = method.configure(window.config, setting), window.observations[:3]
    for _ in range(2):  # the first compiles
        associate = cached_per_pair(method.associate(setting))
        associate(first, second, config).all()
        began = time.perf_counter()
        associate(second, third, config).all()
    return time.perf_counter() - began


def duration(seconds: float) -> str:
    """For readers."""
    minutes = max(1, round(seconds / 60))
    return f"{minutes} minutes" if minutes < 90 else f"{minutes // 60} h {minutes % 60:02d} min"
