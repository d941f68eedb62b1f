"""Files of reference movements: the one that ships with the package, and those that ``motions build`` makes."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from anchorpose.errors import InputError
from anchorpose.joints import JOINT_COUNT, JOINT_INDEX
from anchorpose.tracking.joint_motion import joint_database
from anchorpose.tracking.motion import MotionConfig
from anchorpose.tracking.motion_database import MotionDatabase

SHIPPED: Final = Path(__file__).parent / "data" / "motions.npz"
"""Movements of stand training by the simulator's people; made by ``tools/build_motion_database.py``."""

FORMAT: Final = "anchorpose-motions 1"
_ARRAYS: Final = ("joints_mm", "start", "names", "rate_hz", "notes")
_REMEDY: Final = "give a file made by 'anchorpose motions build'"


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceClips:
    """Movements without gaps: joints_m (n_i, 21, 3) metres, Y up, any place and heading, each with a name and a rate.

    notes: sentences on where they come from, and what of them was derived or left out.
    """

    joints_m: tuple[np.ndarray, ...]
    names: tuple[str, ...]
    rate_hz: tuple[float, ...]
    notes: tuple[str, ...] = ()

    @property
    def frame_count(self) -> int:
        """Frames of all clips."""
        return sum(len(clip) for clip in self.joints_m)


def join_clips(parts: Sequence[ReferenceClips]) -> ReferenceClips:
    """All clips in one, in order."""
    return ReferenceClips(
        tuple(clip for part in parts for clip in part.joints_m),
        tuple(name for part in parts for name in part.names),
        tuple(rate for part in parts for rate in part.rate_hz),
        tuple(note for part in parts for note in part.notes),
    )


def write_motions(path: Path, clips: ReferenceClips) -> None:
    """Writes the clips to the millimetre, each beside the origin; ``path`` is whole or as it was before."""
    root = JOINT_INDEX["SpineBase"]
    millimetres = [np.rint(1000.0 * (clip - clip[0, root])).astype(np.int16) for clip in clips.joints_m]
    partial = path.with_name(f".{path.name}.partial-{os.getpid()}")
    try:
        with partial.open("wb") as stream:
            np.savez_compressed(
                stream,
                format=np.array(FORMAT),
                joints_mm=np.concatenate(millimetres),
                start=np.cumsum([0, *(len(clip) for clip in millimetres)]),
                names=np.array(clips.names),
                rate_hz=np.array(clips.rate_hz, dtype=np.float64),
                notes=np.array(clips.notes, dtype=np.str_),
            )
        partial.replace(path)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


def read_motions(path: Path) -> ReferenceClips:
    """The clips of a file that ``write_motions`` wrote; raises InputError where it is no such file."""
    arrays = read_arrays(path, ("format", *_ARRAYS), _REMEDY)
    missing = [name for name in ("format", *_ARRAYS) if name not in arrays]
    if missing or str(arrays["format"]) != FORMAT:
        raise InputError(path, "is no file of reference movements", _REMEDY)
    joints, start, names, rate_hz, notes = (arrays[name] for name in _ARRAYS)
    fits = joints.ndim == 3 and joints.shape[1:] == (JOINT_COUNT, 3) and joints.dtype == np.int16
    if not fits or len(start) != len(names) + 1 or rate_hz.shape != names.shape or not (rate_hz > 0).all():
        raise InputError(path, "its arrays do not fit together", _REMEDY)
    if start[0] != 0 or start[-1] != len(joints) or not (np.diff(start) > 0).all():
        raise InputError(path, "its clips do not follow one another", _REMEDY)
    return ReferenceClips(
        tuple(np.split(joints / 1000.0, start[1:-1])),
        tuple(str(name) for name in names),
        tuple(float(rate) for rate in rate_hz),
        tuple(str(note) for note in notes),
    )


def load_motions(path: Path, at_hz: float, config: MotionConfig) -> MotionDatabase | None:
    """The database for a recording of ``at_hz``; None, unread, where the rule needs none. Raises InputError."""
    if not config.uses_database:
        return None
    clips = read_motions(path)
    try:
        return joint_database(clips.joints_m, clips.rate_hz, at_hz, config)
    except ValueError as error:
        raise InputError(path, f"cannot be used at {at_hz:.3g} pictures a second ({error})", _REMEDY) from None


def read_arrays(path: Path, names: Sequence[str], remedy: str) -> dict[str, Any]:
    """Those of the named arrays that an .npz file has; raises InputError where it is none."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in names if name in file.files}
    except FileNotFoundError:
        raise InputError(path, "there is no such file", "check the path") from None
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        first = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
        raise InputError(path, f"is no .npz file that can be read ({first})", remedy) from None
