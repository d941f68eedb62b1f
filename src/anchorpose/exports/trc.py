"""TRC: marker paths as OpenSim reads them, one marker per joint, with a model and set-up files to start from."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.exports.formats import ExportConfig, Product, Source, number_text, rounded_text, write_rows
from anchorpose.exports.osim_folder import write_osim_files
from anchorpose.exports.regular_time import RegularSamples, regular_samples
from anchorpose.joints import JOINT_NAMES
from anchorpose.results.frame_time import blocks

TRC_FILE: Final = "joints.trc"

MISSING: Final = "NaN"
"""As OpenSim writes it. Its reader refuses an empty cell at the end of a line, and takes zeros for a marker at the
origin."""

MICROMETRES: Final = 6  # digits after the point, in metres


def write_trc(folder: Path, source: Source, config: ExportConfig) -> Product:
    """joints.trc, and beside it the files with which OpenSim works on it."""
    regular = regular_samples(source.samples)
    write_rows(folder / TRC_FILE, "\t", trc_head(regular), trc_body(regular))
    samples = regular.samples
    notes = write_osim_files(folder, TRC_FILE, samples, config.model)
    return Product(
        axes="OpenSim's and ours: X forward, Y up, Z to the patient's right",
        units="metres, seconds",
        time=str(regular.base),
        missing=f"{MISSING} in all three cells of a marker; OpenSim's inverse kinematics leaves such a marker out",
        counts=(
            ("frames", len(regular.time_s)),
            ("rate_hz", regular.rate_hz),
            ("recorded_frames", int(regular.interpolation.recorded.sum())),
            ("missing_markers", int(np.isnan(samples.position_m[..., 0]).sum())),
        ),
        notes=notes,
    )


def trc_head(regular: RegularSamples) -> list[list[str]]:
    """The lines before the frames."""
    rate, count = number_text(regular.rate_hz), len(regular.time_s)
    markers = range(1, len(JOINT_NAMES) + 1)
    return [
        ["PathFileType", "4", "(X/Y/Z)", TRC_FILE],
        ["DataRate", "CameraRate", "NumFrames", "NumMarkers", "Units", "OrigDataRate", "OrigDataStartFrame",
         "OrigNumFrames"],
        [rate, rate, str(count), str(len(JOINT_NAMES)), "m", rate, "1", str(count)],
        ["Frame#", "Time", *(cell for name in JOINT_NAMES for cell in (name, "", ""))],
        ["", "", *(f"{axis}{marker}" for marker in markers for axis in "XYZ")],
        [""],
    ]  # fmt: skip


def trc_body(regular: RegularSamples) -> Iterator[list[str]]:
    """One line per frame, times as recorded where they are regular."""
    for rows in blocks(len(regular.time_s)):
        samples = regular.part(rows).samples
        places = samples.position_m.reshape(len(samples.time_s), -1).tolist()
        for row, time_s, place in zip(range(rows.start, rows.stop), samples.time_s.tolist(), places, strict=True):
            yield [str(row + 1), repr(time_s), *(rounded_text(x, MICROMETRES, MISSING) for x in place)]
