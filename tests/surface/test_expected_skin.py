"""What the predicted body tells the surface: what touches is cut, and what is hidden is closed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from body_builder import adult_body
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from trousers_builder import AWAY_M, CAMERA, CROTCH_M, expected_legs, legs_depth

from anchorpose.body.skin_map import map_body
from anchorpose.geodesics.distance import geodesic_distance
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface import contacts
from anchorpose.surface.contacts import cut_contacts
from anchorpose.surface.hidden import assign_skin, find_ambiguous_skin
from anchorpose.surface.links import links
from anchorpose.surface.mesh import build_surface
from anchorpose.surface.patient_surface import patient_surface
from anchorpose.surface.surface import HIDDEN_SKIN, geodesic_lower_bound, seen_part

BAR = np.s_[62:74]  # rows that a bar hides, 6.5 cm of both legs


def view_of(depth_m, bar_depth_m=None):
    """The legs as the patient; rows of the bar are equipment at a depth, or without a reading."""
    depth = depth_m.copy()
    labels = np.where(depth > 0, PixelLabel.PATIENT, PixelLabel.BACKGROUND).astype(np.uint8)
    if bar_depth_m is not None:
        depth[BAR], labels[BAR] = bar_depth_m, PixelLabel.EQUIPMENT
    else:
        depth[depth == 0] = 4.0
    return View(depth, labels)


def at(surface, side, up_m):
    """The seen node in the middle of a leg, side -1 or 1 (left, right in the picture), at a height."""
    seen = surface.points_m[: surface.seen_count]
    wanted = np.array([AWAY_M - 0.06, 0, 0])
    place = np.array([2.4 - wanted[0], 1.0 + up_m, -side * 0.06])
    return int(np.argmin(np.linalg.norm(seen - place, axis=1)))


def way(surface, one, other):
    return float(geodesic_distance(surface, [one])[0, other])


def test_without_prediction_the_legs_are_joined_where_they_touch():
    surface = patient_surface([view_of(legs_depth())], [CAMERA])
    assert way(surface, at(surface, -1, -0.2), at(surface, 1, -0.2)) < 0.25


@pytest.mark.parametrize("shift", [(0, 0, 0), (0.02, 0, 0), (-0.015, 0.01, 0.015), (0, -0.02, -0.02)])
def test_legs_that_touch_are_cut_along_their_crease_up_to_the_crotch(shift):
    surface = patient_surface([view_of(legs_depth())], [CAMERA], expected_legs(shift))
    foot, other = at(surface, -1, -0.2), at(surface, 1, -0.2)
    assert way(surface, foot, other) == pytest.approx(2 * (CROTCH_M + 0.2), abs=0.08)
    grid = surface.ring[: surface.seen_count]
    node, place = np.nonzero(grid >= 0)
    left, low = surface.points_m[:, 2] > 0, surface.points_m[:, 1] < 1.0 + CROTCH_M - 0.06
    across = (left[node] != left[grid[node, place]]) & low[node] & low[grid[node, place]]
    assert across.mean() < 0.005  # of all edges


def test_a_leg_predicted_elsewhere_is_not_cut_on_its_smooth_skin(monkeypatch):
    surface = build_surface(legs_depth(), legs_depth() > 0, CAMERA)
    expected = expected_legs((0.06, 0.0, 0.07))
    left, right = 117, 351  # one skin point in the middle of each leg, 70 cm apart on the body
    halved = replace(surface, skin=np.where(surface.points_m[:, 2] > -0.06, left, right).astype(np.int32))
    np.testing.assert_array_equal(cut_contacts(halved, expected).ring, surface.ring)
    monkeypatch.setattr(contacts, "LEAST_STEP", 1e-9)  # every edge is evidence
    anything = cut_contacts(halved, expected)
    assert (surface.ring >= 0).sum() - (anything.ring >= 0).sum() > 200


def test_hidden_skin_behind_a_bar_carries_the_way_comes_last_and_is_no_part_of_what_was_seen():
    surface = patient_surface([view_of(legs_depth(), 1.5)], [CAMERA], expected_legs())
    low, high = at(surface, -1, -0.2), at(surface, -1, 0.2)
    assert way(surface, low, high) == pytest.approx(0.4, abs=0.02)
    assert np.isfinite(geodesic_distance(surface, [low])).all()
    view = view_of(legs_depth(), 1.5)
    surface = patient_surface([view], [CAMERA], expected_legs())
    count = surface.seen_count
    assert 0 < count < len(surface)
    assert (surface.camera[count:] == HIDDEN_SKIN).all()
    assert (surface.camera[:count] != HIDDEN_SKIN).all()
    part = seen_part(surface)
    assert len(part) == count == seen_part(part).seen_count
    assert (links(part)[0] < count).all()
    np.testing.assert_array_equal(part.ring, surface.ring[:count])
    rows = -CAMERA.pixel_rays()[BAR, 0, 1] * AWAY_M
    behind_bar = np.abs(surface.points_m[:, 1] - 1.0 - rows.mean()) < np.ptp(rows) / 2 - 0.005
    assert not behind_bar[:count].any()
    assert behind_bar[count:].sum() >= 2 * 9 * 2  # both legs, nine angles, two heights


def test_skin_that_a_camera_sees_through_is_not_there():
    expected = expected_legs()
    empty = view_of(np.zeros_like(legs_depth()))  # the wall at 4 m in every pixel
    surface = patient_surface([empty], [CAMERA], expected)
    assert len(surface) == 0
    lost = View(np.zeros_like(legs_depth()), np.zeros(legs_depth().shape, np.uint8))
    assert len(patient_surface([lost], [CAMERA], expected)) == len(expected.points_m)


def test_nodes_show_the_skin_that_lies_under_them_and_far_ones_show_none():
    surface = build_surface(legs_depth(), legs_depth() > 0, CAMERA)
    expected = expected_legs()
    shown = assign_skin(surface, CAMERA, expected, find_ambiguous_skin(expected))
    known = shown.skin >= 0
    assert known.mean() > 0.97
    apart = np.linalg.norm(surface.points_m[known] - expected.points_m[shown.skin[known]], axis=1)
    assert apart.max() < 0.03
    away = expected_legs((0.0, 0.0, 0.4))
    assert (assign_skin(surface, CAMERA, away, find_ambiguous_skin(away)).skin == -1).all()


def test_the_body_s_map_knows_near_from_far():
    person, body = adult_body(), _adult_map()
    place = person.mesh.vertices[person.points.vertex]
    straight = np.linalg.norm(place[body.pairs[:, 0]] - place[body.pairs[:, 1]], axis=1)
    assert straight.max() < 0.15
    assert np.bincount(body.pairs.ravel()).min() >= 3
    assert (body.straight > 0.2).all()
    assert (body.straight <= 1.0 + 1e-6).all()
    direct = body.via == body.pairs[:, 0]
    assert (body.straight[direct] == 1.0).all()
    hands = int(np.argmax(place[:, 2])), int(np.argmin(place[:, 2]))
    assert geodesic_lower_bound(body.landmarks_m, *hands) > 1.0


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2399), st.integers(0, 2399))
def test_the_way_over_the_body_is_bounded_by_any_path_and_is_symmetric(a, b):
    body = _adult_map()
    assert geodesic_lower_bound(body.landmarks_m, a, b) == geodesic_lower_bound(body.landmarks_m, b, a)
    assert geodesic_lower_bound(body.landmarks_m, a, a) == 0.0
    through = min(body.landmarks_m[a] + body.landmarks_m[b])
    assert geodesic_lower_bound(body.landmarks_m, a, b) <= through + 1e-5


def test_the_way_over_the_body_is_that_along_the_mesh_or_little_less():
    body, person = _adult_map(), adult_body()
    skin = person.points
    faces, vertices = skin.asset.faces, person.mesh.vertices
    edges = np.unique(np.sort(np.concatenate([faces[:, :2], faces[:, 1:], faces[:, ::2]]), axis=1), axis=0)
    length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    mesh = csr_array((length, edges.T), shape=(len(vertices), len(vertices)))
    for a in (0, 700, 1500, 2300):
        along = dijkstra(mesh, directed=False, indices=skin.vertex[a])[skin.vertex]
        ways = np.array([geodesic_lower_bound(body.landmarks_m, a, b) for b in range(len(along))])
        assert (ways <= along + 1e-4).all()
        assert np.median(ways / np.maximum(along, 1e-9)) > 0.85


@cache
def _adult_map():
    return map_body(adult_body())


def test_only_skin_beside_skin_far_on_the_body_is_contested():
    expected = expected_legs()
    contested = find_ambiguous_skin(expected)
    up = expected.points_m[:, 1] - 1.0
    inner = np.abs(expected.points_m[:, 2]) < 0.02
    assert contested[inner & (up < 0.0)].all()
    assert not contested[np.abs(expected.points_m[:, 2]) > 0.08].any()
