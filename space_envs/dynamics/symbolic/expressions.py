"""CasADi expressions of a robot's bodies: poses, velocities, momentum, forces and energy."""

from functools import cached_property

import casadi as ca
import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array


class BodyExpressions:
    """Expressions of the symbols q, qdot, qddot (n) and twist (6) of the base, in base axes unless noted."""

    def __init__(self, robot: FloatingRobot) -> None:
        self.robot = robot
        n = robot.n_joints
        self.q, self.qdot, self.qddot = (ca.SX.sym(name, n) for name in ("q", "qdot", "qddot"))
        self.twist = ca.SX.sym("twist", 6)
        # Pose of link i + 1 in its parent: the rotation of the hinge first, then the fixed mounting.
        self._hinge_rotation = [_about(axis, self.q[i]) for i, axis in enumerate(robot.hinge)]
        self._mounting = [ca.SX(ca.sparsify(ca.DM(_snapped(m)))) for m in robot.mounting]
        self._offset = [ca.SX(ca.sparsify(ca.DM(o))) for o in robot.offset]
        # Constant, per body: first moment and inertia about the body frame's origin.
        self._moment = [ca.SX(ca.sparsify(ca.DM(m * c))) for m, c in zip(robot.mass, robot.com, strict=True)]
        self._inertia = [
            ca.SX(ca.sparsify(ca.DM(_snapped(i + m * (c @ c * np.eye(3) - np.outer(c, c))))))
            for i, m, c in zip(robot.inertia, robot.mass, robot.com, strict=True)
        ]

    def torque(self) -> ca.SX:
        """Joint torques (n) at zero momentum, with a floating base, by the Newton-Euler recursion.

        The acceleration of the base follows from zero momentum.
        """
        twist = self.free_twist
        change = ca.jtimes(twist, self.q, self.qdot) + ca.jtimes(twist, self.qdot, self.qddot)
        linear, angular = change[:3] + ca.cross(twist[3:], twist[:3]), change[3:]
        forces = self._forces(linear, angular)
        torque = ca.DM(self.robot.rotor_inertia) * self.qddot
        for link in reversed(range(self.robot.n_joints)):
            parent, (force, moment) = int(self.robot.parent[link]), forces[link + 1]
            torque[link] += ca.dot(ca.DM(self.robot.hinge[link]), moment)
            force, moment = (self._mounting[link] @ (self._hinge_rotation[link] @ x) for x in (force, moment))
            sums = forces[parent]
            forces[parent] = sums[0] + force, sums[1] + moment + ca.cross(self._offset[link], force)
        return torque

    def generalized_jacobian(self, index: int) -> ca.SX:
        """Twist (6, n) of an end-effector per joint rate at zero momentum."""
        position, rotation = self.end_effector(index)
        rotations = [  # The axial vector of (dR/dq_j) R^T is the angular velocity of a unit rate of joint j.
            ca.inv_skew(ca.reshape(ca.jacobian(ca.vec(rotation), self.q[j]), 3, 3) @ rotation.T)
            for j in range(self.robot.n_joints)
        ]
        linear, angular = self.base_map[:3, :], self.base_map[3:, :]
        linear = ca.jacobian(position, self.q) + linear - ca.skew(position) @ angular
        return ca.vertcat(linear, ca.horzcat(*rotations) + angular)

    def poses(self) -> tuple[list[ca.SX], list[ca.SX]]:
        """Axes and origin of every body in the base frame, the base first."""
        rotation, position = [ca.SX.eye(3)], [ca.SX(3, 1)]
        for link, parent in enumerate(self.robot.parent):
            position.append(position[parent] + rotation[parent] @ self._offset[link])
            rotation.append(rotation[parent] @ self._mounting[link] @ self._hinge_rotation[link])
        return rotation, position

    def end_effector(self, index: int) -> tuple[ca.SX, ca.SX]:
        """Position and rotation of an end-effector in the base frame."""
        rotation, position = self.poses()
        link = int(self.robot.end_effector_link[index])
        point = position[link] + rotation[link] @ ca.DM(self.robot.end_effector_offset[index])
        return point, rotation[link] @ ca.DM(_snapped(self.robot.end_effector_mounting[index]))

    def velocities(self, twist: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Velocity of every body frame's origin and its angular velocity, in that body's axes."""
        velocities = [(twist[:3], twist[3:])]
        for link, parent in enumerate(self.robot.parent):
            linear, angular = velocities[parent]
            linear = linear + ca.cross(angular, self._offset[link])
            linear, angular = (
                self._hinge_rotation[link].T @ (self._mounting[link].T @ x) for x in (linear, angular)
            )
            velocities.append((linear, angular + ca.DM(self.robot.hinge[link]) * self.qdot[link]))
        return velocities

    def _body_momentum(self, body: int, linear: ca.SX, angular: ca.SX) -> tuple[ca.SX, ca.SX]:
        moment = self._moment[body]
        p = float(self.robot.mass[body]) * linear + ca.cross(angular, moment)
        return p, self._inertia[body] @ angular + ca.cross(moment, linear)

    def momentum(self, twist: ca.SX) -> ca.SX:
        """Total momentum [p; L], summed from the end-effectors to the base."""
        sums = [self._body_momentum(body, *velocity) for body, velocity in enumerate(self.velocities(twist))]
        for link in reversed(range(self.robot.n_joints)):
            parent = int(self.robot.parent[link])
            p, angular = (self._mounting[link] @ (self._hinge_rotation[link] @ x) for x in sums[link + 1])
            sums[parent] = (sums[parent][0] + p, sums[parent][1] + angular + ca.cross(self._offset[link], p))
        return ca.vertcat(*sums[0])

    def _forces(self, linear: ca.SX, angular: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Force on each body and moment about its origin by its own motion, in its axes.

        Args:
            linear, angular: (3,) acceleration of the base's origin and its angular acceleration, base axes.
        """
        accelerations = [(linear, angular)]
        spins = [velocity[1] for velocity in self.velocities(self.free_twist)]
        for link, parent in enumerate(self.robot.parent):
            linear, angular = accelerations[parent]
            offset, spin = self._offset[link], spins[parent]
            linear = linear + ca.cross(angular, offset) + ca.cross(spin, ca.cross(spin, offset))
            linear, angular, spin = (
                self._hinge_rotation[link].T @ (self._mounting[link].T @ x) for x in (linear, angular, spin)
            )
            hinge = ca.DM(self.robot.hinge[link])
            angular = angular + hinge * self.qddot[link] + ca.cross(spin, hinge * self.qdot[link])
            accelerations.append((linear, angular))
        forces = []
        for body, ((linear, angular), spin) in enumerate(zip(accelerations, spins, strict=True)):
            moment, inertia = self._moment[body], self._inertia[body]
            inner = ca.cross(angular, moment) + ca.cross(spin, ca.cross(spin, moment))
            outer = inertia @ angular + ca.cross(spin, inertia @ spin) + ca.cross(moment, linear)
            forces.append((float(self.robot.mass[body]) * linear + inner, outer))
        return forces

    def energy(self, twist: ca.SX) -> ca.SX:
        # As in MuJoCo a rotor moves with the rate of its own joint only, and has no momentum.
        energy = 0.5 * ca.dot(ca.DM(self.robot.rotor_inertia), self.qdot**2)
        for body, (linear, angular) in enumerate(self.velocities(twist)):
            p, angular_momentum = self._body_momentum(body, linear, angular)
            energy += 0.5 * (ca.dot(linear, p) + ca.dot(angular, angular_momentum))
        return energy

    @cached_property
    def _system(self) -> tuple[ca.SX, ca.SX]:
        """First moment (3) and inertia (3, 3) of the whole robot about the base origin, base axes."""
        mass, moment, inertia = self.robot.mass.copy(), list(self._moment), list(self._inertia)
        for link in reversed(range(self.robot.n_joints)):
            parent, offset = int(self.robot.parent[link]), self._offset[link]
            first, second = moment[link + 1], inertia[link + 1]
            for rotation in (self._hinge_rotation[link], self._mounting[link]):
                first, second = rotation @ first, _symmetric(rotation @ second @ rotation.T)
            shift = ca.skew(offset)
            across = shift @ ca.skew(first)
            second = second - across - across.T - float(mass[link + 1]) * (shift @ shift)
            moment[parent] = moment[parent] + first + float(mass[link + 1]) * offset
            inertia[parent] = inertia[parent] + _symmetric(second)
            mass[parent] += mass[link + 1]
        return moment[0], inertia[0]

    def _solve(self, momentum: ca.SX) -> ca.SX:
        """Twist (6) of the whole robot with locked joints for a momentum: H_b^-1 momentum.

        With respect to the centre of mass the two halves are separate: a symmetric 3 by 3 system remains.
        """
        total = float(self.robot.mass.sum())
        moment, inertia = self._system
        com = moment / total
        p, spin_momentum = momentum[:3], momentum[3:]
        square = ca.dot(moment, com)
        central = _symmetric(inertia - square * ca.SX.eye(3) + moment @ com.T)
        angular = _solve_symmetric(central, spin_momentum - ca.cross(com, p))
        return ca.vertcat(p / total - ca.cross(angular, com), angular)

    @cached_property
    def free_twist(self) -> ca.SX:
        return self._solve(-self.momentum(ca.SX(6, 1)))

    @cached_property
    def base_map(self) -> ca.SX:
        return ca.jacobian(self.free_twist, self.qdot)


def _about(axis: Array, angle: ca.SX) -> ca.SX:
    """Rotation matrix about a unit axis; entries that are always 0 or 1 are structural."""
    along = np.outer(axis, axis)
    skew = ca.sparsify(ca.skew(ca.DM(axis)))
    return (
        ca.cos(angle) * ca.sparsify(ca.DM(np.eye(3) - along))
        + ca.sin(angle) * skew
        + ca.sparsify(ca.DM(along))
    )


def _snapped(matrix: Array) -> Array:
    """Entries within rounding of -1, 0 or 1, replaced by these values: expressions then stay sparse.

    Models store rotations by pi/2 as quaternions, whose matrices are exact to 2e-16 only.
    """
    nearest = np.round(matrix)
    return np.where((np.abs(matrix - nearest) < 1e-15) & (np.abs(nearest) <= 1.0), nearest, matrix)


def _symmetric(matrix: ca.SX) -> ca.SX:
    """The matrix whose lower triangle is the upper one's, so that it is not computed twice."""
    return ca.triu2symm(ca.triu(matrix))


def _solve_symmetric(a: ca.SX, b: ca.SX) -> ca.SX:
    """Solve a symmetric 3 by 3 system by its adjugate: one division."""
    xx, xy, xz, yy, yz, zz = a[0, 0], a[0, 1], a[0, 2], a[1, 1], a[1, 2], a[2, 2]
    c0, c1, c2 = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    c3, c4, c5 = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    adjugate = ca.blockcat([[c0, c1, c2], [c1, c3, c4], [c2, c4, c5]])
    return (adjugate @ b) / (xx * c0 + xy * c1 + xz * c2)
