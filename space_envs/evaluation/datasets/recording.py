"""Trajectories of a policy: recorded side by side, then each replayed alone in an environment of its own."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.evaluation.datasets.storage import Trajectory, first_difference
from space_envs.evaluation.play.chunks import Unit, built, prepared
from space_envs.evaluation.play.rollout import ask, made_anew
from space_envs.policy import Policy


@dataclass(frozen=True)
class LeftOut:
    """An episode that is not in a dataset: its number, the index of its goal, and why."""

    episode: int
    index: int
    reason: str


@dataclass(frozen=True, eq=False)
class Recorded:
    """Episodes of a unit, in its order: those that are kept, and the others."""

    kept: tuple[Trajectory, ...]
    left_out: tuple[LeftOut, ...]


def record(unit: Unit) -> Recorded:
    """Play a unit's episodes on one thread, replay each from its actions, and keep those that come out alike.

    An episode in which the policy raises, or returns NaN, infinity or another shape, is left out too.
    """
    with prepared(unit):
        environment = {**unit.environment, "threads": 1}
        kept, left_out = [], []
        env = CaptureEnv(**environment)
        with made_anew(partial(built, unit), environment, unit.player.foreign) as fresh:
            for row, played in _played(unit, fresh, environment):
                reason = played if isinstance(played, str) else check(played, env)
                if isinstance(played, str) or reason is not None:
                    left_out.append(LeftOut(unit.first + row, unit.indices[row], str(reason)))
                else:
                    kept.append(played)
        return Recorded(tuple(kept), tuple(left_out))


def check(trajectory: Trajectory, env: CaptureEnv) -> str | None:
    """Replay a trajectory from its goal, seed and actions; None if every bit of it comes out again.

    Args:
        env: of the same task and control mode, whose split the goal's index is in.
    """
    observation, _ = env.reset(seed=trajectory.seed, options={"index": trajectory.index})
    observations, rewards, terminations, truncations = [observation], [], [], []
    outcome = "running"
    for action in trajectory.actions:
        if outcome != "running":
            break
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        rewards.append(reward)
        terminations.append(terminated)
        truncations.append(truncated)
        outcome = info["outcome"]
    replayed = Trajectory(
        episode=trajectory.episode,
        index=trajectory.index,
        seed=trajectory.seed,
        outcome=outcome,
        observations=np.array(observations),
        actions=trajectory.actions[: len(rewards)],
        rewards=np.array(rewards),
        terminations=np.array(terminations, dtype=bool),
        truncations=np.array(truncations, dtype=bool),
    )
    difference = first_difference(trajectory, replayed)
    return None if difference is None else f"the replay from its actions differs: {difference}"


def _played(
    unit: Unit, fresh: Callable[[], Policy], environment: dict[str, Any]
) -> Iterator[tuple[int, Trajectory | str]]:
    """Row and trajectory of each episode, or why it was lost."""
    rows = np.arange(len(unit.indices))
    try:
        yield from enumerate(_side_by_side(unit, fresh(), environment, rows))
        return
    except PolicyError as error:
        if len(rows) == 1:
            yield 0, str(error)
            return
    for row in rows:
        try:
            yield int(row), _side_by_side(unit, fresh(), environment, rows[row : row + 1])[0]
        except PolicyError as error:
            yield int(row), str(error)


def _side_by_side(
    unit: Unit, policy: Policy, environment: dict[str, Any], rows: NDArray[np.int64]
) -> list[Trajectory]:
    """Episodes of some rows of a unit.

    Raises:
        PolicyError: if the policy raises or returns no actions.
    """
    n = len(rows)
    env = CaptureVectorEnv(num_envs=n, autoreset_mode="disabled", **environment)
    index = np.array(unit.indices)[rows]
    seeds = [unit.seed + unit.first + int(row) for row in rows]
    observation, _ = env.reset(seed=list(seeds), options={"split": unit.task.split, "index": index})
    observations, steps = [observation], []
    running, length = np.ones(n, dtype=bool), np.zeros(n, dtype=np.int64)
    outcome, state = np.full(n, "running", dtype=object), None
    for step in range(env.task.horizon):
        action, state = _act(policy, observation, state, step, running, env)
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        steps.append((action, reward, terminated, truncated))
        length += running
        outcome = info["outcome"]
        running = outcome == "running"
        if not running.any():
            break
    env.close()
    seen = np.stack(observations, axis=1)
    action, reward, terminated, truncated = (np.stack(each, axis=1) for each in zip(*steps, strict=True))
    return [
        Trajectory(
            episode=unit.first + int(rows[row]),
            index=int(index[row]),
            seed=seeds[row],
            outcome=str(outcome[row]),
            observations=seen[row, : end + 1],
            actions=action[row, :end],
            rewards=reward[row, :end],
            terminations=terminated[row, :end],
            truncations=truncated[row, :end],
        )
        for row, end in enumerate(length)
    ]


def _act(
    policy: Policy,
    observation: NDArray,
    state: Any,
    step: int,
    running: NDArray[np.bool_],
    env: CaptureVectorEnv,
) -> tuple[NDArray[np.float32], Any]:
    """The actions that are recorded and acted on: clipped, in the action space's own type, 0 after the end.

    Raises:
        PolicyError: if the policy raises, or returns NaN, infinity or another shape.
    """
    start = np.full(len(observation), step == 0)
    try:
        action, state = ask(policy, observation, state, start, env.single_action_space.shape)
    except PolicyError as error:
        raise PolicyError(f"{error} (step {step})") from error
    action[~running] = 0.0
    if not np.isfinite(action).all():
        raise PolicyError(f"the action held NaN or infinity at step {step}")
    return np.clip(action, -1.0, 1.0).astype(np.float32), state
