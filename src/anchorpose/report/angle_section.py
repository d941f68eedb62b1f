"""Joint angles: a chart of each, left and right together, in the order of the body from the ground up."""

from __future__ import annotations

from typing import Final

import numpy as np

from anchorpose.report.chart import Chart, chart_html
from anchorpose.report.curves import Curve, Quantity, curve_rows, readings, state_rows
from anchorpose.report.ledger import ON_ARC, Form, Rows, Taking
from anchorpose.report.session import Session
from anchorpose.report.words import (
    COVERAGE,
    INFERRED_STATES,
    escape,
    named_part,
    on_shortest_arc,
    row,
    spaced,
    split_side,
    table,
)
from anchorpose.results.tables import ANGLES_FILE

GROUPS: Final = {
    "Knees": ("knee",),
    "Hips": ("hip",),
    "Ankles": ("ankle", "foot"),
    "Pelvis and trunk": ("pelvis", "trunk", "spine", "thorax"),
    "Arms": ("shoulder", "elbow", "wrist", "forearm"),
    "Head and neck": ("neck", "head"),
}
"""Headings, and with which words the names of their angles begin; others come last."""

OTHERS: Final = "Other angles"

DEGREES: Final = Quantity(label="degrees", unit="°", unit_name="deg", decimals=1, least_span=10.0)

RANGE: Final = tuple(how + ON_ARC for how in ("lowest", "median", "highest"))
"""What is taken of an angle's column: none of it is made up by the numbers' jump from 180 to -180."""

_RANGE_TITLES: Final = ("angle", "lowest", "median", "highest", "typical ±", "inferred", "lost", "source")


def angle_section(session: Session) -> str:
    """HTML: for each part of the body a table of ranges and the charts."""
    parts = []
    for heading, bases in grouped_angles(session.angles.names).items():
        names = [name for sides in bases.values() for name in sides]
        charts = "".join(_chart(session, base, sides) for base, sides in bases.items())
        parts.append(f"<h3>{heading}</h3>{_ranges(session, heading, names)}{charts}")
    return "".join(parts)


def grouped_angles(names: tuple[str, ...]) -> dict[str, dict[str, list[str]]]:
    """Heading to angle without its side to the angles of both sides, left first."""
    groups: dict[str, dict[str, list[str]]] = {heading: {} for heading in (*GROUPS, OTHERS)}
    for name in sorted(names, key=lambda name: (names.index(name), split_side(name)[1] or "")):
        base, _ = split_side(name)
        heading = next((title for title, words in GROUPS.items() if base.startswith(words)), OTHERS)
        groups[heading].setdefault(base, []).append(name)
    return {heading: bases for heading, bases in groups.items() if bases}


def _chart(session: Session, base: str, names: list[str]) -> str:
    curves = [_curve(session, name) for name in names]
    if not any(np.isfinite(curve.value).any() for curve in curves):
        return f"<p>{escape(spaced(base).capitalize())}: no value in any frame.</p>"
    labels = [split_side(name)[1] or spaced(base) for name in names]
    rows = curve_rows(curves, DEGREES, session.bins, 150) + state_rows(curves, session.bins)
    sources = "".join(session.ledger.link(Rows(ANGLES_FILE, (("angle", name),))) for name in names)
    chart = Chart(
        identity=f"angle-{base}",
        title=f"{spaced(base)}, degrees over time",
        caption=f"<b>{escape(spaced(base).capitalize())}</b>",
        rows=rows,
        readings=[readings(curve, DEGREES, session.bins, label) for curve, label in zip(curves, labels, strict=True)],
        source=sources,
    )
    return chart_html(chart, session.bins)


def _curve(session: Session, name: str) -> Curve:
    column, angles = session.angles.names.index(name), session.angles
    return Curve(
        key=name,
        side=split_side(name)[1] or "",
        value=on_shortest_arc(angles.degrees[:, column]),
        sigma=angles.sigma_deg[:, column],
        state_code=angles.state_code[:, column],
    )


def _ranges(session: Session, heading: str, names: list[str]) -> str:
    body = "".join(row(named_part(name), _range(session, name)) for name in names)
    return table(f"{heading}: range over the session, degrees", _RANGE_TITLES, f"<tbody>{body}</tbody>")


def _range(session: Session, name: str) -> list[str]:
    ledger, rows = session.ledger, Rows(ANGLES_FILE, (("angle", name),))
    percent = Form(times=100.0, after=" %", share=True)
    reach = Form(decimals=1, times=COVERAGE, before="± ", after="°")
    return [
        *(ledger.figure(rows, Taking(column="degrees", how=how), Form(after="°")) for how in RANGE),
        ledger.figure(rows, Taking(column="sigma_deg", how="median"), reach),
        ledger.figure(rows, Taking(column="state", how="share", among=INFERRED_STATES), percent),
        ledger.figure(rows, Taking(column="state", how="share", among=("lost",)), percent),
        ledger.link(rows),
    ]
