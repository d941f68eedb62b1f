"""The map of least distortion between whole surfaces, which the paper's feature approximates (Section III-A)."""

from __future__ import annotations

from typing import Any

import numpy as np

from anchorpose.association.hypotheses import Matcher
from anchorpose.research.experiment.method import NO_SUBSET, Family, Method
from anchorpose.research.features.gmds import GmdsConfig, match_by_gmds
from anchorpose.tracker.association import Associate
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation


def _associate(setting: Any) -> Associate:
    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        def find(nodes: np.ndarray) -> np.ndarray:
            return match_by_gmds(now.surface, following.surface, setting)[nodes][:, None]

        return Matcher(find, len(now.surface), NO_SUBSET)

    return pair


METHODS = (
    Method(
        key="gmds",
        title="GMDS",
        family=Family.GLOBAL,
        source="Bronstein et al. 2006, doi:10.1073/pnas.0508601103",
        settings=(GmdsConfig(), GmdsConfig(samples=60), GmdsConfig(cap_m=0.3)),
        associate=_associate,
        frame_ms=500.0,
    ),
)
