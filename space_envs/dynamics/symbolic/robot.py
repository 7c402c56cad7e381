"""Momentum-level mathematics of `floating.py` as CasADi functions.

The algorithm differs, so that each checks the other: velocities are propagated from link to link in the
links' own axes (Newton-Euler), momentum is summed in the opposite direction, and the matrices are the
derivatives of momentum and of kinetic energy (`expressions.py`). `floating.py` sums composite bodies in base
axes instead.

Frames are those of `floating.py`: all quantities are in the axes of the base frame. A twist is [v; w]: linear
velocity of the base origin, then angular velocity. Momentum is [p; L] with L about the base origin.
"""

from functools import cached_property

import casadi as ca

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.symbolic.expressions import BodyExpressions


class SymbolicRobot:
    """CasADi functions of one robot, each built at its first use.

    Inputs and outputs are columns and matrices, by name: q (n) rad, qdot (n) rad/s, qddot (n) rad/s^2,
    twist (6) [v; w] m/s and rad/s; momentum (6) is [p; L], N s and N m s.
    """

    def __init__(self, robot: FloatingRobot) -> None:
        self.robot, self._bodies = robot, BodyExpressions(robot)

    @cached_property
    def kinematics(self) -> ca.Function:
        """q -> rotation (3, 3 n) link axes next to each other; position (3, n), axis (3, n), com (3, n) m;
        centre_of_mass (3) m of the whole robot."""
        rotation, position = self._bodies.poses()
        links = range(1, self.robot.n_joints + 1)
        axis = [rotation[i] @ ca.DM(self.robot.hinge[i - 1]) for i in links]
        com = [position[i] + rotation[i] @ ca.DM(self.robot.com[i]) for i in links]
        outputs = [ca.horzcat(*columns) for columns in (rotation[1:], position[1:], axis, com)]
        mass = self.robot.mass
        moment = outputs[-1] @ ca.DM(mass[1:]) + float(mass[0]) * ca.DM(self.robot.com[0])
        names = ["rotation", "position", "axis", "com", "centre_of_mass"]
        return self._function("kinematics", ["q"], names, [*outputs, moment / float(mass.sum())])

    @cached_property
    def momentum(self) -> ca.Function:
        """q, qdot, twist -> momentum (6)."""
        return self._function(
            "momentum", ["q", "qdot", "twist"], ["momentum"], [self._bodies.momentum(self._bodies.twist)]
        )

    @cached_property
    def momentum_matrices(self) -> ca.Function:
        """q -> base (6, 6) H_b and coupling (6, n) H_bm: momentum = H_b twist + H_bm qdot."""
        total = self._bodies.momentum(self._bodies.twist)
        outputs = [ca.jacobian(total, self._bodies.twist), ca.jacobian(total, self._bodies.qdot)]
        return self._function("momentum_matrices", ["q"], ["base", "coupling"], outputs)

    @cached_property
    def base_map(self) -> ca.Function:
        """q -> base_map (6, n) from joint rates to the base twist at zero momentum."""
        return self._function("base_map", ["q"], ["base_map"], [self._bodies.base_map])

    @cached_property
    def base_twist(self) -> ca.Function:
        """q, qdot -> twist (6) at zero momentum; `space_envs.dynamics.base_twist` compiles it."""
        return self._function("base_twist", ["q", "qdot"], ["twist"], [self._bodies.free_twist])

    def end_effector_pose(self, index: int = 0) -> ca.Function:
        """q -> position (3) m and rotation (3, 3) of an end-effector in the base frame."""
        return self._function(
            "end_effector_pose", ["q"], ["position", "rotation"], list(self._bodies.end_effector(index))
        )

    def generalized_jacobian(self, index: int = 0) -> ca.Function:
        """q -> jacobian (6, n), base axes: end-effector [v; w] per joint rate at zero momentum."""
        jacobian = self._bodies.generalized_jacobian(index)
        return self._function("generalized_jacobian", ["q"], ["jacobian"], [jacobian])

    @cached_property
    def kinetic_energy(self) -> ca.Function:
        """q, qdot, twist -> energy, J, including the rotors."""
        inputs = ["q", "qdot", "twist"]
        return self._function("kinetic_energy", inputs, ["energy"], [self._bodies.energy(self._bodies.twist)])

    @cached_property
    def mass_matrix(self) -> ca.Function:
        """q -> mass (6 + n, 6 + n) of the velocities [twist; qdot]."""
        velocity = ca.vertcat(self._bodies.twist, self._bodies.qdot)
        mass = ca.hessian(self._bodies.energy(self._bodies.twist), velocity)[0]
        return self._function("mass_matrix", ["q"], ["mass"], [mass])

    @cached_property
    def reduced_mass(self) -> ca.Function:
        """q -> mass (n, n) seen by the joints at zero momentum (I_m of eq. 12 of shah2013)."""
        mass = ca.hessian(self._bodies.energy(self._bodies.free_twist), self._bodies.qdot)[0]
        return self._function("reduced_mass", ["q"], ["mass"], [mass])

    @cached_property
    def inverse_dynamics(self) -> ca.Function:
        """q, qdot, qddot -> torque (n) N m at zero momentum, with a floating base."""
        torque = self._bodies.torque()
        return self._function("inverse_dynamics", ["q", "qdot", "qddot"], ["torque"], [torque])

    def _function(self, name: str, inputs: list[str], outputs: list[str], values: list[ca.SX]) -> ca.Function:
        arguments = [getattr(self._bodies, symbol) for symbol in inputs]
        return ca.Function(name, arguments, ca.cse(values), inputs, outputs)
