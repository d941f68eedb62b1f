"""``anchorpose export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from anchorpose.cli.console import say
from anchorpose.errors import AnchorposeError

if TYPE_CHECKING:
    from anchorpose.exports.formats import ExportConfig


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class ExportOptions:
    """The options of ``anchorpose export`` that only some formats use."""

    subject: str = "01"
    """Pseudonym of the patient for bids, letters and digits only."""

    session: str | None = None
    """Label of the session for bids, letters and digits only; left out by default."""

    task: str = "standing"
    """What the patient did, for bids; letters and digits only."""

    model: Literal["rajagopal", "gait2392"] = "rajagopal"
    """Whose signs mot and model.osim follow: rajagopal (a bent knee is positive) or gait2392 (negative)."""

    def settings(self) -> ExportConfig:
        """The settings; raises AnchorposeError for a label that BIDS does not allow."""
        from anchorpose.exports.formats import CoordinateModel, ExportConfig
        from anchorpose.settings import sentence_of

        try:
            return ExportConfig(
                subject=self.subject.removeprefix("sub-"),
                session=None if self.session is None else self.session.removeprefix("ses-"),
                task=self.task.removeprefix("task-"),
                model=CoordinateModel(self.model),
            )
        except ValueError as error:
            raise AnchorposeError(f"--{sentence_of(error)}.") from None


def export(
    results: Path,
    /,
    *,
    to: str,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    overwrite: bool = False,
    by: str = "",
    options: ExportOptions | None = None,
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

    settings = (options or ExportOptions()).settings()
    exported = export_results(results, parse_formats(to), settings, output, overwrite)
    inside = [f"{EXPORTS_FOLDER}/{folder.name}/{RECORD_FILE}" for folder, _ in exported] if output is None else []
    log_event(results, "export", inside, by, {"to": ",".join(folder.name for folder, _ in exported)})
    for folder, product in exported:
        say(f"{folder}: {product.units}; time {product.time}.")
        for note in product.notes:
            say(f"- {note}")
