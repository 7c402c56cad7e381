"""Control from the learned distribution (sec. VII): policy `promp_feedback` in MuJoCo, on one goal."""

from contextlib import closing
from dataclasses import dataclass
from itertools import islice

import numpy as np

from agents.policies.single_arm.promp import ConditionalMean, ProMPPolicy
from agents.policies.single_arm.promp_feedback import PrompFeedback
from reproduce.shyam2020.cases import DIFFICULTY, ENV_ID, C, GoalCase, context
from reproduce.shyam2020.sampling import joint_goal, prior
from space_envs.dynamics import attitude_cost
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.steps import steps

EPISODES = 48  # with accelerations drawn by the law
NEVER = 1e-9  # m, so near a goal that episodes go on to the end of the motion


@dataclass(frozen=True, eq=False)
class SimulatedEpisodes:
    """E episodes of a policy in MuJoCo, from home to one goal.

    Attributes:
        time: (T,) s. joints: (E, T, 7) rad. position_error: (E,) m and rotation_error: (E,) rad, of the
            end-effector at the end. attitude: (E,) rad, of the base there. cost: (E,) m^2/s, eq. 20 times dt.
    """

    time: Array
    joints: Array
    position_error: Array
    rotation_error: Array
    attitude: Array
    cost: Array


@dataclass(frozen=True, eq=False)
class FeedbackResult:
    """Simulations of the law, and the distribution that it should reproduce.

    Attributes:
        mean: (T, 7) rad and spread: (T, 7) rad, standard deviation, of the ProMP conditioned on start and
            goal. drawn, expected, followed, best: accelerations drawn; expected ones; the conditional mean
            followed by the suite's tracking; the best of 100 likewise.
    """

    mean: Array
    spread: Array
    drawn: SimulatedEpisodes
    expected: SimulatedEpisodes
    followed: SimulatedEpisodes
    best: SimulatedEpisodes


def simulate(
    case: GoalCase, kind: type[ProMPPolicy], seed: int, episodes: int, deterministic: bool = True
) -> SimulatedEpisodes:
    """Simulate a policy on a goal until its motion is over."""
    env = CaptureVectorEnv(
        ENV_ID, episodes, autoreset_mode="disabled", difficulty=DIFFICULTY, position_tolerance=NEVER
    )
    with closing(env):
        at = context()
        options = {
            "goal_position": np.tile(case.position, (episodes, 1)),
            "goal_quaternion": np.tile(case.quaternion, (episodes, 1)),
        }
        policy, read = kind(at, seed), at.layout.read
        observation, _ = env.reset(seed=seed, options=options)
        joints, cost = [read(observation, "joint_position").copy()], np.zeros(episodes)
        for step in islice(steps(policy, env, observation, deterministic), len(prior().times) - 1):
            before, observation = _integrand(observation), step.observation
            joints.append(read(observation, "joint_position").copy())
            cost += 0.5 * at.control_period * (before + _integrand(observation))
        still = np.tile([1.0, 0.0, 0.0, 0.0], (episodes, 1))
        return SimulatedEpisodes(
            prior().times,
            np.stack(joints, axis=1),
            np.linalg.norm(read(observation, "end_effector_position") - case.position, axis=1),
            angle_between(
                read(observation, "end_effector_quaternion"), np.tile(case.quaternion, (episodes, 1))
            ),
            angle_between(read(observation, "base_quaternion"), still),
            cost,
        )


def _integrand(observation: Array) -> Array:
    """Eq. 20 (N,), m^2/s^2, of the base as it is observed."""
    read = context().layout.read
    twist = np.concatenate(
        [read(observation, "base_linear_velocity"), read(observation, "base_angular_velocity")], axis=1
    )
    return attitude_cost(twist[:, None, :], 1.0, C)


def simulate_law(case: GoalCase, seed: int) -> FeedbackResult | None:
    """Simulations on a goal; None where the distribution has no joint goal for it."""
    goal = joint_goal(case)
    if goal is None:
        return None
    at = prior()
    weights = at.weights(case.start[None], np.zeros((1, len(goal))), goal[None])
    covariance = at.free.state(at.times / at.times[-1], float(at.times[-1]))[1]
    variance = np.diagonal(covariance, axis1=1, axis2=2)[:, : len(goal)]
    return FeedbackResult(
        at.motion(weights).position[0],
        np.sqrt(np.maximum(variance, 0.0)),
        simulate(case, PrompFeedback, seed, EPISODES, deterministic=False),
        simulate(case, PrompFeedback, seed, 1),
        simulate(case, ConditionalMean, seed, 1),
        simulate(case, ProMPPolicy, seed, 1),
    )


def spread_ratio(found: FeedbackResult) -> float:
    """Root mean square of the simulated joints' spread over that of the ProMP."""
    return float(np.sqrt((found.drawn.joints.var(axis=0)).mean() / (found.spread**2).mean()))
