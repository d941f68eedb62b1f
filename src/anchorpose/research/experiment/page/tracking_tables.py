"""Make tables of tracked joints' errors: by size of hole, by joint, by scene, and as ratios to errors without holes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from anchorpose.joints import JOINT_NAMES
from anchorpose.research.experiment.config import Form, Scene
from anchorpose.research.experiment.method import Method
from anchorpose.research.experiment.page.selection import Kept, Tracking, ablated, compared, frame_means, without_hands
from anchorpose.research.experiment.page.tables import (
    Column,
    Estimate,
    Row,
    Table,
    Unit,
    deviation_over,
    mean_over,
    median_over,
    ratio_of,
)
from anchorpose.research.experiment.results import ExperimentResults

Groups = list[np.ndarray]
Summary = Callable[[Groups], Estimate]

SAME_NOTE = "The same frames for every method: those that all methods below ran on."
BODY_NOTE = "Without hands and wrists, which are most of every mean over all joints."

OTHER_HOLES = (Scene.LOOSE, Scene.REAL)
"""Scenes in which holes are cut, other than the paper's."""


def tracking_tables(results: ExperimentResults) -> list[Table]:
    """Return tables of the paper's scene, of all scenes, and of the variants of this project's tracker."""
    tracking = Tracking(results)
    tables = [*_paper_tables(results, tracking), _unrejected(results), _scene_table(results, tracking)]
    tables += [_other_holes(results, tracking, scene) for scene in OTHER_HOLES]
    tables.append(_ablation_table(results, tracking))
    return [table for table in tables if table.rows]


def _paper_tables(results: ExperimentResults, tracking: Tracking) -> list[Table]:
    resamples = results.config.resamples
    methods = tracking.ran(Scene.PAPER, compared(results.methods))
    kept = tracking.shared(Scene.PAPER, methods)
    mean = partial(mean_over, resamples=resamples)
    median = partial(median_over, resamples=resamples)
    deviation = partial(deviation_over, resamples=resamples)
    by_size = partial(by_size_rows, tracking, methods, kept)
    by_joint = partial(_by_joint, tracking, methods, kept)
    note = note_on(kept)
    return [
        Table("result1", "Mean joint error by size of hole, mm (r_or)", "hole_m", note, by_size(mean)),
        Table("median", "Median joint error by size of hole, mm", "hole_m", note, by_size(median)),
        Table(
            "body",
            "Mean error of the joints but hands and wrists by size of hole, mm",
            "hole_m",
            f"{note} {BODY_NOTE}",
            by_size(of_body(mean)),
        ),
        Table(
            "sd1",
            "Standard deviation over frames of a frame’s mean error, mm",
            "hole_m",
            note,
            by_size(lambda groups: deviation([frame_means(group) for group in groups])),
        ),
        Table(
            "result1_occluded",
            "Mean joint error by size of hole, mm, only frames with a hole",
            "hole_m",
            note,
            by_size(mean, occluded=True),
        ),
        Table(
            "known",
            "Share of joints with an error",
            "hole_m",
            f"{note} Joints that a method or the reference lacks do not count in any mean.",
            by_size(lambda groups: mean([np.isfinite(group).astype(float) for group in groups]), unit=Unit.SHARE),
        ),
        Table(
            "ratio",
            "Mean error with a hole over that without, in the same frames",
            "hole_m",
            note,
            _ratios(tracking, methods, kept, resamples, False),
        ),
        Table(
            "ratio_occluded",
            "Mean error with a hole over that without, only frames with a hole",
            "hole_m",
            note,
            _ratios(tracking, methods, kept, resamples, True),
        ),
        Table("result2", "Mean error by joint over all sizes of hole, mm (r_i)", "joint", note, by_joint(mean)),
        Table(
            "sd2",
            "Standard deviation of the error by joint over all sizes of hole, mm",
            "joint",
            note,
            by_joint(deviation),
        ),
    ]


def _unrejected(results: ExperimentResults) -> Table:
    """Return the paper's table "result1" for the form (variant) of the framework that the paper describes, which
    rejects no matches.
    """
    tracking = Tracking(results, Form.REFINED_ALL)
    methods = tracking.ran(Scene.PAPER, compared(results.methods))
    kept = tracking.shared(Scene.PAPER, methods)
    rows = by_size_rows(tracking, methods, kept, partial(mean_over, resamples=results.config.resamples))
    title = "Mean joint error by size of hole, nothing rejected as in the paper, mm"
    return Table("result1_all", title, "hole_m", note_on(kept), rows)


def of_body(summarise: Summary) -> Summary:
    """Return the function that summarises errors as ``summarise`` does, but without hands and wrists."""
    return lambda groups: summarise([without_hands(group) for group in groups])


def note_on(kept: Kept) -> str:
    """Return the note below a table, which states from which frames, and from how many, the table is made."""
    sizes = {hole for _, hole in kept}
    count = sum(len(chosen) for chosen in kept.values()) // max(len(sizes), 1)
    return f"{SAME_NOTE} {count} frames for each size of hole."


def _other_holes(results: ExperimentResults, tracking: Tracking, scene: Scene) -> Table:
    """Return the paper's table "result1" for another scene."""
    methods = tracking.ran(scene, compared(results.methods))
    kept = tracking.shared(scene, methods)
    rows = by_size_rows(tracking, methods, kept, partial(mean_over, resamples=results.config.resamples), scene=scene)
    return Table(
        f"{scene}_by_size", f"Mean joint error by size of hole, mm, scene “{scene}”", "hole_m", note_on(kept), rows
    )


def hole_column(hole_m: float, unit: Unit = Unit.MM) -> Column:
    """Return the column of a table for recordings with one size of hole in their depth images."""
    return Column(f"{hole_m:g}", f"{hole_m:.2f} m" if hole_m else "none", unit)


def by_size_rows(
    tracking: Tracking,
    methods: Sequence[Method],
    kept: Kept,
    summarise: Summary,
    occluded: bool = False,
    unit: Unit = Unit.MM,
    scene: Scene = Scene.PAPER,
) -> tuple[Row, ...]:
    """Return a row (value) for every method and size of hole of a scene. occluded: use only frames with a hole."""
    return tuple(
        Row(
            method,
            hole_column(hole, unit),
            summarise(list(tracking.errors(scene, method.key, hole, kept, occluded).values())),
        )
        for method in methods
        for hole in tracking.holes(scene)
        if hole > 0 or not occluded
    )


def _by_joint(tracking: Tracking, methods: Sequence[Method], kept: Kept, summarise: Summary) -> tuple[Row, ...]:
    rows = []
    for method in methods:
        together = list(errors_of_all_sizes(tracking, method.key, kept).values())
        for index, name in enumerate(JOINT_NAMES):
            rows.append(Row(method, Column(name, name), summarise([errors[:, index] for errors in together])))
    return tuple(rows)


def errors_of_all_sizes(tracking: Tracking, method: str, kept: Kept | None = None) -> dict[str, np.ndarray]:
    """Return a method's joint errors (f, 21) in millimetres, by recording of the paper's scene.

    The frames of one size of hole follow the frames of the next smaller size.

    Every size of hole has the same number of frames.
    """
    parts: dict[str, list[np.ndarray]] = {}
    for hole in tracking.holes(Scene.PAPER):
        for recording, errors in tracking.errors(Scene.PAPER, method, hole, kept).items():
            parts.setdefault(recording, []).append(errors)
    return {recording: np.concatenate(arrays) for recording, arrays in sorted(parts.items())}


def _ratios(
    tracking: Tracking, methods: Sequence[Method], kept: Kept, resamples: int, occluded: bool
) -> tuple[Row, ...]:
    return tuple(
        Row(method, hole_column(hole, Unit.RATIO), ratio_to_none(tracking, method.key, hole, resamples, occluded, kept))
        for method in methods
        for hole in tracking.holes(Scene.PAPER)
        if hole > 0
    )


def ratio_to_none(
    tracking: Tracking, method: str, hole_m: float, resamples: int, occluded: bool = False, kept: Kept | None = None
) -> Estimate:
    """Return a method's mean error with a hole divided by its error without a hole, in the same frames.

    occluded: use only frames whose depth images have a hole.
    """
    pairs = tracking.pairs(Scene.PAPER, (method, hole_m), (method, 0.0), occluded, kept).values()
    return ratio_of([with_hole for with_hole, _ in pairs], [without for _, without in pairs], resamples)


def _scene_table(results: ExperimentResults, tracking: Tracking) -> Table:
    rows, all_methods = [], compared(results.methods)
    for method in all_methods:
        for scene in Scene:
            methods = tracking.ran(scene, all_methods)
            if method in methods:
                kept = tracking.shared(scene, methods)
                rows += _in_scene(tracking, scene, method, kept, results.config.resamples)
    return Table("scenes", "Mean joint error by scene, mm", "scene", f"{SAME_NOTE} Scene by scene.", tuple(rows))


def _in_scene(tracking: Tracking, scene: Scene, method: Method, kept: Kept, resamples: int) -> list[Row]:
    """Return a method's rows (values) in a scene: without a hole and, if holes are cut, with the largest hole."""
    return [
        Row(
            method,
            scene_column(scene, hole),
            mean_over(list(tracking.errors(scene, method.key, hole, kept).values()), resamples),
        )
        for hole in _end_holes(tracking, scene)
    ]


def _end_holes(tracking: Tracking, scene: Scene) -> list[float]:
    """Return the smallest and the largest size of hole of a scene, in metres, or the only size."""
    holes = tracking.holes(scene)
    return list(dict.fromkeys((holes[0], holes[-1])))


def scene_column(scene: Scene, hole_m: float) -> Column:
    """Return the column of a table for a scene and a size of hole."""
    return Column(f"{scene} {hole_m:g}", f"{scene}, {hole_m:.2f} m" if hole_m else str(scene))


def _ablation_table(results: ExperimentResults, tracking: Tracking) -> Table:
    """Return the mean errors of the tracker's variants over the joints that all variants found, and how many joints of
    the same frames each variant found.
    """
    methods = ablated(results.methods)
    rows = [row for scene in Scene for row in _ablation_rows(tracking, scene, methods, results.config.resamples)]
    # The sort is stable, so the columns of each method keep their order
    rows.sort(key=lambda row: methods.index(row.method))
    note = (
        "The tracker without one component at a time; the same frames for all variants. The mean is over the joints "
        "that all variants found; “known” is the share of joints that a variant found."
    )
    return Table("ablation", "Ablation of anchorpose’s tracker: mean joint error, mm", "scene", note, tuple(rows))


def _ablation_rows(tracking: Tracking, scene: Scene, methods: Sequence[Method], resamples: int) -> list[Row]:
    """Return the rows of one scene, sorted by size of hole; none if fewer than two variants ran."""
    together, rows = tracking.ran(scene, methods), list[Row]()
    if len(together) < 2:
        return rows
    kept = tracking.shared(scene, together)
    for hole in _end_holes(tracking, scene):
        column, recordings = scene_column(scene, hole), [recording for recording, of in kept if of == hole]
        errors = {method: tracking.errors(scene, method.key, hole, kept) for method in together}
        found = {recording: np.isfinite([errors[method][recording] for method in together]) for recording in recordings}
        for index, method in enumerate(together):
            common = [errors[method][recording][found[recording].all(axis=0)] for recording in recordings]
            known = [found[recording][index].astype(float) for recording in recordings]
            share = Column(f"{column.key} known", f"{column.label}, known", Unit.SHARE)
            rows += [Row(method, column, mean_over(common, resamples)), Row(method, share, mean_over(known, resamples))]
    return rows
