"""The hypotheses of one frame, on demand: some seconds to a minute of work, in a process of its own."""

from __future__ import annotations

import multiprocessing
import threading
from dataclasses import dataclass, replace
from enum import StrEnum
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.geodesics.anchors import ANCHOR_NAMES
from anchorpose.recording.recording import Recording
from anchorpose.threads import one_thread
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.inspection import inspect_frame
from anchorpose.viewer.payloads import pack, told

FIRST_GUESS = (
    "With a first guess of the body, from this frame on; 'anchorpose inspect --as-tracked' repeats track itself."
)


class Progress(StrEnum):
    """Where the work stands."""

    IDLE = "idle"
    WORKING = "working"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True)
class Standing:
    """For the page: which row of the results is worked on, how many frames were read, what is to be said."""

    progress: Progress
    position: int | None = None
    frames_read: int = 0
    said: tuple[str, ...] = ()


class HypothesisWorker:
    """One frame at a time; asking for another ends what is under way."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: BaseProcess | None = None
        self._standing, self._data = Standing(Progress.IDLE), b""

    @property
    def standing(self) -> Standing:
        """As of now."""
        with self._lock:
            return self._standing

    @property
    def data(self) -> bytes:
        """What ``hypotheses_of`` found, packed; empty unless the work is done."""
        with self._lock:
            return self._data

    def start(self, position: int, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
        """Begins with the frame of this number; patient_xz_m: where the results have him in it, None where lost."""
        self.cancel()
        context = multiprocessing.get_context("spawn")  # the server has threads: their locks must not be copied
        ours, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(theirs, recording, frame, patient_xz_m), daemon=True)
        with self._lock:  # who cancels finds it started, or not at all
            process.start()
            self._process, self._data = process, b""
            self._standing = Standing(Progress.WORKING, position)
        theirs.close()
        threading.Thread(target=self._listen, args=(process, ours), daemon=True).start()

    def cancel(self) -> None:
        """Ends the work, if there is any."""
        with self._lock:
            process, self._process = self._process, None
            if process is None:
                return
            self._standing = replace(self._standing, progress=Progress.CANCELLED)
        process.terminate()
        process.join()

    def _listen(self, process: BaseProcess, ours: Connection) -> None:
        while True:
            try:
                kind, what = ours.recv()
            except EOFError:
                self._take(process, "failed", ("The work ended without an answer.",))
                return
            self._take(process, kind, what)
            if kind != "frames":
                return

    def _take(self, process: BaseProcess, kind: str, what: Any) -> None:
        with self._lock:
            if process is not self._process:  # cancelled, or another frame was asked for
                return
            if kind == "frames":
                self._standing = replace(self._standing, frames_read=what)
                return
            self._process = None
            if kind == "done":
                self._data, said = what
                self._standing = replace(self._standing, progress=Progress.DONE, said=said)
            else:
                self._standing = replace(self._standing, progress=Progress.FAILED, said=what)


def hypotheses_of(
    recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None, tick: Any
) -> tuple[bytes, tuple[str, ...]]:
    """The nodes of a frame and where each subset of anchors finds them in the next, packed; and what is to be said.

    Arrays: nodes (m, 3) and reached (m, s, 3) float32 world metres, NaN where a subset finds no match; best (m,) int32:
    the subset on the best branch, -1 where none; asked (m,) uint8: whether the track tree asked for the node.
    meta: subsets [[anchor names]]; frames [this, next].
    """
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
    return pack(meta, arrays), (FIRST_GUESS,)


def _work(pipe: Connection, recording: Recording, frame: int, patient_xz_m: tuple[float, float] | None) -> None:
    read = 0

    def tick() -> None:
        nonlocal read
        read += 1
        pipe.send(("frames", read))

    try:
        with one_thread():
            data, said = hypotheses_of(recording, frame, patient_xz_m, tick)
    except AnchorposeError as error:
        pipe.send(("failed", (told(error),)))
        return
    pipe.send(("done", (data, said)) if data else ("failed", said))
