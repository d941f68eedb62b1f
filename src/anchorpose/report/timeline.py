"""The session at a glance: posture, contacts, what could be seen and how certain the joints are, over one time axis."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.joints import JOINT_COUNT, STATE_CODE, JointState
from anchorpose.report.chart import Axis, Chart, Column, Reading, Row, cells, heading
from anchorpose.report.curves import band_path, line_paths
from anchorpose.report.ledger import Rows
from anchorpose.report.session import Bins, Session, envelope
from anchorpose.report.timeline_rows import (
    kept_rows,
    marked_row,
    posture_readings,
    posture_rows,
    touch_reading,
    touch_rows,
)
from anchorpose.report.words import COVERAGE, STATE_WORDS
from anchorpose.results.explained import EXPLAINED_FILE, unexplained
from anchorpose.results.frame_time import blocks
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE
from anchorpose.results.tables import JOINTS_FILE, POSTURE_FILE

PERCENT: Final = Axis(0.0, 100.0, (0.0, 100.0))


def timeline(session: Session) -> Chart:
    """The whole chart, with a heading above each kind of rows."""
    shares = [(state, _share(session, state)) for state in JointState]
    shares = [(state, share) for state, share in shares if state is JointState.OBSERVED or share.max() > 0]
    return Chart(
        identity="timeline",
        title="Timeline of the session: posture, contacts, what was seen of the joints, and their uncertainty",
        caption="The session over time",
        rows=[
            *posture_rows(session),
            *touch_rows(session),
            heading("Joints"),
            *(_share_row(STATE_WORDS[state], share, session.bins, str(state)) for state, share in shares),
            *_confidence_rows(session),
            *kept_rows(session),
        ],
        readings=[
            *posture_readings(session),
            touch_reading(session),
            *(_share_reading(STATE_WORDS[state], f"joints_{state}", share, session.bins) for state, share in shares),
            *_confidence_readings(session),
        ],
        sources=[session.ledger.link(Rows(file)) for file in _files(session)],
        bins=session.bins,
    )


def _files(session: Session) -> tuple[str, ...]:
    return (*_event_files(session), JOINTS_FILE, *(() if session.explained is None else (EXPLAINED_FILE,)))


def short_timeline(session: Session, label: str) -> Chart:
    """Posture and contacts only, to stand beside those of other sessions."""
    return Chart(
        identity=f"timeline-{session.ledger.name}",
        title=f"Posture and contacts of {label}",
        caption="Posture and contacts",
        rows=[*posture_rows(session), *touch_rows(session)],
        readings=[*posture_readings(session), touch_reading(session)],
        sources=[session.ledger.link(Rows(file)) for file in _event_files(session)],
        bins=session.bins,
    )


def _event_files(session: Session) -> tuple[str, ...]:
    """The tables that posture and contacts come from, of those that there are."""
    return (POSTURE_FILE, EPISODES_FILE, *(() if session.contacts is None else (CONTACTS_FILE,)))


def joint_confidence_mm(session: Session) -> tuple[np.ndarray, np.ndarray]:
    """(n,) 1.96 sigma of the median and of the worst joint that is not lost, NaN in frames without any."""
    sigma_m = session.joints.sigma_m
    median, highest = np.full(len(sigma_m), np.nan), np.full(len(sigma_m), np.nan)
    for rows in blocks(len(sigma_m)):
        reach_mm = 1000.0 * COVERAGE * sigma_m[rows]
        known = np.isfinite(reach_mm).any(axis=1)
        median[rows][known] = np.nanmedian(reach_mm[known], axis=1)
        highest[rows][known] = np.nanmax(reach_mm[known], axis=1)
    return median, highest


def matched_percent(session: Session) -> np.ndarray | None:
    """(n,) of run.json's ``association.matched_share``, NaN where no point was followed, or None."""
    shares = session.run.get("association", {}).get("matched_share", [])
    if len(shares) != len(session.joints.frame):
        return None
    return np.array([np.nan if share is None else 100.0 * share for share in shares])


def _share(session: Session, state: JointState) -> np.ndarray:
    return 100.0 * (session.joints.state_code == STATE_CODE[state]).sum(axis=1) / JOINT_COUNT


def _share_row(label: str, percent: np.ndarray, bins: Bins, name: str) -> Row:
    """Dark up to the lowest share of each group of frames, lighter up to the highest."""
    shape, ground = envelope(percent, bins), np.zeros(bins.count)
    high, low = (band_path(ground, edge, bins, PERCENT) for edge in (shape.high, shape.low))
    shapes = ((f"area {name} light", high), (f"area {name}", low))
    return Row(label=f"{label}, %", height=30, shapes=shapes, axis=PERCENT, kind="share")


def _confidence_rows(session: Session) -> list[Row]:
    labels = ("± of the median joint, mm", "± of the worst joint, mm")
    values = joint_confidence_mm(session)
    rows = [_line_row(label, value, session.bins) for label, value in zip(labels, values, strict=True)]
    matched = matched_percent(session)
    if matched is not None and np.isfinite(matched).any():
        rows.append(_share_row("points found again", matched, session.bins, "matched"))
    if session.explained is not None:
        rows += marked_row(session, "not explained by the body", unexplained(session.explained) >= 1.0)
    return [heading("Confidence"), *rows]


def _line_row(label: str, value: np.ndarray, bins: Bins) -> Row:
    top = float(np.nanmax(value)) if np.isfinite(value).any() else 1.0
    top = max(1.0, float(np.ceil(top)))
    axis = Axis(0.0, top, (0.0, top))
    line, _ = line_paths(envelope(value, bins), np.ones(bins.count, dtype=bool), bins, axis)
    return Row(label=label, height=34, shapes=(("line both thick", line),), axis=axis, kind="curves")


def _share_reading(label: str, key: str, percent: np.ndarray, bins: Bins) -> Reading:
    shape = envelope(percent, bins)
    low, high = (
        Column(f"{key}_lowest_percent", cells(shape.low, 0)),
        Column(f"{key}_highest_percent", cells(shape.high, 0)),
    )
    return Reading(label=label, unit=" %", low=low, high=high)


def _confidence_readings(session: Session) -> list[Reading]:
    spoken = []
    for name, value in zip(("median", "worst"), joint_confidence_mm(session), strict=True):
        shape = envelope(value, session.bins)
        low = Column(f"plus_minus_{name}_joint_lowest_mm", cells(shape.low, 1))
        high = Column(f"plus_minus_{name}_joint_highest_mm", cells(shape.high, 1))
        spoken.append(Reading(label=f"{name} joint ±", unit=" mm", low=low, high=high))
    matched = matched_percent(session)
    if matched is not None:
        spoken.append(_share_reading("points found again", "matched", matched, session.bins))
    return spoken
