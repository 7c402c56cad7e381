"""Samples of the conditioned ProMP (V-D), as motions of the floating robot."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.inverse_kinematics import (
    JointMotion,
    floating_inverse_kinematics,
)
from agents.policies.single_arm.promp import SAMPLES, ConditionedPrior, prior_of
from agents.policies.single_arm.reaching import motion_times
from reproduce.shyam2020.cases import GoalCase, context
from reproduce.shyam2020.measures import IDENTITY
from space_envs.dynamics import roll_out_base, trajectory_cost
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, multiply, rotate

SHOWN = 20  # samples in the paper's figures 3 and 4


@cache
def prior() -> ConditionedPrior:
    """The shipped ProMP, ready to be conditioned on any start and goal."""
    return ConditionedPrior(prior_of(context().robot), motion_times(context()))


@dataclass(frozen=True, eq=False)
class DrawnSamples:
    """S samples of the conditioned ProMP, as motions of the floating robot.

    Attributes:
        goal: (7,) rad, the joint goal. weights: (S, 7, nb). motion: (S, T, 7).
        cost: (S,) m^2/s. attitude: (S, T, 4) and base: (S, T, 3) m of the base.
        end_effector: (S, T, 3) m.
        position_error: (S,) m and rotation_error: (S,) rad, of the end-effector at the end.
        within: (S,) bool, whether joint angles, rates and accelerations keep the limits.
    """

    goal: Array
    weights: Array
    motion: JointMotion
    cost: Array
    attitude: Array
    base: Array
    end_effector: Array
    position_error: Array
    rotation_error: Array
    within: NDArray[np.bool_]

    @property
    def end_attitude(self) -> Array:
        """Final angle (S,) of the base from its initial attitude, rad."""
        return angle_between(self.attitude[:, -1], np.broadcast_to(IDENTITY, self.attitude[:, -1].shape))


def joint_goal(case: GoalCase, at: ConditionedPrior | None = None) -> Array | None:
    """The joint goal (7,) to which the conditional mean leads so that the inertial pose is met, if any."""
    at, start = at or prior(), case.start[None]

    def motion(goal: Array, rows: NDArray[np.int64]) -> JointMotion:
        begin = np.repeat(start, len(goal), axis=0)
        return at.motion(at.weights(begin, np.zeros_like(begin), goal))

    found = floating_inverse_kinematics(
        context().arm,
        case.position[None],
        case.quaternion[None],
        motion,
        np.zeros((1, 3)),
        IDENTITY[None],
        start,
        context().joint_limits,
    )
    return found.position[0] if found.converged[0] else None


def draw_samples(
    case: GoalCase, seed: int, count: int = SAMPLES, at: ConditionedPrior | None = None
) -> DrawnSamples | None:
    """Samples of a ProMP conditioned on the start and on the joint goal; None where there is none.

    Args:
        at: the ProMP; None is the shipped one.
    """
    at, arm = at or prior(), context().arm
    goal = joint_goal(case, at)
    if goal is None:
        return None
    mean = at.weights(case.start[None], np.zeros((1, arm.n_joints)), goal[None])[0]
    weights = mean + at.free.sample(np.random.default_rng(seed), count) - at.free.mean
    motion = at.motion(weights)
    twist = arm.base_twist(motion.position, motion.velocity)
    base, attitude = roll_out_base(arm, motion.position, motion.velocity, motion.dt, twist=twist)
    local, axes = arm.end_effector_pose(motion.position)
    end_effector = base + rotate(attitude, local)
    rotation = multiply(attitude[:, -1], from_matrix(axes[:, -1]))
    low, high = context().joint_limits.T
    within = ((motion.position >= low) & (motion.position <= high)).all(axis=(1, 2))
    within &= (np.abs(motion.velocity) <= context().rate_limit).all(axis=(1, 2))
    within &= (np.abs(at.acceleration(weights)) <= context().acceleration_limit).all(axis=(1, 2))
    return DrawnSamples(
        goal,
        weights,
        motion,
        trajectory_cost(arm, motion.position, motion.velocity, motion.dt, context().c),
        attitude,
        base,
        end_effector,
        np.linalg.norm(end_effector[:, -1] - case.position, axis=1),
        angle_between(rotation, np.broadcast_to(case.quaternion, rotation.shape)),
        within,
    )


def sample_figures(drawn: DrawnSamples) -> dict[str, Any]:
    """Figures of the samples.

    They are every cost, m^2/s, and end attitude, rad; how many keep the limits; the largest goal errors, m
    and rad; and the rank correlation of cost and end attitude.
    """
    return {
        "cost": drawn.cost.tolist(),
        "end_attitude": drawn.end_attitude.tolist(),
        "within": int(drawn.within.sum()),
        "position_error": float(drawn.position_error.max()),
        "rotation_error": float(drawn.rotation_error.max()),
        "rank_correlation": _rank_correlation(drawn.cost, drawn.end_attitude),
    }


def _rank_correlation(a: Array, b: Array) -> float:
    """Spearman's rank correlation of values that all differ."""
    first, second = (np.argsort(np.argsort(values)).astype(np.float64) for values in (a, b))
    return float(np.corrcoef(first, second)[0, 1])
