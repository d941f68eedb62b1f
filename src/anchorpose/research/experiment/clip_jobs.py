"""Run the tasks of an experiment, one job per recording, with the job engine of ``batch``, and report progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from anchorpose.batch.cluster import Job, Place, run_jobs
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.costs import Costs
from anchorpose.research.experiment.plan import PlanSpec, Task
from anchorpose.research.experiment.work import work_on

BESIDE: Final = "pictures"

Progress = Callable[[float, float], None]
"""Function that is called with approximate seconds of computing on one core: seconds done, and seconds in total."""


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """A part of an experiment (training or test): its clips (recordings), the plan of their tasks, and the tasks'
    costs.
    """

    spec: PlanSpec
    clips: tuple[Clip, ...]
    costs: Costs

    def tasks(self) -> list[Task]:
        """Return the tasks of all clips (recordings)."""
        plan = self.spec.plan()
        return [task for clip in self.clips for task in plan.tasks(clip)]

    def left_s(self) -> float:
        """Return the estimated seconds on one core for all tasks without a result, and for making their recordings."""
        return self.cost_s(self.tasks())

    def cost_s(self, tasks: list[Task]) -> float:
        """Return the estimated seconds on one core for all of ``tasks`` without a result, and for making their
        recordings.
        """
        by_clip: dict[str, float] = {}
        for task in tasks:
            if not task.done:
                known = by_clip.get(task.clip.name, self.costs.making(task.clip))
                by_clip[task.clip.name] = known + self.costs.of(task, self.spec.config)
        return sum(by_clip.values())


def do(
    part: Part, processes: int, progress: Progress, after_s: float, beside: Callable[[], object] | None = None
) -> list[str]:
    """Do all tasks without a result, several clips at a time; return a sentence for each clip that failed.

    after_s: seconds of computing that follow this part, which ``progress`` includes in the total. beside: a function
    that runs at the same time, as an additional job, which starts first.
    """
    tasks = part.tasks()
    left_s = part.cost_s(tasks)
    open_clips = {task.clip.name for task in tasks if not task.done}
    clips = sorted((c for c in part.clips if c.name in open_clips), key=part.costs.making, reverse=True)
    logs = part.spec.cache / "logs"
    jobs = [Job(clip.name, partial(_work, clip, part.spec), logs / f"{clip.name}.log") for clip in clips]
    if beside is not None:
        jobs.insert(0, Job(BESIDE, beside, logs / f"{BESIDE}.log"))
    outcomes = run_jobs(jobs, Place(processes), lambda: progress(left_s - part.cost_s(tasks), left_s + after_s))
    return [f"{outcome.name}: {outcome.why}" for outcome in outcomes if outcome.why is not None]


def _work(clip: Clip, spec: PlanSpec) -> None:
    work_on(clip, spec.plan())
