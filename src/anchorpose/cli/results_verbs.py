"""Verbs about a results folder: measure, export, report, verify."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say, show_table
from anchorpose.cli.settings_file import SettingsFile
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import DAY_S, FASTEST_HZ, OUTPUT, ExportConfig, between, positive

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anchorpose.results.processing import ProcessingConfig
    from anchorpose.results.verify import Fits


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MeasureOptions:
    """The options of ``anchorpose measure``."""

    smooth: Literal["none", "butterworth", "kalman"] = "none"
    """Smooth the joints before angles are computed: 'butterworth' is the usual filter of movement laboratories, without
    delay; 'kalman' also uses the uncertainty of each joint and works with uneven time stamps."""

    cutoff: Annotated[float | None, positive(FASTEST_HZ)] = None
    """For butterworth: movements faster than this, in Hz, are filtered out; 6 by default."""

    fill: Literal["none", "linear", "spline"] = "none"
    """Fill short gaps of a joint along a straight line or a curve; a longer gap stays a gap."""

    longest_gap: Annotated[float | None, between(0.0, DAY_S)] = None
    """For --fill: the longest gap to be filled, in seconds; 0.2 by default."""

    def settings(self) -> ProcessingConfig:
        """Return the settings; raises AnchorposeError where the options do not fit together."""
        from anchorpose.results.processing import ProcessingConfig
        from anchorpose.settings import sentence_of

        if self.cutoff is not None and self.smooth != "butterworth":
            raise AnchorposeError("--cutoff belongs to the Butterworth filter; add --smooth butterworth.")
        if self.longest_gap is not None and self.fill == "none":
            raise AnchorposeError("--longest-gap belongs to --fill; add --fill linear or --fill spline.")
        given = {"cutoff_hz": self.cutoff, "longest_gap_s": self.longest_gap}
        lengths = {name: value for name, value in given.items() if value is not None}
        try:
            return ProcessingConfig(smooth=self.smooth, fill=self.fill, **lengths)
        except ValueError as error:
            raise AnchorposeError(f"{sentence_of(error)}; correct --cutoff or --longest-gap.") from None


def measure(
    results: Path,
    /,
    *,
    events: Path | None = None,
    by: str = "",
    options: MeasureOptions | None = None,
    defaults: SettingsFile | None = None,
) -> None:
    """Measure a session again: joint angles, time upright, standing up, extension, sway, symmetry and assistance.

    Reads joints.parquet and contacts.parquet of the folder and replaces angles, axes, posture, episodes and measures.
    These always come from the joints as they were tracked, so that sessions can be compared. With --smooth or --fill,
    angles_processed.parquet is written as well, with every row marked as measured, smoothed or filled; without them, an
    older one is removed.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    events
        A table of the trials (events.tsv: onset, duration, trial_type and what you set or noted): every measure is then
        also given per trial and per condition. It replaces the trials that the results have; without it, these stay.
    by
        Who does this, for the log of the results that 'anchorpose verify' reads: your initials or pseudonym.
    """
    from anchorpose.cli.console import log_event
    from anchorpose.report.measure_section import measure_rows
    from anchorpose.results.folder import naming_place
    from anchorpose.results.measuring import WRITTEN, MeasureConfig, processing_sentence, write_measured
    from anchorpose.results.trial_input import read_trials_of

    given = options or MeasureOptions()
    trials, hashes = (None, {}) if events is None else read_trials_of(results, events)
    with naming_place(results):
        measured = write_measured(results, given.settings(), MeasureConfig(), trials)
    log_event(results, "measure", WRITTEN, by, {"smooth": given.smooth, "fill": given.fill, **hashes})
    show_table(("", "value ± 95 %", "inferred", "why not"), measure_rows(measured.measures))
    say(f"Everything is in {results / 'measures.parquet'}; docs/measures.md explains each number.")
    if measured.trials is not None:
        count, names = len(measured.trials.rows), ", ".join(measured.trials.conditions)
        say(f"It has them for {count} trials as well (conditions: {names}); 'anchorpose report' compares these.")
    if measured.policy is not None:
        say(f"Processed angles are in {results / 'angles_processed.parquet'}.")
        say(processing_sentence(measured.policy))


def export(
    results: Path,
    /,
    *,
    to: str,
    output: Annotated[Path | None, OUTPUT] = None,
    overwrite: bool = False,
    by: str = "",
    options: ExportConfig | None = None,
    defaults: SettingsFile | None = None,
) -> None:
    """Write results in the formats of other programs: OpenSim, C3D, Excel, R, MATLAB, Blender, BIDS.

    Each format gets a folder of its own with an export.json that describes the files: axes, units, times, and what
    stands where nothing was measured. Nothing in these files names the patient.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    to
        The formats, with commas between: trc (OpenSim markers, with a model and set-up files for inverse kinematics),
        mot (OpenSim joint coordinates), c3d, csv, bvh, bids.
    output
        The folder to write into; by default 'exports' in the results folder.
    overwrite
        Replace earlier exports of these formats.
    by
        Who does this, for the log of the results that 'anchorpose verify' reads: your initials or pseudonym.
    """
    from anchorpose.cli.console import log_event
    from anchorpose.exports.exporting import EXPORTS_FOLDER, RECORD_FILE, export_results, parse_formats

    exported = export_results(results, parse_formats(to), options or ExportConfig(), output, overwrite)
    inside = [f"{EXPORTS_FOLDER}/{folder.name}/{RECORD_FILE}" for folder, _ in exported] if output is None else []
    log_event(results, "export", inside, by, {"to": ",".join(folder.name for folder, _ in exported)})
    for folder, product in exported:
        say(f"{folder}: {product.units}; time {product.time}.")
        for note in product.notes:
            say(f"- {note}")


def report(
    results: Path,
    /,
    *others: Path,
    out: Annotated[Path | None, OUTPUT] = None,
    label: Annotated[list[str] | None, Parameter(negative=())] = None,
    date: Annotated[list[str] | None, Parameter(negative=())] = None,
    reliability: Path | None = None,
    measure: Annotated[list[str] | None, Parameter(negative=())] = None,
    reference: str = "",
    by: str = "",
    defaults: SettingsFile | None = None,
) -> None:
    """Make report.html of a results folder again, or compare several sessions of one patient on one page.

    One folder: its report.html is made from its tables and pictures; where it has trials ('anchorpose measure
    --events'), their conditions are compared. Several folders: one page with their measures side
    by side, which also shows the changes that are larger than the measurement error.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    others
        Results folders of later sessions of the same patient, in order of time.
    out
        The page to write for several sessions, for example comparison.html.
    label
        The name of a session on that page, for example --label before --label after; once for each session.
    date
        The day of a session as 2025-03-28, for trends over three sessions or more; once for each session. By default
        the labels, where all of them are dates.
    reliability
        A table that 'anchorpose reliability' wrote: smaller changes than its MDC95 are marked as not shown.
    measure
        The name of a measure to compare between conditions, as in measures.parquet; once for each. By default, the main
        measures.
    reference
        The condition that the others are compared with; by default that of the first trial.
    by
        Who makes the page of one session again, for the log that 'anchorpose verify' reads: your initials or pseudonym.
    """
    from anchorpose.cli.console import log_event
    from anchorpose.report.comparison import write_comparison
    from anchorpose.report.page import write_report

    if others:
        if out is None:
            remedy = "give the page to write their comparison to, with -o FILE.html"
            raise InputError(results, "is one of several sessions", remedy)
        if measure or reference:
            remedy = "leave out --measure and --reference: all measures are compared, with the first session"
            raise InputError(results, "is one of several sessions", remedy)
        say(f"Open {write_comparison((results, *others), out, label or (), reliability, date or ())} in a browser.")
    elif out is not None or label or date:
        remedy = "give another one to compare it with, or leave out -o, --label and --date"
        raise InputError(results, "is the only session", remedy)
    else:
        page = write_report(results, reliability, measure or (), reference)
        log_event(results, "report", (page.name,), by)
        say(f"Open {page} in a browser.")


def verify(results: Path, recording: Path | None = None, /) -> int:
    """See whether results are as they were written, and of this recording: by the hashes in run.json and log.jsonl.

    Says which tables, pictures and files of the recording were changed, who corrected what, what was measured and
    exported since and by whom, and whether program and libraries are still the same. The exit code is 0 where every
    file fits, 1 where one does not, and 2 where run.json or the log cannot be read.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording that the results are of; without it, only the results are looked at.
    """
    from anchorpose.results.verify import verify as verified

    found = verified(results, recording)
    _print_files("results", found.results)
    if found.recording is not None:
        _print_files("recording", found.recording)
    done = (event.sentence for event in found.log)
    for sentence in (*found.broken, *found.program, *found.corrected, *done):
        say(f"{sentence}.")
    say("Every file is as it was." if found.is_right else "Not every file is as it was.")
    return int(not found.is_right)


def _print_files(what: str, files: Mapping[str, Fits]) -> None:
    right = sum(fits.value == "as it was written" for fits in files.values())
    say(f"{what}: {right} of {len(files)} files are as they were.")
    for name, fits in files.items():
        if fits.value != "as it was written":
            say(f"  {name}: {fits.value}")
