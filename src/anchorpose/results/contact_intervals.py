"""Find when each contact of the patient with people and equipment begins and ends, from their distances in each
frame.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from anchorpose.body.contact_regions import REGIONS, Nearness
from anchorpose.body.equipment_gaps import EquipmentGaps
from anchorpose.results.explained import CM2_PER_M2
from anchorpose.results.records import PERSON, Contact
from anchorpose.settings import NotNegative, Positive, settings

FREE_SHARE: Final = 0.5
"""Limit of the seen share of the patient's skin points that a person touched last. In a frame without a touch, the
contact may continue hidden behind this person only if cameras see less than this share of these points. Otherwise the
person does not hide the skin, so the touch has paused or ended (``release_s``).
"""

HIDDEN_M: Final = 0.08
"""Maximum distance in m at which a hidden contact continues: the distance between another person's skin and the
patient's skin that this person last touched. The value is the length of a palm, since the cameras may see only the back
or the wrist of the hand that holds on. A person who has let go is farther away.
"""

SHOWN_SHARE: Final = 0.2
"""Minimum seen share of the patient's skin next to a part of the equipment, for a contact with this part to count as
seen. The value is the share that is required for a joint to be observed.
"""


@settings
class ContactConfig:
    """Limits that define when skin counts as touched, when touched skin becomes a contact, and when a contact ends."""

    # m, maximum distance between touched skin and the skin of another person. The value is the sum of 3 cm, the maximum
    # distance between skin and skin in a contact; of 2 cm, the thickness of the fingers, since cameras see only the
    # back of a hand that holds; and of half the spacing of the skin points of other people.
    reach_m: Positive = 0.06
    begin_m2: Positive = 0.0025  # m2, minimum area to begin a contact (a few fingertips); a smaller area may be noise
    keep_m2: Positive = 0.0007  # m2, minimum area to continue a contact: the area that one skin point represents
    begin_s: NotNegative = 0.1  # s, minimum duration of a contact; a passing sleeve touches for a shorter time
    release_s: NotNegative = 0.3  # s, maximum pause in a contact; segmentation may miss a hand for a few frames
    # m, maximum gap, as estimated, between touched skin and equipment. Clothed skin touches at true gaps of up to 1 cm.
    # But skin is more often near equipment than touching it. With this limit, as many contacts are missed as are
    # reported wrongly (hard scenes for tuning, ``benchmarks/run.py contacts``).
    equipment_touch_m: Positive = 0.006
    equipment_sigma_m: Positive = 0.02  # m, maximum sigma of an unseen gap that begins a contact: half a wrist

    def __post_init__(self) -> None:
        if self.keep_m2 > self.begin_m2:
            raise ValueError(f"keep_m2 must not exceed begin_m2, got {self.keep_m2} and {self.begin_m2}")


class _Key(NamedTuple):
    """The partners of a contact: the patient's region (index into ``REGIONS``), and ``number``: the label of a person
    or, if ``is_equipment``, the index of a part of the equipment.
    """

    is_equipment: bool
    number: int
    region: int


class _Touch(NamedTuple):
    """Evidence of one frame for a contact: indices of the touched skin points (none for equipment), whether the touch
    is large or certain enough to begin a contact, the touched area, the seen share of this area, and the gap between
    the two surfaces.
    """

    skin: np.ndarray
    begins: bool
    area_m2: float
    seen: float
    gap_m: float


@dataclass(slots=True, eq=False)
class _Open:
    """A contact that has not ended, or (if not ``begun``) a touch that has been too small to begin a contact so far.

    first, last: number and time of the frame in which the contact began, and of the last frame in which it continued.
    skin: skin points touched in the last frame with a touch. frames: number of frames with a touch; area_m2,
    seen_frames: sums of touched areas and of seen shares over these frames. hidden: number of frames up to ``last`` in
    which the contact continued unseen. seen: whether the contact was seen in the last frame.
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

    def add(self, now: tuple[int, float], touch: _Touch) -> None:
        """Add the evidence of one more frame to the contact; now: number and time of this frame."""
        self.begun |= touch.begins
        self.last, self.skin = now, touch.skin
        self.frames += 1
        self.area_m2 += touch.area_m2
        self.seen = touch.seen > 0.0
        self.seen_frames += touch.seen
        self.gap_m = min(self.gap_m, touch.gap_m)


class ContactIntervals:
    """A collector of contacts: it receives frames in the order of time, yields each contact when it has ended, and
    stores the contacts that continue.

    region (p,): index into ``REGIONS`` of each skin point; equipment: names of the parts to which gaps are measured.
    """

    def __init__(self, region: np.ndarray, config: ContactConfig, equipment: Sequence[str] = ()) -> None:
        self._region, self._config, self._equipment = region, config, equipment
        self._open: dict[_Key, _Open] = {}
        self._names: dict[int, str] = {}  # names of people by label; cleared when the patient is lost
        self._named = 0

    def push(
        self, frame: int, time_s: float, near: Nearness | None, gaps: EquipmentGaps | None = None
    ) -> Iterator[Contact]:
        """Add the next frame; yield the contacts that ended before this frame.

        near: the distances from the patient's skin to other people, None if the patient is lost. Other people are not
        followed while the patient is lost, so they get new names afterwards. gaps: the gaps between the patient's skin
        and the equipment, None if the patient is lost or the equipment is unknown.
        """
        if near is None:
            yield from self.finish()
            self._names = {}
            return
        now = (frame, time_s)
        for kept in self._open.values():
            kept.seen = False
        for key, touch in (*self._by_people(near), *(() if gaps is None else self._by_equipment(gaps))):
            self._open.setdefault(key, _Open(now, now, touch.skin)).add(now, touch)
        yield from self._close([key for key, kept in self._open.items() if not self._continues(now, near, key, kept)])

    def finish(self) -> Iterator[Contact]:
        """End every contact that is still open, and yield it."""
        yield from self._close(list(self._open))

    def touched_now(self, by_equipment: bool) -> dict[str, bool]:
        """Return, for each part of the patient (``REGIONS``) that is touched in the last frame, whether a camera sees
        the touch. If ``by_equipment``, only touches by equipment count, else only touches by people.
        """
        parts: dict[str, bool] = {}
        for key, kept in self._open.items():
            if key.is_equipment == by_equipment and self._is_contact(kept):
                parts[REGIONS[key.region]] = parts.get(REGIONS[key.region], False) or kept.seen
        return parts

    def _is_contact(self, kept: _Open) -> bool:
        return kept.begun and kept.last[1] - kept.first[1] >= self._config.begin_s

    def _by_people(self, near: Nearness) -> Iterator[tuple[_Key, _Touch]]:
        """Yield the touches by people in a frame: regions with at least ``keep_m2`` of skin within ``reach_m`` of a
        person.
        """
        config = self._config
        touched = np.flatnonzero(near.distance_m < config.reach_m)
        keys = near.person[touched].astype(np.int64) * len(REGIONS) + self._region[near.point[touched]]
        for key in np.unique(keys).tolist():
            pairs = touched[keys == key]
            area_m2 = near.area_m2 * len(pairs)
            if area_m2 >= config.keep_m2:
                seen, gap_m = float(np.mean(~near.remembered[pairs])), float(near.distance_m[pairs].min())
                touch = _Touch(near.point[pairs], area_m2 >= config.begin_m2, area_m2, seen, gap_m)
                yield _Key(False, *divmod(key, len(REGIONS))), touch

    def _by_equipment(self, gaps: EquipmentGaps) -> Iterator[tuple[_Key, _Touch]]:
        """Yield the touches by equipment in a frame: regions whose skin is nearer to a part of the equipment than
        ``equipment_touch_m``.

        A gap that no camera shows begins a contact only if its sigma is small enough to distinguish touching from being
        near. An unseen touch continues a contact whatever its sigma.
        """
        config, none = self._config, np.zeros(0, dtype=np.int32)
        shown = gaps.shown >= SHOWN_SHARE
        begins = shown | (gaps.sigma_m <= config.equipment_sigma_m)
        for row in np.flatnonzero(gaps.gap_m <= config.equipment_touch_m).tolist():
            key = _Key(True, int(gaps.part[row]), int(gaps.region[row]))
            if begins[row] or key in self._open:
                area_m2, gap_m = float(gaps.area_m2[row]), float(gaps.gap_m[row])
                yield key, _Touch(none, bool(begins[row]), area_m2, float(shown[row]), gap_m)

    def _continues(self, now: tuple[int, float], near: Nearness, key: _Key, kept: _Open) -> bool:
        """Return whether the contact ``kept`` continues in the frame ``now``: its region is touched in this frame; or
        the touching person hides the touched skin and is within ``HIDDEN_M`` of it; or the touch has paused for at most
        ``release_s``.
        """
        if kept.last == now:
            return True
        if not key.is_equipment and kept.begun:
            beside = (near.person == key.number) & (near.distance_m < HIDDEN_M)
            reached = np.isin(near.point[beside], kept.skin).any()
            if reached and np.mean(near.shown[kept.skin]) < FREE_SHARE:
                kept.last = now
                kept.hidden += 1
                return True
        return now[1] - kept.last[1] <= self._config.release_s

    def _close(self, keys: list[_Key]) -> Iterator[Contact]:
        ended = [(key, self._open.pop(key)) for key in keys]
        for key, kept in sorted(ended, key=lambda item: (item[1].first[0], item[0])):
            if self._is_contact(kept):
                yield Contact(
                    part=REGIONS[key.region],
                    with_=self._equipment[key.number] if key.is_equipment else PERSON,
                    person=None if key.is_equipment else self._name(key.number),
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
