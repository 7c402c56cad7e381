"""The loop that plays a policy: one step of all episodes after another, until all have ended."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.foreign_code import actions_and_state, described
from space_envs.policy import Policy


@dataclass(frozen=True, eq=False)
class Step:
    """One control period of N episodes side by side.

    Attributes:
        number: of the period, from 0. running: (N,) bool, episodes that had not ended before it.
        refused: (N,) bool, those of them that end here, since their action held NaN or infinity; it was 0
            instead.
        action: (N, m) given to the environment, 0 where an episode had ended.
        observation, reward, terminated, truncated, info: that the environment returned.
        state: of the policy.
    """

    number: int
    running: NDArray[np.bool_]
    refused: NDArray[np.bool_]
    action: NDArray[np.floating[Any]]
    observation: Array
    reward: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, Any]
    state: Any


def steps(
    policy: Policy,
    env: CaptureVectorEnv,
    observation: Array,
    deterministic: bool = True,
    as_float32: bool = False,
) -> Iterator[Step]:
    """Play the episodes of an environment that was just reset; yields every step until all have ended.

    With autoreset in the same step an episode that has ended is followed by another one, up to the horizon.

    Args:
        env: without autoreset, or with autoreset in the same step. observation: (N, size) of its reset.
        deterministic: whether a stochastic policy gives its mean action.
        as_float32: clip actions and give them in the type of the action space, so that an episode can be
            repeated from its recorded actions.

    Raises:
        PolicyError: if the policy raises or returns no actions; the message says at which step.
    """
    running, start = np.ones((2, env.num_envs), dtype=bool)
    state: Any = None
    for number in range(env.task.horizon):
        try:
            given, state = predicted(
                policy, observation, state, start, env.single_action_space.shape[0], deterministic
            )
        except PolicyError as error:
            raise PolicyError(f"{error} (step {number})") from error
        refused = running & ~np.isfinite(given).all(axis=1)
        given[refused | ~running] = 0.0
        action = np.clip(given, -1.0, 1.0).astype(np.float32) if as_float32 else given
        observation, reward, terminated, truncated, info = env.step(action)
        yield Step(number, running, refused, action, observation, reward, terminated, truncated, info, state)
        ended = terminated | truncated
        if env.autoreset_mode is AutoresetMode.SAME_STEP:
            start = ended
            continue
        running, start = running & ~refused & ~ended, np.zeros_like(start)
        if not running.any():
            return


def predicted(
    policy: Policy,
    observation: Array,
    state: Any,
    start: NDArray[np.bool_],
    size: int,
    deterministic: bool = True,
) -> tuple[Array, Any]:
    """A policy's next actions (N, size), which may hold NaN, and its state.

    Args:
        observation: (N, d); the policy gets a copy. start: (N,) where an episode begins.

    Raises:
        PolicyError: if the policy raises anything but KeyboardInterrupt, which is the user's, or returns no
            pair of actions of that shape and state.
    """
    try:
        returned = policy.predict(
            observation.copy(), state=state, episode_start=start, deterministic=deterministic
        )
        return actions_and_state(returned, (len(observation), size))
    except (PolicyError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PolicyError(f"it raised {described(error)}") from error
