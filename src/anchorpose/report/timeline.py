"""The session at one glance: posture, contacts, what could be seen and how sure the joints are, over one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from anchorpose.joints import JOINT_COUNT, STATE_CODE, JointState
from anchorpose.report.axis import Axis, Bins, envelope
from anchorpose.report.chart import Chart, Column, Reading, Row, cells, chart_html
from anchorpose.report.curves import band_path, line_paths
from anchorpose.report.ledger import Rows
from anchorpose.report.session import Session
from anchorpose.report.timeline_rows import kept_rows, posture_readings, posture_rows, touch_reading, touch_rows
from anchorpose.report.words import COVERAGE, STATE_WORDS
from anchorpose.results.records import CONTACTS_FILE, EPISODES_FILE
from anchorpose.results.tables import JOINTS_FILE, POSTURE_FILE

PERCENT: Final = Axis(0.0, 100.0, (0.0, 100.0))


def timeline(session: Session) -> str:
    """HTML: the chart, with a heading above each kind of rows."""
    bins = session.bins
    shares = [(state, _share(session, state)) for state in JointState]
    shares = [(state, share) for state, share in shares if state is JointState.OBSERVED or share.max() > 0]
    rows = [
        *posture_rows(session),
        *touch_rows(session),
        *_headed("Joints", [_share_row(STATE_WORDS[state], share, bins, str(state)) for state, share in shares]),
        *_confidence_rows(session),
        *kept_rows(session),
    ]
    spoken = [
        *posture_readings(session),
        touch_reading(session),
        *(_share_reading(STATE_WORDS[s], f"joints_{s}", share, bins) for s, share in shares),
        *_confidence_readings(session),
    ]
    files = (*_told_by(session), JOINTS_FILE)
    chart = Chart(
        identity="timeline",
        title="Timeline of the session: posture, contacts, what was seen of the joints, and how sure they are",
        caption="<b>The session over time</b>",
        rows=rows,
        readings=spoken,
        source="".join(session.ledger.link(Rows(file)) for file in files),
    )
    return chart_html(chart, bins)


def short_timeline(session: Session, label: str) -> str:
    """HTML: posture and contacts only, to stand beside those of other sessions."""
    chart = Chart(
        identity=f"timeline-{session.ledger.name}",
        title=f"Posture and contacts of {label}",
        caption="<b>Posture and contacts</b>",
        rows=[*posture_rows(session), *touch_rows(session)],
        readings=[*posture_readings(session), touch_reading(session)],
        source="".join(session.ledger.link(Rows(file)) for file in _told_by(session)),
    )
    return chart_html(chart, session.bins)


def _told_by(session: Session) -> tuple[str, ...]:
    """The tables that posture and contacts come from, of those that there are."""
    return (POSTURE_FILE, EPISODES_FILE, *(() if session.contacts is None else (CONTACTS_FILE,)))


def joint_confidence_mm(session: Session) -> tuple[np.ndarray, np.ndarray]:
    """(n,) 1.96 sigma of the median and of the worst joint that is not lost, NaN in frames without any."""
    reach_mm = 1000.0 * COVERAGE * session.joints.sigma_m
    known = np.isfinite(reach_mm).any(axis=1)
    median, highest = np.full(len(reach_mm), np.nan), np.full(len(reach_mm), np.nan)
    median[known], highest[known] = np.nanmedian(reach_mm[known], axis=1), np.nanmax(reach_mm[known], axis=1)
    return median, highest


def matched_percent(session: Session) -> np.ndarray | None:
    """(n,) of run.json's ``association.matched_share``, NaN where nothing was asked; None where run.json has none."""
    shares = session.run.get("association", {}).get("matched_share", [])
    if len(shares) != len(session.joints.frame):
        return None
    return np.array([np.nan if share is None else 100.0 * share for share in shares])


def _share(session: Session, state: JointState) -> np.ndarray:
    return 100.0 * (session.joints.state_code == STATE_CODE[state]).sum(axis=1) / JOINT_COUNT


def _headed(heading: str, rows: Sequence[Row]) -> list[Row]:
    return [Row(label=heading, height=0, shapes="", kind="heading"), *rows]


def _share_row(label: str, percent: np.ndarray, bins: Bins, name: str) -> Row:
    """Dark up to the lowest share of each group of frames, lighter up to the highest."""
    shape, ground = envelope(percent, bins), np.zeros(bins.count)
    high, low = (band_path(ground, edge, bins, PERCENT) for edge in (shape.high, shape.low))
    shapes = f"<path class='area {name} light' d='{high}'/><path class='area {name}' d='{low}'/>"
    return Row(label=f"{label}, %", height=30, shapes=shapes, axis=PERCENT, kind="share")


def _confidence_rows(session: Session) -> list[Row]:
    labels = ("± of the median joint, mm", "± of the worst joint, mm")
    values = joint_confidence_mm(session)
    rows = [_line_row(label, value, session.bins) for label, value in zip(labels, values, strict=True)]
    matched = matched_percent(session)
    if matched is not None and np.isfinite(matched).any():
        rows.append(_share_row("points found again", matched, session.bins, "matched"))
    return _headed("Confidence", rows)


def _line_row(label: str, value: np.ndarray, bins: Bins) -> Row:
    top = float(np.nanmax(value)) if np.isfinite(value).any() else 1.0
    top = max(1.0, float(np.ceil(top)))
    axis = Axis(0.0, top, (0.0, top))
    line, _ = line_paths(envelope(value, bins), np.ones(bins.count, dtype=bool), bins, axis)
    return Row(label=label, height=34, shapes=f"<path class='line both thick' d='{line}'/>", axis=axis, kind="curves")


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
