"""agreement.html: the main numbers of a comparison, their plots, and how they were found."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from markupsafe import Markup

from anchorpose.agreement.evaluating import Comparison
from anchorpose.agreement.plots import difference_plot, time_plot
from anchorpose.agreement.rows import ALL, AS_MEASURED, INFERRED, Agreement, quantities
from anchorpose.joints import JointState
from anchorpose.results.web_page import render_page

SHOWN_STATES: Final = (ALL, str(JointState.OBSERVED), INFERRED)

DIFFERENCE_HEAD: Final = (
    "", "bias (95 %)", "limits of agreement (95 % of each)", "RMSE", "largest", "CMC", "range, ours / theirs",
    "within 1.96 σ", "calibration error",
)  # fmt: skip
DISTANCE_HEAD: Final = ("", "mean, mm", "RMSE, mm", "largest, mm", "samples")


def page_text(comparison: Comparison, alignments: Sequence[Sequence[str]], methods: Sequence[str]) -> str:
    """The page; alignments: sentences per recording."""
    rows = comparison.rows
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
        joints=[_difference_cells(row) for row in rows if _joint_row(row)],
        plots=_plots(comparison),
        methods=methods,
    )


def distance_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """(title, cells of ``DISTANCE_HEAD``) of joints and of all of them."""
    return [_distance_cells(row) for row in comparison.rows if row.axis == "distance" and row.state in SHOWN_STATES]


def angle_rows(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """(title, cells of ``DIFFERENCE_HEAD``) of angles."""
    return [_difference_cells(row) for row in comparison.rows if row.kind != "joint" and row.state in SHOWN_STATES]


def _joint_row(row: Agreement) -> bool:
    return row.kind == "joint" and row.axis != "distance" and row.state == ALL


def _title(row: Agreement) -> str:
    axis = "" if row.axis in ("distance", "degrees") else f", {row.axis}"
    given = ", as the other system gives it" if row.kind == "given_angle" else ""
    removed = "" if row.offset == AS_MEASURED else ", offset removed"
    return f"{row.name.replace('_', ' ')}{axis}{given} ({row.state}{removed})"


def _distance_cells(row: Agreement) -> tuple[str, list[str]]:
    return _title(row), [f"{row.mean_abs:.1f}", f"{row.rmse:.1f}", f"{row.largest:.0f}", str(row.samples)]


def _difference_cells(row: Agreement) -> tuple[str, list[str]]:
    limits = f"{_number(row.lower)} to {_number(row.upper)}"
    if row.lower_low is not None:
        limits += (
            f" ({_number(row.lower_low)} to {_number(row.lower_high)}; "
            f"{_number(row.upper_low)} to {_number(row.upper_high)})"
        )
    bias = _number(row.bias)
    if row.bias_low is not None:
        bias += f" ({_number(row.bias_low)} to {_number(row.bias_high)})"
    return _title(row), [
        f"{bias} {row.unit}", limits, _number(row.rmse), _number(row.largest), _number(row.cmc, 3),
        f"{_number(row.range_ours)} / {_number(row.range_theirs)}",
        "–" if row.coverage_95 is None else f"{100 * row.coverage_95:.0f} %", _number(row.calibration_error, 2),
    ]  # fmt: skip


def _number(value: float | None, digits: int = 1) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _plots(comparison: Comparison) -> list[tuple[str, list[Markup]]]:
    """Of each angle: differences against means of all recordings, and the first recording over time."""
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
