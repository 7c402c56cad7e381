"""Ids and policies for the names given to a command, and the check that they fit together."""

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from agents.commands.robots import add_robot, robot_keywords
from agents.policies.registry import POLICIES, missing, policies_for
from agents.policies.resolve import ResolvedPolicy, resolve_policy
from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError, UnfitRobotError, unknown_name
from space_envs.evaluation.play.process.policy_process import PolicyProcess
from space_envs.perturbations.amounts import PRESETS, Perturbation
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES, find, make_task
from space_envs.tasks.goals.kinds import GOAL_KINDS


def add_task_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the tasks and of the processes that `evaluate.py` and its commands share."""
    add = parser.add_argument
    add_robot(add)
    what = f"of ids that have the choice: {', '.join(GOAL_KINDS)} (default {GOAL_KINDS[0]})"
    add("--goal", metavar="KIND", help=what)
    what = f"{', '.join(CONTROL_MODES)}; by default the one of each policy"
    add("--control-mode", metavar="MODE", help=what)
    cores = len(os.sched_getaffinity(0))
    add("--jobs", type=int, default=cores, metavar="N", help=f"processes (default {cores}, the cores)")


def add_perturb(parser: argparse.ArgumentParser, several: bool = False) -> None:
    """Add `--perturb`, which may be given several times where `several` perturbations can be played."""
    what = (
        f"a robot that differs from the model that policies know: {', '.join(PRESETS)}, or amounts as "
        f"NAME=VALUE, also after a preset: {', '.join(field.name for field in fields(Perturbation))} "
        "(docs/robustness.md)"
    )
    again = "; may be given again, each as tasks of their own" if several else ""
    action = "append" if several else "store"
    parser.add_argument("--perturb", nargs="+", action=action, metavar="WORD", help=what + again)


def task_keywords(options: argparse.Namespace, env_id: str) -> dict[str, Any]:
    """Keywords of an id's task that the options set: robot, variant and goal.

    Raises:
        ConfigurationError: for a goal on an id that has one kind of goals.
    """
    keywords = robot_keywords(options)
    if options.goal is None:
        return keywords
    if "goal" not in {field.name for field in fields(find(env_id).task)}:
        raise ConfigurationError(f"{env_id} has one kind of goals; --goal is for ids of one arm")
    return {**keywords, "goal": options.goal}


def experts_for(env_id: str, mode: str | None = None, keywords: Mapping[str, Any] | None = None) -> list[str]:
    """Names of the registered planning policies that fit a task in a control mode."""
    return [name for name in policies_for(env_id, mode, keywords) if POLICIES[name].expert]


def expert_names() -> tuple[str, ...]:
    """Names of all registered planning policies."""
    return tuple(name for name, entry in POLICIES.items() if entry.expert)


def choose_ids(names: Sequence[str], robot: Mapping[str, Any]) -> list[str]:
    """Ids for the given names; the module of a `module:id` is imported.

    Args:
        names: `all` alone is every registered one that the robot fits, with a note of the others on standard
            error; none is the first one that it fits. robot: keywords of a task that choose it.

    Raises:
        ConfigurationError: for an unknown name, one that is given twice, or a robot that fits no id.
    """
    if list(names) == ["all"]:
        return fitting_ids(list(ENTRIES), robot)
    if not names:
        return _fitting(list(ENTRIES), robot)[0][:1]
    env_ids = [find(name).id for name in names]
    distinct("environment id", env_ids)
    return env_ids


def fitting_ids(env_ids: Sequence[str], robot: Mapping[str, Any]) -> list[str]:
    """Those of some ids that a robot fits, with a note of the others on standard error; errors as in
    `_fitting`."""
    found, omitted = _fitting(env_ids, robot)
    for reason in omitted:
        print(f"note: omitted, {reason}", file=sys.stderr)
    return found


def _fitting(env_ids: Sequence[str], robot: Mapping[str, Any]) -> tuple[list[str], list[str]]:
    """Those of some ids that a robot fits, and the reasons why it does not fit the others.

    Args:
        robot: keywords of a task that choose it.

    Raises:
        ConfigurationError: for a robot that fits none of them.
    """
    omitted: dict[str, str] = {}
    for env_id in env_ids:
        try:
            make_task(env_id, robot)
        except UnfitRobotError as error:
            omitted[env_id] = str(error)
    if len(omitted) == len(env_ids):
        raise ConfigurationError(f"the robot fits no id: {'; '.join(omitted.values())}")
    return [env_id for env_id in env_ids if env_id not in omitted], list(omitted.values())


def choose_policies(
    names: Sequence[str],
    env_id: str,
    env_ids: Sequence[str],
    control_mode: str | None = None,
    keywords: Mapping[str, Any] | None = None,
) -> list[ResolvedPolicy]:
    """Policies for the given names on one of several ids.

    Args:
        names: registered names, `package.module:Class` or paths; `all` is every registered policy that fits
            the id, `experts` every planner. A policy that fits only others of the ids is omitted.
        control_mode: control mode of all policies; None for the default of each.
        keywords: of the tasks, such as their robot.

    Raises:
        ConfigurationError: for an unknown control mode or name, or a name that is given twice.
        PolicyError: if a policy cannot be loaded, or fits none of the ids.
    """
    if control_mode is not None and control_mode not in CONTROL_MODES:
        raise unknown_name("control mode", control_mode, CONTROL_MODES)
    expanded: list[str] = []
    for name in names:
        several = {"all": policies_for, "experts": experts_for}.get(name)
        expanded += [name] if several is None else several(env_id, control_mode, keywords)
    chosen = [resolve_policy(name, control_mode) for name in expanded]
    distinct("policy", [policy.name for policy in chosen])
    return [policy for policy in chosen if _fits(policy, env_id, env_ids, keywords or {})]


def _fits(policy: ResolvedPolicy, env_id: str, env_ids: Sequence[str], keywords: Mapping[str, Any]) -> bool:
    """Whether a policy fits an id; PolicyError if it fits none of several."""
    if not isinstance(policy.source, str):
        return True  # checked when the policy is built from its file
    reasons = {other: missing(policy.source, other, policy.control_mode, keywords) for other in env_ids}
    if all(reasons.values()):
        raise PolicyError(f"policy {policy.name!r} does not fit {env_id}: {'; '.join(reasons[env_id])}")
    return not reasons[env_id]


def check_fit(policy: ResolvedPolicy, env_id: str, keywords: Mapping[str, Any]) -> None:
    """Build a policy for an environment, so that a mismatch is reported before the first episode.

    Args:
        keywords: of the environment's task.

    Raises:
        ConfigurationError, PolicyError: raised by the policy.
    """
    environment = {"env_id": find(env_id).name, "control_mode": policy.control_mode, **keywords}
    env = CaptureVectorEnv(num_envs=1, **environment)
    if not policy.foreign:
        policy.build(PolicyContext.from_env(env), 0)
        return
    with PolicyProcess(policy.factory(0), environment) as process:
        process.build()


def distinct(title: str, names: Sequence[str]) -> None:
    """Refuse names that are given twice.

    Raises:
        ConfigurationError: with the repeated names.
    """
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigurationError(f"{title} given twice: {', '.join(repeated)}")
