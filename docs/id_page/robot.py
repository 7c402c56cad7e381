"""Sections of an id's page about the robot and its actions."""

import inspect

import numpy as np

from docs.reading import (
    number,
    table,
)
from space_envs.control import CONTROL_MODES, MODES
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.robots import LEAST_TIMESTEP


def _steps(task: CaptureTask) -> str:
    return f"{LEAST_TIMESTEP:g} to {task.robot.steps.largest_timestep:g}"


def robot_section(env: CaptureVectorEnv) -> str:
    """Section on the robot."""
    robot, drive, task = env.task.mechanics, env.drive, env.task
    steps = task.robot.steps
    free = "two slides and a hinge" if env.simulation.planar else "six degrees of freedom"
    rows = [
        ("bodies", f"satellite {robot.mass[0]:g} kg, {robot.n_joints} links {robot.mass[1:].sum():g} kg"),
        ("base", f"{free}; not actuated, gravity is zero"),
        ("home, rad", number(np.round(robot.home, 6).tolist())),
        ("joint range, rad", _ranges(robot.range, robot.home)),
        ("rate limit, rad/s", number(sorted(set(drive.rate_limit.tolist())))),
        ("acceleration limit, rad/s^2", number(sorted(set(drive.acceleration_limit.tolist())))),
        ("torque limit, N m", number(sorted(set(drive.torque_limit.tolist())))),
        (
            "reach from the centre of mass, m",
            ", ".join(f"{robot.reach(arm):.2f}" for arm in range(len(robot.end_effector_link))),
        ),
        (
            "control period, s",
            f"{number(task.control_period)}; at most {steps.largest_control_period:g}",
        ),
        ("simulation step, s", f"{number(task.step_size)}, fourth-order Runge-Kutta; {_steps(task)}"),
        ("cameras", ", ".join(f"`{task.render_model.cam(i).name}`" for i in range(task.render_model.ncam))),
    ]
    return "\n\n".join(
        [
            "## Robot",
            "An episode starts with the satellite at the inertial origin and the whole robot at rest, so "
            "that its total momentum is zero and remains zero. The joints are at `home`, or near it where "
            "the goal includes initial joint angles. Limits are those of the drives, in every mode.",
            table(("", "value"), rows),
            f"This is `{task.robot.name}`; keyword `robot` takes another one, by name or by its description. "
            "Its links are listed in [physics](../physics.md#the-models).",
        ]
    )


def _ranges(limits: Array, home: Array) -> str:
    """Joint ranges (n, 2) as text, equal ones once."""
    around = {f"{a:+.3g} to {b:+.3g}" for a, b in limits - home[:, None]}
    absolute = [f"{a:+.3g} to {b:+.3g}" for a, b in limits]
    if len(around) == 1:
        return f"{around.pop()} from home"
    joints: dict[str, list[str]] = {}
    for number_, text in enumerate(absolute, start=1):
        joints.setdefault(text, []).append(str(number_))
    if len(joints) == 1:
        return absolute[0]
    return "; ".join(f"{text} (joints {', '.join(which)})" for text, which in joints.items())


def actions_section(env: CaptureVectorEnv) -> str:
    """Section on the actions of each control mode."""
    rows = []
    for mode in CONTROL_MODES:
        built = MODES[mode](env.drive)
        scale = [float(each) for each in built.scale]
        shown = f"{number(scale[0])} each" if len(set(scale)) == 1 else number(scale)
        name = f"`{mode}`" + (" (default)" if mode == env.control_mode else "")
        rows.append((name, str(built.size), shown, " ".join((inspect.getdoc(MODES[mode]) or "").split())))
    return "\n\n".join(
        [
            "## Actions",
            f"`Box(-1, 1, (m,), {env.single_action_space.dtype})`. Actions outside the box are clipped and "
            "counted in `info`; a wrong shape, NaN or infinity is an `ActionError` before anything moves. "
            "Every mode results in joint torques, held over the control period.",
            table(("control mode", "m", "physical units per unit action", "meaning"), rows),
        ]
    )
