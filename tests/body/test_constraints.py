"""What the depth says about the body: rows from surface to skin and from skin to outline."""

from dataclasses import replace

import numpy as np
import pytest
from body_builder import (
    FRONT,
    adult_body,
    before_wall,
    camera_at,
    evidence_of,
    photograph,
    random_pose,
    seen_body,
    skin_in,
    stepped,
)
from scipy.spatial import cKDTree

from anchorpose.body import constraints
from anchorpose.body.config import RegistrationConfig
from anchorpose.body.constraints import (
    NORMAL_WEIGHT_M,
    UNCOVERED_M,
    Constraints,
    join,
    place_constraints,
    surface_constraints,
)
from anchorpose.body.evidence import evidence_rows, find_outline, nearest_possible, outline_constraints
from anchorpose.body.nearest_skin import nearest_point
from anchorpose.body.skin_points import PosedPoints, pose_points
from anchorpose.camera import Camera, invert_rigid, transform_points
from anchorpose.isolation.view import PixelLabel, View
from anchorpose.surface.surface import Nodes

CONFIG = RegistrationConfig()
BODY = adult_body()
POSE = random_pose(1, 0.3)
POSED = pose_points(BODY, POSE)


def nodes(points_m: np.ndarray, normals: np.ndarray, camera: int = 0) -> Nodes:
    count = len(points_m)
    seen_by, pixel = np.full(count, camera, np.uint8), np.zeros((count, 2), np.int16)
    return Nodes(points_m.astype(np.float32), normals.astype(np.float32), seen_by, pixel)


def facing(posed: PosedPoints, least: float = 0.5, camera: Camera = FRONT) -> np.ndarray:
    ray = camera.position_m - posed.points_m
    return np.flatnonzero((ray * posed.normals).sum(axis=1) > least * np.linalg.norm(ray, axis=1))


def moved(shift_m: tuple[float, float, float]) -> PosedPoints:
    return pose_points(BODY, stepped(POSE, *shift_m))


def view_of_body() -> View:
    return before_wall(photograph(skin_in(POSE, BODY), FRONT), FRONT)


def test_a_surface_that_is_the_skin_has_no_residual():
    mine = facing(POSED)
    rows = surface_constraints(POSED, nodes(POSED.points_m[mine], POSED.normals[mine]), (FRONT,), 0.1, CONFIG)
    assert len(rows) == len(mine)
    np.testing.assert_array_equal(rows.point, mine)
    np.testing.assert_allclose(rows.residuals(POSED), 0.0, atol=1e-6)  # the surface is float32
    np.testing.assert_allclose(rows.direction, POSED.normals[mine], atol=1e-6)
    np.testing.assert_allclose(rows.weights(rows.residuals(POSED)), 1.0 / CONFIG.surface_sigma_m**2, rtol=1e-6)


def test_a_surface_that_the_camera_saw_lies_on_the_skin_to_millimetres():
    evidence = seen_body(POSE, BODY)
    rows = surface_constraints(POSED, evidence.surface, (FRONT,), 0.06, CONFIG)
    # between points 28 mm apart, symmetric planes leave the curvature of fingers, nose and toes
    assert np.median(np.abs(rows.residuals(POSED))) < 0.001
    assert np.percentile(np.abs(rows.residuals(POSED)), 95) < 0.006
    assert len(rows) > 0.98 * min(len(evidence.surface), CONFIG.node_count)


def test_a_step_off_the_skin_is_the_residual_along_the_normal():
    mine = facing(POSED)
    off = nodes(POSED.points_m[mine] + 0.004 * POSED.normals[mine], POSED.normals[mine])
    rows = surface_constraints(POSED, off, (FRONT,), 0.1, CONFIG)
    own = rows.point == mine
    assert own.mean() > 0.99
    np.testing.assert_allclose(rows.residuals(POSED)[own], -0.004, atol=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("reach_m", [0.06, 0.12, 0.4])
def test_every_node_pulls_the_nearest_skin_in_place_and_normal_of_all_skin_that_faces_it(reach_m):
    behind = camera_at((-2.4, 1.1, 0.0), (0.0, 0.9, 0.0), "behind")
    evidence, posed = seen_body(POSE, BODY, (FRONT, behind)), moved((0.05, 0.03, 0.08))
    config = replace(CONFIG, node_count=10_000)
    rows = surface_constraints(posed, evidence.surface, evidence.cameras, reach_m, config)
    place, wanted = 0, evidence.surface
    for node in range(len(wanted)):
        mine = facing(posed, 0.0, evidence.cameras[wanted.camera[node]])
        six = np.hstack([posed.points_m[mine], NORMAL_WEIGHT_M * posed.normals[mine]])
        own = np.hstack([wanted.points_m[node], NORMAL_WEIGHT_M * wanted.normals[node]]).astype(np.float64)
        away = np.linalg.norm(six - own, axis=1)
        if away.min() < reach_m:
            assert rows.point[place] == mine[away.argmin()]
            place += 1
    assert place == len(rows)


@pytest.mark.parametrize("reach_m", [0.01, 0.08, 0.5])
def test_the_nearest_point_by_place_is_that_of_a_search_tree(reach_m):
    nodes_m = POSED.points_m[::3] + np.random.default_rng(4).normal(0.0, 0.1, POSED.points_m[::3].shape)
    distance, nearest = cKDTree(POSED.points_m).query(nodes_m)
    found = nearest_point(POSED.points_m, nodes_m, reach_m)
    np.testing.assert_array_equal(found, np.where(distance < reach_m, nearest, -1))


def test_the_plane_of_a_row_is_the_mean_of_both_normals():
    mine = facing(POSED)
    turned = POSED.normals[mine] + 0.2 * np.random.default_rng(1).normal(size=(len(mine), 3))
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    rows = surface_constraints(POSED, nodes(POSED.points_m[mine], turned), (FRONT,), 0.1, CONFIG)
    mean = turned + POSED.normals[rows.point]
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    near = np.linalg.norm(POSED.points_m[rows.point] - POSED.points_m[mine], axis=1) < UNCOVERED_M
    np.testing.assert_allclose(rows.direction[near], mean[near], atol=1e-6)


def test_symmetric_planes_cancel_the_curvature_of_a_sphere(monkeypatch: pytest.MonkeyPatch):
    """Two places on one sphere are joined by no residual at all, however far apart (Rusinkiewicz 2019)."""
    rng = np.random.default_rng(2)
    normal = rng.normal(size=(40, 3)) * 0.2 + [1.0, 0.0, 0.0]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    posed = PosedPoints(0.1 * normal[:1] + [0.0, 1.0, 0.0], normal[:1], np.eye(4)[None])
    monkeypatch.setattr(constraints, "UNCOVERED_M", 1.0)
    rows = surface_constraints(posed, nodes(0.1 * normal[1:] + [0.0, 1.0, 0.0], normal[1:]), (FRONT,), 0.3, CONFIG)
    assert len(rows) > 30
    np.testing.assert_allclose(rows.residuals(posed), 0.0, atol=1e-7)


def test_nodes_that_no_skin_covers_pull_straight():
    mine = facing(POSED)[::40]
    off = POSED.points_m[mine] + [0.0, 0.0, 0.0]
    off += 0.05 * np.cross(POSED.normals[mine], [0.0, 1.0, 0.0])
    rows = surface_constraints(POSED, nodes(off, POSED.normals[mine]), (FRONT,), 0.15, CONFIG)
    gap = POSED.points_m[rows.point] - rows.target_m
    uncovered = np.linalg.norm(gap, axis=1) > UNCOVERED_M
    assert uncovered.sum() >= 3
    distance = np.linalg.norm(gap[uncovered], axis=1)
    np.testing.assert_allclose(rows.residuals(POSED)[uncovered], distance, rtol=1e-6)


def test_nodes_beyond_reach_say_nothing():
    mine = facing(POSED)
    off = nodes(POSED.points_m[mine] + [0.5, 0.0, 0.0], POSED.normals[mine])
    assert len(surface_constraints(POSED, off, (FRONT,), 0.1, CONFIG)) == 0


def test_skin_that_faces_away_from_the_camera_is_not_pulled():
    evidence = seen_body(POSE, BODY)
    rows = surface_constraints(POSED, evidence.surface, (FRONT,), 0.1, CONFIG)
    assert set(rows.point) <= set(facing(POSED, 0.0))
    behind = camera_at((-2.4, 1.1, 0.0), (0.0, 0.9, 0.0))
    rows = surface_constraints(POSED, evidence.surface, (behind,), 0.1, CONFIG)
    assert set(rows.point) <= set(facing(POSED, 0.0, behind))


def test_each_camera_pulls_the_skin_it_sees():
    behind = camera_at((-2.4, 1.1, 0.0), (0.0, 0.9, 0.0), "behind")
    evidence = seen_body(POSE, BODY, (FRONT, behind))
    rows = surface_constraints(POSED, evidence.surface, evidence.cameras, 0.06, CONFIG)
    front = set(facing(POSED, 0.0))
    assert 0.35 < np.mean([point in front for point in rows.point]) < 0.65


def test_no_more_nodes_are_asked_than_configured_and_always_the_same():
    evidence = seen_body(POSE, BODY)
    few = replace(CONFIG, node_count=200)
    first, again = (surface_constraints(POSED, evidence.surface, (FRONT,), 0.1, few) for _ in range(2))
    assert 150 < len(first) <= 200
    for name in Constraints.__slots__:
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_a_surface_of_no_nodes_gives_no_rows():
    empty = nodes(np.empty((0, 3)), np.empty((0, 3)))
    assert len(surface_constraints(POSED, empty, (FRONT,), 0.1, CONFIG)) == 0


def test_the_outline_is_the_nearest_pixel_of_the_patient():
    rng = np.random.default_rng(3)
    labels = np.where(rng.random((40, 50)) < 0.01, PixelLabel.PATIENT, PixelLabel.BACKGROUND).astype(np.uint8)
    labels[20:24, 10:30] = PixelLabel.PATIENT
    possible = find_outline(View(np.ones(labels.shape, np.float32), labels))
    goals = np.argwhere(labels == PixelLabel.PATIENT)
    np.testing.assert_array_equal(np.argwhere(possible), goals)
    for row, column in np.ndindex(labels.shape):
        found = nearest_possible(possible, row, column, 60)
        away = np.sqrt(((goals - (row, column)) ** 2).sum(axis=1))
        assert np.hypot(found[0] - row, found[1] - column) == away.min()
        assert nearest_possible(possible, row, column, int(away.min() / 1.5))[0] == -1 or possible[found]


def test_a_view_without_the_patient_has_no_outline():
    view = view_of_body()
    labels = np.where(view.patient, PixelLabel.OTHER_PERSON, view.labels).astype(np.uint8)
    assert find_outline(View(view.depth_m, labels)) is None


def stray_rows(
    labels: np.ndarray | None = None, shift_m: float = 0.06, depth_m: np.ndarray | None = None
) -> Constraints:
    """Rows of a body that stands to the side of where the picture shows it; the patient himself is near everything."""
    view = view_of_body()
    depth = np.where(view.patient, np.float32(0.2), view.depth_m) if depth_m is None else depth_m
    shown = View(depth, view.labels if labels is None else labels)
    return outline_constraints(moved((0.0, 0.0, shift_m)), shown, find_outline(view), FRONT, 0.1)


def test_skin_beside_the_outline_is_pulled_back_to_it():
    rows, posed, view = stray_rows(), moved((0.0, 0.0, 0.06)), view_of_body()
    assert len(rows) > 50
    column, row, inside = FRONT.pixel_of(transform_points(invert_rigid(FRONT.require_pose()), rows.target_m))
    assert inside.all()
    assert view.patient[row, column].all()
    offset = posed.points_m[rows.point] - rows.target_m
    np.testing.assert_allclose(rows.residuals(posed), np.linalg.norm(offset, axis=1), atol=1e-9)
    # the pull is across the ray: it says nothing about depth
    in_camera = transform_points(invert_rigid(FRONT.require_pose()), posed.points_m[rows.point])
    np.testing.assert_allclose(
        transform_points(invert_rigid(FRONT.require_pose()), rows.target_m)[:, 2], in_camera[:, 2], atol=1e-6
    )
    assert np.median(offset[:, 2]) > 0.0  # towards the side it strayed from
    np.testing.assert_allclose(np.abs(rows.residuals(posed)).max(), 0.06, atol=0.02)


def test_a_body_in_its_place_has_next_to_nothing_beside_the_outline():
    rows = stray_rows(shift_m=0.0)
    assert np.abs(rows.residuals(POSED)).max(initial=0.0) < 0.02  # one to two pixels of the skin's edge


@pytest.mark.parametrize("label", [PixelLabel.NO_READING, PixelLabel.EQUIPMENT, PixelLabel.CLUTTER])
def test_pixels_that_hide_or_miss_say_nothing(label):
    labels = np.where(view_of_body().patient, PixelLabel.PATIENT, label).astype(np.uint8)
    assert len(stray_rows(labels)) == 0


@pytest.mark.parametrize("label", [PixelLabel.OTHER_PERSON, PixelLabel.OTHER_PERSON + 1])
def test_another_person_behind_the_skin_pushes_it_away_as_the_background_does(label):
    labels = np.where(view_of_body().patient, PixelLabel.PATIENT, label).astype(np.uint8)
    np.testing.assert_array_equal(stray_rows(labels).point, stray_rows().point)


def test_skin_behind_what_the_pixel_shows_may_be_there():
    view = view_of_body()
    nearer = np.full_like(view.depth_m, 1.0)
    assert len(stray_rows(depth_m=nearer)) == 0


def test_skin_too_far_from_the_outline_is_not_pulled():
    near, far = stray_rows(shift_m=0.06), stray_rows(shift_m=0.9)
    assert len(near) > 50
    assert (np.linalg.norm(moved((0.0, 0.0, 0.9)).points_m[far.point] - far.target_m, axis=1) < 0.3).all()


def test_skin_outside_the_picture_is_not_pulled():
    view = view_of_body()
    posed = moved((0.0, -3.0, 0.0))
    assert len(outline_constraints(posed, view, find_outline(view), FRONT, 0.1)) == 0


def test_a_limb_may_be_hidden_in_a_wide_hole_and_not_in_the_rim_of_lost_readings():
    view = view_of_body()
    rows, columns = np.nonzero(view.patient)
    row, left = int(np.median(rows)), int(columns.min())
    labels = view.labels.copy()
    labels[row - 40 : row + 40, left - 32 : left - 30] = PixelLabel.NO_READING  # two pixels wide
    thin = find_outline(View(view.depth_m, labels))
    labels[row - 40 : row + 40, left - 50 : left - 30] = PixelLabel.NO_READING
    wide = find_outline(View(view.depth_m, labels))
    assert nearest_possible(thin, row, left - 60, 99)[1] >= left
    assert nearest_possible(wide, row, left - 60, 99)[1] == left - 50


def test_evidence_without_pictures_is_the_surface_alone():
    evidence = seen_body(POSE, BODY)
    blind = replace(evidence, views=(None,), outlines=(None,))
    rows = evidence_rows(BODY, POSE, blind, 0.1, CONFIG)
    alone = surface_constraints(POSED, evidence.surface, evidence.cameras, 0.1, CONFIG)
    np.testing.assert_array_equal(rows.point, alone.point)


def test_the_evidence_of_an_empty_picture_gives_no_rows():
    view = view_of_body()
    empty = View(view.depth_m, np.full(view.labels.shape, PixelLabel.BACKGROUND, np.uint8))
    assert len(evidence_rows(BODY, POSE, evidence_of((empty,), (FRONT,)), 0.1, CONFIG)) == 0


def test_known_places_are_three_rows_each():
    target = np.array([[0.1, 0.2, 0.3], [1.0, 1.1, 1.2]])
    rows = place_constraints(np.array([5, 9]), target, 0.05, 0.25)
    posed = PosedPoints(POSED.points_m, POSED.normals, POSED.transforms)
    expected = (POSED.points_m[[5, 9]] - target).ravel()
    np.testing.assert_allclose(rows.residuals(posed), expected, atol=1e-12)
    np.testing.assert_array_equal(rows.point, [5, 5, 5, 9, 9, 9])


def test_joined_rows_keep_their_order():
    first, second = (place_constraints(np.array([k]), np.full((1, 3), k), 0.01 * k, 0.1) for k in (1, 2))
    rows = join([first, second])
    np.testing.assert_array_equal(rows.point, [1, 1, 1, 2, 2, 2])
    np.testing.assert_array_equal(rows.sigma_m, [0.01] * 3 + [0.02] * 3)


def test_the_robust_kernel_halves_the_slope_weight_twice_at_its_scale():
    rows = place_constraints(np.array([0]), np.zeros((1, 3)), 0.02, 0.06)
    weight = rows.weights(np.array([0.0, 0.06, 1e3]))
    assert weight == pytest.approx([1 / 0.02**2, 1 / (4 * 0.02**2), 0.0], abs=1e-3)


@pytest.mark.parametrize("name", ["surface_sigma_m", "node_count", "rows_per_observation", "held_steps"])
@pytest.mark.parametrize("value", [-1, float("nan")])
def test_a_configuration_that_cannot_work_is_refused(name, value):
    with pytest.raises(ValueError, match=name):
        RegistrationConfig(**{name: value})
