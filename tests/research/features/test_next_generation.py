"""The most similar node by distances to anchors, signature and place together, against brute force."""

import numpy as np
import pytest

from anchorpose.research.experiment.methods.next_generation import MOST, most_similar

pytestmark = pytest.mark.thorough

SUBSETS = np.array([[0, 1, 2], [1, 3, 4]])


@pytest.mark.parametrize("seed", range(3))
def test_the_most_similar_node_is_that_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    local = rng.uniform(0, 4, (20, 50)).astype(np.float32)
    seen = (rng.uniform(0, 1, (20, 5)).astype(np.float32), rng.uniform(0, 1, (20, 3)).astype(np.float32))
    others = (rng.uniform(0, 1, (50, 5)).astype(np.float32), rng.uniform(0, 1, (50, 3)).astype(np.float32))
    others[0][::7, 1] = np.inf
    others[0][::5, 3] = np.nan
    match, total = most_similar(local, seen, others, SUBSETS, (25.0, 16.0))
    place2 = np.minimum(16.0 * ((seen[1][:, None] - others[1]) ** 2).sum(axis=2), MOST)
    anchor2 = np.nan_to_num(np.minimum(25.0 * (seen[0][:, None] - others[0]) ** 2, MOST), nan=MOST)
    for s, subset in enumerate(SUBSETS):
        expected = local + place2 + anchor2[:, :, subset].sum(axis=2)
        np.testing.assert_array_equal(match[:, s], expected.argmin(axis=1))
        np.testing.assert_allclose(total[:, s], expected.min(axis=1), rtol=1e-5)


def test_a_distance_that_a_hole_changed_costs_no_more_than_three_deviations() -> None:
    local = np.zeros((1, 2), np.float32)
    source, place = np.full((1, 5), 0.5, np.float32), np.zeros((1, 3), np.float32)
    target = np.array([[5.0, 0.5, 0.5, 0.5, 0.5], [0.5, 0.65, 0.65, 0.5, 0.5]], np.float32)
    match, total = most_similar(
        local, (source, place), (target, np.zeros((2, 3), np.float32)), SUBSETS[:1], (625.0, 1.0)
    )
    assert (match[0, 0], total[0, 0]) == (0, pytest.approx(MOST))
