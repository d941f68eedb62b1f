"""What geodesics show of one frame, for proposals of poses that owe nothing to a prediction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anchorpose.geodesics.anchors import Anchors
from anchorpose.surface.surface import Surface


@dataclass(frozen=True, slots=True, eq=False)
class SeenGeodesics:
    """The patient's surface in one frame with its anchors and distances.

    whole: with the hidden skin, which is inferred and comes last. descriptor (n, 5) metres: the distance of each seen
    node to each anchor, inf where not reached, NaN where the anchor is missed or the distance is not trusted.
    """

    whole: Surface
    anchors: Anchors
    descriptor: np.ndarray
