"""``anchorpose evaluate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

if TYPE_CHECKING:
    from anchorpose.results.evaluate import Evaluation


def evaluate(
    results: Path,
    /,
    *,
    truth: Path,
    json: Path | None = None,
    skip: Annotated[float, Parameter(name="--skip-s")] = 0.0,
) -> None:
    """Compare results with the true joints: position errors, whether the stated uncertainty is right, and which
    contacts were found.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    truth
        The truth.npz that belongs to the recording (simulated recordings have one in truth/).
    json
        Write all figures to this JSON file as well.
    skip
        Leave out this many seconds at the start.
    """
    from anchorpose.errors import AnchorposeError
    from anchorpose.results.evaluate import evaluate as evaluate_results
    from anchorpose.results.evaluation_file import write_evaluation

    if not 0.0 <= skip < float("inf"):
        raise AnchorposeError(f"--skip-s is {skip:g}; give a number of seconds, 0 or more.")
    evaluation = evaluate_results(results, truth, skip)
    if json is not None:
        write_evaluation(json, evaluation)
    print_evaluation(evaluation)


def print_evaluation(evaluation: Evaluation) -> None:
    """The figures as a table on the output."""
    from rich.console import Console
    from rich.table import Table

    from anchorpose.results.evaluation_file import (
        angle_rows,
        confidence_sentences,
        contact_rows,
        evaluation_rows,
        longest_error_sentence,
    )

    table = Table("", "mean mm", "median mm", "95 % mm", "lost %", "in 95 % band")
    table.columns[0].no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"
    for row in evaluation_rows(evaluation):
        table.add_row(*row)
    angles = Table("angle", "mean error, degrees", "95 %, degrees", "in 95 % band")
    for column in angles.columns[1:]:
        column.justify = "right"
    for row in angle_rows(evaluation):
        angles.add_row(*row)
    console = Console()
    console.print(table)
    console.print(angles)
    for sentence in (longest_error_sentence(evaluation), *confidence_sentences(evaluation)):
        console.print(sentence, highlight=False)
    drift = f"{evaluation.drift_ratio:.2f}" if evaluation.drift_ratio is not None else "unknown"
    console.print(
        f"{evaluation.matched_frames} of {evaluation.truth_frames} frames of the truth were compared; "
        f"mean error of the second half over the first: {drift}."
    )
    if evaluation.contacts is not None:
        touched = Table("contacts", "frames touched", "rightly reported %", "found %")
        for row in contact_rows(evaluation.contacts):
            touched.add_row(*row)
        console.print(touched)
