"""Make tables by form (variant) of the paper's framework, and by gap (time between the two frames whose nodes are
matched); compare the method "next generation" (anchors with the local descriptor SHOT) with the other methods.

The forms of the paper's framework differ in whether body parts are also registered to the surface, and in whether bad
matches are rejected. Tables of "next generation" compare this method with every other method.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from anchorpose.research.experiment.config import Form, Scene
from anchorpose.research.experiment.method import NEXT, Method
from anchorpose.research.experiment.page.selection import (
    Matching,
    Tracking,
    compared,
    every_mm,
    frame_means,
    of_moved,
    penalised_mm,
    without_hands,
)
from anchorpose.research.experiment.page.tables import Column, Estimate, Row, Table, Unit, mean_over, median_over
from anchorpose.research.experiment.page.tracking_tables import BODY_NOTE, Summary, note_on, of_body
from anchorpose.research.experiment.results import ExperimentResults, Matched

FORM_NAMES = {
    Form.REFINED: "surface",
    Form.REFINED_ALL: "surface, nothing rejected",
    Form.MATCHES: "matches alone",
    Form.MATCHES_ALL: "matches alone, nothing rejected",
}
WITHIN_MM = 50.0  # mm, a match with a smaller error counts as good; this is the paper's bound on an anchor's error

Take = Callable[[Matched], np.ndarray]


def form_tables(results: ExperimentResults) -> list[Table]:
    """Return all tables of this module that have data."""
    mean = partial(mean_over, resamples=results.config.resamples)
    median = partial(median_over, resamples=results.config.resamples)
    tables = [
        _by_form(results, "forms", "Mean joint error by form of the framework, mm", "", mean),
        _by_form(results, "forms_median", "Median joint error by form of the framework, mm", "", median),
        _by_form(results, "forms_body", "The same without hands and wrists, mean, mm", BODY_NOTE, of_body(mean)),
        *_gap_tables(results),
        _next_joints(results, "next_joints", "all joints", frame_means),
        _next_joints(results, "next_body", "without hands and wrists", lambda e: frame_means(without_hands(e))),
        *_next_matches(results),
    ]
    return [table for table in tables if table.rows]


def _columns(results: ExperimentResults) -> list[tuple[Form, float, Column]]:
    """Return up to two entries per form of the paper's framework: without holes in the depth images, and with the
    largest holes. Each entry has the form, the radius of the holes (m), and the column of the table.
    """
    found = []
    for form in results.config.forms:
        holes = Tracking(results, form).holes(Scene.PAPER)
        for hole in dict.fromkeys((holes[0], holes[-1])) if holes else ():
            label = f"{FORM_NAMES[form]}, {f'{hole:.2f} m' if hole else 'none'}"
            found.append((form, hole, Column(f"{form} {hole:g}", label)))
    return found


def _by_form(results: ExperimentResults, key: str, title: str, note: str, summarise: Summary) -> Table:
    rows, text = dict[str, list[Row]](), ""
    for form, hole, column in _columns(results):
        tracking = Tracking(results, form)
        methods = tracking.ran(Scene.PAPER, compared(results.methods))
        kept = tracking.shared(Scene.PAPER, methods)
        text = note_on(kept)
        for method in methods:
            errors = tracking.errors(Scene.PAPER, method.key, hole, kept)
            rows.setdefault(method.key, []).append(Row(method, column, summarise(list(errors.values()))))
    return Table(key, title, "form", f"{text} {note}".strip(), tuple(row for own in rows.values() for row in own))


def _gap_tables(results: ExperimentResults) -> list[Table]:
    """Return tables of matches by gap between the two frames, for all nodes and for nodes that moved."""
    resamples = results.config.resamples

    def share(take: Take) -> Take:
        return lambda match: np.where(np.isfinite(take(match)), take(match) < WITHIN_MM, False).astype(float)

    wanted: list[tuple[str, str, Unit, Callable[..., Estimate], Take]] = [
        (
            "gaps_within",
            f"Share of nodes whose match lies within {WITHIN_MM:.0f} mm",
            Unit.SHARE,
            mean_over,
            share(every_mm),
        ),
        ("gaps_median", "Median error of the matches, mm", Unit.MM, median_over, every_mm),
        ("gaps_mean", "Mean error of the matches, mm", Unit.MM, mean_over, every_mm),
        (
            "moved_within",
            f"Nodes that moved over 3 cm: share within {WITHIN_MM:.0f} mm",
            Unit.SHARE,
            mean_over,
            of_moved(share(every_mm)),
        ),
        ("moved_median", "Nodes that moved over 3 cm: median error, mm", Unit.MM, median_over, of_moved(every_mm)),
        ("moved_mean", "Nodes that moved over 3 cm: mean error, mm", Unit.MM, mean_over, of_moved(every_mm)),
    ]
    return [
        _by_gap(results, key, title, unit, partial(summarise, resamples=resamples), take)
        for key, title, unit, summarise, take in wanted
    ]


def _by_gap(results: ExperimentResults, key: str, title: str, unit: Unit, summarise: Summary, take: Take) -> Table:
    rows, counts = dict[str, list[Row]](), list[str]()
    for gap_s in results.config.gaps_s:
        matching = Matching(results, gap_s)
        counts.append(f"{len(matching.windows)} pairs of frames {gap_s:g} s apart")
        for method in matching.methods:
            for hole in dict.fromkeys((*matching.holes()[:1], *matching.holes()[-1:])):
                label = f"{gap_s:g} s, {f'{hole:.2f} m' if hole else 'none'}"
                values = list(matching.values(method.key, take, hole).values())
                column = Column(f"{gap_s:g} {hole:g}", label, unit)
                rows.setdefault(method.key, []).append(Row(method, column, summarise(values)))
    note = f"The track tree’s choice, nothing rejected, of all nodes seen in both frames; {', '.join(counts)}."
    return Table(key, title, "gap", note, tuple(row for own in rows.values() for row in own))


def _next_joints(results: ExperimentResults, key: str, what: str, take: Callable[[np.ndarray], np.ndarray]) -> Table:
    """Return a table of the joint error of "next generation" minus each other method's error, in the same frames."""
    rows = dict[str, list[Row]]()
    for form, hole, column in [*_columns(results), *_all_sizes(results)]:
        tracking = Tracking(results, form)
        methods = tracking.ran(Scene.PAPER, compared(results.methods))
        for method in _others(methods):
            pairs = tracking.pairs(Scene.PAPER, (NEXT, hole), (method.key, hole)).values()
            value = mean_over([take(one - other) for one, other in pairs], results.config.resamples)
            rows.setdefault(method.key, []).append(Row(method, column, value))
    note = "Below 0: the next generation is better. Paired: the same frames, intervals over recordings."
    return Table(
        key,
        f"Joint error of the next generation minus that of each row, {what}, mm",
        "form",
        note,
        tuple(row for own in rows.values() for row in own),
    )


def _all_sizes(results: ExperimentResults) -> list[tuple[Form, float, Column]]:
    """Return (form, radius of the hole, column of the table) for the forms (variants) of the paper's framework that fit
    body parts to the surface, with the sizes of hole that ``_columns`` leaves out.
    """
    return [
        (form, hole, Column(f"{form} {hole:g}", f"{FORM_NAMES[form]}, {hole:.2f} m"))
        for form in results.config.forms
        for hole in Tracking(results, form).holes(Scene.PAPER)[1:-1]
        if form.refined
    ]


def _others(methods: Sequence[Method]) -> list[Method]:
    """Return all methods except "next generation", with which they are compared; return an empty list if "next
    generation" is not among ``methods``.
    """
    keys = {method.key for method in methods}
    return [method for method in methods if method.key != NEXT] if NEXT in keys else []


def _next_matches(results: ExperimentResults) -> list[Table]:
    wanted: tuple[tuple[str, str, Take], ...] = (
        ("next_matches", "all nodes, nothing rejected", every_mm),
        ("next_matches_rejected", "all nodes, rejection, a missing match counting 100 mm", penalised_mm),
        ("next_matches_moved", "nodes that moved over 3 cm, nothing rejected", of_moved(every_mm)),
    )
    return [_minus(results, key, what, take) for key, what, take in wanted]


def _minus(results: ExperimentResults, key: str, what: str, take: Take) -> Table:
    rows = dict[str, list[Row]]()
    for gap_s in results.config.gaps_s:
        matching = Matching(results, gap_s)
        for method in _others(matching.methods):
            for hole in dict.fromkeys((*matching.holes()[:1], *matching.holes()[-1:])):
                ones, others = (_window_means(matching, name, take, hole) for name in (NEXT, method.key))
                value = mean_over(
                    [one - other for one, other in zip(ones, others, strict=True)], results.config.resamples
                )
                column = Column(f"{gap_s:g} {hole:g}", f"{gap_s:g} s, {f'{hole:.2f} m' if hole else 'none'}")
                rows.setdefault(method.key, []).append(Row(method, column, value))
    note = "Mean error of a pair of frames, paired by pair. Below 0: the next generation is better."
    return Table(
        key,
        f"Error of the next generation’s matches minus that of each row, {what}, mm",
        "gap",
        note,
        tuple(row for own in rows.values() for row in own),
    )


def _window_means(matching: Matching, method: str, take: Take, hole_m: float) -> list[np.ndarray]:
    """Return, per recording, the mean error of each window (pair of frames); NaN for a window without a match."""

    def mean(match: Matched) -> np.ndarray:
        values = take(match)
        known = values[np.isfinite(values)]
        return np.array([known.mean() if len(known) else np.nan])

    return list(matching.values(method, mean, hole_m).values())
