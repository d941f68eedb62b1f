"""Follow the patient live: compute the joints in the newest frame, send them at once, and store them in blocks of
frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import region_of_points
from anchorpose.body.skin_points import Body, body_points
from anchorpose.isolation.other_place import without_other_places
from anchorpose.joints import LOST, STATE_CODE
from anchorpose.live.feed import LiveSet
from anchorpose.live.output import LiveFrame, Outputs, people_in
from anchorpose.live.stored import MAKE_ROOM, LivePatient, instead_of_resuming
from anchorpose.recording.recording import FrameSet
from anchorpose.results.contact_intervals import ContactIntervals
from anchorpose.tracker.estimate import Estimate
from anchorpose.tracker.following import Follower
from anchorpose.tracker.frame_record import FrameRecord, TrackedFrame, label_pictures, record_of

LONGEST_MS: Final = 60_000  # ms, maximum latency that is counted; larger latencies count as this value


class LatencyMeter:
    """A meter of the latency from taking an image to sending its joints. It counts how many frames have each latency
    in whole milliseconds, so its memory does not grow with the session. dropped: number of images that were not
    tracked.
    """

    def __init__(self) -> None:
        self._counts = np.zeros(LONGEST_MS + 1, np.int64)
        self._longest_s, self.dropped = 0.0, 0

    def add(self, latency_s: float, dropped: int = 0) -> None:
        """Count a frame. dropped: number of images before this frame that were not tracked."""
        self._counts[min(max(round(1000 * latency_s), 0), LONGEST_MS)] += 1
        self._longest_s = max(self._longest_s, latency_s)
        self.dropped += dropped

    @property
    def count(self) -> int:
        """Return the number of frames tracked live."""
        return int(self._counts.sum())

    def quantile_s(self, share: float) -> float:
        """Return a quantile of the latency, exact to a millisecond: the given share of the frames has at most this
        latency. NaN without frames.
        """
        found = np.searchsorted(np.cumsum(self._counts), share * self.count)
        return float(found) / 1000 if self.count else float("nan")

    @property
    def sentence(self) -> str:
        """Return the latencies and counts of frames as a sentence for the screen and run.json."""
        if not self.count:
            return "no frame was tracked live"
        return (
            f"{self.count} frames were tracked live, {self.dropped} images were dropped; from image to joints "
            f"{1000 * self.quantile_s(0.5):.0f} ms in the median, {1000 * self.quantile_s(0.99):.0f} ms in 99 of 100 "
            f"frames, {1000 * self._longest_s:.0f} ms at most"
        )


BLOCK: Final = 48  # number of frames per stored block
ROUNDING_S: Final = 1e-5  # s, tolerance in comparing times, which are recorded with six decimals


@dataclass(slots=True, eq=False)
class LiveFollower:
    """The tracker of a live patient, which takes image sets in the order of time. patient: the person who is or was the
    patient; with_labels: whether to store the person label of each pixel; labels are of use only if the depth images
    are recorded, too.
    """

    patient: LivePatient
    body: Body | None
    follower: Follower
    outputs: Outputs
    with_labels: bool
    latency: LatencyMeter
    # by frame number, when the images of a frame were taken; only for frames that wait for later frames (look-ahead)
    _taken_s: dict[int, float] = field(default_factory=dict)
    _kept: list[TrackedFrame] = field(default_factory=list)
    _stored: int = 0
    _last_s: float = float("-inf")  # time in s of the last tracked frame
    _last_frame: int = -1  # number of the last tracked frame
    _tracked: int = 0  # number of tracked frames; images that are dropped or lost do not count
    _contacts: ContactIntervals | None = None
    _touched: Mapping[str, bool] | None = None
    _holding: Mapping[str, bool] | None = None

    def take(self, live_set: LiveSet, live: bool) -> None:
        """Track an image set. live: whether this set is the newest; only then are joints sent to the outputs and their
        latency counted.
        """
        room = self.patient.run.room
        frame_set = live_set.frame_set(room.recording.cameras, room.clocks.clocks)
        self._step(frame_set, live_set.taken_s, live, live_set.skipped if live else 0)

    @property
    def patient_xz_m(self) -> np.ndarray | None:
        """Return the place (2,), x and z, at which the patient was last seen; None if the patient is lost."""
        tracker = self.follower.tracker
        return None if tracker is None else tracker.last.belief.pose.root_m[[0, 2]]

    def take_recorded(self, frame_set: FrameSet) -> None:
        """Track a recorded frame of the first seconds."""
        self._step(frame_set, float("nan"), live=False)

    def finish(self) -> None:
        """Track the frames that still wait for later frames, then store everything."""
        self._pass_on(self.follower.finish(), live=False)
        self.store()

    def _step(self, frame_set: FrameSet, taken_s: float, live: bool, dropped: int = 0) -> None:
        """Track a frame. A frame that is not later than the last tracked frame is ignored; for example, the last frame
        of the first seconds may come twice.

        Frames have the numbers of the first camera's images, as in a recording of the session. While this camera gives
        no images, the numbers increase by one per frame.
        """
        if frame_set.time_s <= self._last_s + ROUNDING_S:
            self.latency.dropped += dropped + int(live)
            return
        self._last_s, self._last_frame = frame_set.time_s, max(frame_set.frame, self._last_frame + 1)
        self._taken_s[self._last_frame] = taken_s
        self._tracked += 1
        numbered = replace(frame_set, frame=self._last_frame, position=self._tracked)
        numbered = without_other_places(numbered, self.patient.run.room.scenes)
        self._pass_on(self.follower.step(numbered), live, dropped)

    def _pass_on(self, estimates: Iterator[Estimate], live: bool, dropped: int = 0) -> None:
        for estimate in estimates:
            taken_s = self._taken_s.pop(estimate.frame_set.frame)
            if live:
                codes = np.array([STATE_CODE[state] for state in estimate.states], np.int8)
                frame = LiveFrame(
                    frame=estimate.frame_set.frame,
                    time_s=estimate.frame_set.time_s,
                    taken_s=taken_s,
                    joints_m=estimate.joints_m,
                    sigma_m=estimate.sigma_m,
                    state_code=codes,
                    why_lost=estimate.why_lost if (codes == LOST).all() else "",
                    touched=self._touched,
                    holding=self._holding,
                    dropped=self.latency.dropped + dropped,
                    people=people_in(self.follower.memory),
                    patient=self.patient.number,
                )
                self.outputs.send(frame)
                self.latency.add(frame.latency_s, dropped)
                dropped = 0
            labels = label_pictures(estimate.frame_set, estimate.observation) if self.with_labels else ()
            record = record_of(estimate, self.body, self.patient.run)
            self._touch(record)
            self._kept.append(TrackedFrame(record, labels))
            if len(self._kept) == BLOCK:
                self.store()

    def _touch(self, record: FrameRecord) -> None:
        """Find the patient's present contacts with other people and with the equipment. This method is called after the
        frame was sent, so that it does not delay sending; the contacts are sent with the next frame.
        """
        if self._contacts is None:
            run = self.patient.run
            parts = run.room.recording.part_names
            self._contacts = ContactIntervals(region_of_points(body_points()), run.config.contacts, parts)
        for _ in self._contacts.push(record.joints.frame, record.joints.time_s, record.near, record.gaps):
            pass  # contacts that have ended are not sent, only stored in the results
        self._touched = None if record.near is None else self._contacts.touched_now(by_equipment=False)
        self._holding = None if record.gaps is None else self._contacts.touched_now(by_equipment=True)

    def store(self) -> None:
        """Store the frames tracked since the last call; raises InputError if the disk is full."""
        if self._kept:
            with instead_of_resuming(MAKE_ROOM):
                self.patient.blocks.write(self._stored, self._kept)
                self.patient.blocks.write_count(self._stored + 1)
            self._kept, self._stored = [], self._stored + 1
