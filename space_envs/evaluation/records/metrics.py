"""Table of the metrics that every task has, and the function of each."""

from collections import Counter
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.dynamics.trajectories import attitude_cost
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.rollout import Rollout
from space_envs.metric import Display, Metric
from space_envs.registration import ENTRIES
from space_envs.tasks.outcome import Outcome


def time_to_capture(episodes: Rollout, task: Any) -> Array:
    """Time (K,) until the capture, s."""
    return _of_captures(episodes, episodes.length * task.control_period)


def time_to_envelope(episodes: Rollout, task: Any) -> Array:
    """Time (K,) until the capture envelope was entered for good, s."""
    return _of_captures(episodes, (episodes.length - task.hold_steps) * task.control_period)


def base_disturbance(episodes: Rollout, task: Any) -> Array:
    """Cost (K,) of eq. 20 of shyam2020 times dt, m^2/s.

    From the base twist after each control period, as in the reward; docs/physics.md says how near the time
    integral that is.
    """
    alive = np.arange(episodes.torque.shape[1]) < episodes.length[:, None]  # (K, T) steps before the end
    twist = episodes.qvel[:, 1:, :6] * alive[..., None]  # rotation of the axes does not change eq. 20
    return attitude_cost(twist, task.control_period, task.c)


def collisions(episodes: Rollout, task: Any) -> NDArray[np.int64]:
    """Number (K,) of collisions; the first ends the episode."""
    return np.array([outcome == Outcome.COLLISION for outcome in episodes.outcome], dtype=np.int64)


def _of_captures(episodes: Rollout, values: Array) -> Array:
    captured = np.array([outcome == Outcome.CAPTURED for outcome in episodes.outcome], dtype=bool)
    return np.where(captured, values, np.nan)


def _recorded(name: str) -> Callable[[Any, Any], Any]:
    """Function that returns the episodes' attribute (K,) of this name."""
    return lambda episodes, task: getattr(episodes, name)


def _final(name: str) -> Callable[[Any, Any], Array]:
    """Function that returns the last value (K,) of the episodes' attribute (K, T + 1) of this name."""
    return lambda episodes, task: getattr(episodes, name)[:, -1]


METRICS: tuple[Metric, ...] = (
    Metric(
        "time_to_capture",
        "s",
        "time until the capture",
        time_to_capture,
        Display("time to capture", "lower", "median", room="paper", priority=11, order=5),
        of_captures=True,
    ),
    Metric(
        "time_to_envelope",
        "s",
        "until the envelope was entered for good: time_to_capture without the time for which it is held",
        time_to_envelope,
        of_captures=True,
    ),
    Metric("steps", "", "control steps until the end", _recorded("length"), whole=True),
    Metric(
        "episode_return", "", "sum of the rewards", _recorded("episode_return"), signed=True, optional=True
    ),
    Metric(
        "position_error",
        "m",
        "when the episode ended: for a capture, at the capture, not where it settles later",
        _final("position_error"),
        Display(
            "position error at capture",
            "lower",
            unit="mm",
            scale=1000,
            key="position_error_at_capture",
            priority=15,
            order=6,
        ),
    ),
    Metric(
        "orientation_error",
        "deg",
        "when the episode ended, as the position error",
        _final("orientation_error"),
        Display(key="orientation_error_at_capture", order=7),
    ),
    Metric(
        "peak_attitude",
        "deg",
        "largest angle of the base from its initial attitude, at any step of the simulation",
        _recorded("peak_attitude"),
        Display("peak attitude", "lower", room="paper", priority=2, order=2),
    ),
    Metric(
        "final_attitude",
        "deg",
        "angle of the base from its initial attitude, at the end",
        _final("attitude"),
        Display("final attitude", "lower", room="readme", priority=4, order=1),
    ),
    Metric(
        "attitude_cost",
        "m^2/s",
        "eq. 20 of Shyam et al. 2020 times the control period, summed; a slower motion has less",
        base_disturbance,
        Display(
            "base disturbance (eq. 20)",
            "lower",
            unit="cm^2/s",
            scale=10000.0,
            room="paper",
            priority=8,
            order=3,
        ),
    ),
    Metric(
        "base_angular_impulse",
        "N m s",
        "total variation of the base's angular momentum about its centre of mass, at every simulation step",
        _recorded("base_angular_impulse"),
        Display(order=8),
    ),
    Metric(
        "kinetic_energy_integral",
        "J s",
        "integral of twice the kinetic energy: C of shah2013",
        _recorded("kinetic_energy_integral"),
        Display(order=9),
    ),
    Metric(
        "mechanical_work",
        "J",
        "sum over joints and steps of the simulation of |torque times angle|",
        _recorded("mechanical_work"),
        Display(order=10),
        signed=True,
        optional=True,
    ),
    Metric(
        "peak_power",
        "W",
        "largest sum over joints of |torque times rate|, at any step of the simulation",
        _recorded("peak_power"),
        Display(order=11),
    ),
    Metric(
        "collisions",
        "",
        "how often the robot touched what it must not; the first ends the episode",
        collisions,
        whole=True,
    ),
    Metric("clipped_actions", "", "steps whose action lay outside [-1, 1]", _recorded("clipped"), whole=True),
    Metric(
        "linear_momentum_drift",
        "N s",
        "largest change of the robot's total linear momentum since the start",
        _recorded("linear_momentum_drift"),
        Display(statistic="largest", over="all"),
    ),
    Metric(
        "angular_momentum_drift",
        "N m s",
        "largest change of the robot's total angular momentum since the start",
        _recorded("angular_momentum_drift"),
        Display(statistic="largest", over="all"),
    ),
)


Described = Mapping[str, tuple[Metric, ...]]
"""Metrics of tasks' own by environment id, as results describe them."""


def metrics_of(env_id: str, described: Described = MappingProxyType({})) -> tuple[Metric, ...]:
    """Metrics of an id's episodes in the order of the records: those of every task, then its own."""
    return METRICS + own_metrics(env_id, described)


def own_metrics(env_id: str, described: Described = MappingProxyType({})) -> tuple[Metric, ...]:
    """Metrics of an id's task alone: as they are described, else as the task is registered."""
    registered = ENTRIES[env_id].task.metrics if env_id in ENTRIES else ()
    return described.get(env_id, registered)


def episode_metrics(episodes: Rollout, task: Any) -> dict[str, NDArray[Any]]:
    """Values (K,) of all metrics of recorded episodes of a task, by name; NaN where an episode has none.

    Raises:
        ConfigurationError: if a metric of the task has the name of another, or gives no K numbers.
    """
    metrics = (*METRICS, *task.metrics)
    kind, names = type(task).__name__, Counter(metric.name for metric in metrics)
    for name, times in names.items():
        if times > 1:
            raise ConfigurationError(f"{kind} has two metrics of the name {name!r}")
    count, values = len(episodes.index), {}
    for metric in metrics:
        found = np.asarray(metric.of(episodes, task))
        if found.shape != (count,) or found.dtype.kind not in "biuf":
            raise ConfigurationError(
                f"metric {metric.name!r} of {kind} must give {count} numbers, got {found.dtype} {found.shape}"
            )
        values[metric.name] = found.astype(np.int64 if metric.whole else np.float64)
    return values
