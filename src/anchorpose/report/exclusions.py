"""What was left out and why: frames with problems, put together where they follow one another; notes; corrections."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from anchorpose.report.session import Session
from anchorpose.report.words import counted, escape, named_part
from anchorpose.results.run_record import RUN_FILE

MOST_LINES: Final = 60
"""More are counted and left to run.json: a page of them tells a reader nothing."""


def exclusions(session: Session) -> str:
    """HTML lists."""
    problems = [_stretch(drops) for drops in _stretches(session.run.get("dropped", []))]
    more = len(problems) - MOST_LINES
    if more > 0:
        problems = [*problems[:MOST_LINES], f"and {counted(more, 'more stretch', 'more stretches')}: see {RUN_FILE}"]
    notes = [str(note) for note in session.run.get("notes", [])]
    return (
        f"<h3>Frames with problems</h3>{_list(problems, 'No frame had problems.')}"
        f"<h3>Notes of the tracking</h3>{_list(notes, 'Nothing to note.')}"
        f"<h3>Corrections by a reviewer</h3>{_list(_corrections(session), 'None.')}"
        f"<p class='hint'>From {RUN_FILE}: dropped, notes, corrections.</p>"
    )


def _stretches(dropped: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Neighbouring frames with the same reason, apart from the number of the frame in a file's name."""
    stretches: list[list[dict[str, Any]]] = []
    for drop in sorted(dropped, key=lambda drop: (_reason(drop), drop["frame"])):
        last = stretches[-1][-1] if stretches else None
        if last is not None and _reason(last) == _reason(drop) and drop["frame"] - last["frame"] <= 1:
            stretches[-1].append(drop)
        else:
            stretches.append([drop])
    return sorted(stretches, key=lambda drops: drops[0]["frame"])


def _reason(drop: dict[str, Any]) -> str:
    return str(drop["why"]).replace(f"{drop['frame']:06d}", "…")


def _stretch(drops: Sequence[dict[str, Any]]) -> str:
    first, last = drops[0], drops[-1]
    if len(drops) == 1:
        return f"Frame {first['frame']} ({first['time_s']:.2f} s): {first['why']}"
    seconds = f"{first['time_s']:.2f} to {last['time_s']:.2f} s"
    return f"Frames {first['frame']} to {last['frame']} ({seconds}): {_reason(first)}"


def _corrections(session: Session) -> list[str]:
    """Each entry of the reviewer's file that tracking honoured, signed; see ``CorrectionsRecord``."""
    record = session.run.get("corrections")
    if record is None:
        return []
    unusable = [
        f"Unusable: frames {entry['first_frame']} to {entry['last_frame']} "
        f"({entry['start_s']:.2f} to {entry['end_s']:.2f} s): {_signed(entry)}"
        for entry in record["unusable"]
    ]
    joints = [
        f"Placed by hand: {named_part(entry['joint'])} in frame {entry['frame']} ({entry['time_s']:.2f} s): "
        f"{_signed(entry)}"
        for entry in record["joints"]
    ]
    return [*unusable, *joints, f"These are from {record['file']}, SHA-256 {record['sha256']}."]


def _signed(entry: dict[str, Any]) -> str:
    return f"{entry['reason']} ({entry['who']}, {entry['when']})"


def _list(lines: Sequence[str], nothing: str) -> str:
    return f"<ul>{''.join(f'<li>{escape(line)}</li>' for line in lines)}</ul>" if lines else f"<p>{nothing}</p>"
