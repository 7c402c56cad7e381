"""The momentum-level mathematics of `floating.py` as CasADi functions, of the same robot.

The algorithm is another one, so that each checks the other: velocities are handed from link to link in the
links' own axes (Newton-Euler), momentum is summed on the way back, and the matrices are the derivatives of
momentum and of kinetic energy. `floating.py` sums composite bodies in base axes instead.

Frames are those of `floating.py`: all quantities are in the axes of the base frame. A twist is [v; w]: linear
velocity of the base origin, then angular velocity. Momentum is [p; L] with L about the base origin.
"""

from functools import cached_property

import casadi as ca
import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array


class SymbolicRobot:
    """CasADi functions of one robot; each is built when it is first asked for.

    Inputs and outputs are columns and matrices, by name: q (n) rad, qdot (n) rad/s, qddot (n) rad/s^2,
    twist (6) [v; w] m/s and rad/s; momentum (6) is [p; L], N s and N m s.
    """

    def __init__(self, robot: FloatingRobot) -> None:
        self.robot = robot
        n = robot.n_joints
        self._q, self._qdot, self._qddot = (ca.SX.sym(name, n) for name in ("q", "qdot", "qddot"))
        self._twist = ca.SX.sym("twist", 6)
        # Pose of link i + 1 in its parent: the hinge's turn first, then the fixed mounting.
        self._turn = [_about(axis, self._q[i]) for i, axis in enumerate(robot.hinge)]
        self._mounting = [ca.SX(ca.sparsify(ca.DM(_snapped(m)))) for m in robot.mounting]
        self._offset = [ca.SX(ca.sparsify(ca.DM(o))) for o in robot.offset]
        # Constant, per body: first moment and inertia about the body frame's origin.
        self._moment = [ca.SX(ca.sparsify(ca.DM(m * c))) for m, c in zip(robot.mass, robot.com, strict=True)]
        self._inertia = [
            ca.SX(ca.sparsify(ca.DM(_snapped(i + m * (c @ c * np.eye(3) - np.outer(c, c))))))
            for i, m, c in zip(robot.inertia, robot.mass, robot.com, strict=True)
        ]

    @cached_property
    def kinematics(self) -> ca.Function:
        """q -> rotation (3, 3 n) link axes side by side; position (3, n), axis (3, n), com (3, n) m."""
        rotation, position = self._poses()
        links = range(1, self.robot.n_joints + 1)
        axis = [rotation[i] @ ca.DM(self.robot.hinge[i - 1]) for i in links]
        com = [position[i] + rotation[i] @ ca.DM(self.robot.com[i]) for i in links]
        outputs = [ca.horzcat(*columns) for columns in (rotation[1:], position[1:], axis, com)]
        return self._function("kinematics", ["q"], ["rotation", "position", "axis", "com"], outputs)

    @cached_property
    def momentum(self) -> ca.Function:
        """q, qdot, twist -> momentum (6)."""
        return self._function("momentum", ["q", "qdot", "twist"], ["momentum"], [self._total(self._twist)])

    @cached_property
    def momentum_matrices(self) -> ca.Function:
        """q -> base (6, 6) H_b and coupling (6, n) H_bm: momentum = H_b twist + H_bm qdot."""
        total = self._total(self._twist)
        outputs = [ca.jacobian(total, self._twist), ca.jacobian(total, self._qdot)]
        return self._function("momentum_matrices", ["q"], ["base", "coupling"], outputs)

    @cached_property
    def base_map(self) -> ca.Function:
        """q -> base_map (6, n) from joint rates to the base twist at zero momentum."""
        return self._function("base_map", ["q"], ["base_map"], [self._base_map])

    @cached_property
    def base_twist(self) -> ca.Function:
        """q, qdot -> twist (6) at zero momentum. The compiled kernel is this function."""
        return self._function("base_twist", ["q", "qdot"], ["twist"], [self._free_twist])

    def end_effector_pose(self, tip: int = 0) -> ca.Function:
        """q -> position (3) m and rotation (3, 3) of an end-effector in the base frame."""
        return self._function("end_effector_pose", ["q"], ["position", "rotation"], list(self._tip_pose(tip)))

    def generalized_jacobian(self, tip: int = 0) -> ca.Function:
        """q -> jacobian (6, n), base axes: end-effector [v; w] per joint rate at zero momentum."""
        position, rotation = self._tip_pose(tip)
        turning = [  # The axial vector of (dR/dq_j) R^T is the angular velocity of a unit rate of joint j.
            ca.inv_skew(ca.reshape(ca.jacobian(ca.vec(rotation), self._q[j]), 3, 3) @ rotation.T)
            for j in range(self.robot.n_joints)
        ]
        linear, angular = self._base_map[:3, :], self._base_map[3:, :]
        linear = ca.jacobian(position, self._q) + linear - ca.skew(position) @ angular
        jacobian = ca.vertcat(linear, ca.horzcat(*turning) + angular)
        return self._function("generalized_jacobian", ["q"], ["jacobian"], [jacobian])

    @cached_property
    def kinetic_energy(self) -> ca.Function:
        """q, qdot, twist -> energy, J, with that of the rotors."""
        inputs = ["q", "qdot", "twist"]
        return self._function("kinetic_energy", inputs, ["energy"], [self._energy(self._twist)])

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """q -> mass (6 + n, 6 + n) of the velocities [twist; qdot]."""
        velocity = ca.vertcat(self._twist, self._qdot)
        mass = ca.hessian(self._energy(self._twist), velocity)[0]
        return self._function("mass_matrix", ["q"], ["mass"], [mass])

    @cached_property
    def reduced_mass(self) -> ca.Function:
        """q -> mass (n, n) that the joints feel at zero momentum (I_m of eq. 12 of shah2013)."""
        mass = ca.hessian(self._energy(self._free_twist), self._qdot)[0]
        return self._function("reduced_mass", ["q"], ["mass"], [mass])

    @cached_property
    def inverse_dynamics(self) -> ca.Function:
        """q, qdot, qddot -> torque (n) N m at zero momentum, the base floating.

        Newton and Euler's recursion; the base accelerates as the zero momentum wants it.
        """
        twist = self._free_twist
        change = ca.jtimes(twist, self._q, self._qdot) + ca.jtimes(twist, self._qdot, self._qddot)
        linear, angular = change[:3] + ca.cross(twist[3:], twist[:3]), change[3:]
        forces = self._forces(linear, angular)
        torque = ca.DM(self.robot.rotor_inertia) * self._qddot
        for link in reversed(range(self.robot.n_joints)):
            parent, (force, moment) = int(self.robot.parent[link]), forces[link + 1]
            torque[link] += ca.dot(ca.DM(self.robot.hinge[link]), moment)
            force, moment = (self._mounting[link] @ (self._turn[link] @ x) for x in (force, moment))
            sums = forces[parent]
            forces[parent] = sums[0] + force, sums[1] + moment + ca.cross(self._offset[link], force)
        return self._function("inverse_dynamics", ["q", "qdot", "qddot"], ["torque"], [torque])

    def _function(self, name: str, inputs: list[str], outputs: list[str], values: list[ca.SX]) -> ca.Function:
        arguments = [getattr(self, f"_{symbol}") for symbol in inputs]
        return ca.Function(name, arguments, ca.cse(values), inputs, outputs)

    def _poses(self) -> tuple[list[ca.SX], list[ca.SX]]:
        """Axes and origin of every body in the base frame, the base first."""
        rotation, position = [ca.SX.eye(3)], [ca.SX(3, 1)]
        for link, parent in enumerate(self.robot.parent):
            position.append(position[parent] + rotation[parent] @ self._offset[link])
            rotation.append(rotation[parent] @ self._mounting[link] @ self._turn[link])
        return rotation, position

    def _tip_pose(self, tip: int) -> tuple[ca.SX, ca.SX]:
        rotation, position = self._poses()
        link = int(self.robot.end_effector_link[tip])
        point = position[link] + rotation[link] @ ca.DM(self.robot.end_effector_offset[tip])
        return point, rotation[link] @ ca.DM(_snapped(self.robot.end_effector_mounting[tip]))

    def _velocities(self, twist: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Velocity of every body frame's origin and its angular velocity, in that body's axes."""
        velocities = [(twist[:3], twist[3:])]
        for link, parent in enumerate(self.robot.parent):
            linear, angular = velocities[parent]
            linear = linear + ca.cross(angular, self._offset[link])
            linear, angular = (self._turn[link].T @ (self._mounting[link].T @ x) for x in (linear, angular))
            velocities.append((linear, angular + ca.DM(self.robot.hinge[link]) * self._qdot[link]))
        return velocities

    def _body_momentum(self, body: int, linear: ca.SX, angular: ca.SX) -> tuple[ca.SX, ca.SX]:
        moment = self._moment[body]
        p = float(self.robot.mass[body]) * linear + ca.cross(angular, moment)
        return p, self._inertia[body] @ angular + ca.cross(moment, linear)

    def _total(self, twist: ca.SX) -> ca.SX:
        """Total momentum [p; L]: every body's, carried from the tips to the base."""
        sums = [self._body_momentum(body, *velocity) for body, velocity in enumerate(self._velocities(twist))]
        for link in reversed(range(self.robot.n_joints)):
            parent = int(self.robot.parent[link])
            p, turning = (self._mounting[link] @ (self._turn[link] @ x) for x in sums[link + 1])
            sums[parent] = (sums[parent][0] + p, sums[parent][1] + turning + ca.cross(self._offset[link], p))
        return ca.vertcat(*sums[0])

    def _forces(self, linear: ca.SX, angular: ca.SX) -> list[tuple[ca.SX, ca.SX]]:
        """Force and moment about its origin that each body's own motion takes, in that body's axes.

        Args:
            linear, angular: (3,) acceleration of the base's origin and its angular acceleration, base axes.
        """
        accelerations = [(linear, angular)]
        turning = [velocity[1] for velocity in self._velocities(self._free_twist)]
        for link, parent in enumerate(self.robot.parent):
            linear, angular = accelerations[parent]
            offset, spin = self._offset[link], turning[parent]
            linear = linear + ca.cross(angular, offset) + ca.cross(spin, ca.cross(spin, offset))
            linear, angular, spin = (
                self._turn[link].T @ (self._mounting[link].T @ x) for x in (linear, angular, spin)
            )
            hinge = ca.DM(self.robot.hinge[link])
            angular = angular + hinge * self._qddot[link] + ca.cross(spin, hinge * self._qdot[link])
            accelerations.append((linear, angular))
        forces = []
        for body, ((linear, angular), spin) in enumerate(zip(accelerations, turning, strict=True)):
            moment, inertia = self._moment[body], self._inertia[body]
            inner = ca.cross(angular, moment) + ca.cross(spin, ca.cross(spin, moment))
            outer = inertia @ angular + ca.cross(spin, inertia @ spin) + ca.cross(moment, linear)
            forces.append((float(self.robot.mass[body]) * linear + inner, outer))
        return forces

    def _energy(self, twist: ca.SX) -> ca.SX:
        # A rotor counts with the rate of its own joint alone, as in MuJoCo, and has no momentum.
        energy = 0.5 * ca.dot(ca.DM(self.robot.rotor_inertia), self._qdot**2)
        for body, (linear, angular) in enumerate(self._velocities(twist)):
            p, turning = self._body_momentum(body, linear, angular)
            energy += 0.5 * (ca.dot(linear, p) + ca.dot(angular, turning))
        return energy

    @cached_property
    def _system(self) -> tuple[ca.SX, ca.SX]:
        """First moment (3) and inertia (3, 3) of the whole robot about the base origin, base axes."""
        mass, moment, inertia = self.robot.mass.copy(), list(self._moment), list(self._inertia)
        for link in reversed(range(self.robot.n_joints)):
            parent, offset = int(self.robot.parent[link]), self._offset[link]
            first, second = moment[link + 1], inertia[link + 1]
            for turn in (self._turn[link], self._mounting[link]):
                first, second = turn @ first, _symmetric(turn @ second @ turn.T)
            shift = ca.skew(offset)
            across = shift @ ca.skew(first)
            second = second - across - across.T - float(mass[link + 1]) * (shift @ shift)
            moment[parent] = moment[parent] + first + float(mass[link + 1]) * offset
            inertia[parent] = inertia[parent] + _symmetric(second)
            mass[parent] += mass[link + 1]
        return moment[0], inertia[0]

    def _solve(self, momentum: ca.SX) -> ca.SX:
        """Twist (6) of the whole robot, joints locked, that has this momentum: H_b^-1 momentum.

        The system's centre of mass separates the two halves: only a symmetric 3 by 3 system is left.
        """
        total = float(self.robot.mass.sum())
        moment, inertia = self._system
        com = moment / total
        p, turning = momentum[:3], momentum[3:]
        square = ca.dot(moment, com)
        central = _symmetric(inertia - square * ca.SX.eye(3) + moment @ com.T)
        angular = _solve_symmetric(central, turning - ca.cross(com, p))
        return ca.vertcat(p / total - ca.cross(angular, com), angular)

    @cached_property
    def _free_twist(self) -> ca.SX:
        return self._solve(-self._total(ca.SX(6, 1)))

    @cached_property
    def _base_map(self) -> ca.SX:
        return ca.jacobian(self._free_twist, self._qdot)


def _about(axis: Array, angle: ca.SX) -> ca.SX:
    """Rotation matrix about a unit axis; entries that the axis leaves at 0 or 1 are structural."""
    along = np.outer(axis, axis)
    skew = ca.sparsify(ca.skew(ca.DM(axis)))
    return (
        ca.cos(angle) * ca.sparsify(ca.DM(np.eye(3) - along))
        + ca.sin(angle) * skew
        + ca.sparsify(ca.DM(along))
    )


def _snapped(matrix: Array) -> Array:
    """Entries within rounding of -1, 0 or 1 made exact, which keeps expressions sparse.

    Models store quarter turns as quaternions, whose matrices are exact to 2e-16 only.
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
