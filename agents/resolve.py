"""From what a user calls a policy to something that can be built."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from agents.learned_policy import LearnedPolicy, policy_path
from agents.policy_file import load_policy_file
from agents.registry import POLICIES, control_mode, make_policy
from space_envs.errors import unknown_name
from space_envs.evaluation.policy import Policy, PolicyContext


@dataclass(frozen=True)
class ResolvedPolicy:
    """A policy that exists: its name in tables, the control mode it acts in, how it is built."""

    name: str
    control_mode: str
    build: Callable[[PolicyContext, int], Policy]

    def factory(self, seed: int) -> Callable[[PolicyContext], Policy]:
        """Builds the policy with a seed."""
        return lambda context: self.build(context, seed)


def resolve_policy(name: str, mode: str | None = None) -> ResolvedPolicy:
    """Find a policy by its registered name, as `package.module:Class`, or as the folder of a run.

    Args:
        name: what the user wrote. mode: control mode to use instead of the policy's own.

    Raises:
        ConfigurationError: if there is nothing of that name. PolicyError: if it cannot be loaded.
    """
    if name not in POLICIES and ":" not in name:
        path = Path(name)
        if not path.exists():
            raise unknown_name("policy", name, [*POLICIES, "package.module:Class", "a run's folder"])
        file = load_policy_file(policy_path(path))
        return ResolvedPolicy(
            path.stem if path.is_file() else path.resolve().name,
            mode or file.control_mode,
            lambda context, seed: LearnedPolicy(context, seed, file),
        )
    return ResolvedPolicy(
        name, mode or control_mode(name), lambda context, seed: make_policy(name, context, seed)
    )
