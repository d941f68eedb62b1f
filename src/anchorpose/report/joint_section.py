"""Paths of the joints: three curves each (forward, up, to the right), left and right together."""

from __future__ import annotations

from typing import Final

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES
from anchorpose.report.chart import Chart, chart_html
from anchorpose.report.curves import Curve, Quantity, curve_rows, readings, state_rows
from anchorpose.report.ledger import Rows
from anchorpose.report.session import Session
from anchorpose.report.words import escape, spaced, split_side
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
        severity=session.joints.severity[:, column],
    )
