"""Motions that docs/primer.md explains, computed with the project's own dynamics.

All are of the planar robot with two arms, from rest, so that its total momentum is zero. Arm 2 keeps its
posture except where the reaction null space moves it.
"""

from collections.abc import Callable

import numpy as np

from space_envs.dynamics import FloatingRobot, minimum_jerk, roll_out_base, trajectory_cost
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array, rotate
from space_envs.robots.models import robot_mechanics
from space_envs.robots.zoo import find_robot

ROBOT = find_robot("shah2013")
ARM = slice(0, 3)  # joints of the arm that moves
REACH = np.array([1.5, -0.9, -0.5, 0.0, 0.0, 0.0])  # rad, joint displacement of the examples
DURATION = 20.0  # s, of a motion or of one round
NODES = 401
LINE = np.array([-0.2, 1.5])  # m, straight displacement asked of the end-effector
LOOP = 0.5  # rad, amplitude of the loop in the space of two joints


class PlanarMotion:
    """A joint motion and the base motion that follows from it at zero momentum.

    Attributes:
        time: (T,) s. q: (T, 6) rad. angle: (T,) of the base, rad. position: (T, 3) of the base, inertial, m.
        points: (T, 2, 4, 2) mount, joints and end-effector of both arms, inertial x and y, m.
        cost: eq. 20 of Shyam et al. (2020) times dt, m^2/s.
    """

    def __init__(self, q: Array, qdot: Array, dt: float, base_held: bool = False) -> None:
        robot = planar_robot()
        self.time, self.q = dt * np.arange(len(q)), q
        self.position, quaternion = roll_out_base(robot, q, qdot, dt)
        self.cost = float(trajectory_cost(robot, q, qdot, dt))
        if base_held:
            self.position, quaternion = np.zeros_like(self.position), np.tile([1.0, 0, 0, 0], (len(q), 1))
        self.angle = np.unwrap(2.0 * np.arctan2(quaternion[:, 3], quaternion[:, 0]))
        joints = robot.kinematics(q).position.reshape(len(q), 2, 3, 3)
        ends = np.stack([robot.end_effector_pose(q, arm)[0] for arm in (0, 1)], axis=1)
        points = np.concatenate([joints, ends[:, :, None]], axis=2)
        moved = self.position[:, None, None] + rotate(quaternion[:, None, None], points)
        self.points = moved[..., :2]

    @property
    def rotation(self) -> float:
        """Angle between the first and the last attitude of the base, deg."""
        return float(np.degrees(self.angle[-1] - self.angle[0]))


def planar_robot() -> FloatingRobot:
    """The planar robot with two arms."""
    return robot_mechanics(ROBOT)


def swing(duration: float = DURATION, base_held: bool = False) -> PlanarMotion:
    """Arm 1 moves by `REACH` with minimum jerk, the base free or held by external forces and torques."""
    home = planar_robot().home
    return PlanarMotion(*minimum_jerk(home, home + REACH, duration, NODES), base_held)


def reactionless_swing() -> PlanarMotion:
    """The rates of `swing` projected onto the reaction null space at every configuration."""
    robot = planar_robot()
    rates = minimum_jerk(robot.home, robot.home + REACH, DURATION, 2 * NODES - 1)[1]
    return _integrated(
        lambda half_step, q, angle: reactionless_projection(robot.base_map(q)[3:], rates[half_step])
    )


def straight_line(generalized: bool) -> PlanarMotion:
    """Resolved motion rate control of arm 1 along `LINE`.

    Args:
        generalized: whether with the generalised Jacobian, or with that of the arm on a base assumed fixed.
    """
    robot = planar_robot()
    velocity = minimum_jerk(np.zeros(2), LINE, DURATION, 2 * NODES - 1)[1]

    def rates(half_step: int, q: Array, angle: float) -> Array:
        seen = angle if generalized else 0.0
        to_base = np.array([[np.cos(seen), np.sin(seen)], [-np.sin(seen), np.cos(seen)]])
        every = robot.generalized_jacobian(q, 0) if generalized else robot.end_effector_jacobians(q, 0)[1]
        qdot = np.zeros(robot.n_joints)
        qdot[ARM] = np.linalg.pinv(every[:2, ARM]) @ to_base @ velocity[half_step]
        return qdot

    return _integrated(rates)


def loops(rounds: int) -> PlanarMotion:
    """Joints 1 and 2 follow a closed loop several times, at rest after each round at the initial angles."""
    robot = planar_robot()
    phase, slope, dt = minimum_jerk(np.zeros(1), np.full(1, 2.0 * np.pi), DURATION, NODES)
    q, qdot = np.tile(robot.home, (NODES, 1)), np.zeros((NODES, robot.n_joints))
    q[:, :2] += LOOP * np.concatenate([np.cos(phase) - 1.0, np.sin(phase)], axis=1)
    qdot[:, :2] = LOOP * slope * np.concatenate([-np.sin(phase), np.cos(phase)], axis=1)
    positions, rates = (np.concatenate([x[:1], *[x[1:]] * rounds]) for x in (q, qdot))
    return PlanarMotion(positions, rates, dt)


def _integrated(rates: Callable[[int, Array, float], Array]) -> PlanarMotion:
    """The motion of joint rates that depend on half steps of time, angles and the base's angle (RK4)."""
    robot, dt = planar_robot(), DURATION / (NODES - 1)

    def slope(half_step: int, state: Array) -> Array:
        qdot = rates(half_step, state[:-1], state[-1])
        return np.append(qdot, robot.base_twist(state[:-1], qdot)[5])

    states = np.empty((NODES, robot.n_joints + 1))
    states[0] = np.append(robot.home, 0.0)
    for node in range(NODES - 1):
        state = states[node]
        first = slope(2 * node, state)
        second = slope(2 * node + 1, state + dt / 2 * first)
        third = slope(2 * node + 1, state + dt / 2 * second)
        fourth = slope(2 * node + 2, state + dt * third)
        states[node + 1] = state + dt / 6 * (first + 2 * second + 2 * third + fourth)
    qdot = np.array([slope(2 * node, state)[:-1] for node, state in enumerate(states)])
    return PlanarMotion(states[:, :-1], qdot, dt)
