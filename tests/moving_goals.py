"""Moving goals that the tests of all planners of the single arm share, with the tolerances of their ends."""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import exponential, rotate
from space_envs.tasks.single_arm import SingleArmTask

RATE = np.deg2rad(5.0)  # of the bodies
DURATION = 10.0  # s
ARM = np.array([0.25, 0.0, 0.0])  # m, from the axis of rotation to the grapple, body's axes
TRIAXIAL = np.array([1.0, 1.6, 2.2])
ENDS = {
    "position_error": 0.01,
    "rotation_error": np.deg2rad(1.0),
    "linear_velocity_error": 0.01,
    "angular_velocity_error": np.deg2rad(1.0),
}


def circling(number: int, duration: float = DURATION) -> Reach:
    """Reach to a grapple that circles, and whose pose at T is a validation goal of medium difficulty."""
    return _reach(number, duration, np.array([0.0, 0.0, 1.0]))


def tumbling(number: int, duration: float = DURATION) -> Reach:
    """The same on a body that rotates about its unstable axis, nearly."""
    return _reach(number, duration, np.array([0.3, 0.9, -0.3]))


def _reach(number: int, duration: float, axis: np.ndarray) -> Reach:
    task = SingleArmTask()
    goals = task.goals("validation", np.array([number]))
    position, quaternion = goals.position[0], goals.quaternion[0]
    attitude = exponential(np.array([0.4, -0.3, 0.7]) * (1.0 + number))
    spin = rotate(attitude, RATE * axis / np.linalg.norm(axis))
    body = PoseTwist(position - rotate(attitude, ARM), attitude, np.zeros(3), spin)
    goal = Grapple.on_body(body, TRIAXIAL, position, quaternion).after(-duration)
    return Reach(task.mechanics.home, goal, duration).checked(task.mechanics)


def assert_intercepted(reach: Reach, plan: ReachPlan | Failure, checked: ReachPlan) -> None:
    """Assert that a plan, as measured by `check`, ends at the grapple and as fast as it."""
    assert not isinstance(plan, Failure), plan.reason
    for name, most in ENDS.items():
        assert checked.violation[name] < most, (name, checked.violation[name])
    assert reach.goal.moves


def windowed(reach: Reach, earliest: float, latest: float) -> Reach:
    """The same problem with a time of interception that the planner chooses."""
    return replace(reach, window=(earliest, latest))
