"""Trust from bending paths against the exact definition: what the surface without the hole says."""

from dataclasses import replace
from functools import cache

import body_builder
import numpy as np
import pytest
from occlusion_builder import Pierced, elliptic_hole, lattice_hole
from scipy.spatial.transform import Rotation
from surface_builder import flat_grid, with_links

from anchorpose.geodesics.anchors import find_anchors
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.geodesics.trusted_anchors import TOLERANCE_M, detour, trusted_anchors
from anchorpose.research.geodesic_solvers import Solver, solve_distance
from anchorpose.research.occlusion import light_from, occlude
from anchorpose.surface.links import pieces
from anchorpose.surface.mesh import build_surface, keep_nodes
from anchorpose.surface.surface import Surface

HOLES = {
    "a round hole": lambda: elliptic_hole(half=20, hole=6),
    "an ellipse": lambda: elliptic_hole(half=20, hole=6, stretch=1.4, turn_rad=0.7),
    "a disc of pixels": lambda: lattice_hole(41, 41, lambda row, col: np.hypot(row - 0.3, col + 0.2) < 6.3),
    "a bar": lambda: lattice_hole(41, 41, lambda row, col: (np.abs(row) < 2) & (np.abs(col) < 12)),
    "a tilted bar": lambda: lattice_hole(
        41, 41, lambda row, col: (np.abs(0.9 * row + 0.44 * col) < 2) & (np.abs(0.9 * col - 0.44 * row) < 12)
    ),
    "a hole in a ball": lambda: elliptic_hole(half=18, hole=6, ball_m=0.25),
}


@cache
def truth(name: str) -> tuple[Pierced, Surface, np.ndarray, np.ndarray, np.ndarray]:
    """The seen surface, five sources on it, its rim, and the true detours (m, 5)."""
    pierced = HOLES[name]()
    sources = np.random.default_rng(11).choice(np.flatnonzero(~pierced.hidden), 5, replace=False)
    occlusion = occlude(pierced.whole, pierced.hidden)
    true = np.stack([light_from(occlusion, node).distortion_m[occlusion.node] for node in sources], axis=1)
    beside = np.append(pierced.hidden, False)[pierced.whole.ring].any(axis=1)[occlusion.node]
    return pierced, occlusion.seen, np.searchsorted(occlusion.node, sources), beside, true


def precision_and_recall(trusted: np.ndarray, true: np.ndarray, tolerance_m: float = TOLERANCE_M):
    dark = true > tolerance_m
    right = (~trusted & dark).sum()
    return right / (~trusted).sum(), right / dark.sum()


@pytest.mark.parametrize("name", HOLES)
def test_with_exact_distances_the_detour_is_the_exact_one(name):
    _, seen, sources, rim, true = truth(name)
    found = detour(seen, solve_distance(seen, sources, solver=Solver.EXACT).T, rim)
    error = np.abs(found - true)
    assert error.mean() < 0.0020
    assert np.median(error[true > 0.001]) < 0.0025
    assert found[true < 1e-5].max() < 0.001


@pytest.mark.parametrize("name", HOLES)
def test_with_fast_marching_it_trusts_what_the_definition_trusts_but_for_the_shadow_s_edge(name):
    _, seen, sources, rim, true = truth(name)
    trusted = trusted_anchors(seen, geodesic_distance(seen, sources).T, rim)
    precision, recall = precision_and_recall(trusted, true)
    assert precision > 0.92
    assert recall > (0.80 if "ball" in name else 0.93)  # a flat filling is a little shorter than the ball
    assert not (trusted & (true > 2 * TOLERANCE_M)).any()
    assert not (~trusted & (true < 0.5 * TOLERANCE_M)).any()


def a_body() -> Surface:
    skin = body_builder.skin_in(body_builder.standing(), body_builder.adult_body())
    depth_m = body_builder.photograph(skin, body_builder.FRONT).depth_m
    surface = build_surface(depth_m, depth_m > 0, body_builder.FRONT)
    return keep_nodes(surface, pieces(surface) == np.bincount(pieces(surface)).argmax())


@pytest.mark.parametrize(("height_m", "side_m", "radius_m"), [(1.15, 0.0, 0.10), (1.0, 0.05, 0.10), (0.85, 0.09, 0.08)])
def test_on_a_body_with_a_hole_it_says_which_anchors_are_disturbed(height_m, side_m, radius_m):
    whole = a_body()
    anchors = find_anchors(whole, np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]), 1.72)
    assert anchors.found.all()
    hidden = np.hypot(whole.points_m[:, 1] - height_m, whole.points_m[:, 2] - side_m) < radius_m
    seen, node = keep_nodes(whole, ~hidden), np.flatnonzero(~hidden)
    after = geodesic_distance(seen, np.searchsorted(node, anchors.node)).T
    true = after - geodesic_distance(whole, anchors.node).T[node]
    rim = np.append(hidden, False)[whole.ring].any(axis=1)[node]
    trusted = trusted_anchors(seen, after, rim)
    assert (true > TOLERANCE_M).sum() > 100
    precision, recall = precision_and_recall(trusted, true)
    assert precision > 0.65  # beside the armpit the outline bends the path as well, and fronts start anew there
    assert recall > 0.85
    band = rim | np.append(rim, False)[seen.ring].any(axis=1)  # as wide as surface.border marks it
    assert (trusted_anchors(seen, after, band) == trusted).mean() > 0.97


def test_the_body_s_own_outline_disturbs_nobody():
    _, seen, sources, rim, _ = truth("a bar")
    field = geodesic_distance(seen, sources).T
    assert trusted_anchors(seen, field, np.zeros(len(seen), bool)).all()
    assert not trusted_anchors(seen, field, rim).all()


def test_an_anchor_missed_or_not_reached_is_not_trusted():
    present = np.ones((12, 20), bool)
    present[:, 9] = False
    surface = flat_grid(12, 20, 0.013, present)
    field = np.full((len(surface), 2), np.nan, np.float32)
    field[:, 0] = geodesic_distance(surface, [0])[0]
    trusted = trusted_anchors(surface, field, np.zeros(len(surface), bool))
    np.testing.assert_array_equal(trusted[:, 0], surface.pixel[:, 1] < 9)
    assert not trusted[:, 1].any()
    assert np.isnan(detour(surface, field, np.zeros(len(surface), bool))[:, 1]).all()


def test_a_bridge_over_the_occlusion_takes_the_detour_away():
    """Links across a bar, as ``surface.joins`` makes them, lead straight on."""
    pierced = lattice_hole(31, 31, lambda row, col: (np.abs(row) < 2) & (np.abs(col) < 12))
    seen, node = keep_nodes(pierced.whole, ~pierced.hidden), np.flatnonzero(~pierced.hidden)
    source = int(np.searchsorted(node, 3 * 31 + 15))
    rim = np.append(pierced.hidden, False)[pierced.whole.ring].any(axis=1)[node]
    cut = trusted_anchors(seen, geodesic_distance(seen, [source]).T, rim)
    ends = [(np.searchsorted(node, 13 * 31 + col), np.searchsorted(node, 17 * 31 + col)) for col in range(4, 27)]
    bridged = with_links(seen, ends)
    whole = trusted_anchors(bridged, geodesic_distance(bridged, [source]).T, rim)
    assert cut.mean() < 0.8
    assert whole.mean() > 0.94  # but for those that go around the bar's ends


def test_a_rigid_motion_and_a_mirror_change_nothing():
    _, seen, sources, rim, _ = truth("a disc of pixels")
    before = detour(seen, geodesic_distance(seen, sources).T, rim)
    turn = Rotation.from_rotvec([0.4, 1.2, -0.6]).as_matrix() * -1.0  # a rotation and a mirror
    points_m, normals = seen.points_m @ turn.T + [1, 2, 3], seen.normals @ turn.T
    moved = replace(seen, points_m=points_m.astype(np.float32), normals=normals.astype(np.float32))
    after = detour(moved, geodesic_distance(moved, sources).T, rim)
    assert np.median(np.abs(after - before)) < 1e-6
    assert np.percentile(np.abs(after - before), 99) < 1e-3  # where two ways are equally long, rounding chooses


def test_what_does_not_fit_together_is_refused():
    surface = flat_grid(5, 5, 0.013)
    field, rim = np.zeros((25, 5), np.float32), np.zeros(25, bool)
    for wrong in ((field[1:], rim), (field, rim[1:]), (field[:, 0], rim), (field, rim.astype(int))):
        with pytest.raises(ValueError, match="do not fit"):
            trusted_anchors(surface, *wrong)
    with pytest.raises(ValueError, match="tolerance_m"):
        trusted_anchors(surface, field, rim, -0.1)
    with pytest.raises(ValueError, match="finite"):
        trusted_anchors(replace(surface, normals=surface.normals * np.nan), field, rim)
