"""Compute the measures of each trial, by cutting a session into trials, and of each condition, by averaging trials.

Posture, transitions and steps are found in the whole recording first, so that a patient who already stands when a trial
begins counts as upright from its first frame. Then the inputs of the measures (joints, posture, contacts) are cut to
each trial, so that the functions for whole recordings also compute the measures of a trial.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np

from anchorpose.recording.events import Trial, Trials
from anchorpose.results.frame_table import cut_rows
from anchorpose.results.frame_time import frame_seconds
from anchorpose.results.records import EPISODE_KINDS, Contact, Episode, Measure, MeasureKey
from anchorpose.results.stand_training.stance import Session
from anchorpose.results.trial_table import CONTACT, EPISODE, TrialInterval, trial_rows
from anchorpose.results.uncertainty import systematic_share

Found = TypeVar("Found")

LEAST_FRAMES: Final = 2
"""Minimum number of frames in a trial, since a single frame has no duration."""

TOO_FEW_FRAMES: Final = "fewer than two frames of this trial were tracked"

MeasureRows = Callable[[Session, slice], Sequence[Measure]]
"""A function that returns the measures of a trial. Its arguments are the session that was cut to the trial, and the
trial's rows (frames) in the whole session.
"""


def measures_by_trial(
    session: Session, trials: Trials, whole: Sequence[Measure], settle_s: float, measure: MeasureRows
) -> list[Measure]:
    """Return the measures of every trial, in the order of the events file, then the measures of every condition.

    whole: the measures of the whole recording. If a person or part in them has no contact in a trial, the trial's
    measures for this person or part are 0 s and 0 contacts. settle_s: time after standing up in which the patient is
    not yet at rest. measure: function that computes the measures of a cut session.
    """
    rows = [row for trial in trials.rows for row in _of_trial(session, trial, whole, settle_s, measure)]
    return [*rows, *condition_measures(trials, rows)]


def _of_trial(
    session: Session, trial: Trial, whole: Sequence[Measure], settle_s: float, measure: MeasureRows
) -> list[Measure]:
    rows = trial_rows(trial, session.joints.time_s)
    if rows.stop - rows.start < LEAST_FRAMES:
        empty: dict[str, Any] = {"value": None, "sigma": None, "frames": 0, "inferred_share": None}
        empty |= {"why": TOO_FEW_FRAMES, "condition": trial.condition, "trial": trial.number}
        return [replace(row, **empty) for row in whole]
    found = {row.key: row for row in measure(cut_session(session, rows, settle_s, trial.start_s), rows)}
    absent = (_absent(row, found) for row in whole if row.key not in found)
    complete = [*found.values(), *(row for row in absent if row is not None)]
    return [replace(row, condition=trial.condition, trial=trial.number) for row in complete]


def _absent(like: Measure, found: dict[MeasureKey, Measure]) -> Measure | None:
    """Return a measure like ``like`` for a part or person without contact in the trial: 0 for a time or a count, no
    value if contacts are unknown. Return None for other measures.
    """
    general = found.get((like.measure, None, None, None))
    if general is None or like.unit not in ("s", "count"):
        return None
    value = None if general.value is None else 0.0
    return replace(like, value=value, sigma=None, frames=0, inferred_share=None, why=general.why)


def cut_session(session: Session, rows: slice, settle_s: float, onset_s: float) -> Session:
    """Cut a session to the given rows (frames) of a trial that begins at onset_s.

    Contacts are cut to the chosen frames, too. Episodes that reach into the chosen frames stay whole. Episodes that
    ended up to settle_s before the chosen frames are also kept, since the patient may not be at rest yet after standing
    up.
    """
    joints = cut_rows(session.joints, rows)
    start_s, end_s = float(joints.time_s[0]), float(joints.time_s[-1])
    contacts = session.contacts
    return replace(
        session,
        joints=joints,
        angles=cut_rows(session.angles, rows),
        posture=cut_rows(session.posture, rows),
        stance=cut_rows(session.stance, rows),
        seconds=frame_seconds(joints.time_s),
        episodes=tuple(e for e in session.episodes if e.end_s + settle_s >= start_s and e.start_s <= end_s),
        contacts=None if contacts is None else tuple(c for _, c in _clipped(contacts, joints.frame, joints.time_s)),
        shifted_upright=session.shifted_upright[rows],
        extended=session.extended[rows],
        onset_s=onset_s,
    )


def begun_within(found: Sequence[Found], rows: slice) -> list[Found]:
    """Return the items whose first frame lies in ``rows``; their ``frames`` are then counted from the first of these
    rows. So an event belongs to the trial in which it begins, even if it ends after that trial.
    """
    first, count = rows.start, rows.stop - rows.start
    shifted = [(one, slice(one.frames.start - first, one.frames.stop - first)) for one in found]  # type: ignore[attr-defined]
    return [replace(one, frames=frames) for one, frames in shifted if 0 <= frames.start < count]  # type: ignore[type-var]


def completely_within(found: Sequence[Found], rows: slice) -> list[Found]:
    """Return the items whose ``frames`` lie completely in ``rows``; their ``frames`` are then counted from the first of
    these rows.
    """
    count = rows.stop - rows.start
    return [one for one in begun_within(found, rows) if one.frames.stop <= count]  # type: ignore[attr-defined]


Interval = TypeVar("Interval", Contact, Episode)


def _clipped(found: Sequence[Interval], frame: np.ndarray, time_s: np.ndarray) -> Iterator[tuple[int, Interval]]:
    """Yield, for each interval that overlaps with the frames (k,) at time_s (k,), its index and the part of it that
    lies in these frames.
    """
    for place, each in enumerate(found):
        inside = np.flatnonzero((frame >= each.first_frame) & (frame <= each.last_frame))
        if len(inside):
            first, last = int(inside[0]), int(inside[-1])
            ends: dict[str, Any] = {"first_frame": int(frame[first]), "last_frame": int(frame[last])}
            ends |= {"start_s": float(time_s[first]), "end_s": float(time_s[last])}
            yield place, replace(each, **ends)


def trial_intervals(session: Session, trials: Trials) -> list[TrialInterval]:
    """Return the part of every episode and contact in every trial, in the order of trials, episodes first."""
    episodes = sorted(session.episodes, key=lambda each: (each.start_s, EPISODE_KINDS.index(each.kind)))
    found = list[TrialInterval]()
    for trial in trials.rows:
        rows = trial_rows(trial, session.joints.time_s)
        frame, time_s, seconds = session.joints.frame[rows], session.joints.time_s[rows], session.seconds[rows]
        clipped: chain[tuple[int, Episode | Contact]] = chain(
            _clipped(episodes, frame, time_s), _clipped(session.contacts or (), frame, time_s)
        )
        for place, each in clipped:
            during = (frame >= each.first_frame) & (frame <= each.last_frame)
            found.append(_interval(trial, place, each, float(seconds[during].sum())))
    return found


def _interval(trial: Trial, row: int, part: Contact | Episode, seconds: float) -> TrialInterval:
    return TrialInterval(
        trial=trial.number,
        condition=trial.condition,
        table=CONTACT if isinstance(part, Contact) else EPISODE,
        row=row,
        kind=part.part if isinstance(part, Contact) else part.kind,
        person=part.person if isinstance(part, Contact) else None,
        first_frame=part.first_frame,
        last_frame=part.last_frame,
        start_s=part.start_s,
        end_s=part.end_s,
        seconds=seconds,
    )


def condition_measures(trials: Trials, rows: Sequence[Measure]) -> list[Measure]:
    """Return the mean of each measure over the trials of a condition that have a value; rows: measures of all
    trials.
    """
    found: dict[tuple[str, MeasureKey], list[Measure]] = {}
    for row in rows:
        found.setdefault((str(row.condition), row.key), []).append(row)
    ordered = sorted(found.items(), key=lambda item: trials.conditions.index(item[0][0]))
    return [_mean(each) for _, each in ordered]


def _mean(rows: Sequence[Measure]) -> Measure:
    """Return the mean of a measure over trials, without a value if no trial has a value."""
    known, first = [row for row in rows if row.value is not None], rows[0]
    if not known:
        reasons = dict.fromkeys(str(row.why) for row in rows)
        return replace(first, trial=None, frames=0, inferred_share=None, why="; ".join(reasons))
    return replace(
        first,
        value=float(np.mean([row.value for row in known if row.value is not None])),
        sigma=sigma_of_trial_mean([row.sigma for row in known], systematic_share(first.unit)),
        frames=sum(row.frames for row in known),
        inferred_share=_inferred(known),
        why=None,
        trial=None,
    )


def _inferred(rows: Sequence[Measure]) -> float | None:
    """Return the share of inferred frames over all rows; None if no row states such a share."""
    shares = [(row.inferred_share, row.frames) for row in rows if row.inferred_share is not None and row.frames]
    frames = sum(count for _, count in shares)
    return sum(share * count for share, count in shares) / frames if frames else None


def sigma_of_trial_mean(sigma: Sequence[float | None], share: float) -> float | None:
    """Return sigma of the mean over trials of one recording; None if a trial has no sigma.

    ``share`` of the variance, the systematic share, is common to all trials; only the random share decreases with their
    number.
    """
    known = np.array([each for each in sigma if each is not None])
    if len(known) < len(sigma):
        return None
    random = (1.0 - share) * float(np.sum(known**2)) / len(known) ** 2
    return float(np.sqrt(share * float(np.mean(known)) ** 2 + random))
