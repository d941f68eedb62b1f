"""From the distance to other people in each frame to contacts: what begins, what continues unseen, what has ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS, Nearness
from anchorpose.results.explained import CM2_PER_M2
from anchorpose.results.records import Contact
from anchorpose.settings import NotNegative, Positive, settings

FREE_SHARE: Final = 0.5
"""Share of the skin last touched that must be seen without anybody on it for the contact to have ended."""


@settings
class ContactConfig:
    """What counts as touched skin, when that becomes a contact, and when the contact has ended."""

    # Touching skin is within 3 cm of the other's skin. Cameras see the back of a hand that holds, so its thickness, 2
    # cm at the fingers, and half the spacing of the points of other people are added.
    reach_m: Positive = 0.06
    begin_m2: Positive = 0.0025  # a few finger tips; less is noise at the border between two people
    keep_m2: Positive = 0.0007  # of a contact that has begun: one skin point
    begin_s: NotNegative = 0.1  # a shorter touch is a sleeve that brushes past
    release_s: NotNegative = 0.3  # gaps up to this are bridged: isolation may lose a hand for a few frames

    def __post_init__(self) -> None:
        if self.keep_m2 > self.begin_m2:
            raise ValueError(f"keep_m2 must not exceed begin_m2, got {self.keep_m2} and {self.begin_m2}")


@dataclass(slots=True, eq=False)
class _Open:
    """A contact that has not ended, or a touch too small to be one yet (not ``begun``).

    first, last: frame and time. skin: points last touched. frames, area_m2, seen_frames: sums over frames with skin in
    reach. hidden: frames in which it continued unseen, up to ``last``. seen: in the last frame.
    """

    first: tuple[int, float]
    last: tuple[int, float]
    skin: np.ndarray
    begun: bool = False
    frames: int = 0
    hidden: int = 0
    seen: bool = False
    area_m2: float = 0.0
    seen_frames: float = 0.0
    gap_m: float = np.inf


class ContactIntervals:
    """Takes frames in the order of time and holds only the contacts that have not ended.

    region (p,): index into ``REGIONS`` of each skin point; area_m2: the skin that one point represents.
    """

    def __init__(self, region: np.ndarray, area_m2: float, config: ContactConfig) -> None:
        self._region, self._area_m2, self._config = region, area_m2, config
        self._open: dict[tuple[int, int], _Open] = {}  # by person's label and region
        self._names: dict[int, str] = {}  # of the labels since the patient was last found
        self._named = 0

    def push(self, frame: int, time_s: float, near: Nearness | None) -> Iterator[Contact]:
        """One more frame; yields the contacts that ended before it. near: None where the patient is lost.

        After the patient was lost everybody has a new name: nobody was followed in between.
        """
        if near is None:
            yield from self.finish()
            self._names = {}
            return
        now = (frame, time_s)
        self._extend(now, near)
        ended = [key for key, kept in self._open.items() if not self._continues(now, near, key[0], kept)]
        yield from self._close(ended)

    def finish(self) -> Iterator[Contact]:
        """Ends every contact that is still open."""
        yield from self._close(list(self._open))

    @property
    def touched_now(self) -> dict[str, bool]:
        """The parts of the patient (``REGIONS``) that are touched, and whether the touch is seen in the last frame."""
        parts: dict[str, bool] = {}
        for (_, region), kept in self._open.items():
            if kept.begun and kept.last[1] - kept.first[1] >= self._config.begin_s:
                parts[REGIONS[region]] = parts.get(REGIONS[region], False) or kept.seen
        return parts

    def _extend(self, now: tuple[int, float], near: Nearness) -> None:
        config = self._config
        for kept in self._open.values():
            kept.seen = False
        touched = np.flatnonzero(near.distance_m < config.reach_m)
        keys = near.person[touched].astype(np.int64) * len(REGIONS) + self._region[near.point[touched]]
        for key in np.unique(keys).tolist():
            pairs = touched[keys == key]
            area_m2 = self._area_m2 * len(pairs)
            if area_m2 < config.keep_m2:
                continue
            kept = self._open.setdefault(divmod(key, len(REGIONS)), _Open(now, now, near.point[pairs]))
            kept.begun |= area_m2 >= config.begin_m2
            kept.last, kept.skin = now, near.point[pairs]
            kept.frames += 1
            kept.area_m2 += area_m2
            kept.seen = bool((~near.remembered[pairs]).any())
            kept.seen_frames += float(np.mean(~near.remembered[pairs]))
            kept.gap_m = min(kept.gap_m, float(near.distance_m[pairs].min()))

    def _continues(self, now: tuple[int, float], near: Nearness, label: int, kept: _Open) -> bool:
        """Whether a contact continues: touched in this frame, hidden with the person in reach, or just paused."""
        if kept.last == now:
            return True
        reached = np.isin(near.point[near.person == label], kept.skin).any()
        if kept.begun and reached and np.mean(near.shown[kept.skin]) < FREE_SHARE:
            kept.last = now
            kept.hidden += 1
            return True
        return now[1] - kept.last[1] <= self._config.release_s

    def _close(self, keys: list[tuple[int, int]]) -> Iterator[Contact]:
        ended = [(key, self._open.pop(key)) for key in keys]
        for (label, region), kept in sorted(ended, key=lambda item: (item[1].first[0], item[0])):
            if kept.begun and kept.last[1] - kept.first[1] >= self._config.begin_s:
                yield Contact(
                    part=REGIONS[region],
                    person=self._name(label),
                    first_frame=kept.first[0],
                    last_frame=kept.last[0],
                    start_s=kept.first[1],
                    end_s=kept.last[1],
                    seen_share=kept.seen_frames / (kept.frames + kept.hidden),
                    area_cm2=CM2_PER_M2 * kept.area_m2 / kept.frames,
                    gap_mm=1000.0 * kept.gap_m,
                )

    def _name(self, label: int) -> str:
        if label not in self._names:
            self._named += 1
            self._names[label] = f"person {self._named}"
        return self._names[label]
