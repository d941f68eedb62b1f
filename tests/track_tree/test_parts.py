"""Parts on their own, as the paper registers them: Arun's fit, ICP, and what happens where too little is seen."""

import numpy as np
import pytest
from body_builder import adult_body, asset, random_pose
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from anchorpose.body.nearest_skin import Oriented
from anchorpose.body.skin_points import pose_points
from anchorpose.camera import transform_points
from anchorpose.errors import DegenerateGeometry
from anchorpose.rotations import fit_rigid_transform
from anchorpose.surface.surface import Nodes
from anchorpose.track_tree.parts import (
    ALIKE,
    ITERATIONS,
    LEAST_PAIRS,
    LEAST_SCALE_M,
    PAIR_ROUNDS,
    REACH_M,
    SHIFT_SIGMA_M,
    SURFACE_SIGMA_M,
    TURN_SIGMA,
    fit_pairs,
    joints_of_parts,
    register_parts,
)

IDENTITY = np.tile(np.eye(4), (3, 1, 1))


def rigid(turn_deg: tuple[float, float, float], shift_m: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(np.radians(turn_deg)).as_matrix()
    T[:3, 3] = shift_m
    return T


def a_limb(seed: int, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Nodes on an oval cylinder that tapers, and normals: no motion but the right one maps it onto itself."""
    rng = np.random.default_rng(seed)
    around, along = rng.uniform(0.0, np.pi, count), rng.uniform(0.0, 0.35, count)
    radius = 0.06 - 0.07 * along
    nodes = np.column_stack([radius * np.sin(around), along, 0.6 * radius * np.cos(around)])
    normals = np.column_stack([0.6 * np.sin(around), 0.6 * 0.07 * np.ones(count), np.cos(around)])
    return nodes, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_weights_of_zero_leave_rows_out():
    source, target = np.random.default_rng(20).normal(size=(2, 12, 3))
    weight = np.repeat([1.0, 0.0], 6)
    np.testing.assert_allclose(
        fit_rigid_transform(source, target, weight), fit_rigid_transform(source[:6], target[:6]), atol=1e-12
    )


def test_a_known_motion_is_found_exactly():
    source = np.random.default_rng(1).normal(size=(20, 3))
    T = rigid((20.0, -70.0, 130.0), (0.3, -1.0, 2.0))
    np.testing.assert_allclose(fit_rigid_transform(source, transform_points(T, source)), T, atol=1e-12)


def test_the_order_of_the_pairs_does_not_matter():
    rng = np.random.default_rng(2)
    source, target = rng.normal(size=(2, 15, 3))
    order = rng.permutation(15)
    np.testing.assert_allclose(
        fit_rigid_transform(source[order], target[order]), fit_rigid_transform(source, target), atol=1e-12
    )


def test_noise_leaves_the_least_squares_motion():
    rng = np.random.default_rng(3)
    source = rng.normal(size=(40, 3))
    target = transform_points(rigid((5.0, 10.0, -8.0), (0.1, 0.0, 0.2)), source) + rng.normal(0.0, 0.02, (40, 3))
    T = fit_rigid_transform(source, target)
    best = ((transform_points(T, source) - target) ** 2).sum()
    for turn in np.vstack([np.eye(3), -np.eye(3)]):
        beside = rigid(tuple(0.05 * turn), tuple(0.001 * turn)) @ T
        assert ((transform_points(beside, source) - target) ** 2).sum() > best


@pytest.mark.parametrize("seed", range(4))
def test_a_mirrored_body_is_never_answered_with_a_reflection(seed):
    body = np.random.default_rng(seed).normal(size=(12, 3))
    for target in (body * [-1.0, 1.0, 1.0], np.random.default_rng(seed + 50).normal(size=(12, 3))):
        T = fit_rigid_transform(body, target)
        np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_points_on_a_line_are_refused():
    line = np.outer(np.linspace(0.0, 1.0, 9), [1.0, 2.0, -1.0])
    with pytest.raises(DegenerateGeometry, match="collinear"):
        fit_rigid_transform(line, line)


@pytest.mark.parametrize("seed", range(4))
def test_points_that_all_go_to_one_place_are_refused(seed):
    rng = np.random.default_rng(seed)
    body, place = rng.normal(size=(18, 3)), rng.normal(size=3)
    with pytest.raises(DegenerateGeometry, match="collinear"):
        fit_rigid_transform(body, np.tile(place, (18, 1)))
    transforms, start = np.eye(4)[None].copy(), np.array([0, 18])
    fit_pairs(body, np.tile(place, (18, 1)), start, transforms, False)
    np.testing.assert_array_equal(transforms[0], np.eye(4))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_points_are_refused(count):
    with pytest.raises(DegenerateGeometry, match=f"{count} points"):
        fit_rigid_transform(np.eye(3)[:count], np.eye(3)[:count])


def parts_one_by_one(skin, part, matched_m, surface, T_predicted, iterations, robust) -> np.ndarray:
    """The reference: one part after another, in numpy."""
    tree = cKDTree(surface.points_m)
    transforms = T_predicted.copy()
    for bone in np.unique(part):
        own = part == bone
        paired = own & np.isfinite(matched_m).all(axis=1)
        T = pairs_fitted(skin.places_m[paired], matched_m[paired], T_predicted[bone], robust)
        transforms[bone] = T_predicted[bone] if T is None else T
        for _ in range(iterations):
            step = plane_step(Oriented(skin.places_m[own], skin.normals[own]), surface, tree, transforms[bone])
            if step is None:
                break
            transforms[bone] = step @ transforms[bone]
    return transforms


def pairs_fitted(skin_m: np.ndarray, matched_m: np.ndarray, T: np.ndarray, robust: bool) -> np.ndarray | None:
    if len(skin_m) < LEAST_PAIRS:
        return None
    try:
        if not robust:
            return fit_rigid_transform(skin_m, matched_m)
        for _ in range(PAIR_ROUNDS):
            residual = np.linalg.norm(transform_points(T, skin_m) - matched_m, axis=1)
            scale = max(float(np.median(residual)), LEAST_SCALE_M)
            T = fit_rigid_transform(skin_m, matched_m, 1.0 / (1.0 + (residual / scale) ** 2))
    except DegenerateGeometry:
        return None
    return T


def plane_step(skin: Oriented, surface: Nodes, tree: cKDTree, T: np.ndarray) -> np.ndarray | None:
    moved, facing = transform_points(T, skin.places_m), skin.normals @ T[:3, :3].T
    distance, nearest = tree.query(moved, distance_upper_bound=REACH_M)
    near = np.flatnonzero(np.isfinite(distance))
    node_normals = surface.normals[nearest[near]].astype(np.float64)
    alike = (node_normals * facing[near]).sum(axis=1) > ALIKE
    near, node_normals = near[alike], node_normals[alike]
    if len(near) < LEAST_PAIRS:
        return None
    direction = node_normals + facing[near]
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    residual = ((moved[near] - surface.points_m[nearest[near]]) * direction).sum(axis=1)
    centre = moved[near].mean(axis=0)
    rows = np.hstack([np.cross(moved[near] - centre, direction), direction])
    weight = 1.0 / (SURFACE_SIGMA_M * (1.0 + (residual / SURFACE_SIGMA_M) ** 2)) ** 2
    keep = np.repeat([1.0 / TURN_SIGMA**2, 1.0 / SHIFT_SIGMA_M**2], 3)
    change = -np.linalg.solve((rows * weight[:, None]).T @ rows + np.diag(keep), rows.T @ (weight * residual))
    step = np.eye(4)
    step[:3, :3] = Rotation.from_rotvec(change[:3]).as_matrix()
    step[:3, 3] = centre - step[:3, :3] @ centre + change[3:]
    return step


@pytest.mark.parametrize("robust", [True, False])
@pytest.mark.parametrize("iterations", [0, ITERATIONS])
@pytest.mark.parametrize("seed", range(4))
def test_all_parts_at_once_move_as_one_by_one(seed: int, iterations: int, robust: bool):
    rng, count = np.random.default_rng(seed), 400
    nodes, normals = a_limb(seed, count)
    part = rng.choice([0, 2, 3, 5, 6], count, p=[0.3, 0.3, 0.3, 0.09, 0.01])  # the last two with hardly a point
    nodes[part == 3] += [0.3, 0.0, 0.0]
    T = rigid((4.0, 8.0, -6.0), (0.02, 0.01, -0.01))
    _, surface = moved(T, nodes[part != 3], normals[part != 3])  # one part is not seen
    pairs = transform_points(T, nodes) + rng.normal(0.0, 0.02, nodes.shape)
    pairs[rng.random(count) < 0.3] = np.nan
    pairs[part == 2] = np.nan
    pairs[(part == 5) & np.isfinite(pairs[:, 0])] = [0.1, 0.2, 0.3]  # all in one place: they determine no turn
    predicted = np.tile(rigid((1.0, 0.0, 2.0), (0.01, 0.0, 0.0)), (7, 1, 1))
    given = (Oriented(nodes, normals), part, pairs, surface, predicted, iterations, robust)
    found, expected = register_parts(*given), parts_one_by_one(*given)
    np.testing.assert_allclose(found, expected, atol=1e-11)
    np.testing.assert_array_equal(changed(found, predicted), changed(expected, predicted))
    assert changed(found, predicted).any()
    assert not changed(found, predicted)[[1, 4]].any()


def changed(T_next_now: np.ndarray, predicted: np.ndarray = IDENTITY) -> np.ndarray:
    """Which parts were registered: the others keep their prediction to the last digit."""
    return np.asarray((T_next_now != predicted).any(axis=(1, 2)))


def a_surface(points_m: np.ndarray, normals: np.ndarray) -> Nodes:
    """Registration asks for places and normals only."""
    count = len(points_m)
    return Nodes(
        points_m.astype(np.float32),
        normals.astype(np.float32),
        np.zeros(count, np.uint8),
        np.zeros((count, 2), np.int16),
    )


def moved(T: np.ndarray, points_m: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, Nodes]:
    """Where the points go, and a surface of them."""
    after = transform_points(T, points_m)
    return after, a_surface(after, normals @ T[:3, :3].T)


def register(
    points_m: np.ndarray,
    normals: np.ndarray,
    part: np.ndarray,
    matched_m: np.ndarray,
    surface: Nodes,
    predicted: np.ndarray = IDENTITY,
    iterations: int = ITERATIONS,
    robust: bool = True,
) -> np.ndarray:
    return register_parts(Oriented(points_m, normals), part, matched_m, surface, predicted, iterations, robust)


def test_pairs_that_are_a_few_centimetres_off_are_refined_on_the_surface():
    T = rigid((4.0, 12.0, -6.0), (0.02, 0.01, -0.03))
    nodes, normals = a_limb(1, 400)
    after, surface = moved(T, nodes, normals)
    pairs = after + np.random.default_rng(2).normal(0.0, 0.02, after.shape)  # the descriptor's own error
    part = np.ones(len(nodes), dtype=int)
    rough = fit_rigid_transform(nodes, pairs)
    found = register(nodes, normals, part, pairs, surface, iterations=20)
    np.testing.assert_array_equal(changed(found), [False, True, False])

    def off(T_found: np.ndarray) -> float:
        return float(np.linalg.norm(transform_points(T_found, nodes) - after, axis=1).mean())

    assert off(found[1]) < 0.5 * off(rough)
    assert off(found[1]) < 0.002


def test_a_third_of_the_pairs_may_be_another_limbs():
    T = rigid((3.0, 5.0, 0.0), (0.01, 0.0, 0.02))
    nodes, normals = a_limb(8, 300)
    after, surface = moved(T, nodes, normals)
    pairs = after.copy()
    pairs[::3] += [0.0, 0.3, 0.2]
    found = register(nodes, normals, np.ones(len(nodes), int), pairs, surface, iterations=0)
    np.testing.assert_allclose(found[1], T, atol=5e-3)
    every = register(nodes, normals, np.ones(len(nodes), int), pairs, surface, iterations=0, robust=False)
    np.testing.assert_allclose(every[1], fit_rigid_transform(nodes, pairs))
    assert np.abs(every[1] - T).max() > 0.05


def test_a_body_that_has_strayed_from_the_surface_is_brought_back_without_a_pair():
    nodes, normals = a_limb(9, 300)
    after, surface = moved(np.eye(4), nodes, normals)
    strayed = np.add(nodes, [0.0, 0.0, 0.02])
    found = register(strayed, normals, np.ones(len(nodes), int), np.full_like(nodes, np.nan), surface, iterations=15)
    assert changed(found)[1]
    left = np.linalg.norm(transform_points(found[1], strayed) - after, axis=1).mean()
    assert left < 0.004


def test_what_no_plane_holds_does_not_slide():
    """Along a plain cylinder nodes say nothing: without pairs the part stays where it was predicted."""
    rng = np.random.default_rng(10)
    around, along = rng.uniform(0.0, np.pi, 400), rng.uniform(0.0, 0.3, 400)
    normals = np.column_stack([np.sin(around), np.zeros(400), np.cos(around)])
    nodes = 0.05 * normals + along[:, None] * [0.0, 1.0, 0.0]
    surface = a_surface(np.add(nodes, [0.0, 0.01, 0.0]), normals)
    found = register(nodes, normals, np.ones(400, int), np.full_like(nodes, np.nan), surface, iterations=10)
    assert abs(found[1, 1, 3]) < 0.002


def test_parts_move_each_on_its_own():
    motions = [rigid((0.0, 0.0, 10.0), (0.02, 0.0, 0.0)), rigid((5.0, 0.0, 0.0), (0.0, 0.0, 0.03))]
    (one, of_one), (two, of_two) = a_limb(3), a_limb(4)
    two = np.add(two, [0.0, 0.0, 0.6])
    after = [transform_points(T, limb) for T, limb in zip(motions, (one, two), strict=True)]
    turned = [normals @ T[:3, :3].T for T, normals in zip(motions, (of_one, of_two), strict=True)]
    part = np.repeat([0, 2], len(one))
    found = register(
        np.concatenate([one, two]),
        np.concatenate([of_one, of_two]),
        part,
        np.concatenate(after),
        a_surface(np.concatenate(after), np.concatenate(turned)),
    )
    np.testing.assert_array_equal(changed(found), [True, False, True])
    np.testing.assert_allclose(found[[0, 2]], motions, atol=1e-5)


def predicted_motions() -> np.ndarray:
    return np.stack([rigid((0.0, 3.0, 0.0), (0.01, 0.0, 0.0))] * 3)


@pytest.mark.parametrize("pairs", [0, 3, 5])
def test_a_part_of_which_too_little_is_seen_keeps_its_prediction_and_says_so(pairs):
    (nodes, normals), predicted = a_limb(5), predicted_motions()
    matched = np.full_like(nodes, np.nan)
    matched[:pairs] = nodes[:pairs]
    nowhere = a_surface(np.add(nodes, [0.0, 0.0, 1.0]), normals)
    found = register(nodes, normals, np.ones(len(nodes), int), matched, nowhere, predicted)
    np.testing.assert_array_equal(found, predicted)


def test_nodes_of_the_other_side_of_a_limb_are_not_its_skin():
    (nodes, normals), predicted = a_limb(6), predicted_motions()
    found = register(
        nodes, normals, np.ones(len(nodes), int), np.full_like(nodes, np.nan), a_surface(nodes, -normals), predicted
    )
    np.testing.assert_array_equal(found, predicted)


def test_a_part_whose_pairs_lie_on_a_line_keeps_its_prediction_and_says_so():
    nodes = np.outer(np.linspace(0.0, 0.3, 40), [0.0, 1.0, 0.0])
    normals, predicted = np.tile([0.0, 0.0, 1.0], (40, 1)), predicted_motions()
    found = register(nodes, normals, np.ones(40, int), nodes, a_surface(nodes, normals), predicted, iterations=0)
    np.testing.assert_array_equal(found, predicted)


def test_parts_that_stay_joined_have_the_joints_of_the_body():
    body = adult_body()
    transforms = pose_points(body, random_pose(3)).transforms
    joints = body.mesh.joints(transforms)
    found = joints_of_parts(asset(), body.mesh, transforms)
    np.testing.assert_allclose(found, joints, atol=1e-9)
