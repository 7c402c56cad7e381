"""The one table of policies."""

import traceback
from dataclasses import dataclass
from typing import Any

from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, PolicyError, SpaceEnvsError, unknown_name
from space_envs.policy import DEFAULT_CONTROL_MODE, Policy, PolicyContext, load_policy_class
from space_envs.strangers import described


@dataclass(frozen=True)
class Entry:
    """One policy: its class as `package.module:Class`, imported when it is asked for, and what it is."""

    policy: str
    summary: str
    control_mode: str = DEFAULT_CONTROL_MODE
    tasks: tuple[str, ...] | None = None  # ids it is made for; None is all


SINGLE_ARM = ("SpaceCapture/SingleArm-v0", "SpaceCapture/SingleArmCluttered-v0")
DUAL_ARM = ("SpaceCapture/DualArmPlanar-v0", "SpaceCapture/DualArmSpatial-v0")
PLANAR = DUAL_ARM[:1]
LEARNED = (SINGLE_ARM[0], *DUAL_ARM)  # ids with clones that are shipped

POLICIES: dict[str, Entry] = {
    "random": Entry("agents.policies.baselines:Random", "uniform actions"),
    "hold": Entry("agents.policies.baselines:Hold", "no motion at all"),
    "minimum_jerk": Entry(
        "agents.policies.single_arm.minimum_jerk:MinimumJerk",
        "quintic joint motion to a goal from inverse kinematics",
        tasks=SINGLE_ARM,
    ),
    "gjm": Entry(
        "agents.policies.gjm:GeneralizedJacobian",
        "resolved rate with the damped generalised Jacobian",
        tasks=SINGLE_ARM,
    ),
    "mpc": Entry(
        "agents.policies.single_arm.mpc:ModelPredictive",
        "linear-quadratic receding horizon on the joints, as in shyam2020",
        tasks=SINGLE_ARM,
    ),
    "promp": Entry(
        "agents.policies.single_arm.promp:ProMPPolicy",
        "best of 100 samples of a ProMP by eq. 20, as in shyam2020",
        tasks=SINGLE_ARM,
    ),
    "promp_mean": Entry(
        "agents.policies.single_arm.promp:ConditionalMean",
        "the conditional mean of the same ProMP",
        tasks=SINGLE_ARM,
    ),
    "promp_feedback": Entry(
        "agents.policies.single_arm.promp_feedback:PrompFeedback",
        "feedback to that mean with gains from the same ProMP's covariance",
        tasks=SINGLE_ARM[:1],
    ),
    "ocp": Entry(
        "agents.policies.single_arm.optimal:OptimalControl",
        "least eq. 20 by collocation, all limits, attitude free",
        tasks=SINGLE_ARM,
    ),
    "promp_optimal": Entry(
        "agents.policies.single_arm.optimal:PrompOptimal",
        "least eq. 20 in the weights of a ProMP, all limits, attitude free",
        tasks=SINGLE_ARM,
    ),
    "promp_optimal_kept": Entry(
        "agents.policies.single_arm.optimal:PrompOptimalKept",
        "the same with the attitude kept at the end",
        tasks=SINGLE_ARM,
    ),
    "promp_demonstrated": Entry(
        "agents.policies.single_arm.promp_demonstrated:PrompDemonstrated",
        "best of 100 samples of ProMPs of optimal demonstrations, conditioned in task space",
        tasks=SINGLE_ARM[:1],
    ),
    "promp_avoiding": Entry(
        "agents.policies.single_arm.promp_avoiding:PrompAvoiding",
        "samples of a ProMP that keep out of spheres, the best refined",
        tasks=SINGLE_ARM[1:],
    ),
    "nmpc": Entry(
        "agents.policies.single_arm.nmpc:NMPC",
        "receding horizon in weights, attitude kept at its end, the observed state fed back",
        tasks=SINGLE_ARM[:1],
    ),
    "reactionless": Entry(
        "agents.policies.dual_arm.reactionless:ZetaZero",
        "polynomial end-effector paths with zeta = 0, as in shah2013",
        tasks=DUAL_ARM,
    ),
    "reactionless_local": Entry(
        "agents.policies.dual_arm.reactionless:Local",
        "the same paths with the least kinetic energy at each instant, as in shah2013",
        tasks=DUAL_ARM,
    ),
    "reactionless_ocp": Entry(
        "agents.policies.dual_arm.reactionless:OptimalControl",
        "the same paths with the least energy over the motion, as in shah2013",
        tasks=PLANAR,
    ),
    "reactionless_free": Entry(
        "agents.policies.dual_arm.reactionless:FreePaths",
        "paths free between their ends, least energy, all limits",
        tasks=DUAL_ARM,
    ),
    "reactionless_rate": Entry(
        "agents.policies.dual_arm.reactionless_rate:ReactionlessRate",
        "resolved rate of both arms with the reactionless constraint, damped",
        tasks=DUAL_ARM,
    ),
    "bc": Entry(
        "agents.policies.learned.learned_policy:BehaviourCloning",
        "cloned from an expert (DAgger), shipped",
        tasks=LEARNED,
    ),
    "ppo": Entry(
        "agents.policies.learned.learned_policy:ProximalPolicyOptimization",
        "the clone, improved by PPO, shipped",
        tasks=SINGLE_ARM[:1],
    ),
    "bc_reactionless": Entry(
        "agents.policies.learned.learned_policy:BehaviourCloning",
        "cloned in control mode reactionless, shipped",
        "reactionless",
        tasks=DUAL_ARM,
    ),
}


def policies_for(env_id: str) -> list[str]:
    """Names of the policies that are made for an id."""
    return [name for name, entry in POLICIES.items() if entry.tasks is None or env_id in entry.tasks]


def check_task(name: str, env_id: str) -> None:
    """Refuse a registered policy on an id that it is not made for.

    Raises:
        ConfigurationError: naming both, and the policies that there are for the id.
    """
    if name in POLICIES and name not in (names := policies_for(env_id)):
        raise ConfigurationError(
            f"policy {name!r} is made for {', '.join(POLICIES[name].tasks or ())}, not for {env_id}; "
            f"there are {', '.join(names)}"
        )


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
    """The control mode that a policy acts in if nothing is said; errors as in `policy_class`."""
    if name in POLICIES:
        return POLICIES[name].control_mode
    mode = getattr(policy_class(name), "control_mode", DEFAULT_CONTROL_MODE)
    if type(mode) is not str or mode not in CONTROL_MODES:
        shown = mode if type(mode) is str else type(mode)
        raise PolicyError(f"policy {name!r}: {unknown_name('control mode', shown, CONTROL_MODES)}")
    return mode


def control_modes(name: str) -> tuple[str, ...]:
    """The control modes that a policy can act in; errors as in `policy_class`."""
    return getattr(policy_class(name), "control_modes", (control_mode(name),))


def make_policy(name: str, context: PolicyContext, seed: int) -> Policy:
    """Build a policy by its name.

    Raises:
        ConfigurationError, PolicyError: as `policy_class` says, if the context's control mode is not the
            policy's, or if one that is not built in raises.
    """
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
        told = f"{message} (line {last.lineno} of {last.filename})"
        raise PolicyError(f"policy {name!r} could not be built with (context, seed): {told}") from None
