"""Find the centre of the surface, its geodesic extrema (the ends of limbs; paper, Section IV-B, after Definition 2),
and the cap of each extremum (the surface around it).

An extremum is a single node: of many nodes that are almost equally far from the centre, it is the farthest. The surface
around an extremum, its cap, has a more stable centre and shows whether the limb really ends there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from anchorpose.errors import DegenerateGeometry
from anchorpose.geodesics.distance import Stop, band_of, geodesic_distance, march_on, new_front, start_at
from anchorpose.surface.surface import MeshArrays, Surface

# number of nodes of a cap, the farthest from the centre, whose mean distance counts as the distance of the limb's end;
# the distance of a single node has half a centimetre of noise
FARTHEST: Final = 10
# minimum share of the nodes in a cap's outer half that lie at a cut (the border of an object in front), for the cap to
# be a stump: the limb then continues behind the object. If a bar cuts a limb off, all nodes of the cap's outer half lie
# at the cut.
STUMP_SHARE: Final = 0.5
# minimum length of hidden (predicted, unseen) skin beyond an extremum, in units of a cap's depth (1.5 are 9 cm), for
# the limb to continue there; fingers without readings are shorter
LONGER: Final = 1.5
# minimum length, in place of ``LONGER``, if an object, such as a bar before a wrist, stands in front of the limb's end
LONGER_AT_CUT: Final = 1.0
# skin area per hidden node, divided by the skin area per seen node: hidden nodes are 2.2 cm apart, seen nodes 1.3 cm
HIDDEN_AREA: Final = 3.0
LEAST_SIGMA_M: Final = 0.003  # m, minimum standard deviation of a cap's centre, a quarter of the spacing of nodes
SPREAD: Final = 0.20  # standard deviation of a cap's centre over frames, divided by the cap's radius


def surface_center(surface: Surface, among: np.ndarray | None = None) -> int:
    """Return V_c, the seen node closest to the average position of all seen nodes.

    If the surface has a hole at the centre, V_c is the nearest node on the hole's rim. among (n,) bool: allowed nodes,
    at least one of them seen; None = all nodes. Raises DegenerateGeometry on a surface without seen nodes.
    """
    if surface.seen_count == 0:
        raise DegenerateGeometry("a surface without seen nodes has no centre")
    x, y, z = (surface.points_m[: surface.seen_count] - seen_mean(surface)).T
    away = x**2 + y**2 + z**2
    return int(np.argmin(away if among is None else np.where(among[: len(away)], away, np.inf)))


def seen_mean(surface: Surface) -> np.ndarray:
    """Return the average position (3,) float64 of all seen nodes, NaN without any."""
    return _mean(surface.points_m, surface.seen_count)


def geodesic_extrema(surface: Surface, field: np.ndarray, radius_m: float) -> np.ndarray:
    """Return (k,) int32: seen nodes farther from the centre than all other seen nodes within ``radius_m``, the farthest
    first.

    field (n,) float32: geodesic distance from the centre; nodes with the distance inf (not connected to the centre) are
    never extrema. radius_m: the paper's r, a distance along the surface, hidden skin included. The paper's definition
    of an extremum is applied without approximation, as follows. Each seen node that is farther from the centre than all
    its seen neighbours is a candidate. From each candidate, a front spreads over the surface, up to the distance
    ``radius_m``. If the front meets a seen node that is at least as far from the centre, the candidate is not an
    extremum.
    """
    if field.shape != (len(surface),):
        raise ValueError(f"field is {field.shape}, the surface has {len(surface)} nodes")
    if not radius_m > 0:
        raise ValueError(f"radius_m must be positive, got {radius_m}")
    field = field.astype(np.float32)
    field[surface.seen_count :] = -np.inf
    mesh = surface.arrays
    candidates = _local_maxima(surface, field)
    extrema = candidates[_is_extremum(mesh, field, candidates, float(radius_m), band_of(mesh))]
    return extrema[np.argsort(-field[extrema], kind="stable")]


@njit(cache=True, error_model="numpy")
def _mean(points: np.ndarray, count: int) -> np.ndarray:
    """Return the mean (3,) float64 of the first count points (n, 3), summed in double precision without a copy."""
    total = np.zeros(3)
    for k in range(count):
        for axis in range(3):
            total[axis] += points[k, axis]
    return total / np.float64(count)


def _local_maxima(surface: Surface, field: np.ndarray) -> np.ndarray:
    """Return the nodes (k,) int32 at which ``field``, the distance from the centre, is larger than at all their
    neighbours, on the grid and across links.
    """
    ring, highest = surface.ring, np.isfinite(field)
    highest &= ((ring < 0) | (field[ring] < field[:, None])).all(axis=1)
    source = np.repeat(np.arange(len(field)), np.diff(surface.link_start))
    highest[source[~(field[surface.link_node] < field[source])]] = False
    return np.flatnonzero(highest).astype(np.int32)


@njit(cache=True)
def _is_extremum(mesh: MeshArrays, field: np.ndarray, candidates: np.ndarray, radius: float, band: float) -> np.ndarray:
    """Return (k,) bool: whether a candidate is an extremum, that is, farther from the centre than all other nodes
    within ``radius``. A front spreads from each candidate, and stops at the first node that is at least as far from the
    centre as the candidate.
    """
    stands = np.empty(len(candidates), np.bool_)
    front = new_front(len(mesh.points_m))
    for k in range(len(candidates)):
        start_at(front, candidates[k : k + 1])
        stands[k] = not march_on(mesh, front, band, Stop(radius, field, np.float64(field[candidates[k]])))
    return stands


@dataclass(frozen=True, slots=True, eq=False)
class Cap:
    """The cap of one extremum: the seen surface at a limb's end, up to a given depth towards the body's centre."""

    tip: int  # the extremum
    nodes: np.ndarray  # (m,) int, seen nodes
    center_m: np.ndarray  # (3,) weighted mean of the nodes; the outermost nodes have the largest weights
    reach_m: float  # geodesic distance of the extremum from the centre of the surface
    sigma_m: float  # standard deviation of ``center_m`` per axis
    stump: bool  # whether the surface ends here only because an object in front hides the rest of the limb
    # whether hidden skin extends much farther from the centre than the extremum, so that the limb continues
    continues: bool


def find_caps(
    surface: Surface, field: np.ndarray, extrema: np.ndarray, depth_m: float, cut: np.ndarray | None = None
) -> list[Cap]:
    """Return the cap (the seen surface at a limb's end) of each extremum. extrema (k,): numbers of seen nodes.

    field (n,) float32: distance from the centre. A cap reaches from the limb's end up to ``depth_m`` towards the
    centre; the distance of the limb's end is the mean distance of the cap's ten farthest nodes. cut (n,) bool: nodes at
    a border where something else cuts the surface (``surface.border``).
    """
    if len(extrema) == 0:
        return []
    near = geodesic_distance(surface, extrema, 2.0 * depth_m)
    return [_cap(surface, field, near[row] < np.inf, int(tip), depth_m, cut) for row, tip in enumerate(extrema)]


def _cap(
    surface: Surface, field: np.ndarray, near: np.ndarray, tip: int, depth_m: float, cut: np.ndarray | None
) -> Cap:
    highest = float(field[tip])
    around = np.flatnonzero(near)
    nodes, hidden = around[around < surface.seen_count], around[around >= surface.seen_count]
    end = float(np.sort(field[nodes])[-FARTHEST:].mean())
    nodes = nodes[field[nodes] > end - depth_m]
    weight = np.minimum(field[nodes] - (end - depth_m), depth_m).astype(np.float64)
    points = surface.points_m[nodes].astype(np.float64)
    center = weight @ points / weight.sum()
    radius = float(np.sqrt(weight @ ((points - center) ** 2).sum(axis=1) / weight.sum() / 3.0))
    beyond = HIDDEN_AREA * float((field[hidden] > highest).sum())
    unseen = beyond / (beyond + len(nodes))
    stump = cut is not None and _is_stump(surface, field, nodes, cut)
    longer = (LONGER_AT_CUT if stump else LONGER) * depth_m
    return Cap(
        tip=tip,
        nodes=nodes,
        center_m=center,
        reach_m=highest,
        sigma_m=max(LEAST_SIGMA_M, float(np.hypot(SPREAD * radius, unseen * depth_m))),
        stump=stump,
        continues=bool((field[hidden] > highest + longer).any()),
    )


def _is_stump(surface: Surface, field: np.ndarray, nodes: np.ndarray, cut: np.ndarray) -> bool:
    """Return whether a cap is a stump, at which the surface ends only because something hides the rest of the limb. It
    is a stump if, of the nodes in its outer half, at least the share ``STUMP_SHARE`` lie at a cut (a border where
    something else cuts the surface); this must hold for each camera that sees the outer half.
    """
    outer = nodes[field[nodes] >= (field[nodes].max() + field[nodes].min()) / 2.0]
    seen = np.bincount(surface.camera[outer])
    at_cut = np.bincount(surface.camera[outer], weights=cut[outer])
    return bool((at_cut[seen > 0] >= STUMP_SHARE * seen[seen > 0]).all())
