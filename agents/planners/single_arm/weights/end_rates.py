"""Joint rates with which motions in weight space meet a moving goal."""

import numpy as np

from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.tasks.goals.kinds import asked_jacobian


def matching_rates(robot: FloatingRobot, reach: Reach, space: WeightSpace, y: Array) -> Array:
    """Least joint rates (n,), rad/s, with which the end-effector moves as the goal does at T.

    Only velocities that the kind of goal asks for are matched.

    Args:
        y: (n, m) coordinates of a motion of `space` to the goal.
    """
    q, attitude = space.last(y)
    # The Jacobian is in axes of the base, the goal's twist in inertial ones.
    wanted = reach.end.twist.reshape(2, 3) @ attitude
    approach = robot.end_effector_pose(q)[1][:, 2]
    asked = asked_jacobian(reach.kind, robot.generalized_jacobian(q), approach)
    return np.linalg.lstsq(asked, wanted.ravel(), rcond=1e-6)[0]
