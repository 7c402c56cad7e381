"""Goals around a robot's home: the task that takes the robot, and whether goals can be drawn."""

import numpy as np

from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.registration import ENTRIES, make_task
from space_envs.robots.robot import Robot

SPLIT = "validation"


def task_of(robot: Robot) -> str:
    """Id of the first registered task that takes a robot.

    Raises:
        ConfigurationError: if there is none.
    """
    reasons: dict[str, None] = {}
    for env_id in ENTRIES:
        try:
            make_task(env_id, {"robot": robot})
        except SpaceEnvsError as error:
            reasons[str(error)] = None
        else:
            return env_id
    raise ConfigurationError(f"no task takes robot {robot.name!r}: {'; '.join(reasons)}")


def goal_problem(robot: Robot) -> str:
    """Reason why no task takes a robot, or its first validation goals cannot be drawn; empty if they can."""
    try:
        make_task(task_of(robot), {"robot": robot}).goals(SPLIT, np.arange(1))
    except SpaceEnvsError as error:
        return str(error)
    return ""
