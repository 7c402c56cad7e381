"""Goals of the single arm from observations: grapples at rest, or on the moving body that is observed."""

import numpy as np

from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

_BODY = ("target_position", "target_quaternion", "target_linear_velocity", "target_angular_velocity")


def observed_goals(context: PolicyContext, observation: Array) -> Grapple:
    """Grapples (N) of observations (N, size) in the inertial frame; their t = 0 is the time of observation.

    A moving grapple moves with the observed target, which is torque-free; without one in the observation it
    keeps its present velocities.
    """

    def read(name: str) -> Array:
        return context.layout.read(observation, name)

    pose = read("goal_position"), read("goal_quaternion")
    if context.goals == "static":
        return Grapple.at_rest(*pose)
    if all(name in context.layout.slices for name in _BODY):
        return Grapple.on_body(PoseTwist(*map(read, _BODY)), target_inertia(context), *pose)
    velocities = read("goal_linear_velocity"), read("goal_angular_velocity")
    return Grapple.on_body(PoseTwist(*pose, *velocities), np.ones(3), *pose)


def target_inertia(context: PolicyContext) -> Array:
    """Principal moments (3,) of the target, kg m^2, in the nominal model."""
    return context.model.body("target").inertia.copy()


def goal_twist(context: PolicyContext, observation: Array) -> Array:
    """Twists (N, 6) [v; w] of the grapples a control period later, m/s and rad/s in inertial axes.

    The drives reach the rates of a command at the end of a period.
    """
    if context.goals == "static":
        return np.zeros((len(observation), 6))
    return observed_goals(context, observation).at(context.control_period).twist
