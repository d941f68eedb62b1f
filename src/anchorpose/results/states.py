"""States as the tables spell them, and as the numbers that say how poorly something is known."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.joints import JointState
from anchorpose.results.joint_frame import SEVERITY

_NAMES: Final = np.array([str(state) for state in JointState], dtype=object)
_SEVERITY_OF: Final = {str(state): rank for state, rank in SEVERITY.items()}


def state_names(severity: np.ndarray) -> np.ndarray:
    """The names, of the shape of ``severity``, whose values are indices into ``JointState``."""
    names: np.ndarray = _NAMES[severity]
    return names


def state_severity(path: Path, column: pa.ChunkedArray) -> np.ndarray:
    """(n,) int8 of a column of states; raises InputError where one is unknown."""
    encoded = column.combine_chunks().dictionary_encode()
    states = encoded.dictionary.to_pylist()
    for state in states:
        if state not in _SEVERITY_OF:
            raise InputError(path, f"holds the unknown state '{state}'", "run 'anchorpose measure' on its folder again")
    ranks = np.array([_SEVERITY_OF[state] for state in states], dtype=np.int8)
    return ranks[encoded.indices.to_numpy()]
