"""Episodes in full, as they were played: also velocities, torques, observations, actions and rewards."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.causes import cause_of, missing_plans
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.play.integrals import Integrals, Totals
from space_envs.evaluation.play.steps import Step


@dataclass(frozen=True, eq=False, kw_only=True)
class Rollout(EpisodeBatch, Totals):
    """K episodes that were just played, with n joints, m numbers an action and d an observation.

    Totals over every step of the simulation are in the fields of `Totals`.

    Attributes:
        joint_position: (K, T + 1, n) rad.
        qvel: (K, T + 1, 6 + n) of the robot, in MuJoCo's conventions for a free joint.
        observation: (K, T + 1, d) that the policy had; errors and metrics are those of the true state.
        action: (K, T, m), torque: (K, T, n) N m and reward: (K, T), zero after the end.
        cause: (K,) why an episode failed, one of `CAUSES`, None for a capture.
        reason: (K,) the cause in a sentence, where the policy or the harness says more, else None.
        clipped: (K,) steps whose action lay outside [-1, 1].
    """

    joint_position: Array
    qvel: Array
    observation: Array
    action: NDArray[np.floating[Any]]
    torque: Array
    reward: Array
    cause: NDArray[np.object_]
    reason: NDArray[np.object_]
    clipped: NDArray[np.int64]

    @property
    def qpos(self) -> Array:
        """Coordinates (K, T + 1, 7 + n) of the robot, with a free joint also where it is planar."""
        return np.concatenate([self.base_pose, self.joint_position], axis=-1)

    @property
    def episode_return(self) -> Array:
        """Sums (K,) of the rewards, added in order."""
        return np.cumsum(self.reward, axis=1)[:, -1] + 0.0


class RolloutRecorder:
    """Records the episodes of an environment step by step.

    Args:
        env: just reset, without autoreset. observation: (N, d) of its reset.
        split, indices: goals that are played.
    """

    def __init__(
        self, env: CaptureVectorEnv, observation: Array, split: str, indices: NDArray[np.int64]
    ) -> None:
        self._env, self._split, self._indices = env, split, indices
        n, horizon = env.num_envs, env.task.horizon
        self._states: dict[str, Array] = {}
        for name, now in self._now(observation).items():
            self._states[name] = np.empty((n, horizon + 1, now.shape[1]))
            self._states[name][:, 0] = now
        self._true = np.empty((n, horizon + 1, env.task.layout.size))
        self._true[:, 0] = env.episodes.observation
        self._torque = np.zeros((n, horizon, env.simulation.n_joints))
        self._action = np.zeros((n, horizon, *env.single_action_space.shape))
        self._reward = np.zeros((n, horizon))
        self._length, self._clipped = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._outcome = np.full(n, "running", dtype=object)
        self._reason = np.full(n, None, dtype=object)
        self._steps, self._policy_state = 0, None
        self._goals = env.task.goals(split, indices)
        self._integrals = Integrals(env.task, env.simulation)
        env.simulation.watch = self._integrals.see

    def add(self, step: Step) -> None:
        """Record a step that was just taken."""
        running, info = step.running, step.info
        self._outcome = np.where(running, info["outcome"], self._outcome)
        self._clipped = np.where(running, info["clipped_actions"], self._clipped)
        self._length += running
        for row in np.flatnonzero(running & (self._outcome == "collision")):
            self._reason[row] = f"{info['collision'][row]} touched"
        for row in np.flatnonzero(step.refused):
            self.lose(int(row), f"the action held NaN or infinity at step {step.number}")
        # A simulation that diverged has started over by itself: the state before is the last true one.
        moved = running & (self._outcome != "diverged")
        self._integrals.add(moved, self._env.episodes.observation)
        for name, now in self._now(step.observation).items():
            record = self._states[name]
            record[:, step.number + 1] = np.where(moved[:, None], now, record[:, step.number])
        # The environment's own last ones.
        self._states["observation"][:, step.number + 1] = step.observation
        self._true[:, step.number + 1] = self._env.episodes.observation
        self._torque[:, step.number] = np.where(running[:, None], self._env.simulation.ctrl, 0.0)
        self._action[:, step.number] = step.action
        self._reward[:, step.number] = np.where(running, step.reward, 0.0)
        self._steps, self._policy_state = step.number + 1, step.state

    def lose(self, row: int, reason: str) -> None:
        """End an episode by an error of the policy."""
        self._outcome[row], self._reason[row] = "policy_error", reason

    def finished(self, policy: str, seed: int, first: int) -> Rollout:
        """Recorded episodes.

        Args:
            policy: name. seed: of the evaluation. first: number of the first episode.
        """
        env, task, n = self._env, self._env.task, self._env.num_envs
        for record in self._states.values():
            record[:, self._steps + 1 :] = record[:, self._steps : self._steps + 1]
        cause, reason = self._causes()
        self._true[:, self._steps + 1 :] = self._true[:, self._steps : self._steps + 1]
        flat = self._true.reshape(-1, task.layout.size)
        errors = task.errors(flat)
        return Rollout(
            entry=LeaderboardEntry(
                replace(EvaluatedTask.of(env.env_id, task), split=self._split), policy, env.control_mode
            ),
            robot=task.robot,
            period=task.control_period,
            attitude=np.rad2deg(task.attitude(flat)).reshape(n, -1),
            position_error=errors.position.reshape(n, -1),
            orientation_error=np.rad2deg(errors.orientation).reshape(n, -1),
            length=self._length,
            seed=np.full(n, seed),
            episode=first + np.arange(n),
            index=self._indices,
            outcome=self._outcome.astype(np.str_),
            goal=dict(vars(self._goals)),
            action=self._action,
            torque=self._torque,
            reward=self._reward,
            cause=cause,
            reason=reason,
            clipped=self._clipped,
            **self._states,
            **vars(self._integrals.totals),
        )

    def _causes(self) -> tuple[NDArray[np.object_], NDArray[np.object_]]:
        """Causes and reasons of all episodes, those of a missing plan among them."""
        plans = missing_plans(self._policy_state, len(self._outcome))
        cause, reason = self._outcome.copy(), self._reason.copy()
        for row, plan in enumerate(plans):
            cause[row] = cause_of(str(self._outcome[row]), plan)
            if plan is not None and cause[row] == plan.cause:
                reason[row] = plan.reason
        return cause, reason

    def _now(self, observation: Array) -> dict[str, Array]:
        """Present states (N, ...) of all that is recorded over time."""
        qpos, qvel = self._env.simulation.robot_state()
        return {
            "scene": self._env.simulation.qpos,
            "base_pose": qpos[:, :7],
            "joint_position": qpos[:, 7:],
            "qvel": qvel,
            "observation": observation,
        }
