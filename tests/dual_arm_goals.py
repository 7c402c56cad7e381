"""Goals of the dual-arm tasks that tests make up: both end-effectors already at their grapple points."""

from functools import cache
from typing import Any, cast

import numpy as np

from space_envs.dynamics.reactionless import Reached, end_effectors, reach
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, exponential, logarithm, multiply, rotate
from space_envs.registration import make_task
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.goals.targets import TargetGoals
from space_envs.tasks.goals.tumbling import RENDEZVOUS_TIME

IDS = ("SpaceCapture/DualArmPlanar-v0", "SpaceCapture/DualArmSpatial-v0")


def task_of(env_id: str, **keywords: Any) -> DualArmTask:
    """The task of one of the two ids."""
    return cast("DualArmTask", make_task(env_id, keywords))


def at_meeting(task: DualArmTask, goals: TargetGoals) -> tuple[Array, Array, Array, Array | None]:
    """Attitude (K, 4) and spin (K, 3) of targets when they are met, grapple points and ways in (K, 2, 3)."""
    times = np.array([RENDEZVOUS_TIME])
    attitude, spin = tumble(goals.quaternion, goals.angular_velocity, np.array(task.target.inertia), times)
    turn = attitude[:, 0][:, None]
    points = goals.position[:, None] + rotate(turn, task.grapples(goals.half_width))
    axes = (
        None
        if task.approach_axes is None
        else rotate(turn, np.broadcast_to(task.approach_axes, points.shape))
    )
    return attitude[:, 0], spin[:, 0], points, axes


def reached(task: DualArmTask, goals: TargetGoals) -> Reached:
    """What a reactionless motion from the start makes of the goals."""
    _, _, points, axes = at_meeting(task, goals)
    return reach(task.mechanics, goals.joint_position, points, axes)


@cache
def _posture(kind: type[DualArmTask]) -> tuple[Array, Array, Array]:
    """Joint angles (n,) at which a goal is met, positions (2, 3) of the end-effectors, and the target's
    attitude (4,)."""
    task = kind()
    goals = task.goals("validation", np.array([0]))
    q = reached(task, goals).q[0]
    return q, end_effectors(task.mechanics, q).position, at_meeting(task, goals)[0][0]


def docked(task: DualArmTask, target_turn: float = 0.0, **changes: Any) -> dict[str, Array]:
    """Options of `reset` that put the end-effectors of a resting robot exactly at the grapple points of a
    target that rests.

    Args:
        target_turn: rad about z, by which the target is turned away from that.
        changes: added to the options by name.
    """
    q, position, attitude = _posture(type(task))
    attitude = multiply(exponential(np.array([0.0, 0.0, target_turn])), attitude)
    width = 0.5 * float(np.linalg.norm(position[1] - position[0]))
    centre = position.mean(axis=0)
    options = {"joint_position": q, "target_half_width": np.array([width])}
    if task.kind == "planar":
        options |= {"target_position": centre[:2], "target_angle": logarithm(attitude)[2:]}
    else:
        options |= {"target_position": centre, "target_quaternion": attitude}
    for name, change in changes.items():
        options[name] = options.get(name, 0.0) + np.asarray(change, dtype=np.float64)
    return options


def along(task: DualArmTask, options: dict[str, Array]) -> Array:
    """Unit vector from the target's centre to the first grapple point, as wide as `target_position`."""
    if task.kind == "planar":
        angle = options["target_angle"][0]
        return np.array([np.sin(angle), -np.cos(angle)])
    return rotate(options["target_quaternion"], np.array([1.0, 0.0, 0.0]))
