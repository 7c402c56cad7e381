"""Motions as actions on the simulated environment: a motion is followed by joint rates."""

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.motions.actions import MotionActions, Motions
from agents.motions.vector import MotionVectorEnv, PartResult, refuse_moving
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext

TRACKING_GAIN = 2.0  # 1/s, of the joint error while a motion is followed


class SimulatedMotions(MotionVectorEnv):
    """Motions as actions on a `CaptureVectorEnv`.

    Args:
        env: in autoreset mode disabled and control mode joint_velocity. parts: actions in an episode.
        duration: s, of a motion; None is the usual share of an episode.
        autoreset_mode: of this environment.

    Raises:
        ConfigurationError: for another mode of `env`, or a task with moving goals.
    """

    def __init__(
        self,
        env: CaptureVectorEnv,
        parts: int = 1,
        duration: float | None = None,
        autoreset_mode: str | AutoresetMode = "next_step",
    ) -> None:
        refuse_moving(env.task)
        for name, got, expected in (
            ("autoreset_mode", env.autoreset_mode.name.lower(), "disabled"),
            ("control_mode", env.control_mode, "joint_velocity"),
        ):
            if got != expected:
                raise ConfigurationError(f"motions need an environment of {name} {expected!r}, got {got!r}")
        self.env, self.context = env, PolicyContext.from_env(env)
        actions = MotionActions.of(self.context, parts, duration)
        super().__init__(env.task, env.num_envs, actions, autoreset_mode)
        self.render_mode = env.render_mode
        self.metadata = {**env.metadata, "autoreset_mode": self.autoreset_mode}

    @property
    def observation(self) -> Array:
        """Present observations (N, size)."""
        return self.env.episodes.observation

    def begin(self, options: dict[str, Any], seed: Any = None) -> tuple[Array, dict[str, Any]]:
        """Start episodes; see the base class."""
        return self.env.reset(seed=seed, options=options)

    def play(self, actions: Array, part: NDArray[np.int64]) -> PartResult:
        """Follow the motions for a part of the episodes; see the base class."""
        position, rate = self._references(actions, part)
        reward, sums = np.zeros(self.num_envs), {}
        observation, info = self.observation, {}
        terminated, truncated = np.zeros((2, self.num_envs), dtype=bool)
        for step in range(self.actions.steps):
            command = following_rates(self.context, observation, position[:, step], rate[:, step + 1])
            observation, gained, terminated, truncated, info = self.env.step(
                np.clip(command / self.context.action_scale, -1.0, 1.0)
            )
            reward += gained
            sums = {
                name: values if name.startswith("_") else values + sums.get(name, 0.0)
                for name, values in info["reward_terms"].items()
            }
            if (terminated | truncated).all():
                break
        return PartResult(observation, reward, terminated, truncated, {**info, "reward_terms": sums})

    def _references(self, actions: Array, part: NDArray[np.int64]) -> tuple[Array, Array]:
        """Angles and rates (N, T, n) of the parts that begin now, one sample a control period."""
        read, chosen = self.task.layout.read, self.actions
        times = np.arange(chosen.steps + 1) * chosen.period
        position, rate = np.empty((2, self.num_envs, len(times), len(chosen.rate)))
        for each in np.unique(part):
            rows = np.flatnonzero(part == each)
            seen = self.observation[rows]
            start = read(seen, "joint_position"), read(seen, "joint_velocity")
            motions: Motions = chosen.plan(min(each, chosen.parts - 1), *start, actions[rows])
            position[rows], rate[rows] = motions.sample(times)
        return position, rate

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Images (H, W, 3), as `CaptureVectorEnv.render`."""
        return self.env.render()

    def snapshot(self) -> dict[str, Any]:
        """State for `restore` as plain values and arrays, without pickles."""
        return {**self.env.snapshot(), "over": self.over}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of as many episodes of the same task, with the same bits."""
        self.env.restore({name: value for name, value in snapshot.items() if name != "over"})
        self.over = snapshot["over"]

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window and release OpenGL."""
        self.env.close()


def following_rates(context: PolicyContext, observation: Array, angle: Array, next_rate: Array) -> Array:
    """Joint rates (N, n), rad/s, of a motion that is at angles (N, n) now, corrected by the joint error.

    Args:
        observation: (N, size). next_rate: (N, n) rad/s, a control period later, when the drives reach it.
    """
    return next_rate + TRACKING_GAIN * (angle - context.layout.read(observation, "joint_position"))
