"""A patient through all frames: found, followed, lost, searched for and found again."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from anchorpose.body.skin_points import FittedShape
from anchorpose.isolation.people import PatientChoice
from anchorpose.recording.recording import FrameSet
from anchorpose.tracker.association import Associate, link
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.estimate import Estimate, nobody_found
from anchorpose.tracker.patient import PatientTracker
from anchorpose.tracker.room import Room
from anchorpose.tracker.search import Search
from anchorpose.tracker.start import NoStart, Start, find_start
from anchorpose.tracker.stopwatch import Stopwatch
from anchorpose.tracking.motion_database import MotionDatabase

FIRST_PAUSE, LONGEST_PAUSE = 5, 15  # frames between searches that fail, doubled each time: one costs thirty frames


def follow_patient(
    room: Room, frames: Iterable[FrameSet], motions: MotionDatabase | None, known: FittedShape | None,
    config: TrackConfig, watch: Stopwatch, begin: Start | None = None, associate: Associate = link,
) -> Iterator[Estimate]:  # fmt: skip
    """An estimate for every frame, in order: lost until he is found, followed, and searched for again when lost.

    frames: in the order of time, or against it; the first one should be the room's opening. known: the learnt shape;
    None where it is still to be learnt. begin: the patient as he was found in the first frame already.
    """
    choice = room.opening.choice if room.opening else None
    for estimate, _ in follow_openly(room, frames, choice, motions, known, config, watch, begin, associate):
        yield estimate


def follow_openly(
    room: Room, frames: Iterable[FrameSet], choice: PatientChoice | None, motions: MotionDatabase | None,
    known: FittedShape | None, config: TrackConfig, watch: Stopwatch, begin: Start | None = None,
    associate: Associate = link,
) -> Iterator[tuple[Estimate, PatientTracker | None]]:  # fmt: skip
    """As ``follow_patient``, from any frame, and with the tracker as it stands after each estimate, if any.

    choice: where he stands in the first frame, None where nobody is to be looked for.
    """
    tracker: PatientTracker | None = None
    search: Search | None = None  # once he was followed and lost
    wait, pause = 0, FIRST_PAUSE
    for frame_set in frames:
        if tracker is None:
            wait -= 1
            if search is not None:
                with watch.stage("isolation"):
                    choice = search.look(frame_set, room, config)
            if choice is None or wait >= 0:
                yield nobody_found(frame_set), None
                continue
            start = begin or find_start(frame_set, room, choice, known, config, watch)
            begin = None
            if isinstance(start, NoStart):
                if start is NoStart.NO_BODY_FITS:
                    wait, pause = pause, min(2 * pause, LONGEST_PAUSE)
                yield nobody_found(frame_set), None
                continue
            tracker, search = PatientTracker(room, start, motions, config, watch, associate), None
            wait, pause = 0, FIRST_PAUSE
            yield tracker.first, tracker
            continue
        for estimate in tracker.push(frame_set):
            yield estimate, tracker
        if tracker.unseen_s > config.follow.lost_after_s:
            search, known = Search(tracker.window[-1], tracker.last_found, tracker.belief.pose.root_m), tracker.shape
            yield from ((nobody_found(seen.frame_set, seen), None) for seen in list(tracker.window)[1:])
            tracker = None
    if tracker is not None:
        for estimate in tracker.finish():
            yield estimate, tracker
