"""Upright or not, and the transitions between sitting and standing, as rows of the timeline."""

from __future__ import annotations

import numpy as np

from anchorpose.joints import JointState
from anchorpose.report.chart import Column, Reading, Row
from anchorpose.report.paths import step_path
from anchorpose.report.session import Session
from anchorpose.report.words import STATE_WORDS
from anchorpose.results.episodes import SIT_TO_STAND, STAND_TO_SIT, Episode
from anchorpose.results.posture import NOT_UPRIGHT, UNKNOWN, UPRIGHT

TRANSITIONS = {SIT_TO_STAND: ("▲", "stands up"), STAND_TO_SIT: ("▼", "sits down")}

POSTURE_WORDS = {UPRIGHT: "upright", NOT_UPRIGHT: "not upright", UNKNOWN: "cannot be told"}


def posture_rows(session: Session) -> list[Row]:
    """A high column is upright, none is not upright, half a column cannot be told; a light one is inferred.

    Of a group of frames the worst is drawn: dark only where all its upright frames were seen.
    """
    bins, upright = session.bins, session.posture.upright
    unknown, standing, inferred = (
        np.maximum.reduceat(some.astype(float), bins.start)
        for some in (upright == UNKNOWN, upright == UPRIGHT, (upright == UPRIGHT) & ~session.posture_seen)
    )
    shapes = f"<path class='lost' d='{step_path(0.5 * unknown, bins)}'/>"
    shapes += f"<path class='posture light' d='{step_path(standing * inferred, bins)}'/>"
    shapes += f"<path class='posture' d='{step_path(standing * (1 - inferred), bins)}'/>"
    label = "upright" + (" (half a column: cannot be told)" if unknown.any() else "")
    rows = [
        Row(label="Posture", height=0, shapes="", kind="heading"),
        Row(label=label, height=18, shapes=shapes, kind="state"),
    ]
    moves = [episode for episode in session.episodes if episode.kind in TRANSITIONS]
    if moves:
        marks = "".join(_mark(session, episode) for episode in moves)
        rows.append(Row(label="▲ stands up, ▼ sits down", height=22, shapes="", marks=marks, kind="marks"))
    return rows


def posture_readings(session: Session) -> list[Reading]:
    """Of each group of frames every posture that it holds, and what begins or goes on in it."""
    bins = session.bins
    words = [
        POSTURE_WORDS[code] + ("" if seen or code == UNKNOWN else " (inferred)")
        for code, seen in zip(session.posture.upright.tolist(), session.posture_seen.tolist(), strict=True)
    ]
    postures = [
        " and ".join(dict.fromkeys(words[first : last + 1])) for first, last in zip(bins.start, bins.last, strict=True)
    ]
    moves = [
        " and ".join(
            TRANSITIONS[episode.kind][1]
            for episode in session.episodes
            if episode.kind in TRANSITIONS and episode.first_frame <= last and episode.last_frame >= first
        )
        for first, last in zip(bins.frame[bins.start], bins.frame[bins.last], strict=True)
    ]
    return [Reading(label="", text=Column("posture", postures)), Reading(label="", text=Column("transition", moves))]


def _mark(session: Session, episode: Episode) -> str:
    begin, end = session.bins.place_of(np.array([episode.start_s, episode.end_s])).tolist()
    sign, words = TRANSITIONS[episode.kind]
    kind = "" if episode.state is JointState.OBSERVED else " unsure"
    title = f"{words}, {episode.start_s:.1f} to {episode.end_s:.1f} s, {STATE_WORDS[episode.state]}"
    return (
        f"<span class='move{kind}' style='left:{100 * begin:.2f}%;width:{100 * (end - begin):.2f}%' title='{title}'>"
        f"{sign}</span>"
    )
