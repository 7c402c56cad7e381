"""Motions as actions at momentum level: no simulation in time, but the base's motion by quadrature.

Joint motions are followed exactly and total momentum is zero, so that the pose of the base is an integral
over the joint motion. A part of an episode is seen at 32 instants, the last 16 of the motion a control period
apart, where captures happen; outcomes and rewards are the task's own functions of what is seen there.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.motions.actions import MotionActions
from agents.motions.judging import Seen, judged
from agents.motions.kinematics import ObservedKinematics
from agents.motions.vector import MotionVectorEnv, PartResult
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics.rotations import Array, base_rotation, from_matrix, to_matrix
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.policy import PolicyContext
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.outcome import Outcome

ROWS = 256  # episodes that are computed together; their arrays then stay in a processor's cache
OPTIONS = ("split", "index", "reset_mask")
_GAUSS = np.array([-0.5, 0.5]) / np.sqrt(3.0) + 0.5  # in an interval
_SENSED = (
    *("joint_position", "joint_velocity", "base_position", "base_quaternion", "base_linear_velocity"),
    *("base_angular_velocity", "end_effector_position", "end_effector_quaternion"),
    *("end_effector_linear_velocity", "end_effector_angular_velocity", "goal_position", "goal_quaternion"),
)


class _Instants(NamedTuple):
    """Instants of a part of an episode, s from its start.

    Attributes:
        gauss: (2, 2 K) Gauss points of the two halves. seen: (2 K,).
        length: (2,) of an interval in each half. rest: control periods at rest after the motion.
    """

    gauss: Array
    seen: Array
    length: Array
    rest: int

    @classmethod
    def of(cls, actions: MotionActions, part: int) -> "_Instants":
        """Instants of a part."""
        left = round((actions.duration - part * actions.steps * actions.period) / actions.period)
        moving = min(actions.steps, left)
        length = np.array([(moving - INTERVALS) / INTERVALS, 1.0]) * actions.period
        first = np.array([0.0, (moving - INTERVALS) * actions.period])
        intervals = np.arange(INTERVALS)
        gauss = first[:, None] + ((intervals[:, None] + _GAUSS).ravel() * length[:, None])
        seen = first[:, None] + (intervals + 1.0) * length[:, None]
        return cls(gauss, seen.ravel(), length, actions.steps - moving)


@dataclass(eq=False)
class _State:
    """Present state of N episodes; sensors (N, s) are those of the simulated model."""

    sensors: Array
    observation: Array
    held: Array
    steps: NDArray[np.int64]
    outcome: NDArray[np.int64]
    index: NDArray[np.int64]
    split: NDArray[np.object_]

    @classmethod
    def empty(cls, n: int, task: CaptureTask) -> "_State":
        """State before the first reset."""
        steps, outcome, index = np.zeros((3, n), dtype=np.int64)
        sensors, observation = np.zeros((n, task.model.nsensordata)), np.zeros((n, task.layout.size))
        return cls(sensors, observation, np.zeros(n), steps, outcome, index, np.full(n, "", dtype=object))


class MomentumMotions(MotionVectorEnv):
    """Motions as actions for a single arm with a static goal, at momentum level.

    Its steps are hundreds of times faster than those of `SimulatedMotions`, and its outcomes, returns and
    attitudes hardly differ: tests/test_motions.py has by how much. Masses are nominal, in every split.

    Args:
        env: gives the task; it is not simulated. num_envs: N. parts, duration, autoreset_mode: as in
            `SimulatedMotions`.

    Raises:
        ConfigurationError: for a task with obstacles, several arms or moving goals, or parts of less than
            1.7 s.
    """

    def __init__(
        self,
        env: CaptureVectorEnv,
        num_envs: int,
        parts: int = 1,
        duration: float | None = None,
        autoreset_mode: str | AutoresetMode = "next_step",
    ) -> None:
        task, self.context = env.task, PolicyContext.from_env(env)
        _check_task(task)
        super().__init__(task, num_envs, MotionActions.of(self.context, parts, duration), autoreset_mode)
        self._functions = ArmFunctions.of(task.mechanics, INTERVALS)
        self._kinematics = ObservedKinematics.of(task.mechanics, task.contacts)
        self._instants = [_Instants.of(self.actions, part) for part in range(parts)]
        if any(each.length[0] <= 0.0 for each in self._instants):
            raise ConfigurationError(
                f"{parts} parts are too short for the momentum level: the motion must go on for more than "
                f"{INTERVALS} control periods in each"
            )
        self._pools: dict[str, tuple[Any, Array, Array]] = {}
        self._state = _State.empty(num_envs, task)

    @property
    def observation(self) -> Array:
        """Present observations (N, size)."""
        return self._state.observation

    def begin(self, options: dict[str, Any], seed: Any = None) -> tuple[Array, dict[str, Any]]:
        """Start episodes; options split, index (one or N) and reset_mask."""
        for name in options:
            if name not in OPTIONS:
                raise unknown_name("reset option", name, OPTIONS)
        if seed is not None:
            self._np_random, self._np_random_seed = seeding.np_random(seed)
        mask = options.get("reset_mask", np.ones(self.num_envs, dtype=bool))
        rows, split = np.flatnonzero(mask), options.get("split", self.task.split)
        size = self.task.split_size(split)
        drawn = self.np_random.integers(size, size=len(rows)) if "index" not in options else options["index"]
        index = (
            np.broadcast_to(drawn, (len(rows),))
            if np.ndim(drawn) == 0 or len(drawn) == len(rows)
            else (np.asarray(drawn)[rows])
        )
        _, sensors, observation = self._pool(split)
        state = self._state
        state.sensors[rows], state.observation[rows] = sensors[index], observation[index]
        state.held[rows] = self.task.errors(observation[index]).within(self.task.limits)
        state.steps[rows] = state.outcome[rows] = 0
        state.index[rows], state.split[rows] = index, split
        info = {"split": state.split.copy(), "_split": mask, "index": state.index.copy(), "_index": mask}
        return state.observation, info

    def _pool(self, split: str) -> tuple[Any, Array, Array]:
        """Goals (K) of a split, with sensors (K, s) and observations (K, size) at the start."""
        if split not in self._pools:
            task = self.task
            goals = task.goals(split, np.arange(task.split_size(split)))
            k, n = goals.joint_position.shape
            pose = np.tile(np.r_[np.zeros(3), np.eye(3).ravel()], (k, 1))
            goal = np.concatenate([goals.position, goals.quaternion], axis=1)
            sensors = self._sensed(goals.joint_position, np.zeros((k, n)), pose, goal)
            self._pools[split] = goals, sensors, task.observe(sensors, np.zeros(k), np.zeros(k))
        return self._pools[split]

    def _sensed(self, angle: Array, rate: Array, pose: Array, goal: Array) -> Array:
        """Sensors (K, s) at joint angles and rates (K, n) and base poses (K, 12).

        Args:
            goal: (K, 7) position and quaternion.
        """
        base, twist, position, rotation = self._kinematics.moving(angle, rate)
        (points,) = self._kinematics.points(angle)
        axes = pose[:, 3:].reshape(-1, 3, 3)  # transposed: base axes of inertial vectors' components
        columns = rotation.reshape(-1, 3, 3)
        vectors = np.stack([base[:, :3], base[:, 3:], position, twist[:, :3], twist[:, 3:]], axis=1) @ axes
        slices, sensors = self.task.layout.slices, np.empty((len(angle), self.task.model.nsensordata))
        values = (
            *(angle, rate, pose[:, :3], from_matrix(axes.swapaxes(1, 2)), vectors[:, 0], vectors[:, 1]),
            *(pose[:, :3] + vectors[:, 2], from_matrix((columns @ axes).swapaxes(1, 2))),
            *(vectors[:, 3], vectors[:, 4], goal[:, :3], goal[:, 3:]),
        )
        for name, value in zip(_SENSED, values, strict=True):
            sensors[:, slices[name]] = value
        sensors[:, self.task.contacts.columns["satellite"]] = points
        return sensors

    def play(self, actions: Array, part: NDArray[np.int64]) -> PartResult:
        """Compute a part of the episodes; see the base class."""
        task, state, n = self.task, self._state, self.num_envs
        terms, attitude = np.zeros((n, len(task.reward_terms))), np.rad2deg(task.attitude(state.observation))
        running = state.outcome == Outcome.RUNNING.code
        for each in np.unique(part[running]):
            rows = np.flatnonzero(running & (part == each))
            for chosen in np.array_split(rows, -(-len(rows) // ROWS)):
                terms[chosen], attitude[chosen] = self._played(int(each), chosen, actions[chosen])
        names = np.array([outcome.value for outcome in Outcome], dtype=object)
        everywhere = np.ones(n, dtype=bool)
        named: dict[str, Any] = {}
        for column, term in enumerate(task.reward_terms):
            named[term.name], named[f"_{term.name}"] = terms[:, column], everywhere
        info = {
            "reward_terms": named,
            "attitude": attitude,
            "is_success": state.outcome == Outcome.CAPTURED.code,
            "outcome": names[state.outcome],
        }
        truncated = state.outcome == Outcome.TIMEOUT.code
        terminated = ~truncated & (state.outcome != Outcome.RUNNING.code)
        info |= {f"_{key}": everywhere for key in info}
        return PartResult(state.observation, terms.sum(axis=1), terminated, truncated, info)

    def _played(self, part: int, rows: NDArray[np.int64], actions: Array) -> tuple[Array, Array]:
        """Terms (k, t) and final attitudes (k,), deg, of rows in a part; their state is replaced."""
        task, state, at, actions_ = self.task, self._state, self._instants[part], self.actions
        slices, sensors = task.layout.slices, state.sensors[rows]
        angle, rate = sensors[:, slices["joint_position"]], sensors[:, slices["joint_velocity"]]
        motions = actions_.plan(part, angle, rate, actions)
        k, n = angle.shape
        states = [x.reshape(k, 2, 2 * INTERVALS, n) for x in motions.sample(at.gauss.ravel())]
        (twist,) = self._functions.twist(*states)
        pose = self._poses(state.observation[rows], twist, at.length)
        angle, rate = motions.sample(at.seen)
        count = 2 * INTERVALS
        goal = sensors[:, slices["goal_position"].start : slices["goal_quaternion"].stop]
        goal = np.repeat(goal, count, axis=0)
        seen = self._sensed(angle.reshape(-1, n), rate.reshape(-1, n), pose.reshape(-1, 12), goal)
        seen = seen.reshape(k, count, -1)
        return self._judged(part, rows, at, np.concatenate([sensors[:, None], seen], axis=1))

    def _poses(self, observation: Array, twist: Array, length: Array) -> Array:
        """Poses (k, 2 K, 12) of the base at the instants that are seen; twist (k, 2, 2 K, 6)."""
        read, k = self.task.layout.read, len(observation)
        position = read(observation, "base_position")[:, None]
        axes = to_matrix(read(observation, "base_quaternion")).swapaxes(1, 2)  # transposed, as in poses
        found = []
        for half in range(2):
            steps = np.full((k, 1), length[half])
            local = self._functions.chain(twist[:, half].reshape(k, -1), steps)[0][:, 1:]
            here = position + local[..., :3] @ axes
            turned = local[..., 3:].reshape(k, INTERVALS, 3, 3) @ axes[:, None]
            found.append(np.concatenate([here, turned.reshape(k, INTERVALS, 9)], axis=2))
            position, axes = here[:, -1:], turned[:, -1]
        return np.concatenate(found, axis=1)

    def _judged(
        self, part: int, rows: NDArray[np.int64], at: _Instants, sensors: Array
    ) -> tuple[Array, Array]:
        """Terms and final attitudes from sensors (k, 1 + 2 K, s) at the beginning and at the instants."""
        task, state, period = self.task, self._state, self.actions.period
        begin = part * self.actions.steps * period
        length = np.repeat(at.length, INTERVALS) / period
        time = np.r_[begin, begin + at.seen]
        if at.rest:
            last = sensors[:, -1:].copy()
            for name in _SENSED:
                if name.endswith("velocity"):
                    last[..., task.layout.slices[name]] = 0.0
            sensors = np.concatenate([sensors, last], axis=1)
            length, time = np.r_[length, at.rest], np.r_[time, time[-1] + at.rest * period]
        peak = task.layout.read(state.observation[rows], "peak_attitude")
        quaternion = sensors[..., task.layout.slices["base_quaternion"]]
        peak = np.maximum.accumulate(np.concatenate([peak, base_rotation(quaternion[:, 1:])], axis=1), axis=1)
        flat = sensors.reshape(-1, sensors.shape[-1])
        observation = task.observe(flat, np.tile(time, len(rows)), peak.ravel())
        observation = observation.reshape(*sensors.shape[:2], -1)
        observation[:, 0] = state.observation[rows]
        result = judged(
            task,
            Seen(observation, sensors, np.broadcast_to(length, (len(rows), len(length))), state.held[rows]),
            self.context.rate_limit,
            over=part == self.actions.parts - 1,
        )
        every = np.arange(len(rows))
        state.sensors[rows], state.observation[rows] = sensors[every, result.last], result.observation
        state.held[rows], state.outcome[rows] = result.held, result.outcome
        state.steps[rows] = np.rint(task.layout.read(result.observation, "time")[:, 0] / period)
        return result.terms, np.rad2deg(task.attitude(result.observation))

    def snapshot(self) -> dict[str, Any]:
        """State for `restore` as plain values and arrays, without pickles."""
        state = {name: value.copy() for name, value in vars(self._state).items() if name != "split"}
        generator = self.np_random.bit_generator.state
        return {**state, "split": self._state.split.tolist(), "over": self.over, "generator": generator}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of as many episodes of the same task, with the same bits."""
        self.over, self.np_random.bit_generator.state = snapshot["over"], snapshot["generator"]
        own = {name: np.array(snapshot[name]) for name in vars(self._state) if name != "split"}
        self._state = _State(**own, split=np.array(snapshot["split"], dtype=object))


def _check_task(task: CaptureTask) -> None:
    """Refuse a task that has more to it than an arm and a static grapple."""
    names = [field.name for field in task.layout.fields]
    sensed = names[: names.index("position_error")] if "position_error" in names else names
    if tuple(sensed) != _SENSED or set(task.contacts.columns) != {"satellite"}:
        raise ConfigurationError(
            "the momentum level is for one arm in space and static grapples without obstacles, not for "
            f"{type(task).__name__}"
        )
