"""Policies from files that training left: networks that act, and networks that plan."""

from pathlib import Path

from agents.policies.base import BasePolicy
from agents.policies.learned.learned_policy import LearnedPolicy, policy_path
from agents.policies.learned.planner_network import PlanningNetwork
from agents.policies.learned.policy_file import PolicyFile, load_policy_file
from agents.policies.learned.reactionless_network import ReactionlessNetwork
from space_envs.policy import PolicyContext


def trained_policy(
    file: PolicyFile, context: PolicyContext, seed: int = 0, search: bool = True
) -> BasePolicy:
    """The policy of a file.

    Args:
        search: whether the search of `promp_reactionless` follows where a network that gives paths in the
            reaction null space leads to no plan.

    Raises:
        PolicyError: if it was trained for another id, control mode or robot.
    """
    if file.plans is None:
        return LearnedPolicy(context, seed, file)
    if file.plans.kind == "reactionless":
        return ReactionlessNetwork(context, seed, file, search=search)
    return PlanningNetwork(context, seed, file)


def load_trained(path: str | Path, context: PolicyContext, seed: int = 0) -> BasePolicy:
    """The policy of a run's folder (the best on the validation split) or of a policy file.

    Raises:
        PolicyError: if there is none, it is not sound, or it does not fit the environment.
    """
    return trained_policy(load_policy_file(policy_path(path)), context, seed)
