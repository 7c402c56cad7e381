"""Compiled matrices of reactionless manipulation along prescribed end-effector paths.

With constant attitude the base only translates. Everything is in the axes of the base; positions are with
respect to the system's centre of mass, which is at rest.
"""

import threading
from dataclasses import dataclass

import casadi as ca
import numpy as np

from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot


@dataclass(frozen=True, eq=False)
class Matrices:
    """Matrices at one configuration.

    Attributes:
        positions: (2 d,) m, of the end-effectors from the system's centre of mass; d is 2 in the plane, else
            3.
        task: (2 d + r, n): end-effector velocities per joint rate with constant attitude (the linear rows of
            J_g in reactionless motion), and Ibm~ of eq. 4 of shah2013 in its last r rows (1 or 3), divided by
            `scale` so that its rows have the unit of a velocity.
        angular: (k, n) angular velocities of the end-effectors, one row each in the plane, else three.
        mass: (n, n) I_m of eq. 12 in reactionless motion, kg m^2.
    """

    positions: Array
    task: Array
    angular: Array
    mass: Array


@dataclass(frozen=True, eq=False)
class PathModel:
    """Matrices of one robot as a function of the joint angles.

    Attributes:
        dimensions: d. momenta: r, number of angular-momentum components. scale: kg m, of Ibm~'s rows.
        symbolic: q -> positions, task, angular, mass as a CasADi function to build on.
    """

    dimensions: int
    momenta: int
    scale: float
    symbolic: ca.Function
    _buffers: threading.local
    _compiled: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "PathModel":
        """Return the model of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if it is interpreted, several times slower.
        """
        return _build(robot)

    def __call__(self, q: Array) -> Matrices:
        """The matrices at joint angles q (n,) rad."""
        if not hasattr(self._buffers, "call"):
            buffer, call = self._compiled.buffer()
            f = self._compiled
            place = np.zeros(f.numel_in(0))
            buffer.set_arg(0, memoryview(place))  # pyright: ignore[reportCallIssue, reportArgumentType]
            results = [np.zeros(f.numel_out(i)) for i in range(f.n_out())]
            for i, result in enumerate(results):
                buffer.set_res(i, memoryview(result))  # pyright: ignore[reportCallIssue, reportArgumentType]
            shaped = [r.reshape(f.size_out(i), order="F") for i, r in enumerate(results)]
            self._buffers.call = (buffer, call, place, shaped)
        _, call, place, shaped = self._buffers.call
        place[:] = q
        call()
        ends, task, angular, mass = (np.array(result) for result in shaped)
        return Matrices(ends[:, 0], task, angular, mass)


@built_once
def _build(robot: FloatingRobot) -> PathModel:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot, rest = ca.SX.sym("q", n), ca.SX.sym("qdot", n), ca.SX(6, 1)
    total = symbolic.momentum(q, qdot, rest)
    mass = float(robot.mass.sum())
    _, _, axes, _, centre = symbolic.kinematics(q)
    linear, angular = total[:3], total[3:] - ca.cross(centre, total[:3])
    planar = bool(angular[0].is_zero() and angular[1].is_zero())
    momentum = angular[2] if planar else angular
    energy = symbolic.kinetic_energy(q, qdot, rest) - 0.5 * ca.dot(linear, linear) / mass
    d = 2 if planar else 3
    positions = [
        symbolic.end_effector_pose(arm)(q)[0] - centre for arm in range(len(robot.end_effector_link))
    ]
    ends = ca.vertcat(*[position[:d] for position in positions])
    # Ibm~ has the unit kg m^2; divided by mass times a metre of the arms it is a velocity per rate.
    scale = float(robot.mass[1:].sum())
    task = ca.vertcat(ca.jacobian(ends, q), ca.jacobian(momentum, qdot) / scale)
    rows = []
    for link in robot.end_effector_link:
        carried = ca.DM(robot.carries[:, int(link) - 1]).T
        spin = axes * ca.repmat(carried, 3, 1)
        rows.append(spin[2, :] if planar else spin)
    outputs = [ends, task, ca.vertcat(*rows), ca.hessian(energy, qdot)[0]]
    function = ca.Function("along_paths", [q], [ca.densify(value) for value in ca.cse(outputs)])
    ready = compiled({"along_paths": function})["along_paths"]
    return PathModel(d, 1 if planar else 3, scale, function, threading.local(), ready)
