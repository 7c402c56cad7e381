"""`train.py`: train one policy, or several with one command."""

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.commands.training.options import add_hyperparameters, add_options, given_options, to_toml
from agents.commands.training.sweep import EPILOG, add_sweep_options, is_sweep, sweep
from agents.learning.runs.folder import RunFolder, command_line
from agents.learning.runs.settings import Settled, check_device, limited, rounding, settle
from agents.learning.validation import checked_episodes
from space_envs.errors import ConfigurationError
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.output import check_free, held

RUN = "training run"  # kind of the folder
DESCRIPTION = """\
Train a policy and keep the best one on the validation split (the held-out part of the train split).

  train.py                                   ppo: clones an expert for half a minute, then improves the clone
  train.py --algo bc --expert mpc            behaviour cloning alone, of any expert
  train.py --algo planner                    a network that plans, trained on its own corrected plans
  train.py --algo ppo --init runs/my-bc      ppo from a policy that was trained earlier
  train.py --algo ppo --init none            ppo from random weights
  train.py --algo td3 --init runs/my-bc      off-policy, with the clone's steps in the replay buffer
  train.py --hidden 64 64 --learning-rate 1e-4 --env-kwargs horizon=100 reward=sparse
  train.py --env my_package:Mine/Task-v0     a task of your own
  train.py --resume runs/my-ppo              continue a run that was stopped or killed
  train.py --algo bc --seeds 0-9 --jobs 4    ten runs, four at a time; see the end of this text

The run's folder holds config.json, policy.npz (the best policy; evaluate.py takes the folder as a policy),
checkpoint.npz, validation.json, summary.json and TensorBoard's logs. All of them are data without code.
"""
# Options that --resume accepts; all others are fixed by the run.
_WITH_RESUME = ("resume", "steps", "minutes", "validation_episodes", "quiet", "dry_run")


def main(arguments: Sequence[str] | None = None) -> int:
    """Train.

    Returns:
        The exit status: 0, 1 if one of several runs failed, 2 for bad input (with a message of one line),
        130 when interrupted.
    """
    return exit_status("train.py", lambda: _run(_parser().parse_args(arguments)))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="train.py",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_options(parser)
    add_hyperparameters(parser)
    add_sweep_options(parser)
    return parser


def _run(parsed: argparse.Namespace) -> int:
    if parsed.resume:
        return _train(_resumed_run(parsed), parsed)
    if is_sweep(parsed):
        return sweep(parsed)
    settled = settle(given_options(parsed))
    checked_episodes(settled.settings.task(), parsed.validation_episodes)
    if parsed.dry_run:
        print(to_toml(settled.settings, settled.parameters), end="")
        return 0
    return _train(_new_run(settled, parsed), parsed)


def _new_run(settled: Settled, parsed: argparse.Namespace) -> RunFolder:
    """A new run, written to its folder."""
    settings = settled.settings
    task = settings.env_id.split(":")[-1].split("/")[-1]
    name = f"{settings.algorithm}-{task}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    folder = RunFolder(Path(parsed.output or Path("runs") / name))
    if not folder.exists():
        check_free(folder.path, RUN)
    folder.create(settings, settled.parameters)
    folder.note_command(command_line())
    if not parsed.quiet:
        for message in settled.messages:
            print(message)
    return folder


def _resumed_run(parsed: argparse.Namespace) -> RunFolder:
    """A run that exists, with more steps or minutes where they were given."""
    given = [name for name, value in vars(parsed).items() if value is not None and name not in _WITH_RESUME]
    if given:
        options = ", ".join(f"--{name.replace('_', '-')}" for name in given)
        raise ConfigurationError(f"--resume takes the run's own settings; omit {options}")
    folder = RunFolder(Path(parsed.resume))
    settings, parameters = folder.restore()
    check_device(settings.device)
    checked_episodes(settings.task(), parsed.validation_episodes)
    parameters = limited(parameters, parsed.steps, parsed.minutes)
    folder.note_command(command_line(), parameters)
    if not parsed.quiet and (message := rounding(parameters, parsed.steps)):
        print(message)
    return folder


def _train(folder: RunFolder, parsed: argparse.Namespace) -> int:
    # Torch takes seconds to import; bad input has been refused by now.
    from agents.learning.training import learn

    if not parsed.quiet:
        print(f"run folder: {folder.path}")
    try:
        with held(folder.path, RUN, known=True):
            summary = learn(folder, parsed.validation_episodes, parsed.quiet)
    except KeyboardInterrupt:
        print(f"\nstopped; continue with: train.py --resume {folder.path}", file=sys.stderr)
        return 130
    if not parsed.quiet:
        print(_ending(summary, folder))
    return 0


def _ending(summary: dict[str, Any], folder: RunFolder) -> str:
    """Lines about a finished run."""
    result, start = summary["validation"], summary["start"]
    text = (
        f"best policy, after {summary['best_steps']:,} of {summary['steps']:,} steps: "
        f"kept-attitude score {result['score']:.3f}, captured "
        f"{100 * result['captured']:.1f} % of {result['episodes']} validation goals, "
        f"final attitude {result['final_attitude']:.2f} deg; {summary['wall_s']:.0f} s\n{folder.policy}"
    )
    if summary["improved"] is not False:
        return text
    return (
        f"{text}\nit is not better than the policy that the run started from, which has a score of "
        f"{start['score']:.3f} and a return of {start['episode_return']:.2f} "
        f"(here {result['episode_return']:.2f})"
    )
