"""The environments: `CaptureVectorEnv` simulates N episodes at once, `CaptureEnv` is the same with N = 1."""

import copy
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from space_envs.control import MODES, Drive
from space_envs.dynamics.rotations import Array
from space_envs.envs.memory import check_memory
from space_envs.envs.reset_options import Seeds, choose_start, rows_to_reset
from space_envs.errors import (
    ActionError,
    ConfigurationError,
    ResetNeededError,
    UnknownKeywordError,
    positive_integer,
    shown,
    unknown_name,
)
from space_envs.registration import asked_of_make, find
from space_envs.simulation import Simulation
from space_envs.tasks.common import Goals

if TYPE_CHECKING:
    from space_envs.rendering import Renderer

OUTCOMES = ("running", "captured", "timeout", "attitude_lost", "diverged", "collision")
_RUNNING, _CAPTURED, _TIMEOUT, _ATTITUDE_LOST, _DIVERGED, _COLLISION = range(6)
_OUTCOME_NAMES = np.array(OUTCOMES, dtype=object)
_COPIED = (
    "_seeds",
    "_spec",
    "closed",
    "_observation",
    "_steps",
    "_held",
    "_clipped",
    "_outcome",
    "_touched",
    "_index",
    "_split",
    "_goal",
    "_started",
)
_AUTORESET = {
    "next_step": AutoresetMode.NEXT_STEP,
    "same_step": AutoresetMode.SAME_STEP,
    "disabled": AutoresetMode.DISABLED,
}
METADATA: dict[str, Any] = {"render_modes": ["human", "rgb_array"], "render_fps": 10}
_CAMERA = "overview"
MOST_ENVS = 2**20
MOST_THREADS = 256


class CaptureVectorEnv(gym.vector.VectorEnv[Array, NDArray, Array]):
    """N episodes of a capture task in one batch of simulations.

    Args:
        env_id: registered id whose task is simulated, or `module:id` of one that a module registers.
        num_envs: N, the number of episodes.
        control_mode: joint_velocity, joint_torque, end_effector_velocity or reactionless.
        autoreset_mode: next_step, same_step or disabled (Gymnasium's `AutoresetMode`).
        threads: of the simulation; None chooses by N.
        render_mode: None, rgb_array (of every simulation) or human (of the first).
        width, height: of pictures, pixels. camera: name of a camera of the model.
        max_episode_steps: the horizon, as Gymnasium calls it; None and -1 leave it to the task. `env.spec`
            then says the task's; `gym.spec(id)` says None, and so does the spec of Gymnasium's own
            vectorization (`vectorization_mode="sync"` or `"async"`).
        **keywords: of the task (difficulty, split, reward, variant, horizon, timestep, control_period,
            attitude_limit, c, collisions; docs/environments has those of each id) and of its capture envelope
            (position_tolerance m, linear_velocity_tolerance m/s, hold_time s, ...).

    Raises:
        ConfigurationError: for a value that is not valid, naming the nearest that is.
        UnknownKeywordError: for a keyword that there is not, likewise.
    """

    metadata: dict[str, Any] = {**METADATA, "autoreset_mode": AutoresetMode.NEXT_STEP}

    single_observation_space: gym.spaces.Box
    single_action_space: gym.spaces.Box
    observation_space: gym.spaces.Box
    action_space: gym.spaces.Box

    def __init__(
        self,
        env_id: str = "SpaceCapture/SingleArm-v0",
        num_envs: int = 1,
        control_mode: str = "joint_velocity",
        autoreset_mode: str | AutoresetMode = "next_step",
        threads: int | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = _CAMERA,
        max_episode_steps: int | None = None,
        **keywords: Any,
    ) -> None:
        entry = find(env_id)
        self._arguments = {
            "env_id": entry.name,
            "num_envs": num_envs,
            "control_mode": control_mode,
            "autoreset_mode": autoreset_mode,
            "threads": threads,
            "render_mode": render_mode,
            "width": width,
            "height": height,
            "camera": camera,
            "max_episode_steps": max_episode_steps,
            **keywords,
        }
        num_envs = positive_integer("num_envs", num_envs, largest=MOST_ENVS)
        if threads is not None:
            threads = positive_integer("threads", threads, largest=MOST_THREADS)
        if not isinstance(control_mode, str) or control_mode not in MODES:
            raise unknown_name("control mode", control_mode, MODES)
        modes = METADATA["render_modes"]
        if render_mode is not None and (not isinstance(render_mode, str) or render_mode not in modes):
            raise unknown_name("render mode", render_mode, modes)
        if isinstance(autoreset_mode, str) and autoreset_mode in _AUTORESET:
            autoreset_mode = _AUTORESET[autoreset_mode]
        if not isinstance(autoreset_mode, AutoresetMode):
            raise unknown_name("autoreset mode", autoreset_mode, _AUTORESET)
        width, height = (
            positive_integer(name, side, largest=4096)
            for name, side in (("width", width), ("height", height))
        )
        self.task = entry.make(_with_horizon(keywords, max_episode_steps))
        if not isinstance(camera, str) or camera != _CAMERA:  # which every model has
            model = self.task.render_model
            cameras = [model.cam(index).name for index in range(model.ncam)]
            if not isinstance(camera, str) or camera not in cameras:
                raise unknown_name("camera", camera, cameras)
        check_memory(num_envs, self.task)
        self.env_id = entry.id
        self.control_mode = control_mode
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.autoreset_mode = autoreset_mode
        self.metadata = {
            **METADATA,
            "render_fps": max(1, round(1.0 / self.task.control_period)),
            "autoreset_mode": autoreset_mode,
        }
        self.simulation = Simulation(self.task.model, num_envs, threads)
        self.drive = Drive(
            self.simulation,
            self.task.control_period,
            self.task.parameters.rate_limit,
            self.task.parameters.acceleration_limit,
        )
        self.mode = MODES[control_mode](self.drive)
        self._view = {"width": width, "height": height, "camera": camera}
        self._renderer: Renderer | None = None

        bound = self.task.layout.bound
        self.single_observation_space = gym.spaces.Box(-bound, bound, dtype=np.float64)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (self.mode.size,), np.float32)
        self.observation_space = _batched(self.single_observation_space, num_envs)
        self.action_space = _batched(self.single_action_space, num_envs)

        self._action_shape = (num_envs, self.mode.size)
        self._all = np.ones(num_envs, dtype=bool)
        self._seeds = Seeds(num_envs)
        self._spec: EnvSpec | None = None
        self._observation = np.zeros((num_envs, self.task.layout.size))
        self._steps = np.zeros(num_envs, dtype=np.int64)
        self._held = np.zeros(num_envs, dtype=np.int64)
        self._clipped = np.zeros(num_envs, dtype=np.int64)
        self._outcome = np.zeros(num_envs, dtype=np.int64)
        self._touched = np.zeros(num_envs, dtype=np.int64)
        self._watched = self.task.collides and self.task.collisions
        names = self.task.contact_names if self._watched else ("",)
        self._contact_names = np.array(names, dtype=object)
        self._index = np.full(num_envs, -1, dtype=np.int64)
        self._split = np.full(num_envs, self.task.split, dtype=object)
        self._goal: list[Goals | None] = [None] * num_envs
        self._started = False

    # Gymnasium's attributes ----------------------------------------------------------------------------

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """How Gymnasium made the environment; `max_episode_steps` is the horizon."""
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
        """Seed of row 0; row i has it plus i, unless it was given its own. -1 after `np_random` was set."""
        return self._seeds.numbers[0]

    # Reset ---------------------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes.

        Args:
            seed: of row 0; row i takes seed + i. Or a list with one seed a row. None goes on with the
                generators there are.
            options: any of split and index (which goal; a number or one a row), or the task's own
                `goal_options` (of SingleArm: goal_position (3,) m and goal_quaternion (4,) in the inertial
                frame), one for all rows or one a row; joint_position and joint_velocity (n,), likewise, the
                base then moving so that total momentum is zero; reset_mask (N,) bool, the rows to reset.

        Raises:
            ConfigurationError: for an option, split or index that does not exist.
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
        return self._observation.copy(), self._reset_info(reset)

    def _begin(
        self,
        rows: NDArray[np.int64],
        options: dict[str, Any],
        seeds: Seeds | None = None,
    ) -> None:
        """Reset rows (k,) of the simulation and of the bookkeeping, and observe them.

        The seeds take the place of those there are once nothing can be refused any more.
        """
        seeds = self._seeds if seeds is None else seeds
        start = choose_start(self.task, options, rows, seeds.generators)
        self._seeds = seeds
        if not len(rows):
            return
        simulation = self.simulation
        simulation.reset(rows)
        simulation.scale_base(rows, start.goals.mass_scale)
        self.task.place(simulation, rows, start.goals)
        simulation.joint_position[rows] = start.goals.joint_position
        if start.joint_velocity is not None:
            simulation.joint_velocity[rows] = start.joint_velocity
            simulation.set_base_velocity(rows)
        simulation.refresh(rows)
        self.drive.reset(rows)
        self._index[rows], self._split[rows] = start.index, start.split
        for place, row in enumerate(rows):
            self._goal[row] = start.goals.take(np.array([place]))
        for counter in (self._steps, self._held, self._clipped, self._outcome, self._touched):
            counter[rows] = 0
        self._observation[rows] = self.task.observe(simulation.sensors, self._time())[rows]
        self._held[rows] = self.task.in_envelope(self.task.norms(self._observation))[rows]

    # Step ----------------------------------------------------------------------------------------------

    def step(
        self, actions: NDArray
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance every episode by one control period.

        Args:
            actions: (N, m) in [-1, 1]; what lies outside is clipped and counted in info["clipped_actions"].

        Returns:
            Observations (N, size), rewards (N,), terminated (N,), truncated (N,) and infos. A row that ended
            before is frozen (autoreset disabled) or starts anew (next_step), with reward 0 for that step.

        Raises:
            ActionError: for a wrong shape or type, NaN or infinity; nothing has moved then.
        """
        if not self._started:
            raise ResetNeededError("call reset before step")
        action = self._checked(actions)
        ended = self._outcome != _RUNNING if self._outcome.any() else None
        running = None if ended is None else np.flatnonzero(~ended)
        self.drive.begin()
        self.simulation.ctrl[:] = self.mode.torques(action)
        before = self.simulation.sensors.copy() if self._watched else None
        self.simulation.step(self.task.substeps, running)
        self._steps += 1 if ended is None else ~ended
        previous, observation = self._observation, self.task.observe(self.simulation.sensors, self._time())
        if ended is not None:
            observation[ended] = previous[ended]
        diverged = None
        if self.simulation.warned() or not np.isfinite(observation).all():
            diverged = self.simulation.diverged() | ~np.isfinite(observation).all(axis=1)
            observation[diverged] = previous[diverged]
        touched = None if before is None else self._collided(before, running)
        reward, terms, attitude = self._judge(observation, action, diverged, touched, ended)
        self._observation = observation
        terminated = (self._outcome == _CAPTURED) | (self._outcome >= _ATTITUDE_LOST)
        truncated = (self._outcome != _RUNNING) & (self._steps >= self.task.horizon)
        if ended is not None and self.autoreset_mode is AutoresetMode.NEXT_STEP:
            self._begin(np.flatnonzero(ended), {})
            terminated[ended] = truncated[ended] = False
            attitude = np.where(ended, 0.0, attitude)
            # Rows that were only reset have nothing to say of a step.
            info = _masked(self._step_info(terms, attitude), ~ended) | self._reset_info(ended)
        else:
            info = self._step_info(terms, attitude)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and (done := terminated | truncated).any():
            info = self._reset_same_step(done, info)
        if self.render_mode == "human":
            self.render()
        return self._observation.copy(), reward, terminated, truncated, info

    def _checked(self, actions: NDArray) -> Array:
        action = _numbers(actions)
        if action.shape != self._action_shape:
            raise ActionError(f"action must have shape {self._action_shape}, got {action.shape}")
        if action.dtype.kind not in "fiu":
            raise ActionError(f"action must be real numbers, got dtype {action.dtype}")
        action = action.astype(np.float64)
        inside = np.minimum(np.maximum(action, -1.0), 1.0)
        # One comparison finds what was clipped and NaN alike; infinity is among the clipped.
        changed = inside != action
        if changed.any():
            if not np.isfinite(action).all():
                rows = np.flatnonzero(~np.isfinite(action).all(axis=1)).tolist()
                raise ActionError(f"action holds NaN or infinity in rows {rows}")
            self._clipped += changed.any(axis=1) & (self._outcome == _RUNNING)
        return inside

    def _collided(self, before: Array, running: NDArray[np.int64] | None) -> NDArray[np.int64]:
        """Codes (N,) of what was touched in this step, by sensors before it; in running rows (k,) only."""
        sensors = self.simulation.sensors
        if running is None:
            return self.task.collided(before, sensors)
        touched = np.zeros(self.num_envs, dtype=np.int64)
        if len(running):
            touched[running] = self.task.collided(before[running], sensors[running])
        return touched

    def _judge(
        self,
        observation: Array,
        action: Array,
        diverged: NDArray[np.bool_] | None,
        touched: NDArray[np.int64] | None,
        ended: NDArray[np.bool_] | None,
    ) -> tuple[Array, Array, Array]:
        """Update outcomes; return rewards (N,), reward terms (N, k) and attitude (N,) rad."""
        task = self.task
        norms, attitude = task.norms(observation), task.attitude(observation)
        self._held = (self._held + 1) * task.in_envelope(norms)
        captured = self._held > task.hold_steps
        lost = attitude > task.attitude_limit_rad
        over = self._steps >= task.horizon
        collided = None
        if touched is not None and touched.any():
            collided = touched > 0
            lost = lost | collided
        if (captured | lost | over).any() or diverged is not None:
            if diverged is not None:
                lost = lost | diverged
            running = self._outcome == _RUNNING
            captured, lost = captured & ~lost & running, lost & running
            self._outcome[over & running] = _TIMEOUT
            self._outcome[captured] = _CAPTURED
            self._outcome[lost] = _ATTITUDE_LOST
            if touched is not None and collided is not None:
                self._outcome[lost & collided] = _COLLISION
                self._touched[lost & collided] = touched[lost & collided]
            if diverged is not None:
                self._outcome[lost & diverged] = _DIVERGED
                self._touched[lost & diverged] = 0
        terms = task.reward_terms(norms, attitude, action, captured, lost)
        if ended is not None:
            terms[ended] = 0.0
        return terms.sum(axis=1), terms, attitude

    def _reset_same_step(self, done: NDArray[np.bool_], info: dict[str, Any]) -> dict[str, Any]:
        """Start the done rows anew; what was said of them moves to `final_obs` and `final_info`."""
        final = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(done):
            final[row] = self._observation[row].copy()
        last = _masked(info, done)
        self._begin(np.flatnonzero(done), {})
        extra = {"final_obs": final, "_final_obs": done, "final_info": last, "_final_info": done}
        return _masked(info, ~done) | self._reset_info(done) | extra

    # Information -----------------------------------------------------------------------------------------

    def _time(self) -> Array:
        return self._steps * self.task.control_period

    def _step_info(self, terms: Array, attitude: Array) -> dict[str, Any]:
        present = self._all.copy()
        named: dict[str, Any] = {}
        for column, name in enumerate(self.task.reward_names):
            named[name], named["_" + name] = terms[:, column], present
        return {
            "reward_terms": named,
            "_reward_terms": present,
            "attitude": np.rad2deg(attitude),
            "_attitude": present,
            "is_success": self._outcome == _CAPTURED,
            "_is_success": present,
            "outcome": _OUTCOME_NAMES[self._outcome],
            "_outcome": present,
            "collision": self._contact_names[self._touched],
            "_collision": present,
            "clipped_actions": self._clipped.copy(),
            "_clipped_actions": present,
        }

    def _reset_info(self, rows: NDArray[np.bool_]) -> dict[str, Any]:
        """Which goals the rows (N,) bool that were reset go for."""
        return {"split": self._split.copy(), "_split": rows, "index": self._index.copy(), "_index": rows}

    # Copies ----------------------------------------------------------------------------------------------

    def __getstate__(self) -> dict[str, Any]:
        """All that makes the copy go on exactly as the original would; batches and windows are made anew."""
        return {
            "arguments": self._arguments,
            "simulation": self.simulation.snapshot(),
            "drive": self.drive.snapshot(),
            "own": {name: copy.deepcopy(getattr(self, name)) for name in _COPIED},
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state["arguments"])
        self.simulation.restore(state["simulation"])
        self.drive.restore(state["drive"])
        for name, value in state["own"].items():
            setattr(self, name, value)

    # Pictures --------------------------------------------------------------------------------------------

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Pictures (H, W, 3) of the simulations (rgb_array), or the first in a window (human).

        Raises:
            RenderingError: on a machine that cannot draw; the simulation itself goes on.
        """
        if self.render_mode is None:
            gym.logger.warn(
                "render was called without a render_mode; give render_mode='rgb_array' to gym.make_vec"
            )
            return None
        if not self._started:
            raise ResetNeededError("call reset before render")
        renderer = self._renderer
        if renderer is None:
            from space_envs.rendering import Renderer  # pictures are rare, and OpenGL may be missing

            renderer = self._renderer = Renderer(self.task.render_model, **self._view)
        pictures = []
        for row in range(1 if self.render_mode == "human" else self.num_envs):
            if (goal := self._goal[row]) is not None:
                self.task.dress(renderer.model, None, goal, 0)
            if self.render_mode == "human":
                renderer.show(self.simulation.state(row))
                return None
            pictures.append(renderer.render(self.simulation.state(row)))
        return tuple(pictures)

    def close_extras(self, **kwargs: Any) -> None:
        """Free what pictures needed."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _with_horizon(keywords: dict[str, Any], max_episode_steps: int | None) -> dict[str, Any]:
    """Keywords of the task, in which Gymnasium's name of the horizon is the task's.

    Raises:
        ConfigurationError: where both are given and differ.
    """
    if max_episode_steps is None or isinstance(max_episode_steps, int) and max_episode_steps == -1:
        return keywords
    limit = positive_integer("max_episode_steps", max_episode_steps)
    horizon = keywords.get("horizon", limit)
    if positive_integer("horizon", horizon) != limit:
        raise ConfigurationError(
            f"horizon and max_episode_steps are the same and must agree, got {shown(horizon)} and {limit}; "
            "give one of them"
        )
    return {**keywords, "horizon": limit}


def _numbers(action: Any) -> NDArray:
    try:
        return np.asarray(action)
    except Exception as error:  # whatever a stranger's object raises
        raise ActionError(f"action must be an array of numbers: {error}") from None


def _batched(space: gym.spaces.Box, n: int) -> gym.spaces.Box:
    return gym.spaces.Box(np.tile(space.low, (n, 1)), np.tile(space.high, (n, 1)), dtype=space.dtype.type)


def _masked(info: dict[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """A copy of a vector info that speaks of `rows` only."""
    return {
        key: rows.copy()
        if key.startswith("_")
        else _masked(value, rows)
        if isinstance(value, dict)
        else value.copy()
        for key, value in info.items()
    }


class CaptureEnv(gym.Env[NDArray, NDArray]):
    """One episode at a time: `CaptureVectorEnv` with N = 1 and the same keywords."""

    metadata: dict[str, Any] = METADATA

    def __init__(self, **keywords: Any) -> None:
        for name in ("num_envs", "autoreset_mode"):
            if name in keywords:
                raise UnknownKeywordError(
                    f"got an unexpected keyword argument {name!r}: it is one of gym.make_vec, not of gym.make"
                )
        keywords.setdefault("max_episode_steps", asked_of_make(self))
        self.vector = CaptureVectorEnv(num_envs=1, autoreset_mode="disabled", **keywords)
        self.render_mode = self.vector.render_mode
        self.metadata = {**METADATA, "render_fps": self.vector.metadata["render_fps"]}
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    @property
    def task(self) -> Any:
        """The task's configuration."""
        return self.vector.task

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """How Gymnasium made the environment; `max_episode_steps` is the horizon."""
        return self.vector.spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self.vector.spec = spec

    # Gymnasium's own accessors and its checkers look at these two.

    @property
    def _np_random(self) -> np.random.Generator | None:  # type: ignore[override]
        return self.vector.np_random

    @_np_random.setter
    def _np_random(self, generator: np.random.Generator) -> None:
        self.vector.np_random = generator

    @property
    def _np_random_seed(self) -> int | None:  # type: ignore[override]
        return self.vector.np_random_seed

    @_np_random_seed.setter
    def _np_random_seed(self, seed: int) -> None:
        """Setting `np_random` sets it to -1, as the vector environment has already done."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options as in `CaptureVectorEnv.reset`."""
        if isinstance(seed, list | tuple | np.ndarray):
            raise ConfigurationError(f"seed must be an integer or None, got {shown(seed)}")
        observation, info = self.vector.reset(seed=seed, options=options)
        return observation[0], _first(info)

    def step(self, action: NDArray) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advance by one control period; action (m,) in [-1, 1]."""
        action = _numbers(action)
        if action.shape != self.action_space.shape:
            raise ActionError(f"action must have shape {self.action_space.shape}, got {action.shape}")
        observation, reward, terminated, truncated, info = self.vector.step(action[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """A picture (H, W, 3) or a window, by render_mode."""
        pictures = self.vector.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Free what pictures needed."""
        self.vector.close()


def _first(info: dict[str, Any]) -> dict[str, Any]:
    """Row 0 of a vector info, without its presence masks, as plain Python values."""
    return {
        key: _first(value) if isinstance(value, dict) else value.item(0)
        for key, value in info.items()
        if not key.startswith("_")
    }
