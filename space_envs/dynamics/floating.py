"""Momentum-level mathematics of a free-floating robot, batched over configurations.

All quantities are in the axes of the base frame (the satellite's) unless stated otherwise; they do not
depend on the pose of the base. A twist is [v; w]: linear velocity of the base origin, then angular velocity.
Momentum is [p; L] with L about the base origin.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from space_envs.dynamics.rotations import Array, cross
from space_envs.dynamics.tree import RobotTree

_BLOCK = 2048  # samples: more do not fit into the cache, fewer make the loops too short


@dataclass(frozen=True)
class Kinematics:
    """Poses of the links in the base frame, for configurations of any batch shape (...).

    Attributes:
        rotation: (..., n, 3, 3) axes of link frames.
        position: (..., n, 3) origins of link frames, which lie on the joint axes, m.
        axis: (..., n, 3) joint axes, unit.
        com: (..., n, 3) centres of mass of the links, m.
    """

    rotation: Array
    position: Array
    axis: Array
    com: Array


@dataclass(frozen=True, eq=False)
class FloatingRobot(RobotTree):
    """Momentum-level mathematics of a robot, whose parameters are those of `RobotTree`."""

    @cached_property
    def _hinge_terms(self) -> tuple[Array, Array, Array]:
        """Mounting times the three terms of Rodrigues' formula: R(q) = A + sin(q) B + (1 - cos(q)) C.

        Each (n, 3, 3, 1), the last axis for samples.
        """
        k = _skew(self.hinge)
        terms = self.mounting, self.mounting @ k, self.mounting @ k @ k
        return terms[0][..., None], terms[1][..., None], terms[2][..., None]

    def kinematics(self, q: Array) -> Kinematics:
        """Forward kinematics of the links in the base frame, q (..., n) rad."""
        n = self.n_joints
        return Kinematics(*self._by_blocks(q, self._kinematics, (n, 3, 3), (n, 3), (n, 3), (n, 3)))

    def momentum_matrices(self, q: Array) -> tuple[Array, Array]:
        """Base inertia H_b (..., 6, 6) and coupling inertia H_bm (..., 6, n): [p; L] = H_b xi + H_bm qdot.

        Eq. 7b of shyam2020 including the linear part (docs/physics.md explains why), by composite bodies.
        """
        base, coupling = self._by_blocks(q, self._momentum_matrices, (6, 6), (6, self.n_joints))
        return base, coupling

    def _by_blocks(
        self, q: Array, function: Callable[[Array], tuple[Array, ...]], *shapes: tuple[int, ...]
    ) -> list[Array]:
        """Apply a function of columns (n, samples) to q (..., n), a block of samples at a time.

        Samples along the last axis make every operation a long loop over contiguous numbers, and a block
        stays in the cache: three times as fast as stacks of small matrices. Only products and sums of
        single numbers are used in it, so that a sample's result does not depend on its neighbours.
        """
        q = self.joint_array(q)
        flat = q.reshape(-1, self.n_joints)
        results = [np.empty((len(flat), *shape)) for shape in shapes]
        for start in range(0, len(flat), _BLOCK):
            block = slice(start, start + _BLOCK)
            for result, value in zip(results, function(np.ascontiguousarray(flat[block].T)), strict=True):
                result[block] = np.moveaxis(value, -1, 0)
        return [result.reshape(*q.shape[:-1], *result.shape[1:]) for result in results]

    def _kinematics(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """Fields of `Kinematics` with the samples along the last axis."""
        still, sine, cosine = self._hinge_terms
        angle = q[:, None, None]
        rotation = still + np.sin(angle) * sine + (1.0 - np.cos(angle)) * cosine  # in the parent
        position = np.empty((self.n_joints, 3, q.shape[-1]))
        for link, parent in enumerate(self.parent):
            offset = self.offset[link][:, None]
            if parent == 0:
                position[link] = offset
            else:
                upper = rotation[parent - 1]
                position[link] = position[parent - 1] + _apply(upper, offset)
                rotation[link] = _product(upper, rotation[link])
        axis = _apply(rotation, self.hinge[..., None])
        return rotation, position, axis, position + _apply(rotation, self.com[1:, :, None])

    def _momentum_matrices(self, q: Array) -> tuple[Array, Array]:
        rotation, position, axis, com = self._kinematics(q)
        # Mass, first moment and inertia about the base origin of every body, then of its whole subtree.
        body_mass = self.mass[:, None, None]
        place = np.empty((self.n_joints + 1, 3, q.shape[-1]))
        place[0], place[1:] = self.com[0][:, None], com
        moment = body_mass * place
        inertia = np.empty((self.n_joints + 1, 3, 3, q.shape[-1]))
        inertia[0] = self.inertia[0][..., None]
        inertia[1:] = _product(_product(rotation, self.inertia[1:, ..., None]), rotation.swapaxes(1, 2))
        inertia -= moment[:, :, None] * place[:, None, :]
        inertia[:, range(3), range(3)] += (moment * place).sum(axis=1)[:, None]
        mass = self.mass.copy()
        for link in range(self.n_joints, 0, -1):
            parent = self.parent[link - 1]
            mass[parent] += mass[link]
            moment[parent] += moment[link]
            inertia[parent] += inertia[link]

        at_origin = _cross(position, axis)  # velocity of the body point at the base origin, unit joint rate
        coupling = np.empty((6, self.n_joints, q.shape[-1]))
        coupling[:3] = (mass[1:, None, None] * at_origin + _cross(axis, moment[1:])).swapaxes(0, 1)
        coupling[3:] = (_cross(moment[1:], at_origin) + _apply(inertia[1:], axis)).swapaxes(0, 1)
        base = np.zeros((6, 6, q.shape[-1]))
        base[range(3), range(3)] = mass[0]
        base[3:, :3] = np.moveaxis(_skew(moment[0].T), 0, -1)
        base[:3, 3:] = -base[3:, :3]
        base[3:, 3:] = inertia[0]
        return base, coupling

    def base_map(self, q: Array) -> Array:
        """Map (..., 6, n) from joint rates to the base twist at zero momentum: -H_b^-1 H_bm."""
        base, coupling = self.momentum_matrices(q)
        return -_solve(base, coupling)

    def base_twist(self, q: Array, qdot: Array) -> Array:
        """Base twist (..., 6) in base axes at zero momentum, m/s and rad/s.

        `space_envs.dynamics.base_twist` computes the same with compiled code.

        Args:
            q: (..., n) rad. qdot: (..., n) rad/s.
        """
        base, coupling = self.momentum_matrices(q)
        return _solve(base, -(coupling @ self.joint_array(qdot, "joint rates")[..., None]))[..., 0]

    def momentum(self, q: Array, qdot: Array, twist: Array) -> Array:
        """Total momentum (..., 6) [p; L] in base axes, L about the base origin, N s and N m s.

        Args:
            q, qdot: (..., n) rad and rad/s.
            twist: (..., 6) of the base, base axes, m/s and rad/s.
        """
        base, coupling = self.momentum_matrices(q)
        moving = coupling @ self.joint_array(qdot, "joint rates")[..., None]
        return (base @ np.asarray(twist)[..., None] + moving)[..., 0]

    def end_effector_pose(self, q: Array, index: int = 0) -> tuple[Array, Array]:
        """Position (..., 3) m and rotation (..., 3, 3) of an end-effector in the base frame."""
        k = self.kinematics(q)
        upper = k.rotation[..., self.end_effector_link[index] - 1, :, :]
        position = (
            k.position[..., self.end_effector_link[index] - 1, :] + upper @ self.end_effector_offset[index]
        )
        return position, upper @ self.end_effector_mounting[index]

    def end_effector_jacobians(self, q: Array, index: int = 0) -> tuple[Array, Array]:
        """Jacobians J_s (..., 6, 6) of the base twist and J_m (..., 6, n) of the joint rates.

        The end-effector's inertial velocity, in base axes, is J_s xi + J_m qdot (eq. 7a of shyam2020).
        """
        k = self.kinematics(q)
        link = self.end_effector_link[index] - 1
        point = k.position[..., link, :] + k.rotation[..., link, :, :] @ self.end_effector_offset[index]
        linear = cross(k.axis, point[..., None, :] - k.position)
        arm = np.concatenate([linear, k.axis], axis=-1).swapaxes(-1, -2) * self.carries[:, link]
        base = np.zeros((*point.shape[:-1], 6, 6))
        base[..., range(6), range(6)] = 1.0
        base[..., :3, 3:] = -_skew(point)
        return base, arm

    def generalized_jacobian(self, q: Array, index: int = 0) -> Array:
        """J* (..., 6, n), base axes: end-effector velocity per joint rate at zero momentum (eq. 8)."""
        base, arm = self.end_effector_jacobians(q, index)
        return arm + base @ self.base_map(q)

    def centre_of_mass(self, kinematics: Kinematics) -> Array:
        """Centre of mass (..., 3) of the whole robot in the base frame, m."""
        return (self.mass[1:] @ kinematics.com + self.mass[0] * self.com[0]) / self.mass.sum()

    def reach(self, index: int = 0) -> float:
        """Largest distance of an end-effector from the system's centre of mass over all configurations, m.

        At rest the floating arm is a fixed arm with shorter links whose shoulder is the centre of mass (the
        virtual manipulator of Vafa and Dubowsky): the distance is at most the sum of its links. Hinges that
        cannot stretch it fully only make the true reach smaller.
        """
        total = self.mass.sum()
        chain = [int(self.end_effector_link[index])]
        while chain[-1] != 0:
            chain.append(int(self.parent[chain[-1] - 1]))
        # Body-fixed vectors whose sum is (end-effector - system centre of mass); one per body.
        vectors = -(self.mass / total)[:, None] * self.com
        vectors[chain[0]] += self.end_effector_offset[index]
        for link in range(1, self.n_joints + 1):
            outboard = self.carries[link - 1] @ self.mass[1:] / total
            vectors[self.parent[link - 1]] += (float(link in chain) - outboard) * self.offset[link - 1]
        return float(np.linalg.norm(vectors, axis=1).sum())


def _solve(a: Array, b: Array) -> Array:
    return np.asarray(np.linalg.solve(a, b), dtype=np.float64)


def _skew(v: Array) -> Array:
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


# Below, samples lie along the last axis: vectors (..., 3, samples), matrices (..., 3, 3, samples).


def _apply(matrix: Array, vector: Array) -> Array:
    return (
        matrix[..., 0, :] * vector[..., None, 0, :]
        + matrix[..., 1, :] * vector[..., None, 1, :]
        + matrix[..., 2, :] * vector[..., None, 2, :]
    )


def _product(a: Array, b: Array) -> Array:
    return (
        a[..., :, 0, None, :] * b[..., None, 0, :, :]
        + a[..., :, 1, None, :] * b[..., None, 1, :, :]
        + a[..., :, 2, None, :] * b[..., None, 2, :, :]
    )


def _cross(a: Array, b: Array) -> Array:
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, :] = a[..., j, :] * b[..., k, :] - a[..., k, :] * b[..., j, :]
    return out
