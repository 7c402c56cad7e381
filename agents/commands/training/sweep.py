"""`train.py --seeds` and `train.py --sweep`: several runs with one command, and the result of each."""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from agents.commands.training.options import given_options
from agents.learning.runs.folder import command_line
from agents.learning.runs.settings import DEFAULT_ALGORITHM, DEFAULT_ENV
from agents.learning.sweeps.plan import SweepPlan, SweepRun, make_runs, read_plan
from agents.learning.sweeps.spread import ERROR, SUMMARY, RunResult, prepare, spread, write_summary
from agents.learning.validation import checked_episodes
from space_envs.errors import ConfigurationError
from space_envs.system.command_line import parse_seeds
from space_envs.system.parallel import BACKENDS, check_backend

SPREADING = ("jobs", "backend", "address")  # options that only several runs have
EPILOG = f"""\
several runs:
  train.py --algo bc --seeds 0-9 --jobs 4          ten runs in runs/bc-SingleArm-v0, four at a time
  train.py --sweep rates.toml --seeds 0,3,5-7      every combination of the file, with each of five seeds
  train.py --sweep rates.toml --backend ray --address 10.0.0.5:6379

A sweep file is TOML. Names are those of the options and hyperparameters above, with _ for -; options of the
command line hold for all runs too.

  seeds = "0-4"                      # or a list; the option --seeds overrides it
  [fixed]                            # the same in all runs
  algo = "ppo"
  hidden = [64, 64]
  [values]                           # lists; every combination is trained with every seed
  learning_rate = [1e-4, 3e-4]
  num_envs = [64, 128]

Each run is a folder inside --output, like learning_rate-0.0003_num_envs-64_seed-2, where evaluate.py and
--resume take it. A failed run does not affect the others; its traceback is in its {ERROR}. The same command
again continues the runs that are not finished. {SUMMARY} has the result of each run. With a cluster, its
workers need this project installed and the output folder at the same path.
"""


def add_sweep_options(parser: argparse.ArgumentParser) -> None:
    """The options of several runs."""
    group = parser.add_argument_group("several runs")
    add = group.add_argument
    add("--seeds", metavar="LIST", help="train with each of these, like 0-9 or 0,3,5-7")
    add("--sweep", metavar="FILE", help="train every combination that this TOML file names; see below")
    add("--jobs", type=int, metavar="N", help="runs at a time, each in a process of its own; default 1")
    add("--backend", metavar="NAME", help=f"what starts the processes: {', '.join(BACKENDS)}; default loky")
    add("--address", metavar="ADDRESS", help="cluster of ray or dask that already runs")


def is_sweep(parsed: argparse.Namespace) -> bool:
    """Whether the options describe several runs.

    Raises:
        ConfigurationError: if there are options of several runs, but neither --seeds nor --sweep.
    """
    if parsed.seeds is not None or parsed.sweep is not None:
        return True
    if given := [f"--{name}" for name in SPREADING if getattr(parsed, name) is not None]:
        raise ConfigurationError(f"{given[0]} is for several runs: give --seeds or --sweep too")
    return False


def sweep(parsed: argparse.Namespace) -> int:
    """Train all runs; returns the exit status: 0, 1 if a run failed, 130 when interrupted.

    Raises:
        SpaceEnvsError: for invalid input of any run, before the first one starts.
    """
    jobs = 1 if parsed.jobs is None else parsed.jobs
    check_backend(jobs, parsed.backend or "loky", parsed.address)
    given = given_options(parsed)
    if "seed" in given:
        raise ConfigurationError("give either --seed or the seeds of several runs")
    runs = _runs(parsed, given)
    if parsed.dry_run:
        print("\n".join(run.name for run in runs))
        return 0
    output = parsed.output or _default_output(parsed.sweep, given)
    results = {result.name: result for result in prepare(runs, output, command_line())}
    if not parsed.quiet:
        done = sum(result.status == "finished" for result in results.values())
        print(f"{len(runs)} runs in {output}" + (f", {done} of them finished before" if done else ""))
        for message in sorted({message for run in runs for message in run.messages}):
            print(message)
    if not _train(parsed, runs, output, results):
        return 130
    if not parsed.quiet:
        _report(runs, results, output)
    failed = [result for result in results.values() if result.status == "failed"]
    for result in failed:
        print(f"train.py: {output / result.name} failed: {result.error}", file=sys.stderr)
    return 1 if failed else 0


def _runs(parsed: argparse.Namespace, given: Mapping[str, Any]) -> list[SweepRun]:
    """All runs, checked."""
    plan = SweepPlan(None, {}, {}) if parsed.sweep is None else read_plan(parsed.sweep)
    if parsed.seeds is not None:
        plan = replace(plan, seeds=parse_seeds(parsed.seeds))
    runs = make_runs(plan, given)
    for run in runs:
        checked_episodes(run.settings.task(), parsed.validation_episodes)
    return runs


def _train(
    parsed: argparse.Namespace, runs: Sequence[SweepRun], output: Path, results: dict[str, RunResult]
) -> bool:
    """Train the unfinished runs and write every result; returns False if it was interrupted."""
    waiting = [output / name for name, result in results.items() if result.status != "finished"]
    width = max(map(len, results))
    quiet = parsed.quiet or not sys.stderr.isatty()
    bar = tqdm(total=len(runs), initial=len(runs) - len(waiting), unit="run", disable=quiet)

    def write() -> None:
        write_summary(output, command_line(), runs, [results[run.name] for run in runs])

    write()
    jobs = 1 if parsed.jobs is None else parsed.jobs
    how = (parsed.validation_episodes, jobs, parsed.backend or "loky", parsed.address)
    try:
        for result in spread(waiting, *how):
            results[result.name] = result
            write()
            bar.update()
            if not parsed.quiet:
                tqdm.write(_line(result, width))
    except KeyboardInterrupt:
        done = sum(result.status == "finished" for result in results.values())
        print(
            f"\nstopped with {done} of {len(runs)} runs finished; the same command continues the others",
            file=sys.stderr,
        )
        return False
    finally:
        bar.close()
    return True


def _default_output(file: str | None, given: Mapping[str, Any]) -> Path:
    """Folder of the runs: the same for the same command, so that it continues them."""
    if file is not None:
        return Path("runs") / Path(file).stem
    env_id = given.get("env", DEFAULT_ENV).split(":")[-1].split("/")[-1]
    return Path("runs") / f"{given.get('algo', DEFAULT_ALGORITHM)}-{env_id}"


def _line(result: RunResult, width: int) -> str:
    if result.summary is None:
        return f"{result.name:{width}}  {result.status}  {result.error or ''}".rstrip()
    summary = result.summary
    validation = summary["validation"]
    return (
        f"{result.name:{width}}  score {validation['score']:.3f}   captured "
        f"{100 * validation['captured']:5.1f} %   attitude "
        f"{validation['final_attitude']:5.2f} deg   after {summary['best_steps']:,} of "
        f"{summary['steps']:,} steps   {summary['wall_s']:.0f} s"
    )


def _report(runs: Sequence[SweepRun], results: Mapping[str, RunResult], output: Path) -> None:
    """All runs, and the mean over seeds of every combination that has several."""
    width = max(map(len, results))
    print()
    for run in runs:
        print(_line(results[run.name], width))
    combinations: dict[str, list[float]] = {}
    for run in runs:
        if summary := results[run.name].summary:
            swept = ", ".join(f"{name} = {value}" for name, value in run.values.items() if name != "seed")
            combinations.setdefault(swept, []).append(summary["validation"]["score"])
    print()
    for swept, scores in combinations.items():
        if len(scores) > 1:
            print(
                f"{swept or 'all'}: score {np.mean(scores):.3f} on average over {len(scores)} seeds, between "
                f"{min(scores):.3f} and {max(scores):.3f}"
            )
    print(output / SUMMARY)
