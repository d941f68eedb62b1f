"""Define the commands that compare results: with the truth, with another system, or with each other."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from cyclopts import Parameter

from anchorpose.cli.console import say, show_table
from anchorpose.cli.settings_file import SettingsFile
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import DAY_S, OUTPUT, ReferenceSettings, between

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anchorpose.agreement.evaluating import Comparison
    from anchorpose.agreement.image_labels import ImageErrors
    from anchorpose.agreement.reliability import Reliability
    from anchorpose.results.evaluate import Evaluation


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ReferenceOptions:
    """The options of ``anchorpose evaluate`` for another motion capture system, and for labels in images."""

    reference: list[Path] | None = None
    """A file of another system with markers, joint centres or angles: .c3d, .trc, .csv, .mot or .sto. Give the option
    once for each results folder. Clock and position of the other system are found from the movement."""

    output: Annotated[Path | None, OUTPUT] = None
    """With --reference: the folder to write tables, agreement.html and methods.txt (a text for publications) to."""

    overwrite: bool = False
    """Replace an earlier comparison in that folder."""

    subject: list[str] | None = None
    """With --reference: the name of the person recorded. Give the option once for each results folder; by default all
    folders count as recordings of one person."""

    labels: Path | None = None
    """A CSV of joints labelled in depth images, with the columns camera,frame,joint,u,v (u: column, v: row of the
    pixel). It needs --recording."""

    recording: Path | None = None
    """With --labels: the recording folder."""


OPTIONS_OF: Final = {
    "truth": ("json", "skip_s"),
    "reference": ("output", "overwrite", "subject", *(field.name for field in fields(ReferenceSettings))),
    "labels": ("recording",),
}
"""The options that belong to each of --truth, --reference and --labels."""


def evaluate(
    results: Path,
    /,
    *others: Path,
    truth: Path | None = None,
    json: Path | None = None,
    skip: Annotated[float, Parameter(name="--skip-s"), between(0.0, DAY_S)] = 0.0,
    options: ReferenceOptions | None = None,
    reading: ReferenceSettings | None = None,
    defaults: SettingsFile | None = None,
) -> None:
    """Compare results with the true joints, with another motion capture system, or with labels in images.

    Give one of --truth, --reference and --labels. With --truth, the command prints position errors, whether the stated
    uncertainty is right, and which contacts were found. With --reference, it prints bias, limits of agreement and more
    for joints and angles.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    others
        With --reference: further results folders; all of them are compared together.
    truth
        The file truth.npz that belongs to the recording (simulated recordings have it in truth/).
    json
        With --truth: also write all figures to this JSON file.
    skip
        With --truth: leave out this many seconds at the start.
    """
    chosen, settings = options or ReferenceOptions(), reading or ReferenceSettings()
    given = [name for name in ("reference", "labels") if getattr(chosen, name)] + (["truth"] if truth else [])
    if len(given) != 1:
        raise InputError(results, "can be compared with one thing at a time", "give --truth, --reference or --labels")
    if given != ["reference"] and others:
        raise InputError(others[0], "is a second results folder", "give several folders with --reference only")
    _require_own_options(given[0], {"json": json, "skip_s": skip, **vars(chosen), **vars(settings)})
    if truth is not None:
        _with_truth(results, truth, json, skip)
    elif chosen.labels is not None:
        _with_labels(results, chosen.labels, chosen.recording)
    else:
        _with_reference((results, *others), chosen, settings)


def _require_own_options(mode: str, values: dict[str, Any]) -> None:
    """Raise AnchorposeError if an option has been given that does not belong to ``mode``, a key of OPTIONS_OF.

    values: the value of each option by its name.
    """
    defaults = {"json": None, "skip_s": 0.0, **vars(ReferenceOptions()), **vars(ReferenceSettings())}
    for other, names in OPTIONS_OF.items():
        for name in names:
            if other != mode and values[name] != defaults[name]:
                raise AnchorposeError(f"--{name.replace('_', '-')} belongs to --{other}; leave it out.")


def _with_reference(results: tuple[Path, ...], options: ReferenceOptions, reading: ReferenceSettings) -> None:
    from anchorpose.agreement.evaluating import compare_with_reference
    from anchorpose.agreement.writing import COMPARISON, write_comparison
    from anchorpose.recording.writable import check_place
    from anchorpose.results.folder import check_results_path

    if options.overwrite and options.output is None:
        raise AnchorposeError("--overwrite belongs to --output; leave it out, or add --output FOLDER.")
    if options.output is not None:
        check_place(options.output, *results, *(options.reference or []))
        check_results_path(options.output, None, options.overwrite, COMPARISON)
    comparison = compare_with_reference(results, options.reference or [], options.subject or [], reading)
    if options.output is not None:
        write_comparison(options.output, comparison, options.overwrite)
    print_comparison(comparison)
    if options.output is not None:
        say(f"Open {options.output / 'agreement.html'} in a browser; the tables and methods.txt are beside it.")


def _with_labels(results: Path, labels: Path, recording: Path | None) -> None:
    from anchorpose.agreement.image_labels import evaluate_labels

    if recording is None:
        raise InputError(labels, "needs the cameras of the recording", "add --recording FOLDER")
    print_image_errors(evaluate_labels(results, recording, labels))


def print_comparison(comparison: Comparison) -> None:
    """Print how the recordings were aligned, and the main figures as tables."""
    from anchorpose.agreement.writing import (
        DIFFERENCE_HEAD,
        DISTANCE_HEAD,
        alignment_sentences,
        angle_rows,
        distance_rows,
    )

    for match in comparison.matches:
        for sentence in alignment_sentences(match):
            say(sentence)
    for head, rows in ((DISTANCE_HEAD, distance_rows(comparison)), (DIFFERENCE_HEAD, angle_rows(comparison))):
        if rows:
            show_table(head, ((title, *cells) for title, cells in rows))


def print_image_errors(errors: tuple[ImageErrors, ...]) -> None:
    """Print a table of the errors, with one row per joint and a last row for all joints."""
    rows = list[list[str]]()
    for row in errors:
        lengths = (row.median_px, row.median_mm, row.p95_mm)
        shares = [None if share is None else 100 * share for share in (row.within_50, row.within_100)]
        cells = ["–" if number is None else f"{number:.1f}" for number in (*lengths, *shares)]
        rows.append([row.name, str(row.labelled), str(row.lost), *cells])
    head = ("", "labels", "lost", "median px", "median mm", "95 % mm", "within 50 mm %", "within 100 mm %")
    show_table(head, rows)


def _with_truth(results: Path, truth: Path, json: Path | None, skip: float) -> None:
    from anchorpose.recording.writable import check_file, new_folder
    from anchorpose.results.evaluate import evaluate as evaluate_results
    from anchorpose.results.evaluation_file import MARK, write_evaluation

    if json is not None:
        check_file(json, MARK, results, truth)
    evaluation = evaluate_results(results, truth, skip)
    if json is not None:
        with new_folder(json.resolve().parent, json):
            write_evaluation(json, evaluation)
    print_evaluation(evaluation)


def print_evaluation(evaluation: Evaluation) -> None:
    """Print the figures of an evaluation as tables and sentences."""
    from anchorpose.results.evaluation_file import (
        angle_rows,
        compared_sentence,
        confidence_sentences,
        contact_rows,
        evaluation_rows,
        event_rows,
        independence_sentence,
        longest_error_sentence,
    )

    errors = ("", "mean mm", "median mm", "95 % mm", "lost %", "in 95 % band")
    show_table(errors, evaluation_rows(evaluation), numbers=True)
    degrees = ("angle", "mean error, degrees", "95 %, degrees", "in 95 % band")
    show_table(degrees, angle_rows(evaluation), numbers=True)
    drift = f"{evaluation.drift_ratio:.2f}" if evaluation.drift_ratio is not None else "unknown"
    for sentence in (
        compared_sentence(evaluation),
        longest_error_sentence(evaluation),
        *confidence_sentences(evaluation),
        f"Mean error of the second half over the first: {drift}.",
    ):
        say(sentence)
    contacts = contact_rows(evaluation)
    if contacts:
        show_table(("contacts with", "part", "frames touched", "rightly reported %", "found %"), contacts)
    events, independence = event_rows(evaluation), independence_sentence(evaluation)
    if events:
        show_table(("event", "true", "found", "onset within 0.1 s", "false", "onset late, s"), events, numbers=True)
    if independence:
        say(independence)


def reliability(sessions: Path, /, *others: Path, out: Annotated[Path | None, OUTPUT] = None) -> None:
    """Report how well measures repeat from session to session, and how large a change must be to mean something.

    For every measure, this prints the intraclass correlations ICC(2,1) and ICC(3,1) with intervals, the standard error
    of measurement (SEM), and the minimal detectable change (MDC95). With the score files of two or more raters, it
    prints how well the raters agree.

    Parameters
    ----------
    sessions
        A CSV with the columns subject, session (or rater, or device) and results (a results folder, relative to the
        folder of this file); in place of results, it may have measure and value. Or a file with the scores of a rater,
        which 'anchorpose view --rate' wrote.
    others
        Files with scores of other raters and of further sessions, one file per rater and session.
    out
        Also write all figures to this CSV file; 'anchorpose report --reliability' reads it.
    """
    from anchorpose.agreement.reliability import HEAD, rater_agreement, reliability_text, session_reliability
    from anchorpose.recording.writable import check_file, new_folder
    from anchorpose.results.folder import write_text_whole

    if out is not None:
        check_file(out, HEAD, sessions, *others)
    agreement = rater_agreement((sessions, *others)) if others else None
    rows = session_reliability(sessions) if agreement is None else (agreement.reliability,)
    if out is not None:
        with new_folder(out.resolve().parent, out):
            write_text_whole(out, reliability_text(rows))
    if agreement is not None:
        without = f"; {agreement.left_out} trials without a score of every rater are left out"
        say(f"Raters: {', '.join(agreement.raters)}{without if agreement.left_out else ''}.")
    _print_reliability(rows)


def _print_reliability(rows: Sequence[Reliability]) -> None:
    cells_of = list[list[str]]()
    for row in rows:
        name = row.measure if row.side is None else f"{row.measure}, {row.side}"
        cells = [
            "–" if value is None else f"{value:.2f} ({low:.2f} to {high:.2f})"
            for value, low, high in (
                (row.icc_2_1, row.icc_2_1_low, row.icc_2_1_high),
                (row.icc_3_1, row.icc_3_1_low, row.icc_3_1_high),
            )
        ]
        errors = ["–" if value is None else f"{value:.3g}" for value in (row.sem, row.mdc95)]
        cells_of.append([name, f"{row.subjects} × {row.repeats}", *cells, *errors, row.unit, row.why or ""])
    show_table(("measure", "n", "ICC(2,1)", "ICC(3,1)", "SEM", "MDC95", "unit", "why not"), cells_of)
