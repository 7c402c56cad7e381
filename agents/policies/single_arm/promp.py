"""The algorithm of shyam2020, sec. V-D: condition a ProMP, sample, and take the minimum of eq. 20."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from agents.planners.common.damped_search import JointGoals, Rows
from agents.planners.common.inverse_kinematics import JointMotion, MotionModel, floating_inverse_kinematics
from agents.planners.common.robot_files import robot_file, robot_options
from agents.policies.clearance import KeepOut
from agents.policies.needs import POSE
from agents.policies.single_arm.joint_goals import JointGoalPolicy
from agents.policies.single_arm.reaching import motion_times
from promp import ProMP, ViaPoint
from space_envs.dynamics import trajectory_cost
from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot

SAMPLES = 100
PRIOR = "promp_prior.npz"
ROWS_AT_ONCE = 8  # whose samples are in memory together


def find_prior(robot: Robot) -> ProMP | None:
    """The ProMP fitted to a robot's demonstrations, if they were made.

    Raises:
        ConfigurationError: if what is there was made for another robot. StorageError: if it is damaged.
    """
    path = robot_file(robot, PRIOR)
    return None if path is None else _loaded(path, path.stat().st_mtime_ns)


def prior_of(robot: Robot) -> ProMP:
    """The ProMP fitted to a robot's demonstrations; errors as in `find_prior`.

    Raises:
        PolicyError: also if there is none, naming the command that makes it.
    """
    prior = find_prior(robot)
    if prior is None:
        raise PolicyError(_missing(robot))
    return prior


def missing_prior(context: PolicyContext) -> str | None:
    """Reason why a policy without demonstrations of its robot cannot plan; None where there are some."""
    return f"it needs {_missing(context.robot)}" if find_prior(context.robot) is None else None


def _missing(robot: Robot) -> str:
    command = f"python -m agents.demonstrations {robot_options(robot)}"
    return f"a ProMP of demonstrations of the robot {robot.name!r}: `{command}` makes them"


@lru_cache(maxsize=8)
def _loaded(path: Path, changed: int) -> ProMP:
    return ProMP.load(path)


class ConditionedPrior:
    """A ProMP conditioned on many start and goal states at once, which share the gain of eq. 19.

    Only the mean depends on the states (eq. 18), and it does so linearly; the gain and the
    conditional distribution are computed once.

    Args:
        prior: of the weights (n, nb). times: (T,) s, of the motion's samples.
    """

    def __init__(self, prior: ProMP, times: Array) -> None:
        self.times = times
        duration = float(times[-1])
        phase = times / duration
        self._basis = prior.basis.value(phase), prior.basis.derivative(phase) / duration
        self._bend = prior.basis.second_derivative(phase) / duration**2
        self._mean = prior.mean
        unit = np.eye(prior.n_dof)
        ends = [basis[node] for node in (0, -1) for basis in self._basis]
        # Rows: position and rate at the start, position and rate at the goal.
        self._features = np.concatenate([np.kron(unit, row) for row in ends])
        directions = prior.factor.directions
        self._gain = directions @ np.linalg.pinv(self._features @ directions, rcond=1e-9)
        met = (self._features @ prior.mean.ravel()).reshape(4, prior.n_dof)
        self.free = prior.condition_on(
            [ViaPoint(0.0, met[0], met[1], duration), ViaPoint(1.0, met[2], met[3], duration)]
        )

    def weights(self, start: Array, rate: Array, goal: Array) -> Array:
        """Conditional means (N, n, nb): from `start` (N, n) rad with `rate` (N, n) rad/s to rest at goal."""
        state = np.concatenate([start, rate, goal, np.zeros_like(goal)], axis=1)
        residual = state - self._features @ self._mean.ravel()
        return self._mean + (self._gain @ residual[..., None]).reshape(-1, *self._mean.shape)

    def moved(self, weights: Array, shift: Array) -> Array:
        """Weights (N, n, nb) with goals shifted by `shift` (N, n) rad and the other end states unchanged."""
        n = self._mean.shape[0]
        return weights + (self._gain[:, 2 * n : 3 * n] @ shift[..., None]).reshape(weights.shape)

    def motion(self, weights: Array, every: int = 1) -> JointMotion:
        """Motions (..., T, n) of weights (..., n, nb), each `every`-th sample."""
        columns = np.ascontiguousarray(weights.swapaxes(-1, -2))
        position, velocity = (basis[::every] @ columns for basis in self._basis)
        return JointMotion(position, velocity, every * float(self.times[1]))

    def acceleration(self, weights: Array, every: int = 1) -> Array:
        """Accelerations (..., T, n), rad/s^2, of weights (..., n, nb)."""
        return self._bend[::every] @ weights.swapaxes(-1, -2)


class ProMPPolicy(JointGoalPolicy):
    """Samples motions to the goal, takes the one with the least base disturbance, and corrects its end.

    All episodes share the standard normal draws behind the samples, which the seed fixes: a plan depends on
    the observation and the seed alone, not on what else is planned.

    Args:
        context, seed: as of every policy. prior: the ProMP; None for the one of the robot's demonstrations.
        samples: number of sampled motions; 0 for the conditional mean.

    Raises:
        PolicyError: if the prior is for another number of joints, or the robot has none.
    """

    needs = replace(POSE, other=missing_prior)

    def __init__(
        self, context: PolicyContext, seed: int = 0, prior: ProMP | None = None, samples: int = SAMPLES
    ) -> None:
        super().__init__(context, seed)
        prior = prior_of(context.robot) if prior is None else prior
        if prior.n_dof != context.arm.n_joints:
            raise PolicyError(f"the prior is of {prior.n_dof} joints, the robot has {context.arm.n_joints}")
        times = motion_times(context)
        self._prior = ConditionedPrior(prior, times)
        self._every = 2 if len(times) % 2 else 1  # costs and base poses are accurate enough at half the rate
        # Offsets of the samples from any conditional mean.
        free = self._prior.free
        offsets = free.sample(np.random.default_rng(seed), samples) - free.mean
        self._offsets = offsets
        self._offset_motion = self._prior.motion(offsets, self._every)
        self._offset_acceleration = self._prior.acceleration(offsets, self._every)

    def plan(self, observation: Array, preferred: Array | None = None) -> tuple[JointMotion, JointGoals]:
        """Steps of sec. V-D for each row, then the correction of the chosen motion's end."""
        read = self.context.layout.read
        start, rate = read(observation, "joint_position"), read(observation, "joint_velocity")
        prior = self._prior

        def mean_motion(goal: Array, rows: Rows) -> JointMotion:
            return prior.motion(prior.weights(start[rows], rate[rows], goal), self._every)

        goals = self._solve(observation, mean_motion, start if preferred is None else preferred)
        keep_out = KeepOut.of(self.context, observation)
        weights = self._chosen(prior.weights(start, rate, goals.position), keep_out)

        # The base ends elsewhere under the chosen motion than under the mean.
        first = goals.position

        def chosen_motion(goal: Array, rows: Rows) -> JointMotion:
            return prior.motion(prior.moved(weights[rows], goal - first[rows]))

        goals = self._solve(observation, chosen_motion, first)
        return prior.motion(prior.moved(weights, goals.position - first)), goals

    def _chosen(self, mean: Array, keep_out: KeepOut | None) -> Array:
        """Weights (N, n, nb) of least cost among each row's samples that keep the limits and are clear.

        The mean where there are none.
        """
        if not len(self._offsets):
            return mean
        best = np.empty_like(mean)
        for first in range(0, len(mean), ROWS_AT_ONCE):
            block = np.arange(first, min(first + ROWS_AT_ONCE, len(mean)))
            best[block] = self._chosen_block(mean[block], None if keep_out is None else keep_out.take(block))
        return best

    def _chosen_block(self, mean: Array, keep_out: KeepOut | None) -> Array:
        context, every = self.context, self._every
        centre = self._prior.motion(mean, every)
        position = centre.position[:, None] + self._offset_motion.position
        velocity = centre.velocity[:, None] + self._offset_motion.velocity
        acceleration = self._prior.acceleration(mean, every)[:, None] + self._offset_acceleration
        cost = trajectory_cost(context.arm, position, velocity, centre.dt, context.c)
        low, high = context.joint_limits.T
        violated = ((position < low) | (position > high)).any(axis=(2, 3))
        violated |= (np.abs(velocity) > context.rate_limit).any(axis=(2, 3))
        violated |= (np.abs(acceleration) > context.acceleration_limit).any(axis=(2, 3))
        cost[violated] = np.inf
        chosen, valid = np.zeros(len(mean), dtype=np.int64), np.zeros(len(mean), dtype=bool)
        for row, costs in enumerate(cost):
            order = [int(k) for k in np.argsort(costs, kind="stable") if not violated[row, k]]
            if keep_out is None:
                best = order[0] if order else None
            else:
                own = keep_out.take(np.array([row]))
                best = own.first_clear(position[row], velocity[row], centre.dt, order)
            chosen[row], valid[row] = (0, False) if best is None else (best, True)
        return mean + valid[:, None, None] * self._offsets[chosen]

    def _solve(self, observation: Array, motion: MotionModel, start: Array) -> JointGoals:
        read, context = self.context.layout.read, self.context
        return floating_inverse_kinematics(
            context.arm,
            read(observation, "goal_position"),
            read(observation, "goal_quaternion"),
            motion,
            read(observation, "base_position"),
            read(observation, "base_quaternion"),
            start,
            context.joint_limits,
            kind=context.goal_kind,
        )


class ConditionalMean(ProMPPolicy):
    """The same with the conditional mean instead of samples, for comparison."""

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed, samples=0)
