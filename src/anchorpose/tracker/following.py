"""A patient through all frames: found, followed, lost, searched for and found again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from anchorpose.body.poor_depth import PoorDepth, too_coarse
from anchorpose.body.skin_points import FittedShape
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.estimate import Estimate, nobody_found
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.run import Run
from anchorpose.tracker.search import Search
from anchorpose.tracker.start import NoStart, Start, find_start

FIRST_PAUSE, LONGEST_PAUSE = 5, 15  # frames between searches that fail, doubled each time: one costs thirty frames
UNSEEN = "the patient was not seen any more"


def follow_patient(
    run: Run, frames: Iterable[FrameSet], known: FittedShape | None, begin: Start | None = None
) -> Iterator[Estimate]:
    """An estimate for every frame, in order: lost until the patient is found, followed, and searched for when lost.

    frames: in the order of time, or against it; the first one should be the room's initial frame. known: the learnt
    shape; None where it is still to be learnt. begin: the patient as already found in the first frame.
    """
    choice = run.room.initial_frame.choice if run.room.initial_frame else None
    for estimate, _ in follow_openly(run, frames, choice, known, begin):
        yield estimate


def follow_openly(
    run: Run,
    frames: Iterable[FrameSet],
    choice: PatientChoice | None,
    known: FittedShape | None,
    begin: Start | None = None,
) -> Iterator[tuple[Estimate, PatientTracker | None]]:
    """As ``follow_patient``, from any frame, and with the tracker as it stands after each estimate, if any.

    choice: where the patient stands in the first frame, None where nobody is to be looked for.
    """
    tracker: PatientTracker | None = None
    search: Search | None = None  # once the patient was followed and lost
    wait, pause, found = 0, FIRST_PAUSE, run.room.why_nobody
    for frame_set in frames:
        if tracker is not None:
            if (estimate := tracker.step(frame_set)) is not None:
                yield estimate, tracker
            if tracker.has_left or tracker.last.gone_s > run.config.follow.lost_after_s:
                search, known = tracker.search(), tracker.shape
                yield from ((nobody_found(seen.frame_set, UNSEEN, seen), None) for seen in list(tracker.window)[1:])
                tracker = None
            continue
        wait -= 1
        if search is not None:
            with run.stage("isolation"):
                looked = search.look(frame_set, run)
            choice, found = (None, looked.value) if isinstance(looked, NoStart) else (looked, found)
        if choice is not None and wait < 0:
            start, begin = begin or find_start(frame_set, run, choice, known), None
            if isinstance(start, Start):
                tracker, search = PatientTracker(run, start), None
                wait, pause = 0, FIRST_PAUSE
                yield tracker.first, tracker
                continue
            found = start.value
            if start is NoStart.NO_BODY_FITS:
                wait, pause = pause, min(2 * pause, LONGEST_PAUSE)
        yield nobody_found(frame_set, found, poor=_poor_at(choice, frame_set, run)), None
    if tracker is not None:
        for estimate in tracker.finish():
            yield estimate, tracker


def _poor_at(choice: PatientChoice | None, frame_set: FrameSet, run: Run) -> tuple[PoorDepth, ...]:
    """Why depth is too poor for joints where the patient should be, who is lost; none where that is not known."""
    if choice is None:
        return ()
    place = np.array([choice.ground_xz_m[0], 0.0, choice.ground_xz_m[1]])
    poor = []
    for scene, depth_m in zip(run.room.scenes, frame_set.depths_m, strict=True):
        away = place - scene.camera.position_m
        distance_m = float(np.linalg.norm(away[[0, 2]]))
        if depth_m is not None and (found := too_coarse(scene.camera.name, scene.background.detail, distance_m)):
            poor.append(found)
    return tuple(poor)
