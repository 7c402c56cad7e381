"""`evaluate.py`: play policies on an id's split and write records, tables and a report."""

import argparse
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

import numpy as np
from rich.console import Console

from agents.registry import POLICIES, check_task, policies_for
from agents.resolve import ResolvedPolicy, resolve_policy
from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, SpaceEnvsError, unknown_name
from space_envs.evaluation.leaderboard import build_rows
from space_envs.evaluation.metrics import episode_records, episode_traces
from space_envs.evaluation.pictures import capture_pictures
from space_envs.evaluation.policy import PolicyContext
from space_envs.evaluation.provenance import provenance
from space_envs.evaluation.records import EpisodeRecord, EvaluationResult, Timing
from space_envs.evaluation.report import BOOTSTRAP_SEED, write_report
from space_envs.evaluation.rollout import Rollout, roll_out, split_indices, time_policy
from space_envs.evaluation.tables import to_terminal
from space_envs.evaluation.traces import Traces
from space_envs.models.parameters import VARIANTS
from space_envs.registration import ENTRIES, make_task
from space_envs.tasks.common import DIFFICULTIES, SPLITS

TIMED_EPISODES = 5
DEFAULT_ENV = "SpaceCapture/SingleArm-v0"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = argparse.ArgumentParser(
        prog="evaluate.py",
        description="Play policies on a split of an environment; write one record an episode, a leaderboard "
        "(terminal, Markdown, CSV) and a self-contained HTML report.",
        epilog="Example: evaluate.py --policy gjm promp runs/mine my_package.planner:Planner --episodes 200",
    )
    out.add_argument(
        "--env", default=DEFAULT_ENV, metavar="ID", help=f"environment id (default {DEFAULT_ENV})"
    )
    out.add_argument(
        "--policy",
        nargs="+",
        default=["all"],
        metavar="NAME",
        help="built-in policies, 'all' for every one of them (default), your own as package.module:Class, or "
        "the folder of a run of train.py",
    )
    out.add_argument("--split", default="test", help=f"{', '.join(SPLITS)} (default test)")
    out.add_argument("--difficulty", default="medium", help=f"{', '.join(DIFFICULTIES)} (default medium)")
    out.add_argument(
        "--variant", help=f"inertias of the single arm's model: {', '.join(VARIANTS)} (default paper)"
    )
    out.add_argument(
        "--control-mode",
        help=f"{', '.join(CONTROL_MODES)}; by default what each policy was made for",
        metavar="MODE",
    )
    out.add_argument("--episodes", type=int, default=100, help="different goals of the split (default 100)")
    out.add_argument("--seed", type=int, default=0, help="of goals, policies and intervals (default 0)")
    out.add_argument(
        "--output", type=Path, default=Path("results/evaluation"), help="folder (default %(default)s)"
    )
    out.add_argument("--no-pictures", action="store_true", help="do not draw captures for the report")
    out.add_argument("--list", action="store_true", help="list ids and built-in policies, and stop")
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    options = parser().parse_args(arguments)
    try:
        if options.list:
            _list()
            return 0
        run(options, sys.argv[1:] if arguments is None else arguments)
    except SpaceEnvsError as error:
        print(f"evaluate.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("evaluate.py: stopped; nothing was written", file=sys.stderr)
        return 130
    return 0


def run(options: argparse.Namespace, arguments: list[str]) -> None:
    """Evaluate as the options say.

    Raises:
        SpaceEnvsError: for anything in the options that is not valid, before an episode is played.
    """
    if options.env not in ENTRIES:
        raise unknown_name("environment id", options.env, ENTRIES)
    if options.seed < 0:
        raise ConfigurationError(f"seed must not be negative, got {options.seed}")
    keywords = {"difficulty": options.difficulty, "split": options.split}
    if options.variant is not None:
        keywords["variant"] = options.variant
    task = make_task(options.env, keywords)
    indices = split_indices(task, options.split, options.episodes, options.seed)
    policies = _policies(options)
    for policy in policies:
        # One that does not fit the environment says so before the first episode of any.
        env = CaptureVectorEnv(options.env, 1, policy.control_mode, **keywords)
        policy.build(PolicyContext.from_env(env), options.seed)
    try:
        options.output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {options.output}: {error.strerror}") from None
    started = perf_counter()
    records: list[EpisodeRecord] = []
    traces: dict[str, Traces] = {}
    rollouts: dict[str, Rollout] = {}
    for policy in policies:
        environment = {"env_id": options.env, "control_mode": policy.control_mode, **keywords}
        rollout = roll_out(
            policy.factory(options.seed), environment, options.split, indices, options.seed, policy.name
        )
        timed = time_policy(
            policy.factory(options.seed), environment, options.split, indices[:TIMED_EPISODES]
        )
        timing = Timing(planning_ms=timed.planning, action_ms=timed.action)
        records += episode_records(
            rollout, task, options.env, policy.name, policy.control_mode, options.split, options.seed, timing
        )
        traces[policy.name], rollouts[policy.name] = episode_traces(rollout, task), rollout
    pictures, note = ({}, "Pictures were switched off with --no-pictures.")
    if not options.no_pictures:
        pictures, note = capture_pictures(task, rollouts)
    about = provenance(shlex.join(["evaluate.py", *arguments]), options.env, options.seed, task)
    about["timing"] = {
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(perf_counter() - started, 1),
    }
    result = EvaluationResult(records, traces, about, pictures, note)
    paths = write_report(result, options.output)
    console = Console()
    to_terminal(build_rows(records, np.random.default_rng(BOOTSTRAP_SEED)), console)
    console.print()
    for label, path in (
        ("Report", paths.html),
        ("Leaderboard", paths.markdown),
        ("Table", paths.csv),
        ("Records", paths.records),
        ("Summary", paths.summary),
    ):
        console.print(f"{label + ':':13}{path}", highlight=False, soft_wrap=True, markup=False)


def _policies(options: argparse.Namespace) -> list[ResolvedPolicy]:
    names: list[str] = []
    for name in options.policy:
        names += policies_for(options.env) if name == "all" else [name]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ConfigurationError(f"policies named twice: {', '.join(repeated)}")
    for name in names:
        check_task(name, options.env)
    if options.control_mode is not None and options.control_mode not in CONTROL_MODES:
        raise unknown_name("control mode", options.control_mode, CONTROL_MODES)
    return [resolve_policy(name, options.control_mode) for name in names]


def _list() -> None:
    for title, table in (("Environments", ENTRIES), ("Policies", POLICIES)):
        print(f"{title}:")
        for name, entry in table.items():
            print(f"  {name:32}{entry.summary}")


if __name__ == "__main__":
    sys.exit(main())
