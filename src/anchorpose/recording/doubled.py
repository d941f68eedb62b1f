"""Pictures that a recorder wrote twice under two times: the second shows an earlier moment than its time says."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

MOST_DOUBLED: Final = 0.5
"""Where more of the pictures are like the one before, the pictures have no noise and sameness says nothing."""


def find_doubled(files: Sequence[Path]) -> np.ndarray:
    """(n,) bool: which files hold, byte for byte, what the file before holds.

    A depth sensor's noise makes two pictures of the same thing differ, so equal files are one picture. Files of other
    sizes are not opened. All False where most files are alike: such pictures were made without noise.
    """
    sizes = [_size(file) for file in files]
    doubled = np.zeros(len(files), dtype=bool)
    for k in range(1, len(files)):
        doubled[k] = sizes[k] == sizes[k - 1] and sizes[k] > 0 and _same(files[k - 1], files[k])
    return doubled if doubled.sum() <= MOST_DOUBLED * len(files) else np.zeros(len(files), dtype=bool)


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def _same(one: Path, other: Path) -> bool:
    try:
        return one.read_bytes() == other.read_bytes()
    except OSError:
        return False  # what cannot be read is reported when its turn comes
