"""The anchor descriptor f (paper, Definition 3): every node's geodesic distance to every anchor."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from anchorpose.geodesics.anchors import Anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.surface.surface import Surface


def anchor_descriptor(
    surface: Surface,
    anchors: Anchors,
    distance: Callable[[Surface, np.ndarray], np.ndarray] = geodesic_distance,
) -> np.ndarray:
    """(n, 5) float32 metres, columns in the order of ``ANCHOR_NAMES``.

    NaN in the column of a missed anchor; inf where the node lies on a piece of surface the anchor does not reach.
    """
    descriptor = np.full((len(surface), len(anchors.node)), np.nan, np.float32)
    descriptor[:, anchors.found] = distance(surface, anchors.node[anchors.found]).T
    return descriptor
