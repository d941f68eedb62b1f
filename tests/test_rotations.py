"""Rotations and directions: against scipy, and the laws they keep."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from anchorpose.rotations import (
    inverse_left_jacobian,
    orthonormal_frame,
    quaternions,
    rotation_matrices,
    rotation_vectors,
    turns,
    unit,
)

directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
angles = st.one_of(st.floats(0.0, 3.0), st.floats(-9.0, 0.0).map(lambda power: 10.0**power), st.just(0.0))


@settings(deadline=None, derandomize=True)
@given(directions, angles)
def test_the_inverse_left_jacobian_is_the_derivative_of_the_logarithm(direction, angle):
    w = np.array(direction) / np.linalg.norm(direction) * angle
    step = 1e-6

    def logarithm(d: np.ndarray) -> np.ndarray:
        return (Rotation.from_rotvec(d) * Rotation.from_rotvec(w)).as_rotvec()

    numeric = np.stack([(logarithm(d) - logarithm(-d)) / (2.0 * step) for d in step * np.eye(3)], axis=1)
    change = np.empty((3, 3))
    inverse_left_jacobian(w, change)
    np.testing.assert_allclose(change, numeric, atol=1e-6)


@settings(deadline=None, derandomize=True)
@given(directions, st.one_of(angles, st.floats(3.0, np.pi - 1e-6)))
def test_rotation_vectors_and_matrices_are_those_of_scipy(direction, angle):
    w = np.array(direction) / np.linalg.norm(direction) * angle
    matrix = Rotation.from_rotvec(w).as_matrix()
    np.testing.assert_allclose(rotation_matrices(w[None])[0], matrix, atol=1e-14)
    np.testing.assert_allclose(turns(w), matrix, atol=1e-14)
    np.testing.assert_allclose(rotation_vectors(matrix[None])[0], w, atol=1e-8)  # near pi few digits carry the vector
    real, *axis = quaternions(matrix[None])[0]
    np.testing.assert_allclose([*axis, real], Rotation.from_rotvec(w).as_quat(canonical=True), atol=1e-8)


def test_unit_vectors_have_length_one_and_no_direction_is_missing():
    vectors = np.array([[3.0, 0.0, 4.0], [0.0, 0.0, 0.0]])
    expected = [[0.6, 0.0, 0.8], [np.nan] * 3]
    np.testing.assert_allclose(unit(vectors), expected)
    np.testing.assert_allclose(unit(vectors.T, axis=0), np.transpose(expected))


def test_an_orthonormal_frame_keeps_its_first_axis():
    rng = np.random.default_rng(5)
    first, second = rng.normal(size=(2, 4, 3))
    frame = orthonormal_frame(first, second)
    np.testing.assert_allclose(frame @ np.swapaxes(frame, -1, -2), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frame), 1.0)
    np.testing.assert_allclose(frame[..., 0], unit(first))
