"""From results folders and skeleton files to one file of reference movements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from anchorpose.errors import InputError
from anchorpose.results.reference_clips import clips_of_results
from anchorpose.tracking.motion_file import (
    FORMAT,
    ReferenceClips,
    join_clips,
    read_arrays,
    read_motions,
    read_skeletons,
    write_motions,
)

SUFFIX = ".npz"


def build_motions(out: Path, sources: Sequence[Path], rate_hz: float | None, overwrite: bool) -> ReferenceClips:
    """Write the movements of all sources to ``out`` and return them.

    sources: results folders, skeleton files and earlier files of reference movements. rate_hz: frames per second of
    skeleton files that do not state it. Raises InputError before anything is written where one cannot be used.
    """
    if out.suffix != SUFFIX:
        raise InputError(out, f"does not end in {SUFFIX}", f"call it {out.name}{SUFFIX}")
    if any(source.resolve() == out.resolve() for source in sources):
        raise InputError(out, "is one of the sources", "choose another name")
    if out.exists() and not overwrite:
        raise InputError(out, "exists already", "choose another name, or give --overwrite to replace it")
    clips = join_clips([_read(source, rate_hz) for source in sources])
    out.parent.mkdir(parents=True, exist_ok=True)
    write_motions(out, clips)
    return clips


def _read(source: Path, rate_hz: float | None) -> ReferenceClips:
    if source.is_dir():
        return clips_of_results(source)
    remedy = "give results folders, skeleton files or files made by 'anchorpose motions build'"
    stored = read_arrays(source, ("format",), remedy).get("format", np.array(""))
    return read_motions(source) if str(stored) == FORMAT else read_skeletons(source, rate_hz)
