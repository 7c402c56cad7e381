"""Policies that were learned: from a run's folder, a policy file, or those that ship with the project."""

from dataclasses import replace
from functools import lru_cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from agents.planners.common.robot_files import robot_options
from agents.policies.base import BasePolicy
from agents.policies.learned.features import FeatureView
from agents.policies.learned.network import Network
from agents.policies.learned.policy_file import PolicyFile, load_policy_file
from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError, unknown_name
from space_envs.policy import DEFAULT_CONTROL_MODE, Knowledge, Needs, PolicyContext

POLICY_FILE = "policy.npz"  # in a run's folder: the best policy on the validation split so far
_SHIPPED = files("agents") / "data" / "policies"


class NetworkPolicy(BasePolicy):
    """Acts by a network.

    Args:
        context: of the environment it acts in.
        seed: of the noise where `predict` is asked not to be deterministic.
        network: from what `view` gives to actions.
        view: from observations (N, size) to the network's inputs; None is the observations themselves.
    """

    def __init__(
        self, context: PolicyContext, seed: int, network: Network, view: FeatureView | None = None
    ) -> None:
        super().__init__(context, seed)
        self.network, self.view = network, view
        self._generator = np.random.default_rng(seed)

    def actions(self, observation: Array, state: Any, deterministic: bool) -> Array:
        """Actions (N, m) in [-1, 1], the mean ones or drawn."""
        inputs = observation if self.view is None else self.view(observation)
        generator = None if deterministic else self._generator
        return self.network.actions(inputs, generator).astype(np.float64)


class LearnedPolicy(NetworkPolicy):
    """Acts by a network that was trained with `train.py`; the normalisation is part of its file.

    Args:
        context: of the environment it acts in.
        seed: of the noise where `predict` is asked not to be deterministic.
        file: the policy.

    Raises:
        PolicyError: if the policy was trained for another id, control mode or robot.
    """

    def __init__(self, context: PolicyContext, seed: int, file: PolicyFile) -> None:
        check_trained_for(file, context)
        if file.network.outputs != len(context.action_scale):
            raise PolicyError(
                f"the policy gives {file.network.outputs} actions, not {len(context.action_scale)}"
            )
        super().__init__(context, seed, file.network, file.view(context.layout))


def check_trained_for(file: PolicyFile, context: PolicyContext) -> None:
    """Refuse a context that a policy was not trained for.

    Raises:
        PolicyError: naming the id, control mode or robot.
    """
    if (context.env_id, context.control_mode) != (file.env_id, file.control_mode):
        raise PolicyError(
            f"the policy was trained for {file.env_id} in control mode {file.control_mode!r}, "
            f"not for {context.env_id} in {context.control_mode!r}"
        )
    file.check_robot(context.robot)


def policy_path(path: str | Path) -> Path:
    """The policy file that a run's folder or a file's path names.

    Raises:
        PolicyError: for a folder without one.
    """
    path = Path(path)
    if path.is_dir():
        inside = path / POLICY_FILE
        if not inside.is_file():
            raise PolicyError(
                f"{path} holds no {POLICY_FILE}: it is no run of train.py, or none was saved yet"
            )
        return inside
    return path


def shipped_name(algorithm: str, control_mode: str) -> str:
    """Name of a policy that ships: its algorithm, and its control mode where that is not the default."""
    return algorithm if control_mode == DEFAULT_CONTROL_MODE else f"{algorithm}_{control_mode}"


def shipped_path(env_id: str, name: str) -> Path:
    """Path of the shipped policy `name` for an id, whether or not it is there."""
    return Path(str(_SHIPPED)) / env_id.removeprefix("SpaceCapture/") / f"{name}.npz"


def shipped_policies(env_id: str) -> tuple[str, ...]:
    """Names of the policies that ship with the project for an id."""
    return tuple(sorted(path.stem for path in shipped_path(env_id, "any").parent.glob("*.npz")))


@lru_cache(maxsize=16)
def load_shipped(env_id: str, name: str) -> PolicyFile:
    """A policy that ships with the project.

    Raises:
        ConfigurationError: if there is none of that name for the id.
    """
    names = shipped_policies(env_id)
    if name not in names:
        raise unknown_name(f"shipped policy for {env_id}", name, names)
    return load_policy_file(shipped_path(env_id, name))


def shipped_file_of(algorithm: str, context: PolicyContext) -> PolicyFile:
    """The shipped policy of an algorithm for a context's id and control mode; errors as in `load_shipped`."""
    return load_shipped(context.env_id, shipped_name(algorithm, context.control_mode))


def missing_weights(algorithm: str, context: PolicyContext) -> str | None:
    """Reason why a shipped policy does not fit a context: there are no weights; None where there are."""
    name, names = shipped_name(algorithm, context.control_mode), shipped_policies(context.env_id)
    if name not in names:
        shipped = f"those that ship are {', '.join(names)}" if names else "none ship for the task"
        return f"it needs weights {name!r}, {shipped}"
    robots = load_shipped(context.env_id, name).robots
    if context.robot.digest in robots:
        return None
    command = f"train.py --algo {algorithm} --env {context.env_id} {robot_options(context.robot)}"
    return (
        f"its weights are for the robot {' or '.join(robots.values())}, not for {context.robot.name}: "
        f"`{command}` trains others"
    )


class ShippedPolicy(LearnedPolicy):
    """A policy that ships with the project; a subclass names it."""

    knowledge = Knowledge.IMITATION
    name: ClassVar[str]
    needs: ClassVar[Needs]

    def __init_subclass__(cls) -> None:
        if "needs" not in vars(cls):
            cls.needs = Needs(other=partial(missing_weights, cls.name))

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed, shipped_file_of(self.name, context))


class BehaviourCloning(ShippedPolicy):
    """Cloned from an expert, `train.py --algo bc`; ignores bodies in its path."""

    name = "bc"


class ReactionlessCloning(BehaviourCloning):
    """The same in control mode reactionless."""

    control_mode = "reactionless"
    needs = replace(BehaviourCloning.needs, control_modes=("reactionless",))


class ProximalPolicyOptimization(ShippedPolicy):
    """Cloned, then improved by reinforcement, `train.py --algo ppo`; ignores bodies in its path."""

    name = "ppo"
