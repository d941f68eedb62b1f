"""Find the paper's anchors (Sections IV-B and V): nodes that are farther along the surface from the body's centre than
all other nodes within 0.5 m.

Each such node, an extremum, is itself the anchor. A piece of surface that is not connected to the centre has no anchor.
The paper orders extrema "based on the corresponding body parts" and gives no rule. In this module, an extremum has the
name of this project's anchor at the same end of a limb.
"""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
from scipy.optimize import linear_sum_assignment

from anchorpose.geodesics.anchors import Anchors, anchor_descriptor, no_anchors
from anchorpose.geodesics.extrema import geodesic_extrema, surface_center
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.surface.surface import Surface

# m, radius around an extremum in which no node is farther from the centre; the paper's r, chosen "empirically"
RADIUS_M: Final = 0.5
# Maximum distance in m between an extremum and an anchor at the same end of a limb. The distance is twice the depth of
# the cap, the surface that counts as the end of a limb (see ``geodesics.extrema``).
SAME_END_M: Final = 0.12
# distances along the edges, as in the work that the paper cites for extrema
by_edges = partial(solve_distance, solver=Solver.DIJKSTRA)


def paper_anchors(surface: Surface, named: Anchors) -> Anchors:
    """Return the paper's anchors on a surface with at least one node that a camera has seen.

    Each extremum has the name of the ``named`` anchor at the same end of a limb; an extremum without such an anchor is
    left out.
    """
    field = by_edges(surface, np.array([surface_center(surface)]))[0]
    extrema, anchors = geodesic_extrema(surface, field, RADIUS_M), no_anchors()
    apart = np.linalg.norm(surface.points_m[extrema][:, None] - named.position_m[None], axis=2)
    apart = np.where(apart < SAME_END_M, apart, np.inf)
    # m; pairs that are too far apart have 1 m instead of an infinite distance, so that an assignment exists; the loop
    # below skips these pairs
    cost = np.minimum(apart, 1.0)
    for row, name in zip(*linear_sum_assignment(cost), strict=True):
        if np.isfinite(apart[row, name]):
            anchors.node[name], anchors.position_m[name] = extrema[row], surface.points_m[extrema[row]]
    return anchors


def paper_descriptor(surface: Surface, named: Anchors) -> np.ndarray:
    """Return the paper's descriptor f (Definition 3): geodesic distances to the anchors, (n, 5) float32 metres.

    The column of a missed anchor is NaN. A node that no path from the anchor reaches has inf.
    """
    if surface.seen_count == 0:
        return np.full((len(surface), len(named.node)), np.nan, np.float32)
    return anchor_descriptor(surface, paper_anchors(surface, named), by_edges)
