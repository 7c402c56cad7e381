"""Slope of a path in the reaction null space, and its derivatives in closed form, as expressions.

Along a path dq/ds = P(q) v, where P is the projector onto the null space of A(q) (3, n), the angular
momentum about the centre of mass per joint rate while the base does not rotate. With a_j, u_j the velocity of
the bodies beyond joint j at a unit rate (angular, and linear at the centre of mass), m_j, h_j, I_j their
mass, and first and second moment about the centre of mass, the columns of linear and angular momentum are

    p_j = m_j u_j + a_j x h_j,    s_j = I_j a_j + h_j x u_j,    A = [s_1 ... s_n].

A rotation of joint j takes the bodies beyond it along. With w_j = u_j - p_j / M (M the whole mass) the change
of column i is therefore

    a_j x s_i + w_j x p_i                        if joint i is j or beyond it,
    dI_j a_i + p_j x w_i                         if joint j is beyond joint i,
    dI_j x = a_j x I_j x - I_j (a_j x x) + 2 (h_j.u_j) x - h_j (u_j.x) - u_j (h_j.x).
"""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot


@dataclass(frozen=True, eq=False)
class _Moving:
    """Bodies beyond a joint: velocity at its unit rate, moments, and the momentum at that rate."""

    axis: ca.SX
    linear: ca.SX
    moment: ca.SX
    inertia: ca.SX
    momentum: ca.SX
    spin: ca.SX
    relative: ca.SX  # linear velocity less that of the centre of mass of the robot

    def turned_inertia(self, x: ca.SX) -> ca.SX:
        """Change of the second moment by a rotation of the joint, times x (3)."""
        turned = ca.cross(self.axis, self.inertia @ x) - self.inertia @ ca.cross(self.axis, x)
        moved = 2.0 * ca.dot(self.moment, self.linear) * x
        return turned + moved - self.moment * ca.dot(self.linear, x) - self.linear * ca.dot(self.moment, x)


class FlowStage:
    """Expressions of a robot at joint angles q (n); `q` and `v` are their symbols."""

    def __init__(self, robot: FloatingRobot) -> None:
        self.q, self.v = ca.SX.sym("q", robot.n_joints), ca.SX.sym("v", robot.n_joints)
        self._beyond = _descent(robot)
        self._joints, self.centre = _moving(robot, self.q)
        rows = ca.horzcat(*(joint.spin for joint in self._joints))
        self._rows, self._inverse = rows, rows.T @ _inverse(rows @ rows.T)
        self.slope = self.v - self._rows.T @ (self._inverse.T @ self.v)

    @cached_property
    def projector(self) -> ca.SX:
        """P (n, n), the derivative of the slope by v."""
        return ca.SX.eye(len(self._joints)) - self._inverse @ self._rows

    @property
    def centre_by_angle(self) -> ca.SX:
        """Derivative (3, n) of the centre of mass in the base frame."""
        return ca.horzcat(*(joint.linear - joint.relative for joint in self._joints))

    def by_angle(self) -> ca.SX:
        """Derivative (n, n) of the slope by q.

        With A x = 0 for x = P v it is -P (dA' l) - A^+ (dA x), where l solves A A' l = A v.
        """
        multiplier = self._inverse.T @ self.v
        moved = ca.horzcat(*(self._moved(j) for j in range(len(self._joints))))
        return -(self.projector @ self._turned(multiplier) + self._inverse @ moved)

    def _turned(self, multiplier: ca.SX) -> ca.SX:
        """Derivative (n, n) of A' l by q."""
        columns = []
        for j, joint in enumerate(self._joints):
            across_axis, across_linear = (ca.cross(multiplier, x) for x in (joint.axis, joint.relative))
            across, changed = ca.cross(multiplier, joint.momentum), joint.turned_inertia(multiplier)
            rows = []
            for i, other in enumerate(self._joints):
                if self._beyond[j, i]:
                    row = ca.dot(other.spin, across_axis) + ca.dot(other.momentum, across_linear)
                elif self._beyond[i, j]:
                    row = ca.dot(other.axis, changed) + ca.dot(other.relative, across)
                else:
                    row = ca.dot(other.relative - other.linear, across)
                rows.append(row)
            columns.append(ca.vertcat(*rows))
        return ca.horzcat(*columns)

    def _moved(self, j: int) -> ca.SX:
        """Derivative (3) of A x by the angle of joint j, at fixed x: the slope."""
        joint, zero = self._joints[j], ca.SX(3, 1)
        spin, momentum, axis, relative = zero, zero, zero, zero
        for i, other in enumerate(self._joints):
            rate = self.slope[i]
            if self._beyond[j, i]:
                spin, momentum = spin + rate * other.spin, momentum + rate * other.momentum
            elif self._beyond[i, j]:
                axis, relative = axis + rate * other.axis, relative + rate * other.relative
            else:
                relative = relative + rate * (other.relative - other.linear)
        own = ca.cross(joint.axis, spin) + ca.cross(joint.relative, momentum)
        return own + joint.turned_inertia(axis) + ca.cross(joint.momentum, relative)


def _descent(robot: FloatingRobot) -> np.ndarray:
    """Mask (n, n): whether joint i (column) is joint j (row) or beyond it."""
    n = robot.n_joints
    beyond = np.eye(n, dtype=bool)
    for i, parent in enumerate(robot.parent):
        if parent > 0:
            beyond[:, i] |= beyond[:, parent - 1]
    return beyond


def _moving(robot: FloatingRobot, q: ca.SX) -> tuple[list[_Moving], ca.SX]:
    """Bodies beyond every joint, and the centre of mass (3) in the base frame."""
    rotation, position, axis, com, centre = SymbolicRobot(robot).kinematics(q)
    rotations, total = ca.horzsplit(rotation, 3), float(robot.mass.sum())
    mass, moment, inertia = [], [], []
    for i, turned in enumerate(rotations):
        own, place = float(robot.mass[i + 1]), com[:, i] - centre
        mass.append(own)
        moment.append(own * place)
        central = turned @ ca.DM(robot.inertia[i + 1]) @ turned.T
        inertia.append(central + own * (ca.dot(place, place) * ca.SX.eye(3) - place @ place.T))
    joints = []
    for i in reversed(range(robot.n_joints)):
        linear = ca.cross(position[:, i] - centre, axis[:, i])
        momentum = mass[i] * linear + ca.cross(axis[:, i], moment[i])
        spin = inertia[i] @ axis[:, i] + ca.cross(moment[i], linear)
        relative = linear - momentum / total
        joints.append(_Moving(axis[:, i], linear, moment[i], inertia[i], momentum, spin, relative))
        if (parent := int(robot.parent[i]) - 1) >= 0:
            mass[parent] += mass[i]
            moment[parent] += moment[i]
            inertia[parent] += inertia[i]
    return joints[::-1], centre


def _inverse(a: ca.SX) -> ca.SX:
    """Inverse of a symmetric matrix (3, 3) by its cofactors."""
    columns = [a[:, 0], a[:, 1], a[:, 2]]
    crossed = [ca.cross(columns[k - 2], columns[k - 1]) for k in range(3)]
    return ca.horzcat(*crossed) / ca.dot(columns[0], crossed[0])
