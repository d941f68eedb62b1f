"""Recordings in parallel, one process each, with progress; finished results stay when it is stopped."""

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

MAKING_S: Final = 0.35  # on one core per frame and camera: to simulate it and to track the reference
POLL_S: Final = 0.5
TERMINATED: Final = 143
STOP_S: Final = 5.0  # for a worker to remove its temporary files

Shown = TypeVar("Shown")
Progress = Callable[[float, float], None]
"""Called with the approximate seconds on one core, done and in total."""


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """Clips, and the plan of their tasks."""

    spec: PlanSpec
    clips: tuple[Clip, ...]

    def tasks(self) -> list[Task]:
        """The tasks of all clips."""
        plan = self.spec.plan()
        return [task for clip in self.clips for task in plan.tasks(clip)]

    def left_s(self) -> float:
        """Seconds on one core for the open tasks and the recordings that they need."""
        return _left_s(self.tasks())


def do(
    job: Job, processes: int, progress: Progress, after_s: float, beside: Callable[[], Shown] | None = None
) -> tuple[list[str], Shown | None]:
    """Do all tasks, clips in parallel; returns a sentence for each clip with a task that could not be done.

    after_s: seconds of work after this job, for the time left. beside: other work that runs in one of the processes;
    its return value is the second result.
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
    """Ctrl-C goes to the parent, which then terminates the workers so that they remove their temporary files."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _end)


def _end(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(TERMINATED)


def _work(clip: Clip, spec: PlanSpec) -> str | None:
    """Work on one clip; an error is returned, not raised, because the other recordings can still be compared."""
    try:
        _unless_stopped(partial(work_on, clip, spec.plan()))
    except AnchorposeError as error:
        return f"{clip.name}: {error}"
    return None


def _unless_stopped(work: Callable[[], Shown]) -> Shown:
    """The work's return value. When stopped, the process ends: the pool would take SystemExit for a result."""
    try:
        return work()
    except SystemExit as end:  # temporary files are removed by now
        os._exit(int(end.code or 0))
