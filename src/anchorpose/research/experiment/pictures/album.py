"""Draw the page's pictures from one training recording, and measure the time of the paper's steps."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.geodesics.distance import geodesic_distance, geodesic_distance_to_set
from anchorpose.geodesics.extrema import surface_center
from anchorpose.research.experiment.clips import Clip
from anchorpose.research.experiment.config import Form
from anchorpose.research.experiment.correspondence import Skin
from anchorpose.research.experiment.given import GivenFrames
from anchorpose.research.experiment.matching import take_window
from anchorpose.research.experiment.method import PROPOSED, Method
from anchorpose.research.experiment.pictures.canvas import (
    Moment,
    Picture,
    View,
    as_png,
    default_style,
    take_moment,
    taken_pixels,
    upright_view,
)
from anchorpose.research.experiment.pictures.hypotheses import hypothesis_pictures
from anchorpose.research.experiment.pictures.matches import match_pictures, pairs_of
from anchorpose.research.experiment.pictures.regions import HoledFrame, region_pictures
from anchorpose.research.experiment.pictures.tracked import follow, tracked_picture
from anchorpose.research.experiment.plan import Plan, PlanSpec, identity
from anchorpose.research.experiment.results import PaperTimes
from anchorpose.research.experiment.work import PreparedClip, Trial, open_trials, prepare_clip
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.results.folder import whole_or_nothing
from anchorpose.surface.mesh import edges
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import Surface
from anchorpose.threads import one_thread
from anchorpose.tracker.room import Run
from anchorpose.versions import code_digest


@dataclass(frozen=True, slots=True, eq=False)
class _Sources:
    """The data from which pictures are drawn."""

    view: View
    skin: Skin
    whole: Moment  # two successive frames, both without a hole
    hole: Moment  # these two frames, with a hole in the second
    holed: Trial  # the recording with holes


def write_pictures(
    folder: Path, prepared: PreparedClip, whole: Trial, holed: Trial, hole_frame: int, plan: Plan
) -> None:
    """Draw all pictures of a recording, and write them as *.png and pictures.json into a folder.

    pictures.json is a list of {"file", "caption", "section"} in the order of the page. prepared: a simulated recording.
    whole, holed: this recording without and with holes. hole_frame: position of a frame with a hole whose previous
    frame has none. Raises ValueError if the patient was not found in the frame before ``hole_frame``, and
    MissingPackage without matplotlib.
    """
    with default_style():
        sources, centre_m = _prepare_sources(prepared, whole, holed, hole_frame), prepared.reference.centre_m
        seen = sources.whole.window.observations[1]
        taken = taken_pixels(whole.given.frame(hole_frame), holed.given.frame(hole_frame))
        frame = HoledFrame(f"Frame {hole_frame}", seen.whole, seen.anchors, taken, centre_m[hole_frame])
        pictures = chain(
            _matches(sources, plan.methods, plan.settings),
            _proposed(sources, plan.methods, plan.settings, hole_frame - 1),
            region_pictures(sources.view, frame),
        )
        contents = [write_picture(folder, picture) for picture in pictures]
    (folder / "pictures.json").write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")


def write_picture(folder: Path, picture: Picture) -> dict[str, str]:
    """Write a picture as PNG, and return its entry for pictures.json."""
    (folder / picture.file).write_bytes(as_png(picture.figure))
    return {"file": picture.file, "caption": picture.caption, "section": picture.section}


def _prepare_sources(prepared: PreparedClip, without: Trial, holed: Trial, hole_frame: int) -> _Sources:
    skin, frame = prepared.skin, hole_frame - 1
    if frame < 0:
        raise ValueError(f"hole_frame must have a frame before it, got {hole_frame}")
    if skin is None:
        raise ValueError("only a simulated recording has a true correspondence to draw")
    whole = take_moment(frame, without, skin, "whole", "Nothing hidden")
    hole = take_moment(frame, holed, skin, "hole", "With a hole in the second frame")
    return _Sources(upright_view(without.given.room.cameras[0]), skin, whole, hole, holed)


def _matches(sources: _Sources, methods: Sequence[Method], settings: Mapping[str, object]) -> Iterator[Picture]:
    for moment in (sources.whole, sources.hole):
        asked = [
            pairs_of(each, settings[each.key], moment) for each in methods if _on_these_meshes(each, moment, settings)
        ]
        yield from match_pictures(sources.view, moment, [pairs for pairs in asked if pairs is not None])


def _on_these_meshes(method: Method, moment: Moment, settings: Mapping[str, object]) -> bool:
    """Return whether the method matches nodes of the drawn meshes; a method that closes holes uses other meshes."""
    if method.associate is None:
        return False
    config = moment.window.config
    return method.configure(config, settings[method.key]).surface == config.surface


def _proposed(
    sources: _Sources, methods: Sequence[Method], settings: Mapping[str, object], start: int
) -> Iterator[Picture]:
    """Yield pictures of tracked joints and hypotheses of the proposed method, if it is among the methods."""
    for method in methods:
        if method.key == PROPOSED:
            setting, holed, truth_m = settings[method.key], sources.holed, sources.skin.performance.joints_m()
            frames = follow(start, holed.given, holed.runs[Form.REFINED], method, setting, truth_m)
            yield tracked_picture(sources.view, method, frames, holed.given.room.recording.rate_hz, start)
            for moment in (sources.whole, sources.hole):
                yield from hypothesis_pictures(sources.view, moment, method, setting)


ROUNDS: Final = 5  # number of runs in which each step is timed; the median of their times is reported


def measure_times(frame: int, given: GivenFrames, run: Run) -> PaperTimes | None:
    """Return the times of the paper's steps (mesh and distances) on one frame, measured after everything was compiled.

    Return None if the patient was not found in the frame.
    """
    fine = replace(run.config.surface, step=1)
    window = take_window(frame, given, run)
    if window is None:
        return None
    views = [view for view in window.observations[0].evidence.views if view is not None]

    def mesh() -> Surface:
        return patient_surface(views, run.room.cameras, None, fine)

    surface = mesh()
    sources, camera = _five(surface), run.room.cameras[0]
    return PaperTimes(
        image=f"{camera.width} x {camera.height}",
        nodes=len(surface),
        edges=len(edges(surface)),
        mesh_s=_median_s(mesh),
        feature_s=_median_s(lambda: geodesic_distance(surface, sources)),
        dijkstra_s=_median_s(lambda: solve_distance(surface, sources, solver=Solver.DIJKSTRA)),
    )


def _five(surface: Surface) -> np.ndarray:
    """Return five nodes that are far from the centre and from each other, as anchors are."""
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


SHOWN: Final = "shown.json"  # file beside the pictures: the measured times, and a digest of the inputs of the pictures
OWN_FILES: Final = ("*.png", "pictures.json", SHOWN)

Shown = tuple[PaperTimes | None, tuple[str, ...]]


def show(out: Path, spec: PlanSpec, trainers: Sequence[Clip]) -> Shown:
    """Write the folder ``out / pictures``; return the measured times of the paper's steps, and a sentence for each
    recording that failed.

    The folder has no pictures if nothing can be drawn. Pictures are made from the last training recording, which has
    fast movements; if this fails, from the recording before it. Times are measured on a larger image
    (``_paper_size_times``). A run that does not tune settings measures no times, since it only shows that the program
    runs. Pictures that an earlier run made from the same inputs are kept.
    """
    plan = spec.plan()
    known = shown_before(out, plan, trainers)
    if known is not None:
        return known
    with whole_or_nothing(out / "pictures", OWN_FILES) as folder, one_thread():
        times, failed = _show_last(folder.parent / folder.name, plan, trainers)
        account = {
            "made_of": _made_of(plan, trainers),
            "times": None if times is None else asdict(times),
            "failed": failed,
        }
        (folder / SHOWN).write_text(json.dumps(account), encoding="utf-8")
    return times, failed


def _made_of(plan: Plan, trainers: Sequence[Clip]) -> str:
    """Return the digest of everything that the pictures depend on: code, methods, settings and recordings."""
    methods = [(method.key, method.content, plan.settings[method.key]) for method in plan.methods]
    what = (code_digest(), plan.config, methods, plan.movements_digest, [identity(clip) for clip in trainers])
    return plan.store.path("pictures", *what).stem


def shown_before(out: Path, plan: Plan, trainers: Sequence[Clip]) -> Shown | None:
    """Return the times and sentences that ``show`` returned when it made the existing pictures; None if no pictures
    from the same inputs exist.
    """
    try:
        account = json.loads((out / "pictures" / SHOWN).read_text(encoding="utf-8"))
        if account["made_of"] != _made_of(plan, trainers):
            return None
        return None if account["times"] is None else PaperTimes(**account["times"]), tuple(account["failed"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _show_last(folder: Path, plan: Plan, trainers: Sequence[Clip]) -> Shown:
    failed, shown = list[str](), False
    for clip in reversed(trainers):
        try:
            if not shown:
                _show_one(folder, plan, clip)
                shown = True
            return _paper_size_times(plan, clip), tuple(failed)
        except AnchorposeError as error:
            failed.append(f"{clip.name} is not shown: {error}")
    return None, tuple(failed)


def _show_one(folder: Path, plan: Plan, clip: Clip) -> None:
    middle = sorted(plan.config.holes_m)[len(plan.config.holes_m) // 2]
    with prepare_clip(clip, plan) as prepared, open_trials(prepared, plan, (0.0, middle)) as trials:
        frame = _moving_frame(prepared, trials[middle].cut)
        if prepared.skin is not None and frame is not None:
            write_pictures(folder, prepared, trials[0.0], trials[middle], frame, plan)


PAPER_SIZE: Final = "azure-kinect"  # camera in whose image a person has as many pixels as the paper's mesh has nodes


def _paper_size_times(plan: Plan, clip: Clip) -> PaperTimes | None:
    """Return the times of the paper's steps on an image in which a person has as many pixels as the paper's mesh has
    nodes.

    The image is from a simulated camera with a finer resolution (``PAPER_SIZE``). Return None for a clip that is not
    simulated, for a run that tunes no settings, and if the patient is not found.
    """
    if clip.simulation is None or not plan.config.tuned:
        return None
    seconds = (plan.config.segment_frames + 1) / plan.config.fps
    finer = replace(clip.simulation, sensor=PAPER_SIZE, seconds=seconds)
    finer_clip = replace(clip, name=f"{clip.name}, finer", simulation=finer)
    with prepare_clip(finer_clip, plan) as prepared, open_trials(prepared, plan, (0.0,)) as trials:
        if not prepared.starts:
            return None
        return measure_times(prepared.starts[0], trials[0.0].given, trials[0.0].runs[Form.REFINED])


def _moving_frame(prepared: PreparedClip, cut: np.ndarray) -> int | None:
    """Return the frame in which the patient moves fastest, of the frames with a hole whose previous frame has none.

    cut (t,) bool: frames with a hole. Return None if no frame qualifies.
    """
    found = prepared.reference.found
    fits = np.flatnonzero(cut[1:-3] & ~cut[:-4] & found[1:-3] & found[:-4]) + 1
    if len(fits) == 0:
        return None
    moved = np.linalg.norm(np.diff(prepared.reference.joints_m, axis=0), axis=2).mean(axis=1)
    return int(fits[np.argmax(moved[fits - 1])])
