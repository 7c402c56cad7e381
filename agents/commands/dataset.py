"""`evaluate.py dataset`: write episodes of policies as datasets, after replaying each from its actions."""

import argparse
import shlex
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from agents.commands.choice import (
    add_perturb,
    add_task_options,
    check_fit,
    choose_ids,
    choose_policies,
    distinct,
    task_keywords,
)
from agents.commands.recording.making import make
from agents.commands.recording.request import DatasetFolders, DatasetRequest, complete
from agents.commands.robots import robot_keywords
from space_envs.codegen.libraries import warned_once
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.datasets.card import read_card
from space_envs.evaluation.datasets.minari import ROOT_VARIABLE, require_minari
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.tables.terminal import print_at, width_of
from space_envs.registration import ENTRIES, make_task
from space_envs.system.command_line import AppendValues, Parser, exit_status, output_path
from space_envs.system.output import check_free, held
from space_envs.system.parallel import check_backend
from space_envs.tasks.common import DIFFICULTIES, SPLITS

LEARNED_FROM = ("train", "validation")  # splits; test goals are in no dataset
FORMATS = ("npz", "minari")
DATASET = "dataset"  # kind of the folder
NAMED = 5  # omitted episodes that the terminal lists for each dataset
DESCRIPTION = """\
Write policies' episodes as datasets: observations, actions, rewards, how each episode ended.

  evaluate.py dataset --env all --policy experts --episodes 100
                                        demonstrations of every expert on every id
  evaluate.py dataset --policy gjm runs/mine my_package.planner:Planner --format npz minari
  evaluate.py dataset --policy nmpc --captured-only --output demonstrations

Each episode is replayed from its actions, alone, in a fresh environment. It is omitted and reported if its
observations and rewards are not reproduced bit by bit, or if its policy fails.

A dataset is a folder OUTPUT/space-capture/ID/POLICY-DIFFICULTY-SPLIT-v0 with episodes.npz, Minari's data/,
and a card: README.md and dataset.json, which is written last. The same command again skips the datasets that
have one, so it continues after it was stopped or killed; incomplete datasets are made again.
docs/datasets.md shows how to load them.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="evaluate.py dataset",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = out.add_argument
    default = next(iter(ENTRIES))
    what = f"environment ids, of another package as module:id, or 'all' (default {default})"
    add("--env", action=AppendValues, nargs="+", default=[default], metavar="ID", help=what)
    add(
        "--policy",
        action=AppendValues,
        nargs="+",
        default=["experts"],
        metavar="NAME",
        help="'experts' for every planner that fits an id (default), 'all' for every built-in policy, "
        "or as in evaluate.py: built-in names, package.module:Class, a run's folder, a zip",
    )
    what = f"{' or '.join(LEARNED_FROM)} (default train); goals that policies are tested on are refused"
    add("--split", default="train", metavar="NAME", help=what)
    what = f"{', '.join(DIFFICULTIES)}, or the task's own (default: the task's, usually medium)"
    add("--difficulty", metavar="NAME", help=what)
    add_task_options(out)
    add_perturb(out)
    add("--episodes", type=int, default=100, metavar="N", help="different goals (default 100)")
    what = "of the goals, their order and the policy (default 0)"
    add("--seed", type=int, default=0, help=what)
    add("--captured-only", action="store_true", help="write only episodes with a capture (default: all)")
    what = f"{' and '.join(FORMATS)}, or one of them (default npz)"
    add("--format", action=AppendValues, nargs="+", default=["npz"], metavar="NAME", help=what)
    default_folder = Path("results/datasets")
    add("--output", type=output_path, default=default_folder, help="folder (default %(default)s)")
    what = f"folder of Minari's datasets, its {ROOT_VARIABLE} (default: that of --output)"
    add("--minari-root", type=output_path, metavar="FOLDER", help=what)
    return out


def main(arguments: list[str]) -> int:
    """Run the command; returns the exit status: 1 if a dataset has no episode."""
    goes_on = "stopped; the same command goes on from here"
    return exit_status("evaluate.py dataset", lambda: _run(parser().parse_args(arguments)), goes_on)


def _run(options: argparse.Namespace) -> int:
    requests = _requests(options)
    output = options.output.absolute()
    folders = DatasetFolders(output, (options.minari_root or output).absolute())
    missing = [request for request in requests if not complete(request, folders)]
    for request in missing:
        check_free(folders.folder(request), DATASET)
    folders.prepare()
    with ExitStack() as stack:
        for request in missing:
            stack.enter_context(held(folders.folder(request), DATASET))
        stack.enter_context(warned_once())
        return int(_show(requests, missing, make(missing, folders, options.jobs), folders))


def _requests(options: argparse.Namespace) -> list[DatasetRequest]:
    """Checked requests for the datasets that the options describe.

    Raises:
        SpaceEnvsError: for anything that is not valid.
    """
    robot = robot_keywords(options)
    env_ids = choose_ids(options.env, robot)
    distinct("format", options.format)
    for name in options.format:
        if name not in FORMATS:
            raise unknown_name("format", name, FORMATS)
    if options.split not in SPLITS:
        raise unknown_name("split", options.split, LEARNED_FROM)
    if options.split not in LEARNED_FROM:
        raise ConfigurationError(
            f"datasets are for training: they have goals of {' or '.join(LEARNED_FROM)}, never those of "
            f"split {options.split!r}, on which policies are tested"
        )
    if options.seed < 0:
        raise ConfigurationError(f"seed must be an integer of at least 0, got {options.seed}")
    if "minari" in options.format:
        require_minari()
    elif options.minari_root is not None:
        raise ConfigurationError("--minari-root goes with --format minari")
    check_backend(options.jobs)
    formats = tuple(name for name in FORMATS if name in options.format)
    keywords = {env_id: task_keywords(options, env_id) for env_id in env_ids}
    chosen = {"split": options.split, **({"difficulty": options.difficulty} if options.difficulty else {})}
    chosen |= {"perturbation": " ".join(options.perturb)} if options.perturb else {}
    tasks = {env_id: make_task(env_id, {**keywords[env_id], **chosen}) for env_id in env_ids}
    requests = [
        DatasetRequest(
            EvaluatedTask.of(env_id, tasks[env_id]),
            tasks[env_id].robot,
            policy,
            options.episodes,
            options.seed,
            options.captured_only,
            formats,
            options.control_mode,
            robot,
        )
        for env_id in env_ids
        for policy in choose_policies(options.policy, env_id, env_ids, options.control_mode, keywords[env_id])
    ]
    distinct("name of a dataset", [request.id for request in requests])
    for request in requests:
        check_fit(request.policy, request.task.env_id, request.task.keywords(request.model))
        request.chunks()  # refuses an invalid number of episodes
    return requests


def _show(
    requests: Sequence[DatasetRequest],
    missing: Sequence[DatasetRequest],
    made: Iterator[tuple[DatasetRequest, dict[str, Any]]],
    folders: DatasetFolders,
) -> bool:
    """Print the table of all datasets; returns whether one of them has no episode."""
    cards = {request.id: card for request, card in made}
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("id", "policy", "episodes", "captured", "omitted", "state"):
        table.add_column(
            name, justify="left" if name in ("id", "policy", "state") else "right", overflow="fold"
        )
    console = Console()
    reasons: list[str] = []
    for request in requests:
        card = cards.get(request.id) or read_card(folders.folder(request)) or {}
        episodes = card["episodes"]
        omitted = episodes["omitted"]
        state = "written" if request in missing else "was complete"
        state = state if episodes["written"] else "nothing to write"
        counts = (episodes["written"], episodes["captured"], len(omitted))
        names = (request.task.env_id.split("/")[1], request.policy.name)
        table.add_row(*(Text(display_name(name)) for name in names), *map(str, counts), state)
        for one in omitted[:NAMED]:
            reasons.append(f"{request.id}: episode {one['episode']} (goal {one['index']}): {one['reason']}")
        if len(omitted) > NAMED:
            reasons.append(f"{request.id}: {len(omitted) - NAMED} more, in its card")
    print_at(console, table, width_of(console))
    for line in reasons:
        console.print(f"omitted from {line}", highlight=False, soft_wrap=True, markup=False)
    console.print(f"Folder: {folders.output}", highlight=False, soft_wrap=True, markup=False)
    if any("minari" in request.formats for request in requests):
        hint = f"Minari finds them with {ROOT_VARIABLE}={shlex.quote(str(folders.minari))}"
        console.print(hint, highlight=False, soft_wrap=True, markup=False)
    return any(not card["episodes"]["written"] for card in cards.values())
