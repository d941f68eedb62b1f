"""What the framework does by itself: a method that is no better than these has not helped."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import KDTree

from anchorpose.association.hypotheses import Matcher
from anchorpose.research.experiment.method import NO_SUBSET, Family, Method
from anchorpose.tracker.association import Associate
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation


def _nobody(setting: Any) -> Associate:
    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        def find(nodes: np.ndarray) -> np.ndarray:
            return np.full((len(nodes), 1), -1, np.int32)

        return Matcher(find, len(now.surface), NO_SUBSET)

    return pair


def _nearest(setting: Any) -> Associate:
    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        def find(nodes: np.ndarray) -> np.ndarray:
            if len(following.surface) == 0:
                return np.full((len(nodes), 1), -1, np.int32)
            nearest = KDTree(following.surface.points_m).query(now.surface.points_m[nodes])[1]
            return nearest.astype(np.int32)[:, None]

        return Matcher(find, len(now.surface), NO_SUBSET)

    return pair


METHODS = (
    Method(key="none", title="no association: prediction and ICP", family=Family.NONE, source="",
           associate=_nobody, frame_ms=1.0),
    Method(key="nearest", title="the node nearest to where the node was", family=Family.NONE, source="",
           associate=_nearest, frame_ms=5.0),
)  # fmt: skip
