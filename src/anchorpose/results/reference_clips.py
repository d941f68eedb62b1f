"""Collect movements from results folders and skeleton files, and write them to one file of reference movements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.motion.database import FORMAT, ReferenceClips, join_clips, read_motions, read_skeletons, write_motions
from anchorpose.recording.regular_file import read_arrays
from anchorpose.recording.writable import check_file, new_folder
from anchorpose.results.frame_time import longest_even_step_s, unbroken_runs, usual_step_s
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.results.verify import require_own

SUFFIX = ".npz"
# s, minimum duration of a clip, so that it contains a frame to be predicted and the earlier frames used for this
# prediction
SHORTEST_S: Final = 0.5
MOTIONS_MARK: Final = "format.npy"  # name of the first array in a file of movements, by which such a file is recognised


def build_motions(out: Path, sources: Sequence[Path], rate_hz: float | None, overwrite: bool) -> ReferenceClips:
    """Collect the movements of all sources, write them to the file ``out`` and return them.

    sources: results folders, skeleton files and earlier files of reference movements. rate_hz: frames per second of
    skeleton files that do not state their frame rate. Raises InputError, before anything is written, if a source cannot
    be used.
    """
    if out.suffix != SUFFIX:
        raise InputError(out, f"does not end in {SUFFIX}", f"call it {out.name}{SUFFIX}")
    check_file(out, MOTIONS_MARK, *sources)
    if out.exists() and not overwrite:
        raise InputError(out, "exists already", "choose another name, or give --overwrite to replace it")
    clips = join_clips([_read(source, rate_hz) for source in sources])
    with new_folder(out.resolve().parent, out):
        write_motions(out, clips)
    return clips


def _read(source: Path, rate_hz: float | None) -> ReferenceClips:
    if source.is_dir():
        return clips_of_results(source)
    remedy = "give results folders, skeleton files or files made by 'anchorpose motions build'"
    stored = read_arrays(source, ("format",), remedy).get("format", np.array(""))
    return read_motions(source) if str(stored) == FORMAT else read_skeletons(source, rate_hz)


def clips_of_results(folder: Path) -> ReferenceClips:
    """Return the runs of successive frames of a results folder, at least half a second long, in which no joint is lost.

    A run ends before a frame with a lost joint, and at a gap in time. Raises InputError if the folder has no usable
    joints or no run of this length.
    """
    require_own(folder, (JOINTS_FILE,))
    table = read_joints(folder / JOINTS_FILE)
    remedy = "give a result in which the patient was followed"
    if len(table.frame) < 2:
        raise InputError(folder, "has fewer than two frames", remedy)
    period_s, whole = usual_step_s(table.time_s), np.isfinite(table.position_m).all(axis=(1, 2))
    runs = unbroken_runs(whole, table.time_s, longest_even_step_s(table.time_s))
    kept = [run for run in runs if (run.stop - run.start) * period_s >= SHORTEST_S]
    if not kept:
        raise InputError(folder, f"has no {SHORTEST_S:g} s without a lost joint or a gap", remedy)
    name, used = folder.resolve().name, sum(run.stop - run.start for run in kept)
    note = f"{name}: {len(kept)} clips, {used} frames at {1.0 / period_s:.3g} Hz"
    if used < len(whole):
        note += f"; {len(whole) - used} frames with lost joints or beside gaps left out"
    return ReferenceClips(
        tuple(table.position_m[run] for run in kept),
        tuple(f"{name} from frame {table.frame[run.start]}" for run in kept),
        (1.0 / period_s,) * len(kept),
        (note,),
    )
