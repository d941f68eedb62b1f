"""Define the public benchmark: its recordings (fixed by seeds of the simulator), tasks, and their names in answers."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final

from anchorpose.research.experiment.config import PAPER_HOLES_M
from anchorpose.simulate import config as presets
from anchorpose.simulate.config import SimulationConfig

VERSION: Final = 2
"""Version of the benchmark.

The version increases with every change of recordings, tasks or scores, since scores of different versions cannot be
compared.
"""

SECONDS: Final = 6.0
FPS: Final = 10.0  # frames per second; the paper's samples (frames), too, are about a tenth of a second apart
GAPS: Final = {"association-0.1s": 1, "association-0.3s": 3, "association-1s": 10, "association-1.5s": 15}
"""Number of frames from the first to the second frame of a pair, by task. In these tasks, nodes are matched."""

FIRST_FRAMES: Final = (4, 22, 40)  # first frames of the pairs in a recording, the same for every value of ``GAPS``
CLINIC: Final = "clinic"
NODES: Final = "nodes"
TRACKING: Final = {f"tracking-{hole_m:.2f}m": hole_m for hole_m in PAPER_HOLES_M}
"""Radius in metres of the hole in the depth images, by task; 0 = no hole. In these tasks, joints are tracked."""

TASKS: Final = (*GAPS, *TRACKING, CLINIC)


class Part(StrEnum):
    """A part of the benchmark: recordings for developing a method, or recordings for the numbers on the leader
    board.
    """

    DEVELOPMENT = "development"
    TEST = "test"


SEEDS: Final = {
    Part.DEVELOPMENT: (range(7601, 7603), range(7651, 7652)),
    Part.TEST: (range(7701, 7711), range(7751, 7755)),
}
"""Seeds of each part: first the seeds of single recordings (one person, one camera), then the seeds of clinics (three
cameras, a standing frame and two therapists). No setting of anchorpose was chosen on these recordings.
"""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two frames of a recording. The task is to match the nodes (points of the patient's surface) of the first frame
    with nodes of the second frame.
    """

    task: str
    name: str
    first_frame: int
    second_frame: int
    first: str  # file with the nodes of the first frame, relative to the benchmark folder
    second: str  # file with the nodes of the second frame, relative to the benchmark folder


@dataclass(frozen=True, slots=True)
class Group:
    """All recordings made from one seed: a single recording (one person, one camera) and its copies with holes, or a
    clinic (a recording of a patient with two therapists by three cameras, see ``SEEDS``).
    """

    part: Part
    is_clinic: bool
    seed: int

    @property
    def name(self) -> str:
        """Return the group's folder, relative to the benchmark folder."""
        return f"{self.part}/{'clinic' if self.is_clinic else 'single'}-{self.seed}"

    @property
    def simulation(self) -> SimulationConfig:
        """Return the settings with which the simulator makes the group's recording."""
        preset = presets.clinic if self.is_clinic else presets.single
        return preset(self.seed, SECONDS, FPS)

    @property
    def recordings(self) -> dict[str, str]:
        """Return, for each task, the path of its recording's folder, relative to the benchmark folder; this path is
        also the recording's name in answers.
        """
        if self.is_clinic:
            return {CLINIC: f"{self.name}/recording"}
        return {task: f"{self.name}/hole-{round(100 * hole_m):03d}" for task, hole_m in TRACKING.items()}

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """Return the pairs of frames to be matched, in the recording without holes; a group with a clinic (three
        cameras and therapists) has no such pairs.
        """
        if self.is_clinic:
            return ()
        return tuple(
            Pair(task, f"{self.name}/{first:06d}", first, first + gap, self.nodes(first), self.nodes(first + gap))
            for task, gap in GAPS.items()
            for first in FIRST_FRAMES
        )

    def nodes(self, frame: int) -> str:
        """Return the file of a frame's nodes, relative to the benchmark folder."""
        return f"{self.name}/{NODES}/{frame:06d}.csv"

    def truth(self, benchmark: Path) -> Path:
        """Return the path of the file of true joints of the group's recordings. benchmark: the benchmark folder."""
        return benchmark / self.name / "truth.npz"


def groups_of(part: Part, at_most: int | None = None) -> tuple[Group, ...]:
    """Return the groups of a part. at_most: maximum number of groups with a single recording (one person, one camera),
    and also of groups with a clinic (a patient with two therapists, three cameras), both in the order of their seeds;
    None = all groups.
    """
    single, clinic = SEEDS[part]
    return tuple(
        Group(part, is_clinic, seed)
        for is_clinic, seeds in ((False, single), (True, clinic))
        for seed in seeds[:at_most]
    )


ALL_GROUPS: Final = tuple(group for part in Part for group in groups_of(part))
