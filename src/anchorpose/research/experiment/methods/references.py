"""Define the methods that serve as references: methods without a descriptor, GMDS, and this project's tracker.

GMDS (generalised multi-dimensional scaling) matches all nodes at once by the distances between them.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, Final

import numpy as np
from scipy.spatial import KDTree

from anchorpose.body.config import LearningConfig
from anchorpose.motion.prediction import MotionConfig, MotionRule
from anchorpose.research.experiment.method import NO_SUBSET, OWN, Family, Method
from anchorpose.research.features.gmds import GmdsConfig, match_by_gmds
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.track_tree.hypotheses import Matcher
from anchorpose.tracker.config import Method as Registration
from anchorpose.tracker.config import TrackConfig
from anchorpose.tracker.observation import Observation
from anchorpose.tracker.observing import Associate


def _none(setting: Any) -> Associate:
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


BASELINES = (
    Method(
        key="none",
        title="no association: prediction and ICP",
        family=Family.NONE,
        source="",
        associate=_none,
        anchored=False,
        frame_ms=1.0,
    ),
    Method(
        key="nearest",
        title="the node nearest to where the node was",
        family=Family.NONE,
        source="",
        associate=_nearest,
        anchored=False,
        frame_ms=3.0,
    ),
)


def _gmds(setting: Any) -> Associate:
    def pair(now: Observation, following: Observation, config: TrackConfig) -> Matcher:
        @cache  # GMDS matches all nodes at once, even if only a few matches are requested
        def match() -> np.ndarray:
            return match_by_gmds(now.surface, following.surface, setting)

        def find(nodes: np.ndarray) -> np.ndarray:
            return match()[nodes][:, None]

        return Matcher(find, len(now.surface), NO_SUBSET)

    return pair


GLOBAL = (
    Method(
        key="gmds",
        title="GMDS",
        family=Family.GLOBAL,
        source="Bronstein et al. 2006, doi:10.1073/pnas.0508601103",
        settings=(GmdsConfig(), GmdsConfig(samples=60), GmdsConfig(cap_m=0.3)),
        associate=_gmds,
        anchored=False,
        frame_ms=550.0,
    ),
)


ABLATION: Final[Mapping[str, tuple[str, TrackConfig]]] = {
    "own-no-movements": ("without reference movements", TrackConfig(motion=MotionConfig(rule=MotionRule.VELOCITY))),
    "own-best-movement": (
        "with the one best movement, as in the paper",
        TrackConfig(motion=MotionConfig(rule=MotionRule.BEST_SUBLIST)),
    ),
    "own-standstill": ("without any prediction", TrackConfig(motion=MotionConfig(rule=MotionRule.STANDSTILL))),
    "own-raw-mesh": ("without closing and cutting the mesh", TrackConfig(surface=SurfaceConfig(by_body=False))),
    "own-mean-body": ("without the learnt body", TrackConfig(learning=LearningConfig(own_shape=False))),
    "own-parts": ("every part by itself", TrackConfig(method=Registration.PARTS)),
}
"""Title and configuration, by key, of variants of this project's tracker that lack one component each."""


def _own(key: str, title: str, config: TrackConfig) -> Method:
    def configure(_framework: TrackConfig, _setting: Any) -> TrackConfig:
        return config

    return Method(key=key, title=title, family=Family.TRACKER, source="", configure=configure)


OWN_TRACKER = (_own(OWN, "anchorpose", TrackConfig()),)
ABLATED = tuple(_own(key, f"anchorpose {title}", config) for key, (title, config) in ABLATION.items())


METHODS = (*BASELINES, *GLOBAL, *OWN_TRACKER)
