"""Compute the true places, in another frame, of a frame's nodes (points of the patient's surface), and the distances
along the skin from these places to matches.
"""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from anchorpose.errors import InputError
from anchorpose.recording.document import read_text
from anchorpose.research.benchmark.plan import NODES, Pair
from anchorpose.research.experiment.correspondence import Skin, TruePlaces

MOVED_M = 0.03  # m; a node counts as moved if its true places in the two frames are farther apart than this


def read_nodes(path: Path) -> np.ndarray:
    """Return the places (n, 3) of a frame's nodes, metres, world. Raises InputError if the file has another format."""
    try:
        table = np.loadtxt(StringIO(read_text(path)), delimiter=",", skiprows=1, ndmin=2)
        if table.shape[1] != 6 or not np.array_equal(table[:, 0], np.arange(len(table))):
            raise ValueError("its columns are others")
    except ValueError as error:
        raise InputError(path, f"is not a file of nodes ({error})", "make the benchmark again") from None
    places: np.ndarray = table[:, 3:]
    return places


@dataclass(frozen=True, slots=True, eq=False)
class PairTruth:
    """The true correspondence of the nodes of two frames."""

    skin: Skin
    pair: Pair
    first_m: np.ndarray  # (n, 3) nodes of the first frame, metres, world
    second_m: np.ndarray  # (k, 3) nodes of the second frame, metres, world
    # places of the first frame's nodes in the second frame; a place is hidden if no node of the second frame is near
    # it; nodes that are not on the body (flying pixels) have no place
    places: TruePlaces

    @property
    def moved(self) -> np.ndarray:
        """Return (n,) bool: nodes that move by more than ``MOVED_M`` from the first to the second frame."""
        moved: np.ndarray = np.linalg.norm(self.places.place_m - self.first_m, axis=1) > MOVED_M
        return moved

    def nearest(self) -> np.ndarray:
        """Return the best possible answer (n,) int: the second frame's node nearest to each true place, -1 if the place
        is hidden.
        """
        best, seen = np.full(len(self.first_m), -1, np.int64), self.places.seen
        best[seen] = cKDTree(self.second_m).query(self.places.place_m[seen])[1]
        return best

    def error_mm(self, match: np.ndarray) -> np.ndarray:
        """Return (n,): the distance along the skin of each match from the true place; NaN without a match, or if the
        true place is hidden or unknown.

        match (n,): node of the second frame, negative = no match. If the straight distance is greater than the distance
        along the skin, the straight distance is returned: the distance along the skin may be too short, since its ends
        are known only to the nearest vertex.
        """
        error, known = np.full(len(match), np.nan), (match >= 0) & self.places.seen
        matched = self.second_m[match[known]]
        vertex = self.skin.vertex_at(matched, self.pair.second_frame)
        along = self.skin.along_skin_m(vertex, self.places.vertex[known])
        error[known] = 1000.0 * np.maximum(along, np.linalg.norm(matched - self.places.place_m[known], axis=1))
        return error


def truth_of(group: Path, pair: Pair, skin: Skin) -> PairTruth:
    """Return the truth about a pair. group: the folder of the pair's group; skin: skin of the group's simulation."""
    first, second = (read_nodes(group / NODES / Path(name).name) for name in (pair.first, pair.second))
    places = skin.follow(first, pair.first_frame, pair.second_frame, second)
    return PairTruth(skin, pair, first, second, places)
