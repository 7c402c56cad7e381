"""Play a policy on goals of a split, all episodes at once in the native vector environment.

Where a policy raises or returns no actions, its episodes are played again one at a time, so that only those
are lost in which it does so by itself.
"""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.episodes import concatenate
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.evaluation.play.process.policy_process import PolicyProcess
from space_envs.evaluation.play.rollout import Rollout, RolloutRecorder
from space_envs.evaluation.play.steps import steps
from space_envs.policy import Policy, PolicyContext

PolicyFactory = Callable[[PolicyContext], Policy]


def split_indices(task: Any, split: str, episodes: int, seed: int) -> NDArray[np.int64]:
    """Goals of a split that are played: `episodes` different ones in an order drawn from the seed.

    Raises:
        ConfigurationError: if the split has fewer goals.
    """
    size = task.split_size(split)
    if not 1 <= episodes <= size:
        raise ConfigurationError(
            f"split {split!r} has {size} goals, so episodes must lie in 1..{size}; got {episodes}"
        )
    return np.random.default_rng(seed).permutation(size)[:episodes]


def roll_out(
    factory: PolicyFactory,
    environment: dict[str, Any],
    split: str,
    indices: NDArray[np.int64],
    seed: int,
    limits: TimeLimits | None = None,
    apart: bool = False,
    policy: str = "",
    first: int = 0,
    as_float32: bool = False,
) -> Rollout:
    """Play one episode per index.

    An episode in which the policy raises, returns NaN, infinity or another shape, or takes too long, ends as
    policy_error with the reason.

    Args:
        factory: makes the policy from its context. environment: keywords of `CaptureVectorEnv`.
        indices: (K,) goals of the split.
        seed: of the evaluation; the environment of episode k, counted from `first`, has the seed `seed + k`.
        limits: of the policy's calls, which are then made for one episode at a time in a process of its own.
        apart: call the policy in a process of its own, with the same actions, since it is third-party code,
            or may end its process.
        policy: its name in what is recorded. as_float32: as in `steps`.
    """

    def played(acting: Policy, rows: slice) -> Rollout:
        number, goals = first + rows.start, indices[rows]
        made = CaptureVectorEnv(num_envs=len(goals), autoreset_mode="disabled", **environment)
        with closing(made) as env:
            observation, _ = env.reset(seed=seed + number, options={"split": split, "index": goals})
            recorder = RolloutRecorder(env, observation, split, goals)
            try:
                for step in steps(acting, env, observation, as_float32=as_float32):
                    recorder.add(step)
            except PolicyError as error:
                if len(goals) > 1:
                    raise
                recorder.lose(0, str(error))
            return recorder.finished(policy, seed, number)

    singly = [slice(row, row + 1) for row in range(len(indices))]
    if limits is not None:
        with PolicyProcess(factory, environment, limits) as process:
            return concatenate([played(process, row) for row in singly])
    with fresh_policies(factory, environment, apart) as fresh:
        try:
            return played(fresh(), slice(0, len(indices)))
        except PolicyError:
            return concatenate([played(fresh(), row) for row in singly])


@contextmanager
def fresh_policies(
    factory: PolicyFactory, environment: dict[str, Any], apart: bool
) -> Iterator[Callable[[], Policy]]:
    """Yield a function that gives a policy which remembers nothing, each time that it is called.

    Args:
        factory, environment, apart: as in `roll_out`.
    """
    if apart:
        with PolicyProcess(factory, environment) as process:

            def renewed() -> Policy:
                process.renew()
                return process

            yield renewed
    else:
        context = PolicyContext.from_env(CaptureVectorEnv(**dict(environment, num_envs=1)))
        yield lambda: factory(context)
