"""Rotations against MuJoCo's own routines and the laws of the rotation group."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from space_envs.dynamics import rotations
from space_envs.dynamics.rotations import Array

numbers = st.floats(-1.0, 1.0, allow_subnormal=False)
vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0, allow_subnormal=False))
quaternions = (
    arrays(np.float64, 4, elements=numbers)
    .filter(lambda q: np.linalg.norm(q) > 1e-3)
    .map(lambda q: q / np.linalg.norm(q))
)


def same_rotation(a: Array, b: Array, tolerance: float = 1e-12) -> bool:
    return bool(min(np.abs(a - b).max(), np.abs(a + b).max()) < tolerance)


@given(quaternions, quaternions, vectors)
def test_agrees_with_mujoco(a: Array, b: Array, v: Array) -> None:
    product, turned, matrix = np.empty(4), np.empty(3), np.empty(9)
    mujoco.mju_mulQuat(product, a, b)
    mujoco.mju_rotVecQuat(turned, v, a)
    mujoco.mju_quat2Mat(matrix, a)
    np.testing.assert_allclose(rotations.multiply(a, b), product, atol=1e-14)
    np.testing.assert_allclose(rotations.rotate(a, v), turned, atol=1e-13)
    np.testing.assert_allclose(rotations.to_matrix(a), matrix.reshape(3, 3), atol=1e-14)
    np.testing.assert_allclose(rotations.cross(v, a[1:]), np.cross(v, a[1:]), atol=1e-14)


@given(quaternions, vectors)
def test_inverse_undoes(q: Array, v: Array) -> None:
    back = rotations.rotate(rotations.conjugate(q), rotations.rotate(q, v))
    np.testing.assert_allclose(back, v, atol=1e-13)


@given(quaternions)
def test_matrix_and_back(q: Array) -> None:
    again = rotations.from_matrix(rotations.to_matrix(q))
    assert again[0] >= 0.0
    assert same_rotation(again, q, 1e-14)


@pytest.mark.parametrize("axis", range(3))
def test_matrix_of_half_turns(axis: int) -> None:
    q = np.zeros(4)
    q[1 + axis] = 1.0
    assert same_rotation(rotations.from_matrix(rotations.to_matrix(q)), q, 1e-15)


@given(arrays(np.float64, 3, elements=st.floats(-1.8, 1.8)))
def test_logarithm_inverts_exponential(v: Array) -> None:
    # 1.8 sqrt(3) rad is just less than a half turn, from where on the rotation vector is another.
    np.testing.assert_allclose(rotations.logarithm(rotations.exponential(v)), v, atol=1e-13, rtol=1e-12)


@given(quaternions)
def test_exponential_inverts_logarithm(q: Array) -> None:
    v = rotations.logarithm(q)
    assert np.linalg.norm(v) <= np.pi + 1e-12
    assert same_rotation(rotations.exponential(v), q)


@given(vectors)
def test_exponential_agrees_with_mujoco(v: Array) -> None:
    expected = np.array([1.0, 0.0, 0.0, 0.0])
    mujoco.mju_quatIntegrate(expected, v, 1.0)
    assert same_rotation(rotations.exponential(v), expected)


def test_small_rotation_vectors_keep_their_digits() -> None:
    v = np.array([3e-9, -4e-200, 1e-320])
    np.testing.assert_allclose(rotations.logarithm(rotations.exponential(v)), v, rtol=1e-14, atol=1e-310)


@given(quaternions, arrays(np.float64, 3, elements=st.floats(-1.8, 1.8)))
def test_angle_between_is_the_angle_of_the_difference(q: Array, v: Array) -> None:
    turned = rotations.multiply(q, rotations.exponential(v))
    angle = np.linalg.norm(v)
    assert rotations.angle_between(q, turned) == pytest.approx(angle, abs=1e-12)
    assert rotations.angle_between(-q, turned) == pytest.approx(angle, abs=1e-12)


@given(quaternions)
def test_canonical_has_positive_scalar_part(q: Array) -> None:
    out = rotations.canonical(q)
    assert out[0] >= 0.0
    assert same_rotation(out, q, 1e-15)


def test_batches_are_rows(rng: np.random.Generator) -> None:
    q = rng.normal(size=(2, 5, 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    v = 0.3 * rng.normal(size=(5, 3))  # broadcast over the first axis
    matrix = rotations.to_matrix(q)
    np.testing.assert_allclose(rotations.rotate(q, v), (matrix @ v[..., None])[..., 0], atol=1e-14)
    np.testing.assert_array_equal(rotations.from_matrix(matrix)[1, 3], rotations.from_matrix(matrix[1, 3]))
    np.testing.assert_array_equal(rotations.logarithm(q)[1, 3], rotations.logarithm(q[1, 3]))
    np.testing.assert_array_equal(rotations.exponential(v)[3], rotations.exponential(v[3]))
    expected = rotations.multiply(q[1, 3], rotations.exponential(v[3]))
    np.testing.assert_array_equal(rotations.multiply(q, rotations.exponential(v))[1, 3], expected)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)
