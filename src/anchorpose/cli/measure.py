"""``anchorpose measure``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say, show
from anchorpose.cli.limits import DAY_S, FASTEST_HZ, between, positive
from anchorpose.errors import AnchorposeError

if TYPE_CHECKING:
    from anchorpose.results.processing import ProcessingConfig


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
        """The settings; raises AnchorposeError where the options do not fit together."""
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


def measure(results: Path, /, *, by: str = "", options: MeasureOptions | None = None) -> None:
    """Measure a session again: joint angles, time upright, standing up, extension, sway, symmetry and assistance.

    Reads joints.parquet and contacts.parquet of the folder and replaces angles, posture, episodes and measures. These
    always come from the joints as they were tracked, so that sessions can be compared. With --smooth or --fill,
    angles_processed.parquet is written as well, with every row marked as measured, smoothed or filled; without them, an
    older one is removed.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    by
        Who does this, for the log of the results that 'anchorpose verify' reads: your initials or pseudonym.
    """
    from rich.table import Table

    from anchorpose.cli.console import log_event
    from anchorpose.report.measure_section import measure_rows
    from anchorpose.results.folder import naming_place
    from anchorpose.results.measuring import WRITTEN, MeasureConfig, processing_sentence, write_measured

    given = options or MeasureOptions()
    with naming_place(results):
        measured = write_measured(results, given.settings(), MeasureConfig())
    log_event(results, "measure", WRITTEN, by, {"smooth": given.smooth, "fill": given.fill})
    table = Table("", "value ± 95 %", "inferred", "why not")
    for row in measure_rows(measured.measures):
        table.add_row(*row)
    show(table)
    say(f"Everything is in {results / 'measures.parquet'}; docs/measures.md explains each number.")
    if measured.policy is not None:
        say(f"Processed angles are in {results / 'angles_processed.parquet'}.")
        say(processing_sentence(measured.policy))
