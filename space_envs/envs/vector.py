"""The vector environment: N episodes in parallel; the single environment is the case N = 1."""

import copy
from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from space_envs.control import MODES
from space_envs.dynamics.rotations import Array
from space_envs.envs.actions import checked_actions
from space_envs.envs.controlled import controlled_simulation
from space_envs.envs.episodes import EpisodeTracker, masked
from space_envs.envs.keywords import RENDER_MODES, EnvKeywords, EnvOptions, explicit_keywords
from space_envs.envs.limits import checked_num_envs
from space_envs.envs.pictures import Pictures
from space_envs.envs.seeds import Seeds
from space_envs.envs.starts import choose_start, rows_to_reset
from space_envs.errors import ConfigurationError, ResetNeededError, unknown_name
from space_envs.registration import find

METADATA: dict[str, Any] = {"render_modes": [*RENDER_MODES], "render_fps": 10}
_AUTORESET = {mode.name.lower(): mode for mode in AutoresetMode}
_COPIED = ("_seeds", "_spec", "_started", "closed")


class CaptureVectorEnv(gym.vector.VectorEnv[Array, NDArray, Array]):
    """N episodes of a capture task in one batch of simulations.

    Args:
        env_id: registered id whose task is simulated, or `module:id` of an id registered by a module.
        num_envs: N, the number of episodes.
        control_mode: joint_velocity, joint_torque, end_effector_velocity or reactionless.
        autoreset_mode: next_step, same_step or disabled (Gymnasium's `AutoresetMode`).
        threads: of the simulation; None is a default that depends on N.
        render_mode: None, rgb_array (of every simulation) or human (of the first).
        width, height: of images, pixels. camera: name of a camera of the model.
        max_episode_steps: the horizon, as Gymnasium calls it; None and -1 are the task's default, which
            `env.spec` then has; `gym.spec(id)` has None, and so does the spec of Gymnasium's own
            vectorization (`vectorization_mode="sync"` or `"async"`).
        **keywords: of the task (difficulty, split, reward, robot, variant, horizon, timestep, control_period,
            attitude_limit, c, collisions, perturbation; docs/environments lists those of each id) and of its
            capture envelope (position_tolerance m, linear_velocity_tolerance m/s, hold_time s, ...).

    Raises:
        ConfigurationError: for an invalid value, with the nearest valid name.
        UnknownKeywordError: for an unknown keyword, with the nearest valid name.
    """

    metadata: dict[str, Any] = {**METADATA, "autoreset_mode": AutoresetMode.NEXT_STEP}

    single_observation_space: gym.spaces.Box
    single_action_space: gym.spaces.Box
    observation_space: gym.spaces.Box
    action_space: gym.spaces.Box

    @explicit_keywords
    def __init__(
        self,
        env_id: str = "SpaceCapture/SingleArm-v0",
        num_envs: int = 1,
        control_mode: str = "joint_velocity",
        autoreset_mode: str | AutoresetMode = "next_step",
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        entry = find(env_id)
        self._arguments = {
            "env_id": entry.name,
            "num_envs": num_envs,
            "control_mode": control_mode,
            "autoreset_mode": autoreset_mode,
            **keywords,
        }
        if not isinstance(control_mode, str) or control_mode not in MODES:
            raise unknown_name("control mode", control_mode, MODES)
        if isinstance(autoreset_mode, str) and autoreset_mode in _AUTORESET:
            autoreset_mode = _AUTORESET[autoreset_mode]
        if not isinstance(autoreset_mode, AutoresetMode):
            raise unknown_name("autoreset mode", autoreset_mode, _AUTORESET)
        options, task_keywords = EnvOptions.separated(keywords)
        self.task = entry.make(task_keywords)
        if keywords.get("robot") is not None:
            self._arguments["robot"] = self.task.robot  # a copy elsewhere may not find the file
        self._pictures = Pictures(self.task, options)
        self.num_envs = checked_num_envs(num_envs, self.task)
        self.env_id = entry.id
        self.control_mode = control_mode
        self.render_mode = options.render_mode
        self.autoreset_mode = autoreset_mode
        self.metadata = {
            **METADATA,
            "render_fps": max(1, round(1.0 / self.task.control_period)),
            "autoreset_mode": autoreset_mode,
        }
        self._controlled = controlled_simulation(self.task, self.num_envs, control_mode, options.threads)
        self.simulation, self.drive = self._controlled.simulation, self._controlled.drive
        self.mode = self._controlled.mode
        bound = self.task.layout.bound
        self.single_observation_space = gym.spaces.Box(-bound, bound, dtype=np.float64)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (self.mode.size,), np.float32)
        self.observation_space = _batched(self.single_observation_space, self.num_envs)
        self.action_space = _batched(self.single_action_space, self.num_envs)
        self.episodes = EpisodeTracker(self.task, self.num_envs)
        self._seeds = Seeds(self.num_envs)
        self._spec: EnvSpec | None = None
        self._started = False

    # Gymnasium's attributes ----------------------------------------------------------------------------

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """Specification that Gymnasium made the environment from; `max_episode_steps` is the horizon."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None:
            self._spec.max_episode_steps = self.task.horizon

    @property
    def np_random(self) -> np.random.Generator:  # type: ignore[override]
        """Generator of row 0; setting it derives those of the other rows from it."""
        return self._seeds.generators[0]

    @np_random.setter
    def np_random(self, generator: np.random.Generator) -> None:
        self._seeds = self._seeds.derived(generator)

    @property
    def np_random_seed(self) -> int:  # type: ignore[override]
        """Seed of row 0; row i has this seed plus i, unless given its own. -1 after `np_random` was set."""
        return self._seeds.numbers[0]

    # Reset ---------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: of row 0; row i takes seed + i. Or a list with one seed per row. None keeps the
                present generators.
            options: split and index of the goal (one value, or one per row), or the task's own
                `goal_options` (of SingleArm: goal_position (3,) m and goal_quaternion (4,) in the inertial
                frame), one for all rows or one per row; joint_position and joint_velocity (n,), likewise,
                with the base velocity that makes total momentum zero; reset_mask (N,) bool, the rows to
                reset.

        Raises:
            ConfigurationError: for an unknown option, split or index.
            GoalError: for a goal that is malformed or out of reach.
        """
        options = {} if options is None else options
        rows = rows_to_reset(self.task, options, self.num_envs)
        if not self._started and len(rows) < self.num_envs:
            raise ConfigurationError("the first reset must reset every row")
        self._begin(rows, options, self._seeds.renewed(seed, rows))
        self._started = True
        if self.render_mode == "human":
            self.render()
        reset = np.zeros(self.num_envs, dtype=bool)
        reset[rows] = True
        return self._controlled.seen(self.episodes.observation), self.episodes.reset_info(reset)

    def _begin(
        self,
        rows: NDArray[np.int64],
        options: dict[str, Any],
        seeds: Seeds | None = None,
    ) -> None:
        """Reset rows (k,) of simulations and episodes, and observe them.

        New seeds replace the present ones after all options have been validated.
        """
        seeds = self._seeds if seeds is None else seeds
        start = choose_start(self.task, options, rows, seeds.generators)
        self._seeds = seeds
        if not len(rows):
            return
        self._controlled.begin(rows, start)
        self.episodes.begin(rows, start)
        sensors, time = self.simulation.sensors[rows], self.episodes.time[rows]
        self.episodes.observe_start(rows, self.task.observe(sensors, time, np.zeros(len(rows))))

    # Step ----------------------------------------------------------------------------------------------

    def step(
        self, actions: NDArray
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance every episode by one control period.

        Args:
            actions: (N, m) in [-1, 1]; values outside are clipped and counted in info["clipped_actions"].

        Returns:
            Observations (N, size), rewards (N,), terminated (N,), truncated (N,) and infos. A row that ended
            before is frozen (autoreset disabled) or is reset (next_step), with reward 0 for that step.

        Raises:
            ActionError: for a wrong shape or type, NaN or infinity; the state is then unchanged.
        """
        if not self._started:
            raise ResetNeededError("call reset before step")
        action, clipped = checked_actions(actions, (self.num_envs, self.mode.size))
        episodes = self.episodes
        ended = episodes.ended
        episodes.count(clipped, ended)
        running = None if ended is None else np.flatnonzero(~ended)
        touched, rotation = self._controlled.advance(action, running, episodes.watched)
        observation, diverged = self._controlled.observe(episodes.time, rotation, episodes.observation, ended)
        terms, attitude = episodes.judge(observation, action, diverged, touched)
        if ended is not None:
            terms[ended] = 0.0
        terminated, truncated = episodes.flags()
        if ended is not None and self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._begin(np.flatnonzero(ended), {})
            terminated[ended] = truncated[ended] = False
            # Rows that were only reset have no step info.
            info = masked(episodes.step_info(terms, np.where(ended, 0.0, attitude)), ~ended)
            info |= episodes.reset_info(ended)
        else:
            info = episodes.step_info(terms, attitude)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and (done := terminated | truncated).any():
            info = self._reset_same_step(done, info)
        if self.render_mode == "human":
            self.render()
        seen = self._controlled.seen(episodes.observation)
        return seen, terms.sum(axis=1), terminated, truncated, info

    def _reset_same_step(self, done: NDArray[np.bool_], info: dict[str, Any]) -> dict[str, Any]:
        """Reset the done rows; their observation and info move to `final_obs` and `final_info`."""
        final = np.full(self.num_envs, None, dtype=object)
        seen = self._controlled.seen(self.episodes.observation)
        for row in np.flatnonzero(done):
            final[row] = seen[row]
        last = masked(info, done)
        self._begin(np.flatnonzero(done), {})
        extra = {"final_obs": final, "_final_obs": done, "final_info": last, "_final_info": done}
        return masked(info, ~done) | self.episodes.reset_info(done) | extra

    # Copies ----------------------------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, Any]:
        """State of a copy that continues exactly like the original; batches and windows are created again."""
        return {
            "arguments": self._arguments,
            "controlled": self._controlled.snapshot(),
            "episodes": self.episodes.snapshot(),
            "own": {name: copy.deepcopy(getattr(self, name)) for name in _COPIED},
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["arguments"])
        self._controlled.restore(state["controlled"])
        self.episodes.restore(state["episodes"])
        for name, value in state["own"].items():
            setattr(self, name, value)

    def snapshot(self) -> dict[str, Any]:
        """State for `restore` as plain values and arrays, without pickles.

        Raises:
            ConfigurationError: where goals were given as numbers.
        """
        return {**self._controlled.snapshot(), **self.episodes.stored(), **self._seeds.stored()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of as many episodes of the same task, with the same bits."""
        self._controlled.restore(snapshot)
        self.episodes.resume(snapshot)
        self._seeds = Seeds.of(snapshot)
        self._started = True

    # Pictures --------------------------------------------------------------------------------------------

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Images (H, W, 3) of the simulations (rgb_array), or None after updating a window (human).

        Raises:
            RenderingError: if this machine cannot render; the simulation can continue.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "render was called without a render_mode; give render_mode='rgb_array' to gym.make_vec"
            )
            return None
        if not self._started:
            raise ResetNeededError("call reset before render")
        if self.render_mode == "human":
            self._pictures.show(self.simulation, self.episodes)
            return None
        return self._pictures.draw(self.simulation, self.episodes)

    def close_extras(self, **kwargs: Any) -> None:
        """Close the window and release OpenGL."""
        self._pictures.close()


def _batched(space: gym.spaces.Box, n: int) -> gym.spaces.Box:
    return gym.spaces.Box(np.tile(space.low, (n, 1)), np.tile(space.high, (n, 1)), dtype=space.dtype.type)
