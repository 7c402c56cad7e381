"""Check that the drives can brake an initial state: by their braking law and by the torque needed."""

import numpy as np

from space_envs.drives import BRAKING_SHARE, STOP_MARGIN, JointStops, braking_shares
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals


def braking_load(task: CaptureTask, goals: Goals, velocity: Array) -> Array:
    """Share (k, n) of each drive's torque needed to brake initial joint rates (k, n), rad/s."""
    rows, simulation = np.arange(len(velocity)), Simulation(task.model, len(velocity))
    simulation.scale_base(rows, goals.mass_scale)
    simulation.joint_position[:], simulation.joint_velocity[:] = goals.joint_position, velocity
    simulation.set_base_velocity(rows)
    simulation.refresh()
    return braking_shares(simulation, JointStops(task.robot))


def check_brakes(task: CaptureTask, goals: Goals, velocity: Array | None) -> None:
    """Reject starts from which the drives cannot stop the joints before the ends of their ranges.

    Args:
        goals: k of the task, with the joint angles at the start. velocity: (k, n) rad/s, or None for rest.

    Raises:
        ConfigurationError: for a joint within the margin of its stop, or too fast to brake before it, and for
            joints that together need more of a drive's torque than `BRAKING_SHARE`.
    """
    position = goals.joint_position
    if not len(position):
        return
    limits = task.robot.joint_range
    near = (position < limits[:, 0] + STOP_MARGIN) | (position > limits[:, 1] - STOP_MARGIN)
    if near.any():
        row, joint = np.argwhere(near)[0]
        raise ConfigurationError(
            f"joint_position outside its limits: joint {joint + 1} starts at {position[row, joint]:.6g} rad, "
            f"and the drives stop it {STOP_MARGIN:g} rad inside its range {limits[joint].tolist()}"
        )
    if velocity is None:
        return
    low, high = JointStops(task.robot).rates(position)
    late = (velocity < low) | (velocity > high)
    if late.any():
        row, joint = np.argwhere(late)[0]
        raise ConfigurationError(
            f"joint_velocity outside its limits: joint {joint + 1} starts at {position[row, joint]:.6g} rad "
            f"with {velocity[row, joint]:.6g} rad/s, and can brake before the end of its range from "
            f"{low[row, joint]:.6g} to {high[row, joint]:.6g} rad/s"
        )
    load = braking_load(task, goals, velocity)
    if (load > BRAKING_SHARE).any():
        row, joint = np.unravel_index(load.argmax(), load.shape)
        slower = np.floor(1e3 * np.sqrt(BRAKING_SHARE / load[row, joint])) / 1e3  # the load is quadratic
        raise ConfigurationError(
            f"joint_velocity outside its limits: to brake all joints together takes {load[row, joint]:.3g} "
            f"of the torque of joint {joint + 1}, and may take {BRAKING_SHARE:g}; the same rates times "
            f"{slower:g} are accepted"
        )
