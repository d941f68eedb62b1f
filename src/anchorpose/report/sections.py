"""What was left out and why: frames with problems, put together where they follow one another; notes; corrections.

Paths of the joints: three curves each (forward, up, to the right), left and right together.

How often each joint was seen, hidden (and by what) or lost, and how sure it is.

From what, with what and how long: versions, cameras, residuals, times, settings and the hashes of all inputs.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from typing import Any, Final

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, JointState
from anchorpose.report.chart import Chart, chart_html
from anchorpose.report.curves import Curve, Quantity, curve_rows, readings, state_rows
from anchorpose.report.ledger import Form, Rows, Taking
from anchorpose.report.session import Session
from anchorpose.report.words import COVERAGE, STATE_WORDS, counted, escape, named_part, row, spaced, split_side, table
from anchorpose.results.run_record import RUN_FILE
from anchorpose.results.tables import JOINTS_FILE

AXES: Final = {"x": "forward (X), m", "y": "up (Y), m", "z": "to the right (Z), m"}


def joint_section(session: Session) -> str:
    """HTML: a chart for each joint, or pair of joints."""
    pairs: dict[str, list[str]] = {}
    for name in JOINT_NAMES:
        pairs.setdefault(split_side(name)[0], []).append(name)
    return "".join(_chart(session, base, names) for base, names in pairs.items())


def _chart(session: Session, base: str, names: list[str]) -> str:
    if session.joints.lost[:, [JOINT_INDEX[name] for name in names]].all():
        return f"<p>{escape(spaced(base).capitalize())}: lost in all frames.</p>"
    rows, spoken = [], []
    for axis, label in AXES.items():
        quantity = Quantity(label=label, unit="m", unit_name="m", decimals=3, least_span=0.05)
        curves = [_curve(session, name, axis) for name in names]
        rows += curve_rows(curves, quantity, session.bins, 96)
        for name, curve in zip(names, curves, strict=True):
            side = split_side(name)[1]
            text = f"{side} {axis.upper()}" if side else axis.upper()
            spoken.append(readings(curve, quantity, session.bins, text, with_state=axis == "z"))
    chart = Chart(
        identity=f"joint-{base}",
        title=f"{spaced(base)}, path over time in metres",
        caption=f"<b>{escape(spaced(base).capitalize())}</b>",
        rows=rows + state_rows([_curve(session, name, "x") for name in names], session.bins),
        readings=spoken,
        source="".join(session.ledger.link(Rows(JOINTS_FILE, (("joint", name),))) for name in names),
    )
    return chart_html(chart, session.bins)


def _curve(session: Session, name: str, axis: str) -> Curve:
    column = JOINT_INDEX[name]
    return Curve(
        key=f"{name}_{axis}",
        side=split_side(name)[1] or "",
        value=session.joints.position_m[:, column, "xyz".index(axis)],
        sigma=session.joints.sigma_m[:, column],
        state_code=session.joints.state_code[:, column],
    )


_PERCENT = Form(times=100.0, share=True)


def state_table(session: Session) -> str:
    """HTML table: one row a joint, per cent of its frames in each state."""
    titles = ("joint", *(f"{words}, %" for words in STATE_WORDS.values()), "typical ±, mm", "source")
    body = "".join(row(named_part(name), _cells(session, name)) for name in JOINT_NAMES)
    return table("Share of the frames in each state, joint by joint", titles, f"<tbody>{body}</tbody>")


def _cells(session: Session, name: str) -> list[str]:
    ledger, rows = session.ledger, Rows(JOINTS_FILE, (("joint", name),))
    shares = [ledger.figure(rows, Taking(column="state", how="share", among=(str(s),)), _PERCENT) for s in JointState]
    typical = ledger.figure(rows, Taking(column="sigma_m", how="median"), Form(times=1000.0 * COVERAGE))
    return [*shares, typical, ledger.link(rows)]


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


def provenance(session: Session) -> str:
    """HTML: tables that open one by one."""
    run = session.run
    measured = session.definition.anchorpose if session.definition else "measures.parquet does not say"
    versions = [*run.get("versions", {}).items(), ("the measures: anchorpose", measured)]
    cameras = [(camera["name"], camera["source"], _position(camera)) for camera in run.get("cameras", [])]
    residuals = [
        (r["camera"], r["what"], f"{r['value']:.4g} {r['unit']}".replace(" 1", "")) for r in run.get("residuals", [])
    ]
    timings = [(timing["stage"], f"{timing['seconds']:.1f}") for timing in run.get("timings", [])]
    return "".join(
        [
            _table("Versions", ("program", "version"), versions),
            _table("Cameras", ("camera", "pose from", "stands at x, y, z in metres"), cameras),
            _table("What calibration left unexplained", ("camera", "what", "value"), residuals),
            _table("The patient's body as learnt", ("what", "value"), _body(run.get("body"))),
            _table("Time spent", ("stage", "seconds"), timings),
            _folded("Settings", f"<pre>{escape(json.dumps(run.get('config'), indent=1, ensure_ascii=False))}</pre>"),
            _table("Input files", ("file", "SHA-256"), _inputs(run.get("inputs_sha256", {}))),
        ]
    )


def _inputs(hashes: dict[str, str]) -> list[tuple[str, str]]:
    """Every file but the numbered pictures, of which a camera's are told by one hash of all their hashes."""
    pictures: dict[str, list[str]] = {}
    named = []
    for file, digest in sorted(hashes.items()):
        folder, _, name = file.rpartition("/")
        if name.split(".")[0].isdigit():
            pictures.setdefault(folder, []).append(digest)
        else:
            named.append((file, digest))
    together = [
        (f"{folder}: {counted(len(digests), 'picture')}, the hash of their hashes in run.json, in order of names",
         hashlib.sha256("\n".join(digests).encode("ascii")).hexdigest())
        for folder, digests in pictures.items()
    ]  # fmt: skip
    return named + together


def _position(camera: dict[str, Any]) -> str:
    pose = camera.get("camera_to_world")
    return "not used" if pose is None else ", ".join(f"{row[3]:.2f}" for row in pose[:3])


def _body(body: dict[str, Any] | None) -> list[tuple[str, str]]:
    if body is None:
        return [("no body was learnt", "")]
    lengths = [
        (spaced(str(bone["bone"])), f"{1000 * bone['length_m']:.0f} ± {1000 * bone['sigma_m']:.0f} mm (one sigma)")
        for bone in body["bones"]
    ]
    height = f"{body['height_m']:.3f} ± {body['height_sigma_m']:.3f} m (one sigma)"
    return [("height without shoes", height), ("thickness of clothes", f"{1000 * body['clothing_m']:.0f} mm"), *lengths]


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return _folded(title, "<p>run.json says nothing of this.</p>")
    body = "".join(row(first, [escape(cell) for cell in rest]) for first, *rest in rows)
    return _folded(title, table(title, head, f"<tbody>{body}</tbody>", "facts"))


def _folded(title: str, content: str) -> str:
    return f"<details><summary>{title}</summary>{content}</details>"
