"""The table of registered policies, and the selection of those that fit a task."""

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError, SpaceEnvsError, shown, unknown_name
from space_envs.foreign_code import described
from space_envs.policy import (
    DEFAULT_CONTROL_MODE,
    Knowledge,
    Needs,
    Policy,
    PolicyContext,
    load_policy_class,
)
from space_envs.registration import find


@dataclass(frozen=True)
class RegisteredPolicy:
    """One policy: its class as `package.module:Class`, imported when it is needed, and what it does.

    `expert` is whether it is a planner or controller: neither learned nor a baseline.
    """

    policy: str
    summary: str
    expert: bool = True


POLICIES: dict[str, RegisteredPolicy] = {
    "random": RegisteredPolicy("agents.policies.baselines:Random", "uniform actions", expert=False),
    "hold": RegisteredPolicy("agents.policies.baselines:Hold", "no motion at all", expert=False),
    "minimum_jerk": RegisteredPolicy(
        "agents.policies.single_arm.minimum_jerk:MinimumJerk",
        "quintic joint motion to a goal from inverse kinematics",
    ),
    "gjm": RegisteredPolicy(
        "agents.policies.single_arm.gjm:GeneralizedJacobian",
        "resolved rate with the damped generalised Jacobian, ignores bodies in its path",
    ),
    "mpc": RegisteredPolicy(
        "agents.policies.single_arm.mpc:ModelPredictive",
        "linear-quadratic receding horizon on the joints, as in shyam2020",
    ),
    "promp": RegisteredPolicy(
        "agents.policies.single_arm.promp:ProMPPolicy",
        "best of 100 samples of a ProMP by eq. 20, as in shyam2020",
    ),
    "promp_mean": RegisteredPolicy(
        "agents.policies.single_arm.promp:ConditionalMean",
        "the conditional mean of the same ProMP",
    ),
    "promp_feedback": RegisteredPolicy(
        "agents.policies.single_arm.promp_feedback:PrompFeedback",
        "feedback to that mean with gains from the same ProMP's covariance",
    ),
    "ocp": RegisteredPolicy(
        "agents.policies.single_arm.optimal:OptimalControl",
        "least eq. 20 by collocation, all limits, attitude unconstrained",
    ),
    "promp_optimal": RegisteredPolicy(
        "agents.policies.single_arm.weights:PrompOptimal",
        "least eq. 20 in the weights of a ProMP, all limits, attitude unconstrained",
    ),
    "promp_optimal_kept": RegisteredPolicy(
        "agents.policies.single_arm.weights:PrompOptimalKept",
        "the same with the initial attitude again at the end",
    ),
    "promp_reactionless": RegisteredPolicy(
        "agents.policies.single_arm.reactionless.policy:PrompReactionless",
        "least eq. 20 among paths in the reaction null space, all limits: the satellite never turns",
    ),
    "promp_demonstrated": RegisteredPolicy(
        "agents.policies.single_arm.weights:PrompDemonstrated",
        "best of 100 samples of ProMPs of optimal demonstrations, conditioned in task space",
    ),
    "promp_avoiding": RegisteredPolicy(
        "agents.policies.single_arm.weights:PrompAvoiding",
        "samples of a ProMP that keep out of spheres, the best refined",
    ),
    "nmpc": RegisteredPolicy(
        "agents.policies.single_arm.nmpc.policy:NMPC",
        "receding horizon in weights, attitude constrained at its end, the observed state fed back",
    ),
    "nmpc_reactionless": RegisteredPolicy(
        "agents.policies.single_arm.nmpc.reactionless:NMPCReactionless",
        "the same from paths in the reaction null space, attitude weighted at all times",
    ),
    "reactionless": RegisteredPolicy(
        "agents.policies.dual_arm.reactionless:ReactionlessZetaZero",
        "polynomial end-effector paths with zeta = 0, as in shah2013",
    ),
    "reactionless_local": RegisteredPolicy(
        "agents.policies.dual_arm.reactionless:ReactionlessLocal",
        "the same paths with the least kinetic energy at each instant, as in shah2013",
    ),
    "reactionless_ocp": RegisteredPolicy(
        "agents.policies.dual_arm.reactionless:ReactionlessOCP",
        "the same paths with the least energy over the motion, as in shah2013",
    ),
    "reactionless_free": RegisteredPolicy(
        "agents.policies.dual_arm.reactionless:ReactionlessFree",
        "paths free between their ends, least energy, all limits",
    ),
    "reactionless_rate": RegisteredPolicy(
        "agents.policies.dual_arm.reactionless_rate:ReactionlessRate",
        "resolved rate of both arms with the reactionless constraint, damped",
    ),
    "planner_network": RegisteredPolicy(
        "agents.policies.learned.planner_network:PlannerNetwork",
        "a network plans a motion that ends with the initial attitude; two Gauss-Newton corrections",
        expert=False,
    ),
    "planner_network_alone": RegisteredPolicy(
        "agents.policies.learned.planner_network:PlannerNetworkAlone",
        "the same network without corrections",
        expert=False,
    ),
    "reactionless_network": RegisteredPolicy(
        "agents.policies.learned.reactionless_network:ShippedReactionlessNetwork",
        "a network gives a path in the reaction null space, corrected; a search where that leads to no plan",
        expert=False,
    ),
    "reactionless_network_alone": RegisteredPolicy(
        "agents.policies.learned.reactionless_network:ReactionlessNetworkAlone",
        "the same without that search",
        expert=False,
    ),
    "bc": RegisteredPolicy(
        "agents.policies.learned.learned_policy:BehaviourCloning",
        "cloned from an expert (DAgger), shipped, ignores bodies in its path",
        expert=False,
    ),
    "ppo": RegisteredPolicy(
        "agents.policies.learned.learned_policy:ProximalPolicyOptimization",
        "the clone, improved by PPO, shipped, ignores bodies in its path",
        expert=False,
    ),
    "bc_reactionless": RegisteredPolicy(
        "agents.policies.learned.learned_policy:ReactionlessCloning",
        "cloned in control mode reactionless, shipped, ignores bodies in its path",
        expert=False,
    ),
}


def policies_for(
    env_id: str, mode: str | None = None, keywords: Mapping[str, Any] | None = None
) -> list[str]:
    """Names of the policies that fit a task in a control mode; None for each policy's default mode."""
    return [name for name in POLICIES if not missing(name, env_id, mode, keywords)]


def missing(
    name: str, env_id: str, mode: str | None = None, keywords: Mapping[str, Any] | None = None
) -> list[str]:
    """Reasons why a policy does not fit a task in a control mode (None: its default), empty if it fits.

    Args:
        keywords: of the task, such as its robot.

    Raises:
        ConfigurationError, PolicyError: as `policy_class`.
    """
    return needs(name).missing(_context(find(env_id).name, mode or control_mode(name), **keywords or {}))


def check_needs(name: str, context: PolicyContext) -> None:
    """Refuse a policy that does not fit a context.

    Raises:
        PolicyError: naming what the task lacks. ConfigurationError, PolicyError: as `policy_class`.
    """
    if reasons := needs(name).missing(context):
        raise PolicyError(f"policy {name!r} does not fit {context.env_id}: {'; '.join(reasons)}")


@lru_cache(maxsize=64)
def _context(env: str, mode: str, **keywords: Any) -> PolicyContext:
    return PolicyContext.from_env(CaptureVectorEnv(env, control_mode=mode, **keywords))


def policy_class(name: str) -> type[Policy]:
    """Class of a registered policy, or of a user's policy named as `package.module:Class`.

    Raises:
        ConfigurationError: for a name that is neither. PolicyError: if a user's class cannot be loaded.
    """
    if ":" in name:
        return load_policy_class(name)
    if name not in POLICIES:
        raise unknown_name("policy", name, POLICIES)
    return load_policy_class(POLICIES[name].policy)


def needs(name: str) -> Needs:
    """Needs that a policy's class declares; errors as in `policy_class`."""
    declared = getattr(policy_class(name), "needs", Needs())
    if not isinstance(declared, Needs):
        raise PolicyError(f"policy {name!r}: needs must be a space_envs.policy.Needs, got {shown(declared)}")
    return declared


def control_mode(name: str) -> str:
    """Default control mode of a policy; errors as in `policy_class`."""
    mode = getattr(policy_class(name), "control_mode", DEFAULT_CONTROL_MODE)
    if type(mode) is not str or mode not in CONTROL_MODES:
        got = mode if type(mode) is str else type(mode)
        raise PolicyError(f"policy {name!r}: {unknown_name('control mode', got, CONTROL_MODES)}")
    return mode


def knowledge(name: str) -> Knowledge:
    """Knowledge that a policy's class states; errors as in `policy_class`."""
    stated = getattr(policy_class(name), "knowledge", Knowledge.UNSTATED)
    if type(stated) not in (str, Knowledge) or stated not in list(Knowledge):
        got = stated if type(stated) is str else type(stated)
        raise PolicyError(f"policy {name!r}: {unknown_name('kind of knowledge', got, list(Knowledge))}")
    return Knowledge(stated)


def control_modes(name: str) -> tuple[str, ...]:
    """Control modes that a policy supports; errors as in `policy_class`."""
    return needs(name).control_modes or (control_mode(name),)


def make_policy(name: str, context: PolicyContext, seed: int) -> Policy:
    """Build a policy by its name.

    Raises:
        ConfigurationError, PolicyError: as `policy_class`, if the policy does not fit the context, or if one
            that is not built in raises.
    """
    check_needs(name, context)
    build: Any = policy_class(name)
    if name in POLICIES:
        return build(context, seed)
    try:
        return build(context, seed)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        message = described(error)
        if isinstance(error, SpaceEnvsError):
            raise PolicyError(message.partition(": ")[2] or message) from None
        last = traceback.extract_tb(error.__traceback__)[-1]
        message = f"{message} (line {last.lineno} of {last.filename})"
        raise PolicyError(f"policy {name!r} could not be built with (context, seed): {message}") from None
