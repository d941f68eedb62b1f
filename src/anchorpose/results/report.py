"""report.html: one page that a clinician opens anywhere, made from the tables, run.json and the kept pictures."""

from __future__ import annotations

import base64
import html
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.body.regions import REGIONS
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.results.angles import AngleTable
from anchorpose.results.contacts import CONTACTS_FILE, SEEN, Contact, read_contacts
from anchorpose.results.folder import write_text_whole
from anchorpose.results.joint_frame import LOST, SEVERITY
from anchorpose.results.kinematics.joint_angles import joint_angles
from anchorpose.results.run_record import RUN_FILE, read_run_document
from anchorpose.results.tables import JOINTS_FILE, JointTable, read_joints
from anchorpose.results.web_page import fill_page

REPORT_FILE: Final = "report.html"

MOST_POINTS: Final = 3000
"""Frames drawn at most: more than a screen has pixels across; beyond it every k-th frame is drawn."""

STATE_TEXT: Final = {
    JointState.OBSERVED: ("seen", "#0072B2"),
    JointState.HIDDEN_BY_SELF: ("hidden by the body itself", "#56B4E9"),
    JointState.HIDDEN_BY_EQUIPMENT: ("hidden by equipment", "#E69F00"),
    JointState.HIDDEN_BY_PERSON: ("hidden by another person", "#D55E00"),
    JointState.HIDDEN: ("hidden, cause unknown", "#CC79A7"),
    JointState.OUT_OF_VIEW: ("out of view", "#F0E442"),
    JointState.LOST: ("lost", "#8A8A8A"),
}
"""What people read and the colour they see: Okabe and Ito's, told apart by colour-blind readers."""


def write_report(results: Path) -> Path:
    """Writes report.html into a results folder and returns its path; the same folder gives the same bytes.

    Raises InputError where joints.parquet or run.json cannot be used.
    """
    from plotly.offline import get_plotlyjs

    joints, run = read_joints(results / JOINTS_FILE), read_run_document(results / RUN_FILE)
    touched = results / CONTACTS_FILE
    contacts = read_contacts(touched) if touched.exists() else ()
    page = fill_page(
        "anchorpose.results",
        "report_page.html",
        f"anchorpose: {run.get('recording', results.name)}",
        summary=_summary(joints, run),
        states=_state_table(joints),
        contacts=_contact_table(contacts),
        pictures=_pictures(results, run.get("pictures", [])),
        notes=_notes(run),
        provenance=_provenance(run),
        data=json.dumps(_plot_data(joints, joint_angles(joints), contacts), separators=(",", ":"), allow_nan=False),
        plotly=get_plotlyjs(),
    )
    write_text_whole(results / REPORT_FILE, page)
    return results / REPORT_FILE


def _summary(joints: JointTable, run: dict[str, Any]) -> str:
    duration = joints.time_s[-1] - joints.time_s[0]
    cells = {
        "duration": f"{duration:.1f} s",
        "frames": f"{len(joints.frame)}",
        "frames with problems": f"{len({drop['frame'] for drop in run.get('dropped', [])})}",
        "joints seen": f"{100 * np.mean(joints.severity == SEVERITY[JointState.OBSERVED]):.1f} %",
        "joints inferred": f"{100 * np.mean((joints.severity > 0) & (joints.severity < LOST)):.1f} %",
        "joints lost": f"{100 * np.mean(joints.lost):.1f} %",
        "typical uncertainty": _millimetres(joints.sigma_m),
    }
    return "".join(f"<div><b>{html.escape(value)}</b><span>{name}</span></div>" for name, value in cells.items())


def _millimetres(sigma_m: np.ndarray) -> str:
    known = sigma_m[np.isfinite(sigma_m)]
    return f"± {1000 * np.median(known):.0f} mm" if len(known) else "none"


def _state_table(joints: JointTable) -> str:
    """One row a joint: its share of each state, and its median sigma."""
    head = "".join(f"<th><i style='background:{colour}'></i>{text}</th>" for text, colour in STATE_TEXT.values())
    rows = []
    for index, name in enumerate(JOINT_NAMES):
        shares = [100.0 * np.mean(joints.severity[:, index] == SEVERITY[state]) for state in STATE_TEXT]
        cells = "".join(f"<td>{share:.0f}</td>" if share else "<td>·</td>" for share in shares)
        rows.append(f"<tr><th>{name}</th>{cells}<td>{_millimetres(joints.sigma_m[:, index])}</td></tr>")
    return f"<thead><tr><th>joint</th>{head}<th>one sigma</th></tr></thead><tbody>{''.join(rows)}</tbody>"


def _contact_table(contacts: Sequence[Contact]) -> str:
    """One row a contact, in the order in which they began."""
    rows = [
        f"<tr><th>{_words(contact.part)}</th><td>{contact.person}</td><td>{contact.start_s:.2f}</td>"
        f"<td>{contact.end_s:.2f}</td><td>{contact.state}</td><td>{contact.area_cm2:.0f}</td></tr>"
        for contact in sorted(contacts, key=lambda contact: (contact.start_s, contact.part))
    ]
    head = "".join(f"<th>{name}</th>" for name in ("part", "by", "from (s)", "to (s)", "", "area (cm²)"))
    return f"<thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody>"


def _words(part: str) -> str:
    return part.replace("_", " ")


def _plot_contacts(contacts: Sequence[Contact]) -> list[dict[str, Any]]:
    """What the page's script draws: one bar a contact, parts from head to foot."""
    return [
        {"part": _words(c.part), "person": c.person, "from": round(c.start_s, 3), "to": round(c.end_s, 3),
         "seen": c.state == SEEN, "area": round(c.area_cm2)}
        for c in sorted(contacts, key=lambda contact: (REGIONS.index(contact.part), contact.start_s))
    ]  # fmt: skip


def _pictures(results: Path, pictures: list[dict[str, Any]]) -> str:
    figures = []
    for picture in pictures:
        path = results / picture["file"]
        if path.is_file():
            encoded = base64.b64encode(path.read_bytes()).decode("ascii")
            where = f"{picture['camera']}, frame {picture['frame']}, {picture['time_s']:.2f} s"
            caption = html.escape(f"{where}. {picture['caption']}")
            figures.append(
                f"<figure><img alt='{caption}' loading='lazy' src='data:image/png;base64,{encoded}'>"
                f"<figcaption>{caption}</figcaption></figure>"
            )
    return "".join(figures) or "<p>No pictures were kept.</p>"


def _notes(run: dict[str, Any]) -> str:
    notes = [html.escape(note) for note in run.get("notes", [])]
    for drop in run.get("dropped", [])[:50]:
        notes.append(html.escape(f"Frame {drop['frame']} ({drop['time_s']:.2f} s): {drop['why']}"))
    more = len(run.get("dropped", [])) - 50
    if more > 0:
        notes.append(f"… and {more} more frames; all are listed in run.json")
    return "".join(f"<li>{note}</li>" for note in notes) or "<li>Nothing to note.</li>"


def _provenance(run: dict[str, Any]) -> str:
    keys = ("versions", "cameras", "residuals", "timings", "config")
    texts = {key: html.escape(json.dumps(run.get(key), indent=1, ensure_ascii=False)) for key in keys}
    return "".join(f"<details><summary>{key}</summary><pre>{text}</pre></details>" for key, text in texts.items())


def _plot_data(joints: JointTable, angles: AngleTable, contacts: Sequence[Contact]) -> dict[str, Any]:
    """What the page's script draws: lengths in whole millimetres, angles in tenths of a degree, null where lost."""
    step = max(1, -(-len(joints.frame) // MOST_POINTS))
    rows = slice(None, None, step)
    return {
        "step": step,
        "time": np.round(joints.time_s[rows], 3).tolist(),
        "joints": list(JOINT_NAMES),
        "position": _scaled(joints.position_m[rows].transpose(1, 2, 0), 1000.0),
        "sigma": _scaled(joints.sigma_m[rows].T, 1000.0),
        "state": joints.severity[rows].T.tolist(),
        "angles": list(angles.names),
        "degrees": _scaled(angles.degrees[rows].T, 10.0),
        "sigmaDegrees": _scaled(angles.sigma_deg[rows].T, 10.0),
        "angleState": angles.severity[rows].T.tolist(),
        "contacts": _plot_contacts(contacts),
        "stateText": [text for text, _ in STATE_TEXT.values()],
        "stateColour": [colour for _, colour in STATE_TEXT.values()],
    }


def _scaled(values: np.ndarray, factor: float) -> list[Any]:
    """Nested lists of whole numbers, None where NaN."""
    if values.ndim > 1:
        return [_scaled(row, factor) for row in values]
    return [None if math.isnan(value) else round(value * factor) for value in values.tolist()]
