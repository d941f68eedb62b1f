"""Define the commands that read a results folder: measure, export, report, verify, sync."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import log_event, say, show_table
from anchorpose.cli.settings_file import SettingsFile
from anchorpose.errors import AnchorposeError, InputError
from anchorpose.options import DAY_S, FASTEST_HZ, OUTPUT, ExportConfig, SyncSettings, between, positive

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anchorpose.results.processing import ProcessingConfig
    from anchorpose.results.verify import Fits
    from anchorpose.sync.synchronising import Synchronised


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class MeasureOptions:
    """The options of ``anchorpose measure``."""

    smooth: Literal["none", "butterworth", "kalman"] = "none"
    """The filter that smooths joints before angles are computed. 'butterworth' is the usual filter of movement
    laboratories, without delay. 'kalman' also uses each joint's uncertainty and works with uneven time stamps."""

    cutoff: Annotated[float | None, positive(FASTEST_HZ)] = None
    """With butterworth: the frequency in Hz above which movements are filtered out; 6 by default."""

    fill: Literal["none", "linear", "spline"] = "none"
    """Fill short gaps of a joint along a straight line or a curve; longer gaps stay gaps."""

    longest_gap: Annotated[float | None, between(0.0, DAY_S)] = None
    """With --fill: the longest gap that is filled, in seconds; 0.2 by default."""

    def settings(self) -> ProcessingConfig:
        """Return the settings of smoothing and filling; raises AnchorposeError if the options contradict each other."""
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

    The command reads joints.parquet and contacts.parquet and replaces angles, axes, posture, episodes and measures.
    These files are always computed from the joints as tracked, without smoothing or filling, so that sessions can be
    compared. With --smooth or --fill, the command also writes angles_processed.parquet, with every row marked as
    measured, smoothed or filled; without these options, an older file of this name is removed.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    events
        A table of the trials (events.tsv: onset, duration, trial_type and your own columns): every measure is then also
        computed per trial and per condition. The table replaces trials of the results; without it, these stay.
    by
        Your initials or pseudonym, for the log of the results that 'anchorpose verify' reads.
    """
    from anchorpose.report.measure_section import measure_rows
    from anchorpose.results.folder import naming_place
    from anchorpose.results.measuring import MeasureConfig, processing_sentence, write_measured
    from anchorpose.results.trial_table import read_trials_of
    from anchorpose.results.verify import MEASURED

    given = options or MeasureOptions()
    trials, hashes = (None, {}) if events is None else read_trials_of(results, events)
    with naming_place(results):
        measured = write_measured(results, given.settings(), MeasureConfig(), trials)
    log_event(results, "measure", MEASURED, by, {"smooth": given.smooth, "fill": given.fill, **hashes})
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

    Each format gets a separate folder with an export.json that describes the files: axes, units, times, and the form of
    missing values. Nothing in these files names the patient.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    to
        The formats, separated by commas: trc (OpenSim markers, with a model and set-up files for inverse kinematics),
        mot (OpenSim joint coordinates), c3d, csv, bvh, bids.
    output
        The folder to write into; by default 'exports' in the results folder.
    overwrite
        Replace earlier exports of these formats.
    by
        Your initials or pseudonym, for the log of the results that 'anchorpose verify' reads.
    """
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
    label: list[str] | None = None,
    date: list[str] | None = None,
    reliability: Path | None = None,
    measure: list[str] | None = None,
    reference: str = "",
    by: str = "",
    defaults: SettingsFile | None = None,
) -> None:
    """Make report.html of a results folder again, or compare several sessions of one patient on one page.

    With one folder, its report.html is made from its tables and pictures; if it has trials ('anchorpose measure
    --events'), their conditions are compared. With several folders, one page shows their measures side by side, and
    which changes are larger than the measurement error.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    others
        Results folders of later sessions of the same patient, in order of time.
    out
        The page to write for several sessions, for example comparison.html.
    label
        The name of a session on that page, for example --label before --label after; give it once for each session.
    date
        The day of a session as 2025-03-28, for trends over three or more sessions; give it once for each session. By
        default the labels are used, if all of them are dates.
    reliability
        A table that 'anchorpose reliability' wrote: changes below its MDC95 are marked as not shown.
    measure
        The name of a measure to compare between conditions, as in measures.parquet; give it once for each measure. By
        default the main measures are compared.
    reference
        The condition with which the others are compared; by default that of the first trial.
    by
        With one session: your initials or pseudonym, for the log that 'anchorpose verify' reads.
    """
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
    """Check by the hashes in run.json and log.jsonl that results are unchanged and were made from this recording.

    The command lists changed tables, pictures and files of the recording, who corrected what, what was measured and
    exported since and by whom, and whether program and libraries are still the same. The exit code is 0 if all files
    match, 1 if any file differs, and 2 if run.json or the log cannot be read.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    recording
        The recording from which the results were made; without it, only the results are checked.
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


def sync(
    results: Path,
    other: Path,
    /,
    *,
    output: Annotated[Path, OUTPUT],
    overwrite: bool = False,
    settings: SyncSettings | None = None,
) -> None:
    """Bring the file of another device, such as EMG or an accelerometer, to one clock with the results.

    The clocks are compared by the movement of a part of the body that carries a sensor, by pulses that both recorded,
    or by the stamps of the Lab Streaming Layer. The folder OUTPUT then has the offset and drift of the other clock with
    their uncertainty, joints and events on that clock, and the other device's signals at the joints' times.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    other
        The other file: XDF, EDF, BDF, or a CSV with a line of names, a column time_s (s) and a column per signal.
    output
        The folder to write.
    overwrite
        Replace an earlier synchronisation in that folder.
    """
    from anchorpose.recording.writable import check_place
    from anchorpose.results.folder import check_results_path
    from anchorpose.sync.synchronising import synchronise
    from anchorpose.sync.writing import SYNC, write_sync

    check_place(output, results, other)
    check_results_path(output, None, overwrite, SYNC)
    found = synchronise(results, other, settings or SyncSettings())
    write_sync(output, found, overwrite)
    print_clock(found)
    say(f"Clock, joints, events and signals are in {output}.")


def print_clock(found: Synchronised) -> None:
    """Print how the clocks differ, and the notes for the user."""
    clock = found.clock
    say(f"Compared: {found.compared}.")
    offset_ms, gain_ms = 1.96e3 * clock.offset_sigma_s, 1.96e6 * clock.drift_sigma
    say(
        f"The other clock is {clock.offset_s:.4f} s ± {offset_ms:.0f} ms (95 %) ahead at {clock.middle_s:.1f} s, and "
        f"gains {1e6 * clock.drift:.0f} ± {gain_ms:.0f} ms in 1000 s."
    )
    for note in found.notes:
        say(f"{note}.")
