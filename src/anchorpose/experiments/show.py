"""Pictures of one recording, and how long the paper's own steps take on it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.experiments.answers import Brief, Plan
from anchorpose.experiments.clips import Clip
from anchorpose.experiments.framework import paper_config
from anchorpose.experiments.outcome import PaperTimes
from anchorpose.experiments.paper_times import measure
from anchorpose.experiments.pictures.album import write_pictures
from anchorpose.experiments.work import Subject, pierced, subject_of
from anchorpose.results.folder import whole_or_nothing
from anchorpose.threads import one_thread
from anchorpose.tracker.preparation import prepare_room

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
