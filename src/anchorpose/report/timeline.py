"""Draw the session over time: trials, posture, contacts, visibility and sigma of joints, frames with problems.

A contact is a light column from its beginning to its end. The column is dark up to the share of the touching skin that
was seen. Each contact has only one such share, since the tables do not state at which moments the touching skin was
seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.body.contact_regions import REGIONS
from anchorpose.joints import JOINT_COUNT, STATE_CODE, JointState
from anchorpose.report.chart import (
    Axis,
    Bins,
    Chart,
    Column,
    Mark,
    Reading,
    Row,
    envelope,
    heading,
    lowest_and_highest,
    worst,
)
from anchorpose.report.curves import band_path, line_paths, step_path
from anchorpose.report.measure_section import unit_of
from anchorpose.report.session import Session
from anchorpose.report.words import STATE_WORDS, Form, decimals_for, named_part, number
from anchorpose.results.explained import EXPLAINED_FILE, unexplained
from anchorpose.results.frame_table import UNKNOWN
from anchorpose.results.records import (
    BUCKLE_LEFT,
    BUCKLE_RIGHT,
    CONTACTS_FILE,
    EPISODES_FILE,
    FAILED_STAND,
    RECOVERY_LEFT,
    RECOVERY_RIGHT,
    SIT_TO_STAND,
    STAND_TO_SIT,
    Contact,
    Episode,
)
from anchorpose.results.run_record import matched_share
from anchorpose.results.tables import JOINTS_FILE, NOT_UPRIGHT, POSTURE_FILE, UPRIGHT
from anchorpose.results.trial_table import TRIALS_FILE, trial_rows
from anchorpose.results.uncertainty import NORMAL_95

SHARES: Final = Axis(0.0, 100.0, (0.0, 100.0))


def timeline(session: Session) -> Chart:
    """Return the whole chart of the session, with a heading above each kind of rows."""
    shares = [(state, _share(session, state)) for state in JointState]
    shares = [(state, share) for state, share in shares if state is JointState.OBSERVED or share.max() > 0]
    confidence_rows, confidence_readings = _confidence(session)
    return Chart(
        identity="timeline",
        title="Timeline of the session: posture, contacts, what was seen of the joints, and their uncertainty",
        caption="The session over time",
        rows=[
            *condition_rows(session),
            *posture_rows(session),
            *touch_rows(session),
            heading("Joints"),
            *(_share_row(STATE_WORDS[state], share, session.bins, str(state)) for state, share in shares),
            *confidence_rows,
            *kept_rows(session),
        ],
        readings=[
            *trial_readings(session),
            *posture_readings(session),
            touch_reading(session),
            *(_share_reading(STATE_WORDS[state], f"joints_{state}", share, session.bins) for state, share in shares),
            *confidence_readings,
        ],
        sources=[
            *(() if session.trials is None else (TRIALS_FILE,)),
            *_event_files(session),
            JOINTS_FILE,
            *(() if session.explained is None else (EXPLAINED_FILE,)),
        ],
        bins=session.bins,
    )


def short_timeline(session: Session, label: str) -> Chart:
    """Return a chart with only posture and contacts, to be shown beside the charts of other sessions."""
    return Chart(
        identity=f"timeline-{session.name}",
        title=f"Posture and contacts of {label}",
        caption="Posture and contacts",
        rows=[*posture_rows(session), *touch_rows(session)],
        readings=[*posture_readings(session), touch_reading(session)],
        sources=_event_files(session),
        bins=session.bins,
    )


MOST_CONDITIONS: Final = 12
"""Maximum number of rows of conditions; with more conditions, a table is easier to read than a picture."""


def condition_rows(session: Session) -> list[Row]:
    """Return a row per condition, with columns during its trials; return no rows without trials or with too many
    conditions.
    """
    trials = session.trials
    if trials is None or len(trials.conditions) > MOST_CONDITIONS:
        return []
    rows = [heading("Conditions")]
    for name in trials.conditions:
        during = np.zeros(len(session.joints.frame))
        for trial in trials.rows:
            if trial.condition == name:
                during[trial_rows(trial, session.joints.time_s)] = 1.0
        rows.append(_state_row(name, session.bins, 14, posture=worst(during, session.bins)))
    return rows


def trial_readings(session: Session) -> list[Reading]:
    """Return, for the slider, the trials to which each group of frames belongs; an empty list without trials."""
    if session.trials is None:
        return []
    texts: list[list[str]] = [[] for _ in range(session.bins.count)]
    first, last = session.bins.start, session.bins.last
    for trial in session.trials.rows:
        rows = trial_rows(trial, session.joints.time_s)
        for k in np.flatnonzero((first < rows.stop) & (last >= rows.start)):
            texts[k].append(f"{trial.number} ({trial.condition})".replace(",", ";"))
    return [_text_reading("trial", "trial", ["; ".join(text) for text in texts])]


def _text_reading(label: str, column: str, texts: list[str]) -> Reading:
    return Reading(label=label, columns={"text": Column(column, texts)})


def _event_files(session: Session) -> tuple[str, ...]:
    """Return the names of the existing tables of posture and contacts."""
    return (POSTURE_FILE, EPISODES_FILE, *(() if session.contacts is None else (CONTACTS_FILE,)))


def joint_confidence_mm(session: Session) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each frame, the median and the largest of the joints' sigmas, each multiplied by 1.96, (n,) each, in
    mm. Lost joints are left out; NaN where all are lost.
    """
    reach_mm = 1000.0 * NORMAL_95 * session.joints.sigma_m
    known = np.isfinite(reach_mm).any(axis=1)
    median, highest = np.full((2, len(reach_mm)), np.nan)
    median[known], highest[known] = np.nanmedian(reach_mm[known], axis=1), np.nanmax(reach_mm[known], axis=1)
    return median, highest


def _share(session: Session, state: JointState) -> np.ndarray:
    return 100.0 * (session.joints.state_code == STATE_CODE[state]).sum(axis=1) / JOINT_COUNT


def _share_row(label: str, percent: np.ndarray, bins: Bins, name: str) -> Row:
    """Return a row with a column per group of frames: dark up to the group's lowest share, lighter up to its
    highest.
    """
    shape, ground = envelope(percent, bins), np.zeros(bins.count)
    high, low = (band_path(ground, edge, bins, SHARES) for edge in (shape.high, shape.low))
    shapes = ((f"area {name} light", high), (f"area {name}", low))
    return Row(label=f"{label}, %", height=30, shapes=shapes, axis=SHARES, kind="share")


def _confidence(session: Session) -> tuple[list[Row], list[Reading]]:
    """Return rows, and the values that the slider shows for them: the uncertainty of joints, and the share of surface
    points that were found again in the next frame. A last row, without values, shows the frames in which the fitted
    body does not explain the depth images.
    """
    rows, spoken, bins = [heading("Confidence")], list[Reading](), session.bins
    for name, value in zip(("median", "worst"), joint_confidence_mm(session), strict=True):
        rows.append(_line_row(f"± of the {name} joint, mm", value, bins))
        columns = lowest_and_highest(f"plus_minus_{name}_joint_{{}}_mm", value, bins, 1)
        spoken.append(Reading(label=f"{name} joint ±", unit=" mm", columns=columns))
    share = matched_share(session.run, len(session.joints.frame))
    if share is not None:
        matched = 100.0 * share
        spoken.append(_share_reading("points found again", "matched", matched, bins))
        if np.isfinite(matched).any():
            rows.append(_share_row("points found again", matched, bins, "matched"))
    if session.explained is not None:
        rows += marked_row(session, "not explained by the body", unexplained(session.explained) >= 1.0)
    return rows, spoken


def _line_row(label: str, value: np.ndarray, bins: Bins) -> Row:
    top = float(np.nanmax(value)) if np.isfinite(value).any() else 1.0
    top = max(1.0, float(np.ceil(top)))
    axis = Axis(0.0, top, (0.0, top))
    line, _ = line_paths(envelope(value, bins), np.ones(bins.count, dtype=bool), bins, axis)
    return Row(label=label, height=34, shapes=(("line both thick", line),), axis=axis, kind="curves")


def _share_reading(label: str, key: str, percent: np.ndarray, bins: Bins) -> Reading:
    return Reading(label=label, unit=" %", columns=lowest_and_highest(f"{key}_{{}}_percent", percent, bins, 0))


def kept_rows(session: Session) -> list[Row]:
    """Return rows of frames with problems, of frames marked unusable by a reviewer, and of frames with pictures. The
    marks in the row of pictures are links to the pictures.
    """
    bad = np.isin(session.joints.frame, [drop["frame"] for drop in session.run.get("dropped", [])])
    rows = [
        *marked_row(session, "frames with problems", bad),
        *marked_row(session, "marked unusable by a reviewer", unusable_frames(session)),
        *_pictures(session),
    ]
    return [heading("Kept and left out"), *rows] if rows else []


def unusable_frames(session: Session) -> np.ndarray:
    """Return (n,) bool: the frames that a reviewer marked as unusable."""
    entries = (session.run.get("corrections") or {}).get("unusable", [])
    frame, marked = session.joints.frame, np.zeros(len(session.joints.frame), dtype=bool)
    for entry in entries:
        marked |= (entry["first_frame"] <= frame) & (frame <= entry["last_frame"])
    return marked


def marked_row(session: Session, label: str, frames: np.ndarray) -> list[Row]:
    """Return one row with a column for each group of frames that contains a frame marked True in ``frames`` (n,) bool;
    no row if no frame is marked.
    """
    if not frames.any():
        return []
    return [_state_row(label, session.bins, 12, lost=worst(frames.astype(float), session.bins))]


def _state_row(label: str, bins: Bins, height: int, **levels: np.ndarray) -> Row:
    """Return a row of columns. levels: heights (b,) of columns, 0 to 1; each keyword names the CSS classes of its
    columns, with ``_`` in place of a space.
    """
    shapes = tuple((kind.replace("_", " "), step_path(level, bins)) for kind, level in levels.items())
    return Row(label=label, height=height, shapes=shapes, kind="state")


def _pictures(session: Session) -> list[Row]:
    kept = (p for p in session.run.get("pictures", []) if (session.folder / p["file"]).is_file())
    times = dict.fromkeys((picture["frame"], picture["time_s"]) for picture in kept)
    if not times:
        return []
    places = session.bins.place_of(np.array([time_s for _, time_s in times])).tolist()
    marks = []
    for shown, ((frame, _), place) in enumerate(zip(times, places, strict=True), 1):
        title, style = f"pictures of frame {frame}", f"left:{100 * place:.2f}%"
        marks.append(Mark(text=str(shown), kind="kept", style=style, title=title, link=f"#frame-{frame}"))
    return [Row(label="pictures", height=26, marks=tuple(marks), kind="marks")]


TRANSITIONS: Final = {SIT_TO_STAND: ("▲", "stands up"), STAND_TO_SIT: ("▼", "sits down")}

POSTURE_WORDS: Final = {UPRIGHT: "upright", NOT_UPRIGHT: "not upright", UNKNOWN: "posture unknown"}


def posture_rows(session: Session) -> list[Row]:
    """Return the rows of posture, transitions and events.

    A column of full height means upright, a column of half height unknown posture; no column is drawn where the patient
    is not upright. A column is dark if the joints that determine posture were seen in all upright frames of its group
    of frames, else light.
    """
    bins, upright = session.bins, session.posture.upright
    unknown, standing, inferred = (
        worst(some.astype(float), bins)
        for some in (upright == UNKNOWN, upright == UPRIGHT, (upright == UPRIGHT) & ~session.posture_seen)
    )
    levels = {"lost": 0.5 * unknown, "posture_light": standing * inferred, "posture": standing * (1 - inferred)}
    label = "upright" + (" (half a column: unknown)" if unknown.any() else "")
    rows = [heading("Posture"), _state_row(label, bins, 18, **levels)]
    marks = tuple(_mark(bins, each, *TRANSITIONS[each.kind]) for each in session.episodes if each.kind in TRANSITIONS)
    if marks:
        rows.append(Row(label="▲ stands up, ▼ sits down", height=22, marks=marks, kind="marks"))
    return [*rows, *event_rows(session)]


EVENTS: Final = {
    BUCKLE_LEFT: ("L", "left knee buckles", "knee buckles, L left, R right"),
    BUCKLE_RIGHT: ("R", "right knee buckles", "knee buckles, L left, R right"),
    FAILED_STAND: ("↧", "fails to stand", "↧ fails to stand"),
    RECOVERY_LEFT: ("L", "recovery step of the left foot", "recovery steps, L left, R right"),
    RECOVERY_RIGHT: ("R", "recovery step of the right foot", "recovery steps, L left, R right"),
}
"""For each kind of event: its sign, its description, and the label of its row."""


def event_rows(session: Session) -> list[Row]:
    """Return a row of marks per kind of event that was seen; no row without events."""
    rows: dict[str, list[Mark]] = {}
    for episode in session.episodes:
        if episode.kind in EVENTS:
            sign, words, label = EVENTS[episode.kind]
            rows.setdefault(label, []).append(_mark(session.bins, episode, sign, f"{words} by {_depth(episode)}"))
    return [Row(label=label, height=22, marks=tuple(marks), kind="marks") for label, marks in rows.items()]


def _depth(episode: Episode) -> str:
    """Return as text how deep or how far an event went (``Episode.depth``, such as the degrees by which a knee
    buckled), with 1.96 times its sigma.
    """
    times, after = unit_of(episode.unit or "1")
    depth, reach = times * (episode.depth or 0.0), times * NORMAL_95 * (episode.sigma or 0.0)
    decimals = decimals_for(reach, depth)
    return f"{number(depth, decimals)} ± {number(reach, decimals)}{after}"


def posture_readings(session: Session) -> list[Reading]:
    """Return, for the slider, the postures in each group of frames, and the transitions and events that overlap the
    group.
    """
    bins = session.bins
    words = [
        POSTURE_WORDS[code] + ("" if seen or code == UNKNOWN else " (inferred)")
        for code, seen in zip(session.posture.upright.tolist(), session.posture_seen.tolist(), strict=True)
    ]
    postures = [
        " and ".join(dict.fromkeys(words[first : last + 1])) for first, last in zip(bins.start, bins.last, strict=True)
    ]
    seen = [(each, {**TRANSITIONS, **EVENTS}.get(each.kind)) for each in session.episodes]
    moves = [
        " and ".join(sign[1] for each, sign in seen if sign and each.first_frame <= last and each.last_frame >= first)
        for first, last in zip(bins.frame[bins.start], bins.frame[bins.last], strict=True)
    ]
    return [_text_reading("", "posture", postures), _text_reading("", "transition", moves)]


def _mark(bins: Bins, episode: Episode, sign: str, words: str) -> Mark:
    begin, end = bins.place_of(np.array([episode.start_s, episode.end_s])).tolist()
    return Mark(
        text=sign,
        kind="move" if episode.state is JointState.OBSERVED else "move unsure",
        style=f"left:{100 * begin:.2f}%;width:{100 * (end - begin):.2f}%",
        title=f"{words}, {episode.start_s:.1f} to {episode.end_s:.1f} s, {STATE_WORDS[episode.state]}",
    )


SEEN_SHARE: Final = Form(times=100.0, after=" % seen", share=True)


def touch_rows(session: Session) -> list[Row]:
    """Return, for each touched part of the body from head to foot, one row per person or equipment that touches it."""
    rows = [heading("Touched by")]
    if session.contacts is None:
        return [*rows, _state_row("not known: no contacts.parquet", session.bins, 14)]
    touched = sorted({(REGIONS.index(c.part), c.toucher) for c in session.contacts}, key=_natural)
    if (lost := _lost(session)).any():
        rows.append(_state_row("not known: patient lost", session.bins, 15, lost=0.5 * lost))
    if not touched:
        return [*rows, _state_row("nobody, as far as was seen", session.bins, 14)]
    for part, toucher in touched:
        contacts = [c for c in session.contacts if c.part == REGIONS[part] and c.toucher == toucher]
        held, seen = _held_and_seen(contacts, session.bins)
        label = f"{named_part(REGIONS[part])}: {toucher}"
        rows.append(_state_row(label, session.bins, 15, touch_light=held, touch=seen))
    return rows


def touch_reading(session: Session) -> Reading:
    """Return, for each group of frames, every touched part of the body, the person or equipment that touches it, and
    the share of the touching skin that was seen.
    """
    first, last = session.bins.frame[session.bins.start], session.bins.frame[session.bins.last]
    texts: list[list[str]] = [["not known: patient lost"] if lost else [] for lost in _lost(session)]
    for contact in sorted(session.contacts or (), key=lambda c: (REGIONS.index(c.part), c.toucher, c.start_s)):
        text = f"{named_part(contact.part)} by {contact.toucher} ({SEEN_SHARE.write(contact.seen_share)})"
        for k in np.flatnonzero((contact.first_frame <= last) & (contact.last_frame >= first)):
            texts[k].append(text.replace(",", " "))
    return _text_reading("touched", "touched", ["; ".join(dict.fromkeys(text)) for text in texts])


def _lost(session: Session) -> np.ndarray:
    """Return (b,): 1.0 for each group of frames that has a frame in which all joints are lost, else 0."""
    return worst(session.joints.lost.all(axis=1).astype(float), session.bins)


def _held_and_seen(contacts: Sequence[Contact], bins: Bins) -> tuple[np.ndarray, np.ndarray]:
    """Return two arrays (b,) over the groups of frames. The first is 1.0 where any of the contacts overlaps the group,
    else 0. The second is the smallest share of touching skin that was seen, over these contacts; 0 without contact.
    """
    held, seen = np.zeros(bins.count), np.ones(bins.count)
    for contact in contacts:
        there = (contact.first_frame <= bins.frame[bins.last]) & (contact.last_frame >= bins.frame[bins.start])
        held[there], seen[there] = 1.0, np.minimum(seen[there], contact.seen_share)
    return held, held * seen


def _natural(item: tuple[int, str]) -> tuple[int, int, str]:
    """Return a sort key that puts person 10 after person 9."""
    part, person = item
    digits = "".join(filter(str.isdigit, person))
    return part, int(digits) if digits else 0, person
