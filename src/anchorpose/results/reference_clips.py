"""Joints of an earlier run as reference movements for the next ones."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.results.tables import JOINTS_FILE, read_joints
from anchorpose.tracking.motion_file import ReferenceClips

SHORTEST_S: Final = 0.5  # a history, what it is checked on and a step into the future, at 30 Hz
_GAP: Final = 1.5  # periods between two frames: beyond, one is missing


def clips_of_results(folder: Path) -> ReferenceClips:
    """The pieces of a results folder in which every joint of every frame has a place, half a second or longer.

    Frames with a lost joint and gaps in time cut them. Raises InputError where the table cannot be used or nothing is
    left.
    """
    table = read_joints(folder / JOINTS_FILE)
    remedy = "give a result in which the patient was followed"
    if len(table.frame) < 2 or not (np.diff(table.time_s) > 0).all():
        raise InputError(folder, "has fewer than two frames, or times that do not increase", remedy)
    period_s = float(np.median(np.diff(table.time_s)))
    whole = np.isfinite(table.position_m).all(axis=(1, 2))
    broken = ~whole[1:] | ~whole[:-1] | (np.diff(table.time_s) > _GAP * period_s)
    pieces = np.split(np.arange(len(whole)), np.flatnonzero(broken) + 1)
    kept = [piece for piece in pieces if whole[piece].all() and len(piece) * period_s >= SHORTEST_S]
    if not kept:
        raise InputError(folder, f"has no {SHORTEST_S:g} s without a lost joint or a gap", remedy)
    name, used = folder.resolve().name, sum(len(piece) for piece in kept)
    note = f"{name}: {len(kept)} clips, {used} frames at {1.0 / period_s:.3g} Hz"
    if used < len(whole):
        note += f"; {len(whole) - used} frames with lost joints or beside gaps left out"
    return ReferenceClips(
        tuple(table.position_m[piece] for piece in kept),
        tuple(f"{name} from frame {table.frame[piece[0]]}" for piece in kept),
        (1.0 / period_s,) * len(kept),
        (note,),
    )
