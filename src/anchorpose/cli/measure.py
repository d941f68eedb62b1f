"""``anchorpose measure``."""

from __future__ import annotations

from pathlib import Path
from typing import Literal


def measure(
    results: Path,
    /,
    *,
    smooth: Literal["none", "butterworth", "kalman"] = "none",
    cutoff: float | None = None,
    fill: Literal["none", "linear", "spline"] = "none",
    longest_gap: float | None = None,
) -> None:
    """Measure a session again: joint angles, time upright, standing up, extension, sway, symmetry and assistance.

    Reads joints.parquet and contacts.parquet of the folder and writes angles, posture, episodes and measures anew.
    These always come from the joints as they were tracked, so that sessions can be compared. With --smooth or --fill,
    angles_processed.parquet is written besides, with every row marked as measured, smoothed or filled; without, an
    older one is removed.

    Parameters
    ----------
    results
        A results folder made by 'anchorpose track'.
    smooth
        Smooth the joints before their angles are taken: 'butterworth' is the usual filter of movement laboratories,
        without delay; 'kalman' also uses how sure each joint is and bears uneven time stamps.
    cutoff
        For butterworth: faster movements than this, in Hz, are filtered away; 6 by default.
    fill
        Fill short gaps of a joint along a straight line or a curve; a longer gap stays a gap.
    longest_gap
        For --fill: the longest gap to be filled, in seconds; 0.2 by default.
    """
    from rich.console import Console
    from rich.table import Table

    from anchorpose.errors import AnchorposeError
    from anchorpose.results.measuring import measure_rows, processing_sentence, write_measured
    from anchorpose.results.processing.process import ProcessingConfig
    from anchorpose.results.stand_training.measure import MeasureConfig
    from anchorpose.settings import sentence_of

    if cutoff is not None and smooth != "butterworth":
        raise AnchorposeError("--cutoff belongs to the Butterworth filter; add --smooth butterworth.")
    if longest_gap is not None and fill == "none":
        raise AnchorposeError("--longest-gap belongs to --fill; add --fill linear or --fill spline.")
    given = {"cutoff_hz": cutoff, "longest_gap_s": longest_gap}
    try:
        settings = ProcessingConfig(
            smooth=smooth, fill=fill, **{name: value for name, value in given.items() if value is not None}
        )
    except ValueError as error:
        raise AnchorposeError(f"{sentence_of(error)}; correct --cutoff or --longest-gap.") from None
    measured = write_measured(results, settings, MeasureConfig())
    table = Table("", "value ± 95 %", "inferred", "why not")
    for row in measure_rows(measured.measures):
        table.add_row(*row)
    Console().print(table)
    print(f"Everything is in {results / 'measures.parquet'}; docs/measures.md says what each number means.")
    if measured.processed is not None:
        print(f"Processed angles are in {results / 'angles_processed.parquet'}.")
        print(processing_sentence(measured.processed.policy))
