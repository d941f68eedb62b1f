"""Score a method's answers to the benchmark's questions, task by task, and compare the answers of two methods.

In shares of small errors, such as ``within_50mm``, a missing answer counts as an error above the limit. The share of
missing answers is reported, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from anchorpose.research.benchmark.answers import NO_MATCH, NO_ROW, Answers
from anchorpose.research.benchmark.make import Benchmark
from anchorpose.research.benchmark.plan import CLINIC, GAPS, TASKS, TRACKING, VERSION, Group, Part
from anchorpose.research.benchmark.truth import truth_of
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.research.experiment.page.tables import mean_over
from anchorpose.results.run_record import as_json
from anchorpose.results.truth import read_truth
from anchorpose.results.uncertainty import NORMAL_95

WITHIN_MM, FAR_MM = 50.0, 100.0  # mm, largest errors that count in ``within_50mm`` and ``within_100mm``
RESAMPLES: Final = 2000  # number of random draws of recordings from which the bootstrap computes each interval


class Asked(NamedTuple):
    """The m questions of a task about one recording, each with the comparison of its answer with the truth.

    In tasks of matching, a question asks which node of a pair's second frame matches a certain node of the first frame;
    it is asked only if the second frame shows the true place of the match. In tasks of tracking, a question asks for
    the position of a joint in a frame, if the true position is known.
    """

    error_mm: np.ndarray  # (m,), distance of the answer from the truth; NaN for missing answers and "no match"
    none: np.ndarray  # (m,) bool, questions answered by "no match"
    moved: np.ndarray  # (m,) bool, nodes that moved by more than ``truth.MOVED_M``
    # (m, 3), by axis: 1 if the truth lies within 1.96 sigma of the answer, 0 if not, NaN if no sigma is given
    within: np.ndarray


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskScore:
    """The statistics of the errors in one task over all recordings; None = no data for this statistic.

    ``within_50mm`` and ``within_100mm`` are shares of all questions; errors in mm cover only questions whose answer is
    a node or a position, so missing answers and the answer "no match" are left out.
    """

    recordings: int
    asked: int  # number of questions
    missing_share: float  # share of the questions without an answer
    none_share: float  # share of the questions answered by "no match"
    mean_mm: float | None
    median_mm: float | None
    p95_mm: float | None
    within_50mm: float
    within_100mm: float
    moved: int  # number of nodes that moved by more than ``truth.MOVED_M``
    moved_median_mm: float | None
    moved_within_50mm: float | None
    coverage_95: float | None  # share of errors of at most 1.96 sigma, among all coordinates (x, y, z) with a sigma


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """The score of a set of answers."""

    answers: Answers
    part: Part
    # a sentence for each recording of the part whose fingerprint differs from the published fingerprint
    other_bytes: tuple[str, ...]
    tasks: Mapping[str, TaskScore]  # only tasks with at least one answer
    # questions of the tasks in ``tasks``, by task and name of the group (recordings of a seed)
    asked: Mapping[str, Mapping[str, Asked]]


def score_answers(benchmark: Benchmark, answers: Answers, part: Part) -> Score:
    """Score every task that has answers, over all recordings of the part in the benchmark folder."""
    groups = [group for group in benchmark.groups if group.part is part]
    asked: dict[str, dict[str, Asked]] = {}
    for group in groups:
        tasks = [task for task in TASKS if _takes_part(answers, groups, task)]
        for task, one in (*_matches(benchmark, answers, group, tasks), *_joints(benchmark, answers, group, tasks)):
            asked.setdefault(task, {})[group.name] = one
    scores = {task: summarise(list(asked[task].values())) for task in TASKS if task in asked}
    other = tuple(said for said in benchmark.other_bytes if said.startswith(part))
    return Score(answers, part, other, scores, asked)


def _takes_part(answers: Answers, groups: Sequence[Group], task: str) -> bool:
    if task in GAPS:
        return any((task, pair.name) in answers.matches for group in groups for pair in group.pairs)
    return any(group.recordings.get(task) in answers.joints for group in groups)


def _matches(benchmark: Benchmark, answers: Answers, group: Group, tasks: Sequence[str]) -> Iterable[tuple[str, Asked]]:
    """Return, for each task of matching nodes (``GAPS``), its name and its questions about a group of recordings."""
    pairs, found = [pair for pair in group.pairs if pair.task in tasks], dict[str, list[Asked]]()
    if not pairs:
        return []
    skin = Skin(group.simulation)
    for pair in pairs:
        truth = truth_of(benchmark.folder / group.name, pair, skin)
        match = answers.matches.get((pair.task, pair.name), np.full(len(truth.first_m), NO_ROW))
        unknown = np.full((len(match), 3), np.nan)
        every = Asked(truth.error_mm(match), match == NO_MATCH, truth.moved, unknown)
        found.setdefault(pair.task, []).append(Asked(*(column[truth.places.seen] for column in every)))
    return [(task, _together(each)) for task, each in found.items()]


def _joints(benchmark: Benchmark, answers: Answers, group: Group, tasks: Sequence[str]) -> Iterable[tuple[str, Asked]]:
    """Yield, for each task of tracking joints, its name and its questions about a group of recordings."""
    truth_m = read_truth(group.truth(benchmark.folder)).position_m
    known = np.isfinite(truth_m).all(axis=2)
    for task in (task for task in group.recordings if task in tasks):
        answer, none = answers.joints.get(group.recordings[task]), np.zeros(int(known.sum()), bool)
        position_m = np.full_like(truth_m, np.nan) if answer is None else answer.position_m
        sigma_m = np.full(known.shape, np.nan) if answer is None else answer.sigma_m
        away_m, limit_m = (position_m - truth_m)[known], NORMAL_95 * sigma_m[known][:, None]
        within = np.where(np.isfinite(away_m + limit_m), np.abs(away_m) <= limit_m, np.nan)
        yield task, Asked(1000.0 * np.linalg.norm(away_m, axis=1), none, none, within)


def _together(each: Sequence[Asked]) -> Asked:
    return Asked(*(np.concatenate(columns) for columns in zip(*each, strict=True)))


def summarise(each: Sequence[Asked]) -> TaskScore:
    """Return the statistics of the errors in a task over all recordings. each: the questions about each recording."""
    error, none, moved, within = _together(each)
    given, covered = error[np.isfinite(error)], within[np.isfinite(within)]
    moved_error = error[moved]
    return TaskScore(
        recordings=len(each),
        asked=len(error),
        missing_share=float((np.isnan(error) & ~none).mean()),
        none_share=float(none.mean()),
        mean_mm=float(given.mean()) if len(given) else None,
        median_mm=float(np.median(given)) if len(given) else None,
        p95_mm=float(np.percentile(given, 95)) if len(given) else None,
        within_50mm=float((error <= WITHIN_MM).mean()),
        within_100mm=float((error <= FAR_MM).mean()),
        moved=len(moved_error),
        moved_median_mm=float(np.nanmedian(moved_error)) if np.isfinite(moved_error).any() else None,
        moved_within_50mm=float((moved_error <= WITHIN_MM).mean()) if len(moved_error) else None,
        coverage_95=float(covered.mean()) if len(covered) else None,
    )


def compare(one: Score, other: Score) -> dict[str, dict[str, Any]]:
    """Return, by task, the differences ``one`` minus ``other`` in two statistics (mm, within_50mm), with the ends of
    their 95 % intervals (keys that end in _low and _high).

    mm: mean error over the questions that both answer, negative if ``one`` is better. within_50mm: share of all
    questions with an error of at most 50 mm, positive if ``one`` is better. Intervals come from the bootstrap over
    recordings, which draws the same recordings for both scores.
    """
    compared = {}
    for task in (task for task in TASKS if task in one.asked and task in other.asked):
        pairs = [(mine.error_mm, other.asked[task][name].error_mm) for name, mine in one.asked[task].items()]
        shares = [(a <= WITHIN_MM).astype(float) - (b <= WITHIN_MM) for a, b in pairs]
        figures = {"mm": mean_over([a - b for a, b in pairs], RESAMPLES), "within_50mm": mean_over(shares, RESAMPLES)}
        compared[task] = {
            f"{name}{end}": getattr(figure, field)
            for name, figure in figures.items()
            for end, field in (("", "mean"), ("_low", "low"), ("_high", "high"))
        }
    return as_json(compared)


def as_document(score: Score) -> dict[str, Any]:
    """Return the score as values for a JSON file; tasks without any answer are null."""
    return {
        "format": "anchorpose-benchmark-score",
        "version": VERSION,
        "method": score.answers.method,
        "source": score.answers.source,
        "part": score.part,
        "other_bytes": list(score.other_bytes),
        "rows_elsewhere": score.answers.elsewhere,
        "tasks": {task: as_json(score.tasks.get(task)) for task in TASKS},
        "row": leader_board_row(score),
    }


def leader_board_row(score: Score) -> str:
    """Return a row of the leader board, the table in docs/benchmark.md.

    For each gap (number of frames from the first to the second frame of a pair), a cell has the percentages of all
    nodes and of moved nodes that are matched within 50 mm. For each size of hole and for the clinic recordings (a
    patient with two therapists), a cell has the mean joint error (mm), and the percentage of missing joints if this is
    0.05 % or more. The last cell has, for the clinic recordings, the percentage of joint coordinates whose true value
    lies within 1.96 sigma of the answer.
    """
    cells = [score.answers.method]
    for task in (*GAPS, *TRACKING, CLINIC):
        one = score.tasks.get(task)
        if one is None:
            cells.append("–")
        elif task in GAPS:
            cells.append(f"{100 * one.within_50mm:.1f} / {_percent(one.moved_within_50mm)}")
        else:
            missing = f" ({100 * one.missing_share:.1f} % missing)" if one.missing_share >= 0.0005 else ""
            cells.append(("–" if one.mean_mm is None else f"{one.mean_mm:.1f}") + missing)
    clinic = score.tasks.get(CLINIC)
    return "| " + " | ".join([*cells, _percent(None if clinic is None else clinic.coverage_95)]) + " |"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"
