"""``anchorpose export``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from anchorpose.errors import AnchorposeError


def export(
    results: Path,
    /,
    *,
    to: str,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    overwrite: bool = False,
    subject: str = "01",
    session: str | None = None,
    task: str = "standing",
    model: Literal["rajagopal", "gait2392"] = "rajagopal",
) -> None:
    """Write results in the formats of other programs: OpenSim, C3D, Excel, R, MATLAB, Blender, BIDS.

    Each format gets a folder of its own with an export.json that says what was done: axes, units, times, and what
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
    subject
        Pseudonym of the patient for bids, letters and digits only.
    session
        Label of the session for bids, letters and digits only; left out by default.
    task
        What the patient did, for bids; letters and digits only.
    model
        Whose signs mot and model.osim follow: rajagopal (a bent knee is positive) or gait2392 (negative).
    """
    from anchorpose.exports.product import CoordinateModel, ExportConfig
    from anchorpose.exports.run import export_results, parse_formats

    try:
        config = ExportConfig(
            subject=subject.removeprefix("sub-"),
            session=None if session is None else session.removeprefix("ses-"),
            task=task.removeprefix("task-"),
            model=CoordinateModel(model),
        )
    except ValueError as error:
        raise AnchorposeError(f"--{error}.") from None
    for folder, product in export_results(results, parse_formats(to), config, output, overwrite):
        print(f"{folder}: {product.units}; time {product.time}.")
        for note in product.notes:
            print(f"- {note}")
