"""Scores of answers, task by task, and the paired comparison of two.

What was not answered is counted by itself, and lies outside of every share.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

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

WITHIN_MM: Final = 50.0
FAR_MM: Final = 100.0
RESAMPLES: Final = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchScore:
    """Matches of nodes that are seen in both frames; None where there is nothing to take a figure of.

    missing_share: of ``nodes``, those without a row; none_share: said to have no match. Millimetres are along the body,
    of the matches given; shares within 50 mm are of all nodes. hidden_none_share: of nodes that are on the body and not
    seen in the second frame, those said to have no match.
    """

    recordings: int
    nodes: int
    missing_share: float
    none_share: float
    median_mm: float | None
    within_50mm: float
    moved_nodes: int
    moved_median_mm: float | None
    moved_within_50mm: float | None
    hidden_nodes: int
    hidden_none_share: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class JointScore:
    """Joints in frames. missing_share: of ``joint_frames``, those without a position; millimetres are of the others,
    shares within 50 and 100 mm of all. coverage_95: of the axes of joints with a sigma, those with the truth within
    1.96 sigma; sigma_share: of the positions, those with a sigma."""

    recordings: int
    joint_frames: int
    missing_share: float
    mean_mm: float | None
    median_mm: float | None
    p95_mm: float | None
    within_50mm: float
    within_100mm: float
    sigma_share: float | None
    coverage_95: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """tasks: those with any answer; errors_mm: of each task by group, NaN where missing, for comparisons."""

    method: str
    source: str
    part: Part
    other_bytes: tuple[str, ...]
    elsewhere: int
    tasks: Mapping[str, MatchScore | JointScore]
    errors_mm: Mapping[str, Mapping[str, np.ndarray]]


def score_answers(benchmark: Benchmark, answers: Answers, part: Part) -> Score:
    """Every task of a part that the answers take part in: all of its recordings in the folder count."""
    groups = [group for group in benchmark.groups if group.part is part]
    tasks, errors = dict[str, MatchScore | JointScore](), dict[str, dict[str, np.ndarray]]()
    matched = [group for group in groups if group.pairs]
    by_gap = _matches(benchmark, answers, matched)
    for task in TASKS:
        if task in GAPS and by_gap.get(task):
            errors[task] = {name: np.concatenate([one.error_mm for one in each]) for name, each in by_gap[task].items()}
            tasks[task] = _match_score(by_gap[task])
        names = {group.name: group.recordings[task] for group in groups if task in group.recordings}
        if any(name in answers.joints for name in names.values()):
            found = {group.name: _joints(benchmark, answers, group, task) for group in groups if group.name in names}
            errors[task] = {name: one.error_mm for name, one in found.items()}
            tasks[task] = _joint_score(list(found.values()))
    other = tuple(said for said in benchmark.other_bytes if said.startswith(part))
    return Score(answers.method, answers.source, part, other, answers.elsewhere, tasks, errors)


@dataclass(frozen=True, slots=True, eq=False)
class _Matched:
    """The seen nodes of a pair: error_mm, match, moved (m,); none_hidden: of the hidden nodes, said to have none."""

    error_mm: np.ndarray
    match: np.ndarray
    moved: np.ndarray
    none_hidden: np.ndarray


def _matches(benchmark: Benchmark, answers: Answers, groups: list[Group]) -> dict[str, dict[str, list[_Matched]]]:
    """By task and group, for tasks that have any answer."""
    taken = {task for task, _ in answers.matches}
    found: dict[str, dict[str, list[_Matched]]] = {task: {} for task in GAPS if task in taken}
    for group in groups if any((p.task, p.name) in answers.matches for g in groups for p in g.pairs) else ():
        skin = Skin(group.simulation)
        for pair in group.pairs:
            if pair.task in taken:
                truth = truth_of(benchmark.folder / group.name, pair, skin)
                match = answers.matches.get((pair.task, pair.name), np.full(len(truth.first_m), NO_ROW, np.int64))
                seen = truth.places.seen
                one = _Matched(
                    truth.error_mm(match)[seen], match[seen], truth.moved[seen], match[truth.hidden] == NO_MATCH
                )
                found[pair.task].setdefault(group.name, []).append(one)
    return found


def _match_score(by_group: Mapping[str, list[_Matched]]) -> MatchScore:
    every = [one for each in by_group.values() for one in each]
    error, match, moved, hidden = (
        np.concatenate([getattr(one, name) for one in every]) for name in ("error_mm", "match", "moved", "none_hidden")
    )
    return MatchScore(
        recordings=len(by_group),
        nodes=len(error),
        missing_share=float((match == NO_ROW).mean()),
        none_share=float((match == NO_MATCH).mean()),
        median_mm=_median(error),
        within_50mm=float((error <= WITHIN_MM).mean()),
        moved_nodes=int(moved.sum()),
        moved_median_mm=_median(error[moved]),
        moved_within_50mm=float((error[moved] <= WITHIN_MM).mean()) if moved.any() else None,
        hidden_nodes=len(hidden),
        hidden_none_share=float(hidden.mean()) if len(hidden) else None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Joints:
    """Of m joints with a known truth: error_mm, NaN where missing; within (m, 3): axes in 1.96 sigma; has_sigma."""

    error_mm: np.ndarray
    within: np.ndarray
    has_sigma: np.ndarray


def _joints(benchmark: Benchmark, answers: Answers, group: Group, task: str) -> _Joints:
    truth_m = read_truth(group.truth(benchmark.folder)).position_m
    known, answer = np.isfinite(truth_m).all(axis=2), answers.joints.get(group.recordings[task])
    if answer is None:
        nothing = np.zeros(int(known.sum()), bool)
        return _Joints(np.full(len(nothing), np.nan), np.zeros((len(nothing), 3), bool), nothing)
    away_m = (answer.position_m - truth_m)[known]
    sigma_m = answer.sigma_m[known]
    error_mm = 1000.0 * np.linalg.norm(away_m, axis=1)
    return _Joints(error_mm, np.abs(away_m) <= NORMAL_95 * sigma_m[:, None], np.isfinite(sigma_m * error_mm))


def _joint_score(every: list[_Joints]) -> JointScore:
    error, within, has_sigma = (
        np.concatenate([getattr(one, name) for one in every]) for name in ("error_mm", "within", "has_sigma")
    )
    given = error[np.isfinite(error)]
    return JointScore(
        recordings=len(every),
        joint_frames=len(error),
        missing_share=1.0 - len(given) / len(error),
        mean_mm=float(given.mean()) if len(given) else None,
        median_mm=_median(error),
        p95_mm=float(np.percentile(given, 95)) if len(given) else None,
        within_50mm=float((error <= WITHIN_MM).mean()),
        within_100mm=float((error <= FAR_MM).mean()),
        sigma_share=float(has_sigma.sum() / len(given)) if len(given) else None,
        coverage_95=float(within[has_sigma].mean()) if has_sigma.any() else None,
    )


def _median(error_mm: np.ndarray) -> float | None:
    given = error_mm[np.isfinite(error_mm)]
    return float(np.median(given)) if len(given) else None


def compare(one: Score, other: Score) -> dict[str, Any]:
    """``one`` minus ``other``, by task, with 95 % intervals by the bootstrap over recordings, drawn in pairs.

    mm: mean distance where both have an answer, negative where ``one`` is nearer; within_50mm: share of everything that
    was asked, positive where ``one`` is better.
    """
    compared = dict[str, Any]()
    for task in (task for task in one.errors_mm if task in other.errors_mm):
        pairs = [(mine, other.errors_mm[task][name]) for name, mine in one.errors_mm[task].items()]
        shares = [(a <= WITHIN_MM).astype(float) - (b <= WITHIN_MM) for a, b in pairs]
        compared[task] = {
            "mm": as_json(mean_over([a - b for a, b in pairs], RESAMPLES)),
            "within_50mm": as_json(mean_over(shares, RESAMPLES)),
        }
    return compared


def as_document(score: Score) -> dict[str, Any]:
    """The score as JSON values; tasks without any answer are null."""
    return {
        "format": "anchorpose-benchmark-score",
        "version": VERSION,
        "method": score.method,
        "source": score.source,
        "part": score.part,
        "other_bytes": list(score.other_bytes),
        "rows_elsewhere": score.elsewhere,
        "tasks": {task: as_json(score.tasks.get(task)) for task in TASKS},
        "row": leader_board_row(score),
    }


def leader_board_row(score: Score) -> str:
    """A row of the table of docs/benchmark.md: the method; per cent within 50 mm, all / moved, by gap; mean joint error
    by hole and in clinics, with the share that is missing; per cent in 1.96 sigma."""
    cells = [score.method]
    for task in GAPS:
        one = score.tasks.get(task)
        moved = one.moved_within_50mm if isinstance(one, MatchScore) else None
        cells.append(f"{100 * one.within_50mm:.1f} / {_percent(moved)}" if isinstance(one, MatchScore) else "–")
    cells += [_joint_cell(score.tasks.get(task)) for task in (*TRACKING, CLINIC)]
    clinic = score.tasks.get(CLINIC)
    cells.append(_percent(clinic.coverage_95) if isinstance(clinic, JointScore) else "–")
    return "| " + " | ".join(cells) + " |"


def _joint_cell(one: MatchScore | JointScore | None) -> str:
    if not isinstance(one, JointScore):
        return "–"
    mean = "–" if one.mean_mm is None else f"{one.mean_mm:.1f}"
    return mean if one.missing_share < 0.0005 else f"{mean} ({100 * one.missing_share:.1f} % missing)"


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100 * share:.1f}"
