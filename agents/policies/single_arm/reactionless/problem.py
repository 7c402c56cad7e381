"""Limits of a task on reactionless paths, and the time that it leaves for them."""

from agents.planners.single_arm.reactionless.clearances import SatelliteKeepOut
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.policies.single_arm.optimal import drive_limits
from space_envs.drives import braking_deceleration
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

RESERVE = 1.0  # s, of an episode that a plan leaves for the hold at the goal


def path_limits(context: PolicyContext) -> PathLimits:
    """Limits of reactionless paths: those of the drives, their braking law, and the satellite."""
    contacts, arm = context.contacts, context.arm
    deceleration = braking_deceleration(context.robot)
    if contacts is None or not context.robot.satellite.reachable:
        return PathLimits(drive_limits(context), deceleration)

    def gaps(q: Array) -> Array:
        return contacts.satellite_gaps(contacts.points(arm, q))

    return PathLimits(drive_limits(context), deceleration, (SatelliteKeepOut(gaps),))


def latest_arrival(context: PolicyContext) -> float:
    """Time in an episode, s, at which plans arrive at the latest."""
    return context.horizon * context.control_period - RESERVE
