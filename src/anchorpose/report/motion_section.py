"""Write the sections on angles and paths of joints: tables of angle ranges and joint states, charts of both sides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from markupsafe import Markup

from anchorpose.joints import JOINT_INDEX, JOINT_NAMES, STATE_CODE, JointState
from anchorpose.report.chart import Chart
from anchorpose.report.curves import Curve, Quantity, curve_row, readings, state_rows
from anchorpose.report.session import Session
from anchorpose.report.words import PERCENT, Form, figure, named_part, spaced, split_side
from anchorpose.results.tables import ANGLES_FILE, JOINTS_FILE
from anchorpose.results.uncertainty import NORMAL_95

GROUPS: Final = {
    "Knees": ("knee",),
    "Hips": ("hip",),
    "Ankles": ("ankle", "foot"),
    "Pelvis and trunk": ("pelvis", "trunk", "spine", "thorax"),
    "Arms": ("shoulder", "elbow", "wrist", "forearm"),
    "Head and neck": ("neck", "head"),
}
"""Heading of each group of angles, and the first words of its angles' names; angles that fit no group come last."""

OTHERS: Final = "Other angles"

DEGREES: Final = Quantity(label="degrees", unit="°", unit_name="deg", decimals=1, least_span=10.0)

INFERRED_STATES: Final = tuple(state for state in JointState if state not in (JointState.OBSERVED, JointState.LOST))

ANGLE_HEIGHT_PX: Final = 150
PATH_HEIGHT_PX: Final = 96

AXES: Final = {"x": "forward (X), m", "y": "up (Y), m", "z": "to the right (Z), m"}


class AngleGroup(NamedTuple):
    """The angles of one part of the body. rows: (name, cells) of each angle in its table; charts: one chart per angle,
    left and right together; for an angle without a value in any frame, a sentence instead.
    """

    heading: str
    rows: list[tuple[str, list[Markup]]]
    charts: list[Chart | str]


def angle_section(session: Session) -> list[AngleGroup]:
    """Return, for each part of the body in the order of ``GROUPS``, a table of the angles' ranges, and their charts."""
    groups = []
    for heading, bases in grouped_angles(session.angles.names).items():
        charts = [_angle_chart(session, base, names) for base, names in bases.items()]
        names = [name for sides in bases.values() for name in sides]
        groups.append(AngleGroup(heading, [(named_part(name), _range(session, name)) for name in names], charts))
    return groups


def grouped_angles(names: tuple[str, ...]) -> dict[str, dict[str, list[str]]]:
    """Return {heading: {name of an angle without its side: its names with each side}}, in the order of ``names``."""
    groups: dict[str, dict[str, list[str]]] = {heading: {} for heading in (*GROUPS, OTHERS)}
    for name in sorted(names, key=lambda name: (names.index(name), split_side(name)[1] or "")):
        base, _ = split_side(name)
        heading = next((title for title, words in GROUPS.items() if base.startswith(words)), OTHERS)
        groups[heading].setdefault(base, []).append(name)
    return {heading: bases for heading, bases in groups.items() if bases}


def _angle_chart(session: Session, base: str, names: list[str]) -> Chart | str:
    curves = [_angle_curve(session, name) for name in names]
    if not any(np.isfinite(curve.value).any() for curve in curves):
        return f"{spaced(base).capitalize()}: no value in any frame."
    labels = [split_side(name)[1] or spaced(base) for name in names]
    return Chart(
        identity=f"angle-{base}",
        title=f"{spaced(base)}, degrees over time",
        caption=spaced(base).capitalize(),
        rows=[curve_row(curves, DEGREES, session.bins, ANGLE_HEIGHT_PX), *state_rows(curves, session.bins)],
        readings=[readings(curve, DEGREES, session.bins, label) for curve, label in zip(curves, labels, strict=True)],
        sources=[ANGLES_FILE],
        bins=session.bins,
    )


def _angle_curve(session: Session, name: str) -> Curve:
    column, angles = session.angles.names.index(name), session.angles
    return Curve(
        key=name,
        side=split_side(name)[1] or "",
        value=on_shortest_arc(angles.degrees[:, column]),
        sigma=angles.sigma_deg[:, column],
        state_code=angles.state_code[:, column],
    )


def angle_figures(session: Session, name: str) -> list[Markup]:
    """Return lowest, median and highest value of an angle, shifted by ``on_shortest_arc``, as HTML."""
    degrees = on_shortest_arc(session.angles.degrees[:, session.angles.column(name)])
    known = degrees[np.isfinite(degrees)]
    return [figure(reduce(known) if len(known) else None, Form(after="°")) for reduce in (np.min, np.median, np.max)]


def state_share(state_code: np.ndarray, *states: JointState) -> float:
    """Return the share of the codes in ``state_code`` that are codes of ``states``."""
    return float(np.isin(state_code, [STATE_CODE[state] for state in states]).mean())


def _range(session: Session, name: str) -> list[Markup]:
    column = session.angles.column(name)
    sigma_deg, state_code = session.angles.sigma_deg[:, column], session.angles.state_code[:, column]
    return [
        *angle_figures(session, name),
        figure(known_median(sigma_deg), Form(decimals=1, times=NORMAL_95, before="± ", after="°")),
        figure(state_share(state_code, *INFERRED_STATES), PERCENT),
        figure(state_share(state_code, JointState.LOST), PERCENT),
    ]


def known_median(values: np.ndarray) -> float | None:
    """Return the median of the values that are not NaN; None without such values."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else None


def state_table(session: Session) -> list[tuple[str, list[Markup]]]:
    """Return (name, cells) of each joint: percentage of the frames in each state, and the joint's typical
    uncertainty.
    """
    return [(named_part(name), _joint_cells(session, JOINT_INDEX[name])) for name in JOINT_NAMES]


def _joint_cells(session: Session, joint: int) -> list[Markup]:
    percent, millimetres = Form(times=100.0, share=True), Form(times=1000.0 * NORMAL_95)
    shares = [figure(state_share(session.joints.state_code[:, joint], state), percent) for state in JointState]
    return [*shares, figure(known_median(session.joints.sigma_m[:, joint]), millimetres)]


def joint_charts(session: Session) -> list[Chart | str]:
    """Return a chart of the path of each joint, left and right together; for a joint that is lost in all frames, a
    sentence instead.
    """
    pairs: dict[str, list[str]] = {}
    for name in JOINT_NAMES:
        pairs.setdefault(split_side(name)[0], []).append(name)
    return [_path_chart(session, base, names) for base, names in pairs.items()]


def _path_chart(session: Session, base: str, names: Sequence[str]) -> Chart | str:
    if session.joints.lost[:, [JOINT_INDEX[name] for name in names]].all():
        return f"{spaced(base).capitalize()}: lost in all frames."
    rows, read = [], []
    for axis, label in AXES.items():
        quantity = Quantity(label=label, unit="m", unit_name="m", decimals=3, least_span=0.05)
        curves = [_path_curve(session, name, axis) for name in names]
        rows.append(curve_row(curves, quantity, session.bins, PATH_HEIGHT_PX))
        for curve in curves:
            text = f"{curve.side} {axis.upper()}".strip()
            read.append(readings(curve, quantity, session.bins, text, with_state=axis == "z"))
    return Chart(
        identity=f"joint-{base}",
        title=f"{spaced(base)}, path over time in metres",
        caption=spaced(base).capitalize(),
        rows=rows + state_rows([_path_curve(session, name, "x") for name in names], session.bins),
        readings=read,
        sources=[JOINTS_FILE],
        bins=session.bins,
    )


def _path_curve(session: Session, name: str, axis: str) -> Curve:
    column = JOINT_INDEX[name]
    return Curve(
        key=f"{name}_{axis}",
        side=split_side(name)[1] or "",
        value=session.joints.position_m[:, column, "xyz".index(axis)],
        sigma=session.joints.sigma_m[:, column],
        state_code=session.joints.state_code[:, column],
    )


def on_shortest_arc(degrees: np.ndarray) -> np.ndarray:
    """Shift angles by whole turns so that all of them lie on the shortest arc that holds them. degrees (n,): from -180
    to 180, NaN where unknown.

    If a patient faces in the direction opposite to the X axis, the rotation of the pelvis may be 179 degrees in one
    frame and -179 in the next: the difference is 2 degrees, not 358. After the shift, the median is from -180 to 180.
    Angles that span less than half a turn stay unchanged.
    """
    known = np.sort(degrees[np.isfinite(degrees)])
    if len(known) < 2:
        return degrees
    gaps = np.diff(known)
    widest = int(np.argmax(gaps))
    if gaps[widest] <= 360.0 - (known[-1] - known[0]):
        return degrees
    moved = np.where(degrees <= known[widest], degrees + 360.0, degrees)
    return moved - 360.0 if np.nanmedian(moved) > 180.0 else moved
