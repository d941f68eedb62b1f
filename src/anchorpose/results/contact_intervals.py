"""From how near others are, frame by frame, to contacts: what begins, what goes on unseen, what has ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anchorpose.body.contact_regions import REGIONS, Nearness
from anchorpose.results.records import Contact

CM2_PER_M2, MM_PER_M = 1e4, 1e3


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactConfig:
    """When skin is touched, when that is a contact, and when it has ended."""

    # A contact is skin within 3 cm of skin. A camera sees the back of the hand that holds: its thickness, 2 cm at the
    # fingers, comes on top, and half the spacing of the remembered points.
    reach_m: float = 0.06
    begin_m2: float = 0.0025  # a few finger tips; less is noise at the border between two people
    keep_m2: float = 0.0007  # of a contact that has begun: one skin point
    begin_s: float = 0.1  # so long it must last: a sleeve that brushes past is no contact
    release_s: float = 0.3  # gaps up to this are bridged: isolation may lose a hand for a few frames
    free_share: float = 0.5  # of the skin last touched: where so much is seen again and nobody is on it, it was let go

    def __post_init__(self) -> None:
        if not 0 < self.keep_m2 <= self.begin_m2:
            raise ValueError(f"keep_m2 must be positive and at most begin_m2, got {self.keep_m2} and {self.begin_m2}")
        if not (self.reach_m > 0 and 0 < self.free_share <= 1):
            raise ValueError(f"reach_m and free_share must be positive, got {self.reach_m} and {self.free_share}")
        if not (self.begin_s >= 0 and self.release_s >= 0):
            raise ValueError(f"begin_s and release_s must not be negative, got {self.begin_s} and {self.release_s}")


@dataclass(slots=True, eq=False)
class _Open:
    """A contact that has not ended. skin: points last touched; area, seen and frames: sums over frames with skin in
    reach; hidden: frames in which it went on unseen, up to ``last``."""

    first: tuple[int, float]  # frame and time
    last: tuple[int, float]
    skin: np.ndarray
    sure: bool = False
    frames: int = 0
    hidden: int = 0
    area_m2: float = 0.0
    seen_frames: float = 0.0
    gap_m: float = np.inf


class ContactIntervals:
    """Takes frames in the order of time; memory holds only the contacts that have not ended.

    region (p,): index into ``REGIONS`` of each skin point; area_m2: the skin that a point stands for.
    """

    def __init__(self, region: np.ndarray, area_m2: float, config: ContactConfig) -> None:
        self._region, self._area_m2, self._config = region, area_m2, config
        self._open: dict[tuple[int, int], _Open] = {}  # by person's label and region
        self._names: dict[int, str] = {}  # of the labels since the patient was last found
        self._named = 0

    def push(self, frame: int, time_s: float, near: Nearness | None) -> Iterator[Contact]:
        """One more frame; yields what has ended before it. near: None where the patient is lost.

        Whoever is met after the patient was lost has a new name: nobody was followed in between.
        """
        if near is None:
            yield from self.finish()
            self._names = {}
            return
        now = (frame, time_s)
        self._extend(now, near)
        over = [key for key, kept in self._open.items() if not self._goes_on(now, near, key[0], kept)]
        yield from self._close(over)

    def finish(self) -> Iterator[Contact]:
        """What was still going on at the end."""
        yield from self._close(list(self._open))

    def _extend(self, now: tuple[int, float], near: Nearness) -> None:
        config = self._config
        touched = np.flatnonzero(near.distance_m < config.reach_m)
        keys = near.person[touched].astype(np.int64) * len(REGIONS) + self._region[near.point[touched]]
        for key in np.unique(keys).tolist():
            pairs = touched[keys == key]
            area_m2 = self._area_m2 * len(pairs)
            if area_m2 < config.keep_m2:
                continue
            kept = self._open.setdefault(divmod(key, len(REGIONS)), _Open(now, now, near.point[pairs]))
            kept.sure |= area_m2 >= config.begin_m2
            kept.last, kept.skin = now, near.point[pairs]
            kept.frames += 1
            kept.area_m2 += area_m2
            kept.seen_frames += float(np.mean(~near.remembered[pairs]))
            kept.gap_m = min(kept.gap_m, float(near.distance_m[pairs].min()))

    def _goes_on(self, now: tuple[int, float], near: Nearness, label: int, kept: _Open) -> bool:
        """Whether a contact has not ended: touched just now, or hidden and its owner within a hand's length."""
        if kept.last == now:
            return True
        reached = np.isin(near.point[near.person == label], kept.skin).any()
        if kept.sure and reached and np.mean(near.shown[kept.skin]) < self._config.free_share:
            kept.last = now
            kept.hidden += 1
            return True
        return now[1] - kept.last[1] <= self._config.release_s

    def _close(self, keys: list[tuple[int, int]]) -> Iterator[Contact]:
        ended = [(key, self._open.pop(key)) for key in keys]
        for (label, region), kept in sorted(ended, key=lambda item: (item[1].first[0], item[0])):
            if kept.sure and kept.last[1] - kept.first[1] >= self._config.begin_s:
                yield Contact(
                    part=REGIONS[region],
                    person=self._name(label),
                    first_frame=kept.first[0],
                    last_frame=kept.last[0],
                    start_s=kept.first[1],
                    end_s=kept.last[1],
                    seen_share=kept.seen_frames / (kept.frames + kept.hidden),
                    area_cm2=CM2_PER_M2 * kept.area_m2 / kept.frames,
                    gap_mm=MM_PER_M * kept.gap_m,
                )

    def _name(self, label: int) -> str:
        if label not in self._names:
            self._named += 1
            self._names[label] = f"person {self._named}"
        return self._names[label]
