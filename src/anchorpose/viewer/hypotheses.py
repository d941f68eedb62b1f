"""Compute, in a separate process, the hypotheses of each node (point of the patient's surface): its possible places in
the next frame. The computation takes some seconds to a minute, so it is made only if the user asks for it.
"""

from __future__ import annotations

import multiprocessing
import threading
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import count
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.joints import ANCHOR_NAMES
from anchorpose.recording.recording import Recording
from anchorpose.threads import one_thread
from anchorpose.viewer.guarded_server import describe_error
from anchorpose.viewer.payloads import pack


class Progress(StrEnum):
    """The progress of computing hypotheses."""

    IDLE = "idle"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class WorkStatus:
    """The progress of computing hypotheses, as the page shows it. position: row in the results of the frame for which
    hypotheses are computed; frames_read: number of frames read so far; messages: sentences for the user.
    """

    progress: Progress
    position: int | None = None
    frames_read: int = 0
    messages: tuple[str, ...] = ()


class HypothesisWorker:
    """A worker that computes the hypotheses of one frame at a time. If it is started with another frame, it cancels the
    present computation.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._work: tuple[BaseProcess, Connection] | None = None
        self._status, self._data = WorkStatus(Progress.IDLE), b""

    @property
    def status(self) -> WorkStatus:
        """Return the present progress, after reading the messages that the process has sent since the last call."""
        with self._lock:
            while self._work is not None and self._work[1].poll():
                self._receive(self._work[1])
            return self._status

    @property
    def data(self) -> bytes:
        """Return the packed result of ``hypotheses_of``; empty unless the computation is done."""
        with self._lock:
            return self._data

    def start(self, position: int, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
        """Start to compute hypotheses of the frame with this number. position: the frame's row in the results;
        patient_xz_m: the patient's place in the results, None if lost.
        """
        self.cancel()
        # not forked: a forked process would have copies of the locks that threads of the server hold at this moment,
        # and no thread would release these copies
        context = multiprocessing.get_context("spawn")
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(theirs, recording, frame, patient_xz_m), daemon=True)
        with self._lock:  # with the lock, ``cancel`` finds either a process that was started or none
            process.start()
            self._work, self._data = (process, ours), b""
            self._status = WorkStatus(Progress.WORKING, position)
        theirs.close()

    def cancel(self) -> None:
        """Stop computing hypotheses, if any are being computed."""
        with self._lock:
            work, self._work = self._work, None
            if work is None:
                return
            self._status = replace(self._status, progress=Progress.CANCELLED)
        work[0].terminate()
        work[0].join()

    def _receive(self, pipe: Connection) -> None:
        try:
            received: int | tuple[bytes, tuple[str, ...]] = pipe.recv()
        except EOFError:
            received = b"", ("The work ended without a result.",)
        if isinstance(received, int):
            self._status = replace(self._status, frames_read=received)
            return
        self._work, (self._data, messages) = None, received
        progress = Progress.DONE if self._data else Progress.FAILED
        self._status = replace(self._status, progress=progress, messages=messages)


def hypotheses_of(
    recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None, tick: Any
) -> tuple[bytes, tuple[str, ...]]:
    """Return the surface nodes of a frame with their matches (corresponding places) in the next frame, packed; and
    messages for the user. For each subset of the anchors (head, hands and feet), a node's distances to the anchors of
    the subset give one match of the node.

    Packed arrays: nodes (m, 3), the places of the nodes, and reached (m, s, 3), the places of their matches by each
    subset, float32 metres in the world, NaN where a subset finds no match; best (m,) int32: index of the subset whose
    match the track tree (the node's matches over several frames) chose, -1 without a choice; asked (m,) uint8: 1 if the
    track tree was searched for the node. Packed meta data: subsets, a list of the anchors' names for each subset;
    frames, the numbers of this and of the next frame. tick: called for each frame read.
    """
    # importing the tracker takes a second, so only the process that computes hypotheses imports it
    from anchorpose.tracker.config import TrackConfig
    from anchorpose.tracker.inspection import inspect_frame

    found = inspect_frame(recording, frame, replace(TrackConfig(), patient_xz_m=patient_xz_m), False, tick)
    if found.next is None or found.observation is None:
        return b"", (*found.account, "There are no hypotheses: the patient was not found here, or no frame follows.")
    nodes = found.observation.surface.points_m
    after = found.next.observation.surface.points_m
    match, tree = found.next.links.match, found.next.hypothesis
    reached = np.where(match[..., None] >= 0, after[np.maximum(match, 0)], np.float32(np.nan))
    best, asked = np.full(len(nodes), -1, np.int32), np.zeros(len(nodes), np.uint8)
    best[tree.node], asked[tree.node] = tree.tree.subset, 1
    meta = {
        "subsets": [[ANCHOR_NAMES[anchor] for anchor in subset] for subset in found.next.links.subsets.tolist()],
        "frames": [found.frame_set.frame, found.next.observation.frame_set.frame],
    }
    arrays = {"nodes": nodes, "reached": reached.astype(np.float32), "best": best, "asked": asked}
    how = "With a first estimate of the body, from this frame on; 'anchorpose inspect --as-tracked' repeats tracking."
    return pack(meta, arrays), (how,)


def _work(pipe: Connection, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
    read = count(1)
    try:
        with one_thread():
            found = hypotheses_of(recording, frame, patient_xz_m, lambda: pipe.send(next(read)))
    except AnchorposeError as error:
        found = b"", (describe_error(error),)
    pipe.send(found)
