"""MOT: coordinates of OpenSim's models over time, in files without gaps."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import AnchorposeError
from anchorpose.exports.formats import CoordinateModel, ExportConfig, Product, Source, rounded_text, write_rows
from anchorpose.exports.opensim_coordinates import (
    SHIFTS,
    Coordinates,
    HingeAxes,
    opensim_coordinates,
    read_hinge_axes,
)
from anchorpose.exports.regular_time import near_in_time, stretch_name, stretches_of
from anchorpose.results.frame_time import blocks
from anchorpose.results.tables import POSES_FILE

STEM: Final = "motion"
DIGITS: Final = 6  # after the point: micrometres, and millionths of a degree


def write_mot(folder: Path, source: Source, config: ExportConfig) -> Product:
    """motion.mot, or one file for each stretch without a gap; raises AnchorposeError where there is no such stretch."""
    hinges = read_hinge_axes(source.folder / POSES_FILE, source.frame)
    coordinates = _coordinates(source.samples.position_m, config.model, hinges)
    stretches = stretches_of(np.isfinite(coordinates.values), near_in_time(source.samples.time_s))
    if not stretches.runs:
        raise AnchorposeError("No two frames in a row have the joints that a MOT needs; export with --to csv instead.")
    kept = tuple(name for name, keep in zip(coordinates.names, stretches.kept, strict=True) if keep)
    for number, (first, last) in enumerate(stretches.runs):
        name = stretch_name(STEM, ".mot", number, len(stretches.runs))
        values = _unwrapped(kept, coordinates.values[first:last, stretches.kept])
        write_mot_file(folder / name, source.samples.time_s[first:last], kept, values)
    frames = sum(last - first for first, last in stretches.runs)
    left_out = [name for name in coordinates.names if name not in kept]
    return Product(
        axes=f"OpenSim's coordinates of the model {config.model}; X forward, Y up, Z to the patient's right",
        units="degrees; pelvis_tx, pelvis_ty, pelvis_tz metres; seconds",
        time="as recorded",
        missing="a MOT cannot hold a gap: coordinates known in less than half of the frames are left out, and each "
        "stretch of frames without a pause in which all the others are known is a file of its own",
        counts=(("files", len(stretches.runs)), ("frames", frames), ("frames_left_out", len(source.frame) - frames)),
        notes=(
            f"Left out for want of joints: {', '.join(left_out) or 'nothing'}.",
            "hip_rotation and arm_rot are those of the learnt body (poses.parquet); they are the least certain."
            if hinges is not None
            else "hip_rotation and arm_rot cannot be had from joint centres, there is no poses.parquet: left out.",
        ),
    )


def _coordinates(position_m: np.ndarray, model: CoordinateModel, hinges: HingeAxes | None) -> Coordinates:
    """``opensim_coordinates``, some frames at a time."""
    some = [
        opensim_coordinates(position_m[rows], model, None if hinges is None else hinges.rows(rows))
        for rows in blocks(len(position_m))
    ]
    return Coordinates(some[0].names, np.concatenate([each.values for each in some]))


def _unwrapped(names: tuple[str, ...], values: np.ndarray) -> np.ndarray:
    """Values (n, c) in which no angle jumps by 360 degrees, as it would where a patient turns past -X.

    Interpolation and filters would go the long way round. Lengths stay as they are.
    """
    unwrapped = values.copy()
    for column in np.flatnonzero(~np.isin(names, SHIFTS)):  # one by one: all together take four times the memory
        unwrapped[:, column] = np.unwrap(values[:, column], period=360.0)
    return unwrapped


def write_mot_file(path: Path, time_s: np.ndarray, names: tuple[str, ...], values: np.ndarray) -> None:
    """Writes the file; values (n, c) without NaN."""
    head = [path.stem, "version=1", f"nRows={len(time_s)}", f"nColumns={len(names) + 1}", "inDegrees=yes", "endheader"]
    body = (
        [repr(float(time)), *(rounded_text(value, DIGITS, "") for value in row)]
        for rows in blocks(len(time_s))
        for time, row in zip(time_s[rows], values[rows].tolist(), strict=True)
    )
    write_rows(path, "\t", ([line] for line in head), [["time", *names]], body)
