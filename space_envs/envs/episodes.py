"""State of N episodes and the infos derived from it. In a vector info each key has an array and, with a
leading underscore, the mask of the rows for which it is valid."""

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs.starts import Start
from space_envs.errors import ConfigurationError
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals
from space_envs.tasks.outcome import Outcome
from space_envs.tasks.rewards import StepQuantities

_STORED = ("observation", "steps", "held", "clipped", "outcome", "touched", "index")
_RUNNING = Outcome.RUNNING.code
_NAMES = np.array([outcome.value for outcome in Outcome], dtype=object)  # by code
_TERMINATED = np.array([outcome.flag == "terminated" for outcome in Outcome])  # by code


class EpisodeTracker:
    """N episodes of a task.

    Attributes:
        watched: whether contacts end an episode.
        observation: (N, size), the last one. steps: (N,) control periods since the start.
        held: (N,) number of consecutive observations, up to the last, inside the capture envelope.
        clipped: (N,) control periods of the episode whose action was clipped.
        outcome: (N,) codes of `Outcome`. touched: (N,) codes of the task's `contact_names`.
        index, split: (N,) source of the goals. goals: N of the task, None before the first reset.
    """

    def __init__(self, task: CaptureTask, n: int) -> None:
        self._task = task
        self._all = np.ones(n, dtype=bool)
        self.watched = task.collides and task.collisions
        names = task.contact_names if self.watched else ("",)
        self._contact_names = np.array(names, dtype=object)
        self.observation = np.zeros((n, task.layout.size))
        self.steps, self.held, self.clipped, self.outcome, self.touched = (
            np.zeros(n, dtype=np.int64) for _ in range(5)
        )
        self.index = np.full(n, -1, dtype=np.int64)
        self.split = np.full(n, task.split, dtype=object)
        self.goals: list[Goals | None] = [None] * n
        self._last: StepQuantities | None = None  # of the last observation, if it ended a control period

    @property
    def time(self) -> Array:
        """Time (N,) since the start of each episode, s."""
        return self.steps * self._task.control_period

    @property
    def ended(self) -> NDArray[np.bool_] | None:
        """Mask (N,) of finished episodes; None if there are none."""
        return self.outcome != _RUNNING if self.outcome.any() else None

    def begin(self, rows: NDArray[np.int64], start: Start) -> None:
        """Start new episodes in rows (k,)."""
        self.index[rows], self.split[rows] = start.index, start.split
        for place, row in enumerate(rows):
            self.goals[row] = start.goals.take(np.array([place]))
        for counter in (self.steps, self.held, self.clipped, self.outcome, self.touched):
            counter[rows] = 0

    def observe_start(self, rows: NDArray[np.int64], observation: Array) -> None:
        """Store observations (k, size) of rows (k,) as initial ones."""
        self.observation[rows], self._last = observation, None
        self.held[rows] = self._task.errors(observation).within(self._task.limits)

    def count(self, clipped: NDArray[np.bool_] | None, ended: NDArray[np.bool_] | None) -> None:
        """Count a control period of the running episodes, and their clipped actions (N,) bool."""
        if clipped is not None:
            self.clipped += clipped if ended is None else clipped & ~ended
        self.steps += 1 if ended is None else ~ended

    def judge(
        self,
        observation: Array,
        action: Array,
        diverged: NDArray[np.bool_] | None,
        touched: NDArray[np.int64] | None,
    ) -> tuple[Array, Array]:
        """Update outcomes after a control period.

        Args:
            observation: (N, size) at its end. action: (N, m) in [-1, 1].
            diverged: (N,), None if no simulation has. touched: (N,) codes, None if contacts are not checked.

        Returns:
            Weighted reward terms (N, k) and attitude (N,) rad.
        """
        task, before = self._task, self.observation
        beginning = self._state(before) if self._last is None else self._last._replace(beginning=None)
        errors, attitude = task.errors(observation), task.attitude(observation)
        self.held = (self.held + 1) * errors.within(task.limits)
        captured, failed = self._end(
            self.held > task.hold_steps, attitude > task.attitude_limit_rad, diverged, touched
        )
        self.observation = observation
        layout, limits = task.layout, task.limits
        self._last = StepQuantities(
            observation, before, action, errors, attitude, captured, failed, layout, limits, beginning
        )
        return task.weighted_terms(self._last), attitude

    def _state(self, observation: Array) -> StepQuantities:
        """Quantities of a state (N, size) in which no episode ended."""
        task, none = self._task, np.zeros(len(observation), dtype=bool)
        errors, attitude = task.errors(observation), task.attitude(observation)
        action = np.zeros((len(observation), 0))
        return StepQuantities(
            observation, observation, action, errors, attitude, none, none, task.layout, task.limits
        )

    def _end(
        self,
        captured: NDArray[np.bool_],
        failed: NDArray[np.bool_],
        diverged: NDArray[np.bool_] | None,
        touched: NDArray[np.int64] | None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Set the outcome of episodes that end now; returns the masks (N,) of captured and of failed ones."""
        over = self.steps >= self._task.horizon
        collided = touched > 0 if touched is not None and touched.any() else None
        for other in (collided, diverged):
            failed = failed if other is None else failed | other
        if not (captured | failed | over).any():
            return captured, failed
        running = self.outcome == _RUNNING
        captured, failed = captured & ~failed & running, failed & running
        self.outcome[over & running] = Outcome.TIMEOUT.code
        self.outcome[captured] = Outcome.CAPTURED.code
        self.outcome[failed] = Outcome.ATTITUDE_LOST.code
        if touched is not None and collided is not None:
            self.outcome[failed & collided] = Outcome.COLLISION.code
            self.touched[failed & collided] = touched[failed & collided]
        if diverged is not None:
            self.outcome[failed & diverged] = Outcome.DIVERGED.code
            self.touched[failed & diverged] = 0
        return captured, failed

    def flags(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether episodes (N,) have terminated, and whether they were truncated."""
        over = self.steps >= self._task.horizon
        return _TERMINATED[self.outcome], (self.outcome != _RUNNING) & over

    def step_info(self, terms: Array, attitude: Array) -> dict[str, Any]:
        """Vector info of a control period, from weighted reward terms (N, k) and attitude (N,) rad."""
        present = self._all.copy()
        named: dict[str, Any] = {}
        for column, term in enumerate(self._task.reward_terms):
            named[term.name], named[f"_{term.name}"] = terms[:, column], present
        info = {
            "reward_terms": named,
            "attitude": np.rad2deg(attitude),
            "is_success": self.outcome == Outcome.CAPTURED.code,
            "outcome": _NAMES[self.outcome],
            "collision": self._contact_names[self.touched],
            "clipped_actions": self.clipped.copy(),
        }
        return info | {f"_{key}": present for key in info}

    def reset_info(self, rows: NDArray[np.bool_]) -> dict[str, Any]:
        """Vector info of reset rows (N,) bool: the source of their goals."""
        return {"split": self.split.copy(), "_split": rows, "index": self.index.copy(), "_index": rows}

    def snapshot(self) -> dict[str, Any]:
        """Copy of the state, for `restore`."""
        own = {name: value for name, value in vars(self).items() if name not in ("_task", "_last")}
        return copy.deepcopy(own)

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Restore a snapshot of the same number of episodes of the same task."""
        vars(self).update(snapshot)
        self._last = None

    def stored(self) -> dict[str, Any]:
        """Plain values and arrays for `resume`; goals follow from split and index.

        Raises:
            ConfigurationError: where goals were given as numbers.
        """
        if (self.index < 0).any():
            raise ConfigurationError("episodes whose goals were given as numbers cannot be stored")
        episodes = {name: getattr(self, name).copy() for name in _STORED}
        return {"episodes": episodes, "split": self.split.tolist()}

    def resume(self, stored: dict[str, Any]) -> None:
        """Continue as many episodes of the same task as were `stored`."""
        vars(self).update({name: stored["episodes"][name].copy() for name in _STORED})
        self.split, self._last = np.array(stored["split"], dtype=object), None
        self.goals = [
            self._task.goals(split, np.array([index]))
            for split, index in zip(self.split, self.index.tolist(), strict=True)
        ]


def masked(info: dict[str, Any], rows: NDArray[np.bool_]) -> dict[str, Any]:
    """Copy of a vector info, valid in `rows` only."""
    return {
        key: rows.copy()
        if key.startswith("_")
        else masked(value, rows)
        if isinstance(value, dict)
        else value.copy()
        for key, value in info.items()
    }


def first_row(info: dict[str, Any]) -> dict[str, Any]:
    """Row 0 of a vector info, without its masks, as plain Python values."""
    return {
        key: first_row(value) if isinstance(value, dict) else value.item(0)
        for key, value in info.items()
        if not key.startswith("_")
    }
