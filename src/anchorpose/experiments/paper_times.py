"""How long a mesh of every pixel and its five distance fields take, beside the paper's 0.72 s and 0.23 s."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from anchorpose.experiments.outcome import PaperTimes
from anchorpose.experiments.reference import Reference
from anchorpose.experiments.windows import take_window
from anchorpose.geodesics.distance import Solver, geodesic_distance, geodesic_distance_to_set
from anchorpose.geodesics.extrema import surface_center
from anchorpose.surface.mesh import edges
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import Surface
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.room import Room

ROUNDS = 5  # of which the median counts


def measure(frame: int, room: Room, reference: Reference, config: TrackConfig) -> PaperTimes | None:
    """One frame's times, after everything was compiled; None where the patient is not known in it."""
    fine = replace(config.surface, sheet=replace(config.surface.sheet, step=1))
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
        dijkstra_s=_median_s(lambda: geodesic_distance(surface, sources, solver=Solver.DIJKSTRA)),
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
