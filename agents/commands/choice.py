"""Which policies a command means, and whether they fit the environments they are to play in."""

from collections.abc import Mapping, Sequence
from typing import Any

from agents.policies.registry import POLICIES, check_task, policies_for
from agents.policies.resolve import ResolvedPolicy, resolve_policy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.policy_process import PolicyProcess
from space_envs.policy import PolicyContext

# Modules of policies that do not plan.
NO_EXPERTS = ("agents.policies.baselines", "agents.policies.learned.learned_policy")


def experts_for(env_id: str) -> list[str]:
    """Names of the registered policies that plan, of those made for an id."""
    return [name for name in policies_for(env_id) if name in expert_names()]


def expert_names() -> tuple[str, ...]:
    """Names of all registered policies that plan."""
    return tuple(name for name, entry in POLICIES.items() if entry.policy.split(":")[0] not in NO_EXPERTS)


def choose_policies(
    names: Sequence[str], env_id: str, env_ids: Sequence[str], control_mode: str | None = None
) -> list[ResolvedPolicy]:
    """The policies that names stand for on one of several ids.

    Args:
        names: registered names, `package.module:Class` or paths; `all` is every policy made for the id,
            `experts` every planner. A registered one is left out where it is made for another of the ids.
        control_mode: that they act in; None is what each was made for.

    Raises:
        ConfigurationError: for a name of nothing, one that comes twice, or one made for none of the ids.
        PolicyError: if a policy cannot be loaded.
    """
    meant: list[str] = []
    for name in names:
        meant += {"all": policies_for, "experts": experts_for}.get(name, lambda _, name=name: [name])(env_id)
    chosen = []
    for name in meant:
        if name in POLICIES and not any(name in policies_for(other) for other in env_ids):
            check_task(name, env_id)
        if name not in POLICIES or name in policies_for(env_id):
            chosen.append(resolve_policy(name, control_mode))
    distinct("policy", [policy.name for policy in chosen])
    return chosen


def check_fit(policy: ResolvedPolicy, env_id: str, keywords: Mapping[str, Any]) -> None:
    """Build a policy for an environment, so that one that does not fit says so before the first episode.

    Args:
        keywords: of the environment's task.

    Raises:
        ConfigurationError, PolicyError: as the policy says.
    """
    environment = {"env_id": env_id, "control_mode": policy.control_mode, **keywords}
    env = CaptureVectorEnv(num_envs=1, **environment)
    if not policy.foreign:
        policy.build(PolicyContext.from_env(env), 0)
        return
    with PolicyProcess(policy.factory(0), environment) as process:
        process.build()


def distinct(title: str, names: Sequence[str]) -> None:
    """Refuse a name that comes twice.

    Raises:
        ConfigurationError: naming them.
    """
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigurationError(f"{title} given twice: {', '.join(repeated)}")
