"""Episodes of one policy, all at once in the native vector environment, with every state recorded.

Where a policy raises or returns no actions, its episodes are played again one at a time, so that only those
are lost in which it does so by itself.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.integrals import Integrals, Totals
from space_envs.evaluation.play.policy_process import PolicyProcess, TimeLimits
from space_envs.evaluation.records.causes import cause_of, missing_plans
from space_envs.policy import Policy, PolicyContext
from space_envs.strangers import actions_and_state, described
from space_envs.tasks.common import Goals

PLANS = 10.0  # a call that finds its code and data cold takes up to three times as long

PolicyFactory = Callable[[PolicyContext], Policy]


@dataclass(frozen=True)
class Rollout(Totals):
    """K recorded episodes of at most T steps; after its end an episode repeats its last values.

    What they add up to at every step of the simulation is in the fields of `Totals`.

    Attributes:
        index: (K,) goal in the split. length: (K,) steps until the end.
        qpos: (K, T + 1, 7 + n), qvel: (K, T + 1, 6 + n) of the robot, MuJoCo's conventions for a free joint.
        scene: (K, T + 1, nq) all of the model's qpos, to draw pictures from.
        torque: (K, T, n) N m, zero after the end.
        goals: of the task, K of them.
        position_error: (K, T + 1) m. orientation_error, attitude: (K, T + 1) deg.
        outcome: K strings. cause: why an episode failed, one of `records.CAUSES`, None for a capture.
        reason: the cause in a sentence, where the policy or the harness says more, else None.
        episode_return, clipped: (K,).
    """

    index: NDArray[np.int64]
    length: NDArray[np.int64]
    qpos: Array
    qvel: Array
    scene: Array
    torque: Array
    goals: Goals
    position_error: Array
    orientation_error: Array
    attitude: Array
    outcome: list[str]
    cause: list[str | None]
    reason: list[str | None]
    episode_return: Array
    clipped: NDArray[np.int64]


def split_indices(task: Any, split: str, episodes: int, seed: int) -> NDArray[np.int64]:
    """Which goals of a split are played: `episodes` different ones in an order drawn from the seed.

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
) -> Rollout:
    """Play one episode per index.

    An episode in which the policy raises, returns NaN, infinity or another shape, or takes too long, ends as
    policy_error with the reason.

    Args:
        factory: makes the policy from its context.
        environment: keywords of `CaptureVectorEnv`.
        indices: (K,) goals of the split.
        seed: of the environment's generators.
        limits: of the policy's calls, which are then made for one episode at a time in a process of its own.
        apart: call the policy in a process of its own, with the same actions, since it is a stranger's, or
            may end it.
    """
    if limits is not None:
        with PolicyProcess(factory, environment, limits) as policy:
            return join([_played(policy, environment, split, one, seed) for one in indices[:, None]])
    with made_anew(factory, environment, apart) as fresh:
        try:
            return _played(fresh(), environment, split, indices, seed)
        except PolicyError:
            return join([_played(fresh(), environment, split, one, seed) for one in indices[:, None]])


@contextmanager
def made_anew(
    factory: PolicyFactory, environment: dict[str, Any], apart: bool
) -> Iterator[Callable[[], Policy]]:
    """Yield what gives a policy that remembers nothing, each time that it is called.

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
        context = PolicyContext.from_env(CaptureVectorEnv(**{**environment, "num_envs": 1}))
        yield lambda: factory(context)


def _played(
    policy: Policy, environment: dict[str, Any], split: str, indices: NDArray[np.int64], seed: int
) -> Rollout:
    """Episodes side by side.

    Raises:
        PolicyError: if the policy raises or returns no actions, and there are several episodes.
    """
    n = len(indices)
    env = CaptureVectorEnv(num_envs=n, autoreset_mode="disabled", **environment)
    task, simulation = env.task, env.simulation
    observation, _ = env.reset(seed=seed, options={"split": split, "index": indices})
    horizon, joints = task.horizon, simulation.n_joints
    qpos = np.empty((n, horizon + 1, 7 + joints))
    qvel = np.empty((n, horizon + 1, 6 + joints))
    scene = np.empty((n, horizon + 1, simulation.model.nq))
    torque = np.zeros((n, horizon, simulation.n_joints))
    seen = np.empty((n, horizon + 1, observation.shape[1]))
    qpos[:, 0], qvel[:, 0] = simulation.robot_state()
    scene[:, 0], seen[:, 0] = simulation.qpos, observation
    outcome = np.full(n, "running", dtype=object)
    reason: list[str | None] = [None] * n
    length = np.zeros(n, dtype=np.int64)
    total, clipped = np.zeros(n), np.zeros(n, dtype=np.int64)
    goals = task.goals(split, indices)
    integrals = Integrals(task, simulation, goals.mass_scale)
    simulation.watch = integrals.see
    state: Any = None
    running = np.ones(n, dtype=bool)
    for step in range(horizon):
        try:
            action, state = ask(
                policy, observation, state, np.full(n, step == 0), env.single_action_space.shape
            )
        except PolicyError as error:
            if n > 1:
                raise
            outcome[0], reason[0] = "policy_error", f"{error} (step {step})"
            for array in (qpos, qvel, scene, seen):
                array[:, step + 1 :] = array[:, step : step + 1]
            break
        bad = running & ~np.isfinite(action).all(axis=1)
        if bad.any():
            action = np.where(bad[:, None], 0.0, action)
        action[~running] = 0.0
        observation, reward, _, _, info = env.step(action)
        total += np.where(running, reward, 0.0)
        length += running
        state_now = (*simulation.robot_state(), simulation.qpos)
        for record, now in zip((qpos, qvel, scene), state_now, strict=True):
            record[:, step + 1] = np.where(running[:, None], now, record[:, step])
        torque[:, step] = np.where(running[:, None], simulation.ctrl, 0.0)
        seen[:, step + 1] = observation
        outcome = np.where(running, info["outcome"], outcome)
        clipped = np.where(running, info["clipped_actions"], clipped)
        for row in np.flatnonzero(running & (outcome == "collision")):
            reason[row] = f"{info['collision'][row]} touched"
        for row in np.flatnonzero(bad):
            outcome[row], reason[row] = "policy_error", f"the action held NaN or infinity at step {step}"
        diverged = outcome == "diverged"
        integrals.add(running & ~diverged)
        for row in np.flatnonzero(running & diverged):
            # The simulation has started over by itself: the state before is the last true one.
            for record in (qpos, qvel, scene):
                record[row, step + 1] = record[row, step]
        running = running & (outcome == "running")
        if not running.any():
            for array in (qpos, qvel, scene, seen):
                array[:, step + 2 :] = array[:, step + 1 : step + 2]
            break
    env.close()
    plans = missing_plans(state, n)
    cause = [cause_of(ended, plan) for ended, plan in zip(outcome, plans, strict=True)]
    for row, plan in enumerate(plans):
        if plan is not None and cause[row] == plan.cause:
            reason[row] = plan.reason
    flat = seen.reshape(-1, seen.shape[-1])
    errors = task.errors(flat)
    return Rollout(
        index=indices,
        length=length,
        qpos=qpos,
        qvel=qvel,
        scene=scene,
        torque=torque,
        goals=goals,
        position_error=errors.position.reshape(n, -1),
        orientation_error=np.rad2deg(errors.orientation).reshape(n, -1),
        attitude=np.rad2deg(task.attitude(flat)).reshape(n, -1),
        outcome=list(outcome),
        cause=cause,
        reason=reason,
        episode_return=total,
        clipped=clipped,
        **vars(integrals.totals),
    )


def ask(
    policy: Policy, observation: Array, state: Any, start: NDArray[np.bool_], shape: tuple[int, ...]
) -> tuple[Array, Any]:
    """A policy's next actions (N, m), m of `shape`, and its state; they may hold NaN.

    Args:
        observation: (N, d); the policy gets a copy. start: (N,) where an episode begins.

    Raises:
        PolicyError: if the policy raises anything but KeyboardInterrupt, which is the user's, or returns no
            pair of actions of that shape and state.
    """
    try:
        returned = policy.predict(observation.copy(), state=state, episode_start=start, deterministic=True)
        return actions_and_state(returned, (len(observation), shape[0]))
    except (PolicyError, KeyboardInterrupt):
        raise
    except BaseException as error:
        raise PolicyError(f"it raised {described(error)}") from error


def join(parts: Sequence[Rollout]) -> Rollout:
    """The episodes of several roll-outs on one task, one after the other."""
    joined: dict[str, Any] = {}
    for name in vars(parts[0]):
        values = [getattr(part, name) for part in parts]
        if isinstance(values[0], list):
            joined[name] = sum(values, [])
        elif isinstance(values[0], Goals):
            names = vars(values[0])
            joined[name] = type(values[0])(
                **{f: np.concatenate([getattr(v, f) for v in values]) for f in names}
            )
        else:
            joined[name] = np.concatenate(values)
    return Rollout(**joined)


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


def time_policy(
    factory: PolicyFactory,
    environment: dict[str, Any],
    split: str,
    indices: NDArray[np.int64],
    limits: TimeLimits | None = None,
    steps: int = 20,
    apart: bool = False,
) -> PolicyTime:
    """Time a policy's calls on one thread, apart from the simulation; the first episode is not counted.

    Raises:
        PolicyError: if the policy raises, or takes too long.
    """
    environment = {**environment, "threads": 1}
    if limits is not None or apart:
        with PolicyProcess(factory, environment, limits) as policy:
            return _timed(policy, environment, split, indices, steps)
    policy = factory(PolicyContext.from_env(CaptureVectorEnv(**environment)))
    return _timed(policy, environment, split, indices, steps)


def _timed(
    policy: Policy, environment: dict[str, Any], split: str, indices: NDArray[np.int64], steps: int
) -> PolicyTime:
    env = CaptureVectorEnv(num_envs=1, autoreset_mode="disabled", **environment)
    planning, acting = [], []
    for index in [indices[0], *indices]:
        observation, _ = env.reset(seed=0, options={"split": split, "index": int(index)})
        state: Any = None
        durations = []
        for step in range(steps):
            before = perf_counter()
            action, state = ask(
                policy, observation, state, np.array([step == 0]), env.single_action_space.shape
            )
            # A policy in a process of its own says itself how long it took.
            passed = perf_counter() - before
            durations.append(policy.seconds if isinstance(policy, PolicyProcess) else passed)
            observation, *_ = env.step(np.nan_to_num(action))
        later = float(np.median(durations[1:]))
        acting.append(later)
        planning.append(max(durations[0] - later, 0.0))
    env.close()
    plan, act = 1e3 * float(np.median(planning[1:])), 1e3 * float(np.median(acting[1:]))
    return PolicyTime(plan if plan + act >= PLANS * act else None, act)
