"""Recordings side by side, a process each, with progress; what was done stays when it is stopped."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from dataclasses import dataclass
from functools import partial
from multiprocessing import active_children, get_context
from types import FrameType
from typing import Final, NoReturn, TypeVar

from anchorpose.errors import AnchorposeError
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.plan import PlanSpec, Task
from anchorpose.research.experiment.work import work_on

MAKING_S: Final = 0.35  # of one core for a frame of one camera: simulated, and tracked for the reference
POLL_S: Final = 0.5
TERMINATED: Final = 143
STOP_S: Final = 5.0  # that a worker has to take its temporary files away

Shown = TypeVar("Shown")
Progress = Callable[[float, float], None]
"""Called with seconds of one core done, and to do in all, about."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Clips and what is asked about them."""

    spec: PlanSpec
    clips: tuple[Clip, ...]

    def tasks(self) -> list[Task]:
        """Of all clips."""
        plan = self.spec.plan()
        return [task for clip in self.clips for task in plan.tasks(clip)]

    def left_s(self) -> float:
        """Of one core: what is asked and not answered, and the recordings that this takes."""
        return _left_s(self.tasks())


def do(
    job: Job, processes: int, progress: Progress, after_s: float, beside: Callable[[], Shown] | None = None
) -> tuple[list[str], Shown | None]:
    """Answers everything, clips side by side; a sentence for each clip of which something could not be answered.

    after_s: what is to be done after this job, for the time left. beside: something else that takes its time, done in
    one of the processes; what it returns is the second task.
    """
    tasks = job.tasks()
    left_s = _left_s(tasks)
    open_clips = {task.clip.name for task in tasks if not task.done}
    clips = sorted((c for c in job.clips if c.name in open_clips), key=_making_s, reverse=True)
    if not clips and beside is None:
        return [], None
    failed = list[str]()
    executor = ProcessPoolExecutor(processes, mp_context=get_context("spawn"), initializer=_be_a_worker)
    try:
        shown = None if beside is None else executor.submit(_unless_stopped, beside)
        pending = {executor.submit(_work, clip, job.spec) for clip in clips}
        while pending:
            done, pending = wait(pending, timeout=POLL_S, return_when=FIRST_COMPLETED)
            failed += [sentence for future in done if (sentence := future.result())]
            progress(left_s - _left_s(tasks), left_s + after_s)
        result = None if shown is None else shown.result()
    except BaseException:
        for child in active_children():
            child.terminate()
        for child in active_children():
            child.join(STOP_S)
        raise
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
    return failed, result


def _left_s(tasks: list[Task]) -> float:
    by_clip: dict[str, float] = {}
    for task in tasks:
        if not task.done:
            by_clip[task.clip.name] = by_clip.get(task.clip.name, _making_s(task.clip)) + task.cost_s
    return sum(by_clip.values())


def _making_s(clip: Clip) -> float:
    return 10.0 if clip.simulation is None else 5.0 + MAKING_S * clip.simulation.frames * clip.simulation.cameras


def _be_a_worker() -> None:
    """Ctrl-C is for the parent, which then asks to end in a way that takes temporary files away."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(TERMINATED)


def _work(clip: Clip, spec: PlanSpec) -> str | None:
    """One clip; the other recordings are still worth comparing on, so what was wrong with it is told, not raised."""
    try:
        _unless_stopped(partial(work_on, clip, spec.plan()))
    except AnchorposeError as error:
        return f"{clip.name}: {error}"
    return None


def _unless_stopped(work: Callable[[], Shown]) -> Shown:
    """What the work returns. Stopped, the process ends: the pool would take that for an answer and go on."""
    try:
        return work()
    except SystemExit as end:  # by now temporary files are away
        os._exit(int(end.code or 0))
