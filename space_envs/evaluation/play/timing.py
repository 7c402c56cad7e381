"""Time that a policy takes to plan and to act."""

from dataclasses import dataclass
from itertools import islice
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.playing import PolicyFactory
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.evaluation.play.process.policy_process import PolicyProcess
from space_envs.evaluation.play.steps import steps
from space_envs.policy import Policy, PolicyContext

PLANS = 5.0  # a call that finds its code and data cold takes up to three times as long


@dataclass(frozen=True)
class PolicyTime:
    """Milliseconds on one thread, one episode at a time: medians over episodes.

    Attributes:
        planning: of the first call of an episode beyond what a later call takes; None for a policy that
            makes no plan, whose first call takes less than PLANS times as long as a later one.
        action: of a later call.
    """

    planning: float | None
    action: float


class Stopwatch:
    """Policy that calls another one and measures the time of each call.

    Attributes:
        seconds: of every call so far.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.seconds: list[float] = []

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions and state of the other policy."""
        before = perf_counter()
        returned = self._policy.predict(observation, state, episode_start, deterministic)
        passed = perf_counter() - before
        # A policy in a process of its own says itself how long it took.
        self.seconds.append(self._policy.seconds if isinstance(self._policy, PolicyProcess) else passed)
        return returned


def time_policy(
    factory: PolicyFactory,
    environment: dict[str, Any],
    split: str,
    indices: NDArray[np.int64],
    limits: TimeLimits | None = None,
    calls: int = 20,
    apart: bool = False,
) -> PolicyTime:
    """Time a policy's calls on one thread, apart from the simulation; the first episode is not counted.

    Raises:
        PolicyError: if the policy raises, or takes too long.
    """
    environment = {**environment, "threads": 1}
    if limits is not None or apart:
        with PolicyProcess(factory, environment, limits) as policy:
            return _timed(policy, environment, split, indices, calls)
    policy = factory(PolicyContext.from_env(CaptureVectorEnv(**environment)))
    return _timed(policy, environment, split, indices, calls)


def _timed(
    policy: Policy, environment: dict[str, Any], split: str, indices: NDArray[np.int64], calls: int
) -> PolicyTime:
    env = CaptureVectorEnv(num_envs=1, autoreset_mode="disabled", **environment)
    planning, acting = [], []
    for index in [indices[0], *indices]:
        watch = Stopwatch(policy)
        observation, _ = env.reset(seed=0, options={"split": split, "index": int(index)})
        for _ in islice(steps(watch, env, observation), calls):
            pass
        later = float(np.median(watch.seconds[1:] or watch.seconds))
        acting.append(later)
        planning.append(max(watch.seconds[0] - later, 0.0))
    env.close()
    plan, act = 1e3 * float(np.median(planning[1:])), 1e3 * float(np.median(acting[1:]))
    return PolicyTime(plan if plan + act >= PLANS * act else None, act)
