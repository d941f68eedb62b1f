"""This project's own tracker, from a first pose that it finds itself, and what each of its ingredients brings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from anchorpose.association.matcher import Feature, HypothesisConfig
from anchorpose.body.config import LearningConfig
from anchorpose.research.experiment.method import OWN, Family, Method
from anchorpose.surface.surface import SurfaceConfig
from anchorpose.tracker.config import FollowConfig, TrackConfig
from anchorpose.tracker.config import Method as Registration
from anchorpose.tracking.motion import MotionConfig, MotionRule

ABLATION: Final[Mapping[str, tuple[str, TrackConfig]]] = {
    "own-no-descriptor": (
        "without the descriptor", TrackConfig(hypotheses=HypothesisConfig(feature=Feature.POSITION)),
    ),
    "own-no-subsets": ("without subsets of anchors", TrackConfig(hypotheses=HypothesisConfig(subset_size=5))),
    "own-no-tree": ("without the tree", TrackConfig(follow=FollowConfig(look_ahead=1))),
    "own-no-movements": (
        "without reference movements", TrackConfig(motion=MotionConfig(rule=MotionRule.VELOCITY)),
    ),
    "own-best-movement": (
        "with the one best movement, as in the paper", TrackConfig(motion=MotionConfig(rule=MotionRule.BEST_SUBLIST)),
    ),
    "own-standstill": ("without any prediction", TrackConfig(motion=MotionConfig(rule=MotionRule.STANDSTILL))),
    "own-raw-mesh": ("without closing and cutting the mesh", TrackConfig(surface=SurfaceConfig(by_body=False))),
    "own-mean-body": ("without the learnt body", TrackConfig(learning=LearningConfig(own_shape=False))),
    "own-parts": ("every part by itself", TrackConfig(method=Registration.PARTS)),
}  # fmt: skip
"""Each ingredient of the tracker switched off, one at a time: title and configuration."""


def _method(key: str, title: str, config: TrackConfig) -> Method:
    def configure(_framework: TrackConfig, _setting: Any) -> TrackConfig:
        return config

    return Method(key=key, title=title, family=Family.TRACKER, source="", configure=configure, sampled=False)


METHODS = (_method(OWN, "anchorpose", TrackConfig()),)
ABLATED = tuple(_method(key, f"anchorpose {title}", config) for key, (title, config) in ABLATION.items())
