"""`evaluate.py`: evaluate policies on splits of ids and write records, tables and a report."""

import argparse
import difflib
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from agents.commands.choice import (
    add_perturb,
    add_task_options,
    check_fit,
    choose_ids,
    choose_policies,
    distinct,
    task_keywords,
)
from agents.commands.evaluation.dry_run import dry_run
from agents.commands.evaluation.run import RunOptions, run
from agents.commands.robots import robot_keywords
from agents.policies.registry import POLICIES
from agents.policies.resolve import ResolvedPolicy
from space_envs.errors import ConfigurationError, positive
from space_envs.evaluation.harness.evaluation import Evaluation
from space_envs.evaluation.harness.runner import EVALUATION
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.perturbations.amounts import NOMINAL, Perturbation
from space_envs.registration import ENTRIES, make_task
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import robot_names, robot_summary
from space_envs.system.command_line import AppendValues, Parser, exit_status, output_path, parse_seeds
from space_envs.system.output import check_free
from space_envs.system.parallel import BACKENDS, check_backend
from space_envs.tasks.common import DIFFICULTIES, SPLITS

COMMANDS = ("compare", "show", "replay", "dataset")
DESCRIPTION = """\
Evaluate policies on splits of ids; write one record an episode, a leaderboard (terminal, Markdown, CSV,
LaTeX) and a self-contained HTML report.

  evaluate.py --policy gjm promp runs/mine my_package.planner:Planner --episodes 200
  evaluate.py --env all --split test ood --seeds 0-4 --jobs 8
  evaluate.py ... --perturb mild --perturb mass=0.1 action_delay=2
                                        with a robot that differs from the model that policies know
  evaluate.py ... --resume              continue an evaluation that was stopped or killed
  evaluate.py ... --overwrite           replace the evaluation that the folder holds

  evaluate.py show RESULTS              print the table again
  evaluate.py compare RESULTS...        merge result folders into one leaderboard
  evaluate.py replay RESULTS ...        look at an episode, or write a video of it
  evaluate.py dataset ...               write episodes as npz or as Minari datasets

Records do not depend on the number of jobs nor on the backend. An episode fails
if its policy raises, returns NaN or a wrong shape, or exceeds the time limit; the others continue.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="evaluate.py", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = out.add_argument
    what = (
        "environment ids, of another package as module:id, or 'all' (default: the first that the robot fits, "
    )
    what += f"without --robot {next(iter(ENTRIES))})"
    add("--env", action=AppendValues, nargs="+", default=[], metavar="ID", help=what)
    add(
        "--policy",
        action=AppendValues,
        nargs="+",
        default=["all"],
        metavar="NAME",
        help="built-in policies, 'all' for every one of them (default), 'experts' for the planners, your own "
        "as package.module:Class, the folder of a run of train.py, or a zip of stable-baselines3",
    )
    add(
        "--split",
        action=AppendValues,
        nargs="+",
        default=["test"],
        metavar="NAME",
        help=f"{', '.join(SPLITS)} (default test)",
    )
    what = f"{', '.join(DIFFICULTIES)}, or the task's own (default: the task's, usually medium)"
    add("--difficulty", action=AppendValues, nargs="+", default=[], metavar="NAME", help=what)
    add_task_options(out)
    add_perturb(out, several=True)
    add("--episodes", type=int, default=100, help="different goals of each split, a seed (default 100)")
    what = "of goals and policies, such as 3, 0-4 or 0,2,5-7; strata of the intervals (default 0)"
    add("--seeds", "--seed", default="0", metavar="LIST", help=what)
    default = Path("results/evaluation")
    add("--output", type=output_path, default=default, metavar="FOLDER", help="default %(default)s")
    again = out.add_mutually_exclusive_group()
    what = "continue the same evaluation in the folder"
    again.add_argument("--resume", action="store_true", help=what)
    what = "replace the evaluation that the folder holds"
    again.add_argument("--overwrite", action="store_true", help=what)
    add("--backend", default="loky", help=f"{', '.join(BACKENDS)} (default loky: this machine)")
    add("--address", help="of a Ray or Dask cluster that runs already")
    what = "limit of each call of a policy; with it, episodes run one at a time"
    add("--time-limit", type=float, metavar="SECONDS", help=what)
    what = "limit of the first call of an episode, which plans (default as --time-limit)"
    add("--planning-limit", type=float, metavar="SECONDS", help=what)
    add(
        "--dry-run", action="store_true", help="print what would be evaluated and how long it takes, and stop"
    )
    add("--no-pictures", action="store_true", help="do not draw captures for the report")
    add("--videos", action="store_true", help="write an mp4 of each policy's best episode")
    add("--list", action="store_true", help="list ids, built-in policies and robots, and stop")
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    given = sys.argv[1:] if arguments is None else arguments
    if given and given[0] in COMMANDS:
        return import_module(f"agents.commands.{given[0]}").main(given[1:])
    goes_on = "stopped; what is done is kept, and the same command with --resume goes on from here"
    return exit_status("evaluate.py", lambda: _run(given), goes_on)


def _run(given: list[str]) -> int:
    if given and not given[0].startswith("-"):
        near = difflib.get_close_matches(given[0], COMMANDS, n=1)
        hint = f" Did you mean {near[0]!r}?" if near else ""
        raise ConfigurationError(
            f"unknown command {given[0]!r}; there are {', '.join(COMMANDS)}, and options to evaluate.{hint}"
        )
    options = parser().parse_args(given)
    if options.list:
        _list()
        return 0
    evaluation, chosen = _checked(options, given)
    if options.dry_run:
        dry_run(evaluation, chosen.jobs)
        return 0
    return run(evaluation, chosen)


def _checked(options: argparse.Namespace, arguments: list[str]) -> tuple[Evaluation, RunOptions]:
    """The evaluation that the options describe, and the options of its run, all of them checked.

    Raises:
        SpaceEnvsError: for anything that is not valid.
    """
    robot = robot_keywords(options)
    env_ids = choose_ids(options.env, robot)
    distinct("split", options.split)
    distinct("difficulty", options.difficulty)
    check_backend(options.jobs, options.backend, options.address)
    limits = _limits(options)
    check_free(options.output, EVALUATION)
    entries: list[tuple[EvaluatedTask, ResolvedPolicy]] = []
    robots: dict[EvaluatedTask, Robot] = {}
    for env_id in env_ids:
        tasks = _tasks(env_id, options)
        robots |= tasks
        usual = next(iter(tasks))
        keywords = task_keywords(options, env_id)
        policies = choose_policies(options.policy, env_id, env_ids, options.control_mode, keywords)
        for policy in policies:
            check_fit(policy, env_id, usual.keywords(tasks[usual]))
        entries += [(task, policy) for task in tasks for policy in policies]
    evaluation = Evaluation(
        tuple(entries),
        options.episodes,
        parse_seeds(options.seeds),
        robots,
        limits,
    )
    evaluation.chunks()  # refuses an invalid number of episodes
    chosen = RunOptions(
        options.output.absolute(),
        options.resume,
        options.overwrite,
        options.jobs,
        options.backend,
        options.address,
        not options.no_pictures,
        options.videos,
        tuple(arguments),
    )
    return evaluation, chosen


def _tasks(env_id: str, options: argparse.Namespace) -> dict[EvaluatedTask, Robot]:
    """An id's tasks with their robots, by difficulty, split and perturbation; errors as in `make_task`."""
    keywords = task_keywords(options, env_id)
    difficulties = options.difficulty or [make_task(env_id, keywords).difficulty]
    perturbations = [Perturbation.of(" ".join(words)) for words in options.perturb or [[NOMINAL]]]
    distinct("perturbation", [perturbation.text for perturbation in perturbations])
    made = [
        make_task(
            env_id, {**keywords, "difficulty": difficulty, "split": split, "perturbation": perturbation}
        )
        for difficulty in difficulties
        for split in options.split
        for perturbation in perturbations
    ]
    return {EvaluatedTask.of(env_id, task): task.robot for task in made}


def _limits(options: argparse.Namespace) -> TimeLimits | None:
    for name, value in (("--time-limit", options.time_limit), ("--planning-limit", options.planning_limit)):
        if value is not None:
            positive(name, value)
    if options.time_limit is None:
        if options.planning_limit is not None:
            raise ConfigurationError("--planning-limit goes with --time-limit")
        return None
    usual = TimeLimits(options.time_limit, options.time_limit)
    return usual if options.planning_limit is None else replace(usual, planning=options.planning_limit)


def _list() -> None:
    listed = {
        "Environments": {name: entry.summary for name, entry in ENTRIES.items()},
        "Policies": {name: entry.summary for name, entry in POLICIES.items()},
        "Robots": {name: robot_summary(name) for name in robot_names()},
    }
    for title, summaries in listed.items():
        print(f"{title}:")
        for name, summary in summaries.items():
            print(f"  {name:38}{summary}")


if __name__ == "__main__":
    sys.exit(main())
