"""The one table of policies."""

from dataclasses import dataclass

from space_envs.errors import unknown_name
from space_envs.evaluation.policy import DEFAULT_CONTROL_MODE, Policy, PolicyContext, load_policy_class


@dataclass(frozen=True)
class Entry:
    """One policy: its class as `package.module:Class`, imported when it is asked for, and what it is."""

    policy: str
    summary: str
    control_mode: str = DEFAULT_CONTROL_MODE


POLICIES: dict[str, Entry] = {
    "random": Entry("agents.baselines:Random", "uniform actions"),
    "hold": Entry("agents.baselines:Hold", "no motion at all"),
    "minimum_jerk": Entry(
        "agents.minimum_jerk:MinimumJerk", "quintic joint motion to a goal from inverse kinematics"
    ),
    "gjm": Entry("agents.gjm:GeneralizedJacobian", "resolved rate with the damped generalised Jacobian"),
    "mpc": Entry(
        "agents.mpc:ModelPredictive", "linear-quadratic receding horizon on the joints, as in shyam2020"
    ),
    "promp": Entry(
        "agents.promp_policy:ProMPPolicy", "best of 100 samples of a ProMP by eq. 20, as in shyam2020"
    ),
    "promp_mean": Entry("agents.promp_policy:ConditionalMean", "the conditional mean of the same ProMP"),
    "bc": Entry("agents.learned_policy:BehaviourCloning", "cloned from gjm (DAgger), shipped"),
    "ppo": Entry("agents.learned_policy:ProximalPolicyOptimization", "the clone, improved by PPO, shipped"),
}


def policy_class(name: str) -> type[Policy]:
    """The class of a registered policy, or of a user's own, named as `package.module:Class`.

    Raises:
        ConfigurationError: for a name that is neither. PolicyError: if a user's class cannot be loaded.
    """
    if ":" in name:
        return load_policy_class(name)
    if name not in POLICIES:
        raise unknown_name("policy", name, POLICIES)
    return load_policy_class(POLICIES[name].policy)


def control_mode(name: str) -> str:
    """The control mode that a policy acts in; errors as in `policy_class`."""
    if name in POLICIES:
        return POLICIES[name].control_mode
    return getattr(policy_class(name), "control_mode", DEFAULT_CONTROL_MODE)


def make_policy(name: str, context: PolicyContext, seed: int) -> Policy:
    """Build a policy by its name.

    Raises:
        ConfigurationError, PolicyError: as `policy_class` says, or if the context's control mode is not the
            policy's.
    """
    return policy_class(name)(context, seed)  # pyright: ignore[reportCallIssue]
