"""What nodes of two frames are matched by, and how many anchors at a time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial import KDTree

from anchorpose.association.gate import GateConfig
from anchorpose.association.hypotheses import Hypotheses
from anchorpose.surface.surface import Surface


class Feature(StrEnum):
    """What says that two nodes are the same place of the skin."""

    GEODESIC = "geodesic"  # distances to the anchors (paper, Definition 3)
    POSITION = "position"  # being near to where the node was: what is left without a descriptor, to compare with


@dataclass(frozen=True, slots=True, kw_only=True)
class HypothesisConfig:
    """How hypotheses are made."""

    feature: Feature = Feature.GEODESIC
    subset_size: int = 3  # N_S: three anchors tell nodes apart (paper, Section IV-D); 5: one hypothesis by all of them
    trusted_only: bool = (
        True  # leave out distances that a hole lengthens; False: leave that to the subsets, as the paper
    )

    def __post_init__(self) -> None:
        if self.subset_size < 1:
            raise ValueError(f"subset_size must be at least 1, got {self.subset_size}")


def nearest_hypotheses(source: Surface, target: Surface, config: GateConfig) -> Hypotheses:
    """One hypothesis a node, by position: the nearest node of the target within ``search_radius_m``, else missed.

    It rests on no anchor, so its one subset is empty.
    """
    match = np.full((len(source), 1), -1, np.int32)
    if len(source) and len(target):
        nearest = KDTree(target.points_m).query(source.points_m, distance_upper_bound=config.search_radius_m)[1]
        match[:, 0] = np.where(nearest < len(target), nearest, -1)
    return Hypotheses(match, np.empty((1, 0), np.int64))
