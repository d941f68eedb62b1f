"""Define the command sync, which brings results and the file of another device to one clock."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from anchorpose.cli.console import say
from anchorpose.options import OUTPUT, SyncSettings

if TYPE_CHECKING:
    from anchorpose.sync.synchronising import Synchronised


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
