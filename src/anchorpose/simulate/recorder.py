"""What the recorder keeps of a camera's pictures: which reach the disk, under which stamp, and which twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.simulate.clinic import Clinic, random_stream

JITTER_LIMIT = 0.4  # of a period: beyond half of one, stamps could change places
JITTER_SPREADS = 2.0  # where the normal distribution of the jitter is cut


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """One camera's files, by frame number of the programme; each (t,).

    kept: bool, the picture is on the disk; shown: int64, whose picture the file holds (its own number or, doubled, an
    earlier one); stamp_s: float64, what timestamps.csv says; taken_s: float64, when the picture it holds was taken.
    """

    kept: np.ndarray
    shown: np.ndarray
    stamp_s: np.ndarray
    taken_s: np.ndarray


def draw_record(clinic: Clinic, index: int) -> Record:
    """What camera ``index`` writes. The first camera keeps all its pictures: its frames number the truth."""
    config = clinic.config
    nominal_s, taken_s = np.arange(config.frames) / config.fps, clinic.true_times_s(index)
    kept = _kept(clinic, index, nominal_s)
    shown = np.arange(config.frames)
    doubled = (random_stream(config, "doubles", index).random(config.frames) < config.doubled_share) & kept
    before = np.maximum.accumulate(np.where(kept, shown, -1))  # the last picture on the disk, this one included
    for frame in np.flatnonzero(doubled):
        if frame > 0 and before[frame - 1] >= 0:
            shown[frame] = shown[before[frame - 1]]
    epoch_s = config.clock_epoch_s[index] if config.clock_epoch_s else 0.0
    stamp_s = nominal_s + epoch_s + _jitter_s(clinic, index)
    return Record(kept, shown, stamp_s, taken_s[shown])


def _kept(clinic: Clinic, index: int, nominal_s: np.ndarray) -> np.ndarray:
    config = clinic.config
    kept = random_stream(config, "drops", index).random(config.frames) >= config.dropped_share
    starts = config.starts_late_s[index] if config.starts_late_s else 0.0
    ends = config.ends_early_s[index] if config.ends_early_s else 0.0
    running = (nominal_s >= starts) & (nominal_s <= nominal_s[-1] - ends)
    kept[int(np.flatnonzero(running)[0])] = True
    return (kept | (index == 0)) & running


def _jitter_s(clinic: Clinic, index: int) -> np.ndarray:
    config = clinic.config
    if config.stamp_jitter_s == 0:
        return np.zeros(config.frames)
    limit_s = min(JITTER_SPREADS * config.stamp_jitter_s, JITTER_LIMIT / config.fps)
    late_s = random_stream(config, "stamps", index).normal(0.0, config.stamp_jitter_s, config.frames)
    return late_s.clip(-limit_s, limit_s)
