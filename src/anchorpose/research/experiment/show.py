"""Pictures of one recording, and how long the paper's own steps take on it.

How long a mesh of every pixel and its five distance fields take, beside the paper's 0.72 s and 0.23 s.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.geodesics.distance import geodesic_distance, geodesic_distance_to_set
from anchorpose.geodesics.extrema import surface_center
from anchorpose.research.experiment.answers import Brief, Plan
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.framework import paper_config
from anchorpose.research.experiment.matching import take_window
from anchorpose.research.experiment.outcome import PaperTimes
from anchorpose.research.experiment.pictures.album import write_pictures
from anchorpose.research.experiment.reference import Reference
from anchorpose.research.experiment.work import Subject, pierced, subject_of
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.results.folder import whole_or_nothing
from anchorpose.surface.mesh import edges
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import Surface
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.preparation import prepare_room
from anchorpose.tracker.room import Room

ROUNDS = 5  # of which the median counts


def measure(frame: int, room: Room, reference: Reference, config: TrackConfig) -> PaperTimes | None:
    """One frame's times, after everything was compiled; None where the patient is not known in it."""
    fine = replace(config.surface, step=1)
    window = take_window(frame, room, reference, None, config)
    if window is None:
        return None
    views = [view for view in window.observations[0].evidence.views if view is not None]

    def mesh() -> Surface:
        return patient_surface(views, room.cameras, None, fine)

    surface = mesh()
    sources = _five(surface)
    return PaperTimes(
        nodes=len(surface),
        edges=len(edges(surface)),
        mesh_s=_median_s(mesh),
        feature_s=_median_s(lambda: geodesic_distance(surface, sources)),
        dijkstra_s=_median_s(lambda: solve_distance(surface, sources, solver=Solver.DIJKSTRA)),
    )


def _five(surface: Surface) -> np.ndarray:
    """Five nodes far from the centre and from each other, as anchors are."""
    chosen = [surface_center(surface)]
    for _ in range(5):
        field = geodesic_distance_to_set(surface, np.array(chosen))
        chosen.append(int(np.argmax(np.where(np.isfinite(field), field, -1.0))))
    return np.array(chosen[1:])


def _median_s(work: Callable[[], object]) -> float:
    took = []
    for _ in range(ROUNDS):
        start = time.process_time()
        work()
        took.append(time.process_time() - start)
    return float(np.median(took))


PICTURES = "pictures"


def show(out: Path, brief: Brief, trainers: Sequence[Clip]) -> tuple[PaperTimes | None, tuple[str, ...]]:
    """Writes ``out / pictures``, empty where nothing can be shown; the times, and a sentence for each failed recording.

    Of the training recordings the last on which it can be done: its movements are the fastest.
    """
    plan, times, failed = brief.plan(), None, list[str]()
    with whole_or_nothing(out / PICTURES) as folder, one_thread():
        for clip in reversed(trainers):
            try:
                times = _show_one(folder.parent / folder.name, plan, clip)
            except AnchorposeError as error:
                failed.append(f"{clip.name} is not shown: {error}")
                continue
            break
    return times, tuple(failed)


def _show_one(folder: Path, plan: Plan, clip: Clip) -> PaperTimes | None:
    config, middle = paper_config(plan.movements), sorted(plan.config.holes_m)[len(plan.config.holes_m) // 2]
    with subject_of(clip, plan) as subject, pierced(subject, middle) as (holed, cut):
        if not subject.starts:
            return None
        times = measure(subject.starts[0], prepare_room(subject.recording, config), subject.reference, config)
        frame = _moving_frame(subject, cut)
        if subject.skin is not None and frame is not None:
            write_pictures(
                folder, subject.recording, holed, subject.reference, subject.skin, frame, plan.methods, plan.settings,
                plan.movements,
            )  # fmt: skip
    return times


def _moving_frame(subject: Subject, cut: np.ndarray) -> int | None:
    """Of the frames with a hole whose frame before has none, the one that the body has moved most to."""
    found = subject.reference.found
    fits = np.flatnonzero(cut[1:-3] & ~cut[:-4] & found[1:-3] & found[:-4]) + 1
    if len(fits) == 0:
        return None
    moved = np.linalg.norm(np.diff(subject.reference.joints_m, axis=0), axis=2).mean(axis=1)
    return int(fits[np.argmax(moved[fits - 1])])
