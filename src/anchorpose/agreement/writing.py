"""Write the results of a comparison: tables as CSV, sentences for a methods section, and an HTML page."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, Final

import numpy as np
from markupsafe import Markup

from anchorpose import __version__
from anchorpose.agreement.evaluating import (
    ALL,
    AS_MEASURED,
    AXES,
    COLUMNS,
    INFERRED,
    NOT_NAMED,
    Agreement,
    Compared,
    Comparison,
    quantities,
)
from anchorpose.agreement.matching import Match
from anchorpose.agreement.reliability import csv_text
from anchorpose.agreement.statistics import LEAST_UNITS
from anchorpose.joints import JOINT_NAMES, JointState
from anchorpose.report.chart import Axis, make_axis
from anchorpose.report.words import render_page
from anchorpose.results.folder import FolderKind, check_results_path, whole_or_nothing
from anchorpose.results.frame_time import runs_of
from anchorpose.results.run_record import as_json

SHOWN_STATES: Final = (ALL, str(JointState.OBSERVED), INFERRED)

DIFFERENCE_HEAD: Final = (
    "",
    "bias (95 %)",
    "limits of agreement (95 % of each)",
    "RMSE",
    "largest",
    "CMC",
    "range, ours / theirs",
    "within 1.96 σ",
    "calibration error",
)
DISTANCE_HEAD: Final = ("", "mean, mm", "RMSE, mm", "largest, mm", "samples")


def page_text(comparison: Comparison, alignments: Sequence[Sequence[str]], methods: Sequence[str]) -> str:
    """Return the HTML page. alignments: ``alignment_sentences`` per recording; methods: ``methods_sentences``."""
    named = [f"{match.results.name} against {match.reference.path.name}" for match in comparison.matches]
    return render_page(
        "anchorpose.agreement",
        "templates/agreement.html",
        title="Agreement with another system",
        recordings=list(zip(named, alignments, strict=True)),
        notes=[note for match in comparison.matches for note in match.reference.notes],
        distance_head=DISTANCE_HEAD,
        distances=distance_rows(comparison),
        difference_head=DIFFERENCE_HEAD,
        differences=angle_rows(comparison),
        joints=[_difference_cells(row) for row in comparison.rows if row.axis in AXES and row.state == ALL],
        plots=_plots(comparison),
        methods=methods,
    )


def distance_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Return the rows of the table of distances, each a title and the cells below ``DISTANCE_HEAD``. Each joint, and
    all joints together, have a row per state in ``SHOWN_STATES``, as measured and with the offset removed.
    """
    return [
        (_title(row), [f"{row.mean_abs:.1f}", f"{row.rmse:.1f}", f"{row.largest:.0f}", str(row.samples)])
        for row in comparison.rows
        if row.axis == "distance" and row.state in SHOWN_STATES
    ]


def angle_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Return the rows of the table of angle differences, each a title and the cells below ``DIFFERENCE_HEAD``. Each
    angle has a row per state in ``SHOWN_STATES``, as measured and with the offset removed.
    """
    return [_difference_cells(row) for row in comparison.rows if row.kind != "joint" and row.state in SHOWN_STATES]


def _title(row: Agreement) -> str:
    axis = "" if row.axis in ("distance", "degrees") else f", {row.axis}"
    given = ", as the other system gives it" if row.kind == "given_angle" else ""
    removed = "" if row.offset == AS_MEASURED else ", offset removed"
    return f"{row.name.replace('_', ' ')}{axis}{given} ({row.state}{removed})"


def _difference_cells(row: Agreement) -> tuple[str, list[str]]:
    bias, limits = _number(row.bias), _span(row.lower, row.upper)
    if row.bias_low is not None:  # if the bias has an interval, the limits of agreement have intervals, too
        bias += f" ({_span(row.bias_low, row.bias_high)})"
        limits += f" ({_span(row.lower_low, row.lower_high)}; {_span(row.upper_low, row.upper_high)})"
    return _title(row), [
        f"{bias} {row.unit}",
        limits,
        _number(row.rmse),
        _number(row.largest),
        _number(row.cmc, 3),
        f"{_number(row.range_ours)} / {_number(row.range_theirs)}",
        "–" if row.coverage_95 is None else f"{100 * row.coverage_95:.0f} %",
        _number(row.calibration_error, 2),
    ]


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _span(low: float | None, high: float | None) -> str:
    return f"{_number(low)} to {_number(high)}"


def _plots(comparison: Comparison) -> list[tuple[str, list[Markup]]]:
    """Return a title and two plots per angle: differences against means, and the first recording's values over time."""
    chosen = {
        (row.kind, row.name): row
        for row in comparison.rows
        if row.kind != "joint" and row.state == ALL and row.offset == AS_MEASURED
    }
    found = []
    for quantity in quantities(comparison.matches):
        row = chosen.get((quantity.kind, quantity.name))
        if row is not None:
            series = [each for each in map(quantity.take, comparison.matches) if each is not None]
            pictures = [difference_plot(series, row), time_plot(series[0], row.name, row.unit)]
            found.append((_title(row), pictures))
    return found


class Plot:
    """The size of a picture (WIDTH, HEIGHT), and the edges of the plot area in this picture (LEFT, END, TOP, BASE), in
    units of the SVG.
    """

    WIDTH, HEIGHT = 420, 240
    LEFT, END, TOP, BASE = 52, 408, 10, 206


MOST_POINTS: Final = 400
"""Number of points to which a long recording is thinned for a plot (at most twice as many are drawn); more points would
hide each other.
"""


def difference_plot(series: Sequence[Compared], row: Agreement) -> Markup:
    """Plot the difference of both systems' values against their mean (Bland and Altman), with one point per frame of
    the thinned recording and lines at the bias and the limits of agreement.
    """
    means, differences, inferred = (np.concatenate(each) for each in zip(*map(_cloud, series), strict=True))
    lines = [value for value in (row.bias, row.lower, row.upper) if value is not None]
    across = make_axis([(means, means)], [], 1e-6)
    up = make_axis([(np.append(differences, lines), np.append(differences, lines))], [], 1e-6)
    x, y = _along(across, means), _down(up, differences)
    shapes = [
        f'<circle class="{"inferred" if hidden else "seen"}" cx="{a:.0f}" cy="{b:.0f}" r="1.6"/>'
        for a, b, hidden in zip(x, y, inferred, strict=True)
    ]
    for kind, value in (("bias", row.bias), ("limit", row.lower), ("limit", row.upper)):
        if value is not None:
            height = float(_down(up, np.array(value)))
            shapes.append(f'<path class="{kind}" d="M{Plot.LEFT} {height:.1f}H{Plot.END}"/>')
    title = f"{row.name}: ours minus theirs against the mean, {row.unit}"
    return _picture(title, across, up, "".join(shapes), (f"mean, {row.unit}", f"ours − theirs, {row.unit}"))


def time_plot(each: Compared, name: str, unit: str) -> Markup:
    """Plot this program's values, with a band of ±1.96 sigma, and the other system's values over time."""
    every = max(1, len(each.time_s) // MOST_POINTS)
    time_s, ours, theirs, sigma = (a[::every] for a in (each.time_s, each.ours, each.theirs, each.sigma))
    across = make_axis([(time_s, time_s)], [], 1.0)
    up = make_axis([(ours, ours), (theirs, theirs)], [(ours - 1.96 * sigma, ours + 1.96 * sigma)], 1e-6)
    x = _along(across, time_s)
    shapes = [
        f'<path class="sigma" d="{_band(x, _down(up, ours - 1.96 * sigma), _down(up, ours + 1.96 * sigma))}"/>',
        f'<path class="theirs" d="{_line(x, _down(up, theirs))}"/>',
        f'<path class="ours" d="{_line(x, _down(up, ours))}"/>',
    ]
    return _picture(f"{name} over time, both systems, {unit}", across, up, "".join(shapes), ("time, s", unit))


def _cloud(each: Compared) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    known = np.flatnonzero(np.isfinite(each.ours + each.theirs))
    rows = known[:: max(1, len(known) // MOST_POINTS)]
    ours, theirs = each.ours[rows], each.theirs[rows]
    return 0.5 * (ours + theirs), ours - theirs, each.state_code[rows] > 0


def _along(axis: Axis, value: np.ndarray) -> np.ndarray:
    return Plot.LEFT + (Plot.END - Plot.LEFT) * (value - axis.low) / (axis.high - axis.low)


def _down(axis: Axis, value: np.ndarray) -> np.ndarray:
    return Plot.TOP + (Plot.BASE - Plot.TOP) * np.clip((axis.high - value) / (axis.high - axis.low), -0.1, 1.1)


def _line(x: np.ndarray, y: np.ndarray) -> str:
    """Return an SVG path through the points (x, y), with a gap where y is missing."""
    return "".join("M" + "L".join(_places(x[run], y[run])) for run in runs_of(np.isfinite(y)))


def _band(x: np.ndarray, low: np.ndarray, high: np.ndarray) -> str:
    paths = []
    for run in runs_of(np.isfinite(low) & np.isfinite(high)):
        across, down = np.append(x[run], x[run][::-1]), np.append(low[run], high[run][::-1])
        paths.append("M" + "L".join(_places(across, down)) + "Z")
    return "".join(paths)


def _places(x: np.ndarray, y: np.ndarray) -> list[str]:
    return [f"{a:.1f} {b:.1f}" for a, b in zip(x, y, strict=True)]


def _picture(title: str, across: Axis, up: Axis, shapes: str, words: tuple[str, str]) -> Markup:
    left, end, top, base = Plot.LEFT, Plot.END, Plot.TOP, Plot.BASE
    ticks = [
        f'<text x="{left - 5}" y="{top + (base - top) * share + 4:.1f}" text-anchor="end">{text}</text>'
        f'<path class="grid" d="M{left} {top + (base - top) * share:.1f}H{end}"/>'
        for share, text in up.labels()
    ]
    ticks += [
        f'<text x="{end - (end - left) * share:.1f}" y="{base + 14}" text-anchor="middle">{text}</text>'
        for share, text in across.labels()
    ]
    names = (
        f'<text x="{(left + end) / 2:.0f}" y="{Plot.HEIGHT - 4}" text-anchor="middle">{words[0]}</text>'
        f'<text transform="translate(11 {(top + base) / 2:.0f}) rotate(-90)" text-anchor="middle">{words[1]}</text>'
    )
    return Markup(
        f'<svg viewBox="0 0 {Plot.WIDTH} {Plot.HEIGHT}" role="img" aria-label="{{}}">'
        f"{''.join(ticks)}{shapes}{names}</svg>"
    ).format(title)


AGREEMENT_FILE: Final = "agreement.csv"
OFFSETS_FILE: Final = "offsets.csv"
ALIGNMENT_FILE: Final = "alignment.json"
METHODS_FILE: Final = "methods.txt"
PAGE_FILE: Final = "agreement.html"
COMPARISON: Final = FolderKind(
    "a comparison", (AGREEMENT_FILE,), (AGREEMENT_FILE, OFFSETS_FILE, ALIGNMENT_FILE, METHODS_FILE, PAGE_FILE)
)

SOURCES: Final = (
    "Bland JM, Altman DG. Agreement between methods of measurement with multiple observations per individual. J "
    "Biopharm Stat 2007. doi:10.1080/10543400701329422",
    "Zou GY. Confidence interval estimation for the Bland-Altman limits of agreement with multiple observations per "
    "individual. Stat Methods Med Res 2013. doi:10.1177/0962280211402548",
    "Ferrari A, Cutti AG, Cappello A. A new formulation of the coefficient of multiple correlation to assess the "
    "similarity of waveforms measured synchronously by different motion analysis protocols. Gait Posture 2010. "
    "doi:10.1016/j.gaitpost.2009.09.009",
    "Kuleshov V, Fenner N, Ermon S. Accurate uncertainties for deep learning using calibrated regression. ICML 2018. "
    "arXiv:1807.00263",
    "Harrington ME, Zavatsky AB, Lawson SEM, Yuan Z, Theologis TN. Prediction of the hip joint centre in adults, "
    "children, and patients with cerebral palsy based on magnetic resonance imaging. J Biomech 2007. "
    "doi:10.1016/j.jbiomech.2006.02.003",
    "Gamage SSHU, Lasenby J. New least squares solutions for estimating the average centre of rotation and the axis of "
    "rotation. J Biomech 2002. doi:10.1016/S0021-9290(01)00160-9",
)


def write_comparison(folder: Path, comparison: Comparison, overwrite: bool = False) -> None:
    """Write all files of a comparison into a new folder or, with ``overwrite``, over the files of an earlier
    comparison; raises InputError if the folder may not be written, for example because it has other files
    (``check_results_path``).
    """
    check_results_path(folder, None, overwrite, COMPARISON)
    methods = methods_sentences(comparison)
    with whole_or_nothing(folder, COMPARISON.own) as work:
        _write(work / AGREEMENT_FILE, _csv(COLUMNS, map(astuple, comparison.rows)))
        _write(work / OFFSETS_FILE, _offsets(comparison))
        _write(work / ALIGNMENT_FILE, json.dumps([_alignment(match) for match in comparison.matches], indent=1) + "\n")
        _write(work / METHODS_FILE, "\n".join([*methods, "", "Sources", *SOURCES]) + "\n")
        _write(work / PAGE_FILE, page_text(comparison, [alignment_sentences(m) for m in comparison.matches], methods))


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")


def _csv(head: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    return csv_text(head, ((f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row) for row in rows))


def _offsets(comparison: Comparison) -> str:
    rows = [
        (str(match.results), name, *(1000.0 * match.placement.offset_m[joint]).tolist())
        for match in comparison.matches
        if match.placement is not None
        for joint, name in enumerate(JOINT_NAMES)
        if np.isfinite(match.placement.offset_m[joint]).all()
    ]
    return _csv(("results", "joint", "forward_mm", "up_mm", "right_mm"), rows)


def _alignment(match: Match) -> Any:
    clock, placement = match.clock, match.placement
    frame = placement and {
        "reference_to_world": placement.T_world_reference,
        "translation_sigma_mm": 1000.0 * placement.translation_sigma_m,
        "rotation_sigma_deg": placement.rotation_sigma_deg,
    }
    about = {"anchorpose": __version__, "results": match.results, "reference": match.reference.path}
    return as_json({**about, "clock": clock, "frame": frame, "understood": match.reference.notes})


def alignment_sentences(match: Match) -> list[str]:
    """Return sentences on how the clocks and frames of two recordings are related, with their uncertainty."""
    clock, placement = match.clock, match.placement
    begin, end = clock.overlap_s
    found = [
        f"The clock of {match.reference.path.name} is {clock.offset_s:.4f} s ahead (standard error "
        f"{1000 * clock.offset_sigma_s:.1f} ms) at {clock.middle_s:.1f} s and gains {1e6 * clock.drift:.0f} ± "
        f"{1e6 * clock.drift_sigma:.0f} microseconds per second; both recorded from {begin:.1f} to {end:.1f} s."
    ]
    if placement is None:
        return [*found, "It has angles only, so that no positions are compared."]
    if np.isfinite(placement.translation_sigma_m):
        found.append(
            f"Its frame was found from {len(match.reference.centres.joints)} joints; leaving one out moves it by "
            f"{1000 * placement.translation_sigma_m:.1f} mm and {placement.rotation_sigma_deg:.2f} degrees (standard "
            "error)."
        )
    else:
        found.append("Its frame was given.")
    return found


def methods_sentences(comparison: Comparison) -> list[str]:
    """Return sentences for a paper's methods section: the steps of the comparison in their order."""
    people = len(set(comparison.subjects))
    known = len(comparison.matches) == 1 or NOT_NAMED not in comparison.subjects
    who = f"{people} subject(s)" if known else "subjects whose number was not stated"
    unit = "subjects" if people >= LEAST_UNITS else "stretches of time longer than twice the errors' correlation time"
    frames = sum(len(match.joints.frame) for match in comparison.matches)
    origins = sorted({how for match in comparison.matches for how in match.reference.centres.origin if how})
    return [
        f"Markerless joint positions and angles (anchorpose {__version__}) were compared with those of another motion "
        f"capture system in {len(comparison.matches)} recording(s) of {who}, {frames} frames.",
        "Clock offset and drift were estimated from the recorded movement itself: first by cross-correlation of "
        "distances between joints, which do not depend on the frame of reference, then by robust least squares; "
        "standard errors are from a jackknife over ten stretches of the recording.",
        "The reference's frame was related to ours by a rigid transform, estimated together with one constant offset "
        "per joint in the axes of its segment, which represents the difference of the two definitions of a joint "
        "centre. Agreement is given as measured, and with these offsets removed.",
        f"Joint centres of the reference: {'; '.join(origins) or 'none'}.",
        "Bias and 95 % limits of agreement follow Bland and Altman (2007) for repeated measurements whose true value "
        f"varies, with {unit} as units of repetition, and intervals by variance estimates recovery (Zou 2013), in "
        "which differences within one correlation time count as one.",
        "Waveforms were compared by the coefficient of multiple correlation (Ferrari et al. 2010). Coverage is the "
        "share of errors within 1.96 of the stated standard deviation; expected calibration error is the mean "
        "difference between nominal and observed coverage (Kuleshov et al. 2018).",
    ]
