"""States as the tables spell them, and as the numbers that say how poorly something is known."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa

from anchorpose.errors import InputError
from anchorpose.joints import STATE_CODE, JointState

_NAMES: Final = np.array([str(state) for state in JointState], dtype=object)
_CODE_OF: Final = {str(state): rank for state, rank in STATE_CODE.items()}


def state_names(state_code: np.ndarray) -> np.ndarray:
    """The names, of the shape of ``state_code``, whose values are indices into ``JointState``."""
    names: np.ndarray = _NAMES[state_code]
    return names


def state_codes(path: Path, column: pa.ChunkedArray) -> np.ndarray:
    """(n,) int8 of a column of states; raises InputError where one is unknown."""
    encoded = column.combine_chunks().dictionary_encode()
    states = encoded.dictionary.to_pylist()
    for state in states:
        if state not in _CODE_OF:
            raise InputError(path, f"holds the unknown state '{state}'", "run 'anchorpose measure' on its folder again")
    ranks = np.array([_CODE_OF[state] for state in states], dtype=np.int8)
    return ranks[encoded.indices.to_numpy()]
