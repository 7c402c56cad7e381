"""Start of training: an expert to clone, or a policy that was trained before."""

from typing import Any

from agents.learning.runs.hyperparameters import PPO, AnyHyperparameters, OffPolicy, Planner
from agents.policies.learned.learned_policy import policy_path
from agents.policies.learned.policy_file import PolicyFile, load_policy_file
from agents.policies.registry import POLICIES, needs
from space_envs.errors import PolicyError
from space_envs.policy import Knowledge, PolicyContext

DEFAULT_EXPERTS = (
    "gjm",
    "reactionless_rate",
)  # reactive ones, which can label any state; the first that fits


def default_expert(context: PolicyContext) -> str | None:
    """The first of the default experts that fits the environment, None if none does."""
    return next((name for name in DEFAULT_EXPERTS if not needs(name).missing(context)), None)


def experts_for(context: PolicyContext) -> list[str]:
    """Names of the registered planners that fit the environment."""
    return [name for name, row in POLICIES.items() if row.expert and not needs(name).missing(context)]


def starting_policy(path: str, context: PolicyContext, parameters: PPO | OffPolicy) -> PolicyFile:
    """The policy of a run's folder or file, checked against what will be trained.

    ppo takes over its weights; the others learn to act like it, so that it may have another network.

    Raises:
        PolicyError: if there is none, or it was trained for another task, robot or network.
    """
    file = load_policy_file(policy_path(path))
    file.check_robot(context.robot)
    checks: list[tuple[str, Any, Any]] = [
        ("environment id", file.env_id, context.env_id),
        ("control mode", file.control_mode, context.control_mode),
        ("features", file.features, parameters.features),
    ]
    own = (
        ("hidden layers", tuple(len(bias) for bias in file.network.biases[:-1]), parameters.hidden),
        ("activation", file.network.activation, parameters.activation),
        ("squashing", file.network.squash, False),
    )
    for name, got, expected in (*checks, *(own if isinstance(parameters, PPO) else ())):
        if got != expected:
            raise PolicyError(f"cannot start from {path}: its {name} is {got!r}, this run has {expected!r}")
    return file


def knowledge_of(init: str | None, parameters: AnyHyperparameters) -> Knowledge:
    """Knowledge that a run trains with: an expert's, the initial policy's, or that of rewards alone."""
    if init is not None:
        return load_policy_file(policy_path(init)).knowledge
    if isinstance(parameters, Planner):
        return Knowledge.LEARNED_WITH_MODEL
    return Knowledge.INTERACTION if parameters.expert is None else Knowledge.IMITATION
