"""Grapples on freely moving bodies, against conservation laws, differences and closed forms."""

import numpy as np
import pytest

from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import (
    angle_between,
    conjugate,
    exponential,
    logarithm,
    multiply,
    rotate,
    to_matrix,
)

RATE = np.deg2rad(5.0)
TIMES = np.linspace(0.0, 40.0, 81)
TRIAXIAL = np.array([1.0, 1.6, 2.2])


def tumbling() -> Grapple:
    """A grapple on a triaxial body that drifts and rotates mostly about its unstable axis."""
    turn = exponential(np.array([0.3, -0.8, 0.5]))
    spin = rotate(turn, RATE * np.array([0.3, 1.0, -0.4]))
    body = PoseTwist(np.array([0.4, 0.1, 1.2]), turn, np.array([0.01, -0.004, 0.002]), spin)
    return Grapple.on_body(body, TRIAXIAL, np.array([0.6, 0.0, 1.1]), exponential(np.array([1.0, 0.2, 0.1])))


def test_the_pose_at_rest_is_constant_and_exact() -> None:
    position, quaternion = np.array([0.3, -0.2, 1.0]), exponential(np.array([0.2, 0.4, -1.0]))
    grapple = Grapple.at_rest(position, quaternion)
    found = grapple.at(TIMES)
    assert not grapple.moves and not found.twist.any()
    assert (found.position == position).all() and (found.quaternion == quaternion).all()
    assert grapple.after(3.0) is grapple


def test_a_body_in_principal_rotation_carries_its_grapple_along_a_circle() -> None:
    turn, axis = exponential(np.array([0.5, 0.1, -0.3])), np.array([0.0, 0.0, 1.0])
    centre, arm = np.array([0.4, 0.2, 1.0]), np.array([0.25, 0.0, 0.0])
    spin = rotate(turn, RATE * axis)
    body = PoseTwist(centre, turn, np.zeros(3), spin)
    found = Grapple.on_body(body, TRIAXIAL, centre + rotate(turn, arm), turn).at(TIMES)
    angle = RATE * TIMES[:, None]
    circle = 0.25 * np.concatenate([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    np.testing.assert_allclose(found.position, centre + rotate(turn, circle), atol=1e-7)
    expected = multiply(turn, exponential(angle * axis))
    assert angle_between(found.quaternion, expected).max() < 1e-6
    assert np.linalg.norm(found.linear_velocity, axis=1) == pytest.approx(0.25 * RATE)


def test_momentum_and_energy_of_a_triaxial_body_are_constant() -> None:
    found = tumbling().at(TIMES)
    to_body = multiply(tumbling().orientation, conjugate(found.quaternion))
    local = rotate(to_body, found.angular_velocity)
    momentum = rotate(conjugate(to_body), TRIAXIAL * local)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(len(TIMES), 0), atol=1e-8)
    energy = (TRIAXIAL * local**2).sum(axis=1)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-6)
    assert (np.abs(local - local[0]).max(axis=0) > 0.02 * RATE).all()  # it is no steady rotation


def test_the_twist_is_the_derivative_of_the_pose() -> None:
    grapple, step = tumbling(), 1e-3
    for time in (0.0, 7.3, 25.0):
        before, now, after = (grapple.at(time + change) for change in (-step, 0.0, step))
        speed = (after.position - before.position) / (2.0 * step)
        rotation = logarithm(multiply(after.quaternion, conjugate(before.quaternion))) / (2.0 * step)
        np.testing.assert_allclose(now.linear_velocity, speed, atol=1e-7)
        np.testing.assert_allclose(now.angular_velocity, rotation, atol=1e-7)


def test_the_motion_is_the_same_from_a_later_time_on_and_in_another_frame() -> None:
    grapple, later = tumbling(), 12.5
    place, turn = np.array([0.1, 0.7, -0.4]), exponential(np.array([0.9, -0.2, 0.4]))
    expected, found = grapple.at(TIMES + later), grapple.after(later).in_frame(place, turn).at(TIMES)
    axes = to_matrix(turn)
    np.testing.assert_allclose(place + found.position @ axes.T, expected.position, atol=1e-6)
    np.testing.assert_allclose(found.linear_velocity @ axes.T, expected.linear_velocity, atol=1e-6)
    np.testing.assert_allclose(found.angular_velocity @ axes.T, expected.angular_velocity, atol=1e-6)
    assert angle_between(multiply(turn, found.quaternion), expected.quaternion).max() < 1e-6


def test_rows_of_a_batch_move_as_they_do_alone() -> None:
    one = tumbling()
    shifts = np.array([[0.0, 0.0, 0.0], [0.1, 0.2, 0.3]])
    body = PoseTwist(one.centre + shifts, one.attitude, one.linear_velocity, one.angular_velocity)
    batch = Grapple.on_body(body, TRIAXIAL, one.at(0.0).position + shifts, one.at(0.0).quaternion)
    together = batch.at(TIMES[:5])
    for row, shift in enumerate(shifts):
        for values, alone in zip(together, batch.row(row).at(TIMES[:5]), strict=True):
            np.testing.assert_allclose(values[row], alone, atol=1e-12)
        np.testing.assert_allclose(together.position[row], one.at(TIMES[:5]).position + shift, atol=1e-9)
