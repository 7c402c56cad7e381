"""Command line of training."""

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from agents.commands.sweep import EPILOG, SPREADING, add_options, asked_for, sweep
from agents.learning.hyperparameters import ALGORITHMS, AnyHyperparameters
from agents.learning.options import DEFAULT_ENV, OPTIONS, Options, check_device, limited, rounding
from agents.learning.runs import RunFolder, command_line
from agents.learning.validation import EPISODES
from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.system.command_line import Parser, exit_status, output_path
from space_envs.system.output import check_free, held
from space_envs.tasks.common import DIFFICULTIES

RUN = "training run"  # kind of the folder
DESCRIPTION = """\
Train a policy and keep the best one on the validation split (the held-out part of the train split).

  train.py                                   ppo: clones the expert gjm for half a minute, then improves on it
  train.py --algo bc --expert mpc            behaviour cloning alone, of any expert
  train.py --algo ppo --init runs/my-bc      ppo from a policy that was trained before
  train.py --algo ppo --init none            ppo from random weights
  train.py --resume runs/my-ppo              go on with a run that was stopped or killed
  train.py --algo bc --seeds 0-9 --jobs 4    ten runs, four at a time; more on this at the end

The run's folder holds config.json, policy.npz (the best policy; evaluate.py takes the folder as a policy),
checkpoint.npz, validation.json, summary.json and TensorBoard's logs. All of them are data without code.
"""
# What --resume cannot change; None in the arguments means that it was not given.
_CHANGEABLE = ("steps", "minutes")
_FIXED = (
    *(name for name in OPTIONS if name not in _CHANGEABLE),
    "output",
    "seeds",
    "sweep",
    *SPREADING,
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train.

    Returns:
        The exit status: 0, 1 if one of several runs failed, 2 for bad input (one line says what), 130 when
        interrupted.
    """
    return exit_status("train.py", lambda: _run(_parser().parse_args(arguments)))


def _run(parsed: argparse.Namespace) -> int:
    try:
        if not parsed.resume and asked_for(parsed):
            _check_episodes(parsed)
            return sweep(parsed)
        folder = _resumed(parsed) if parsed.resume else _begun(parsed)
    except SpaceEnvsError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    # Torch takes seconds to import; bad input has been refused by now.
    from agents.learning.training import learn

    if not parsed.quiet:
        print(f"run folder: {folder.path}")
    try:
        with held(folder.path, RUN, known=True):
            summary = learn(folder, parsed.validation_episodes, parsed.quiet)
    except SpaceEnvsError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"\nstopped; go on with: train.py --resume {folder.path}", file=sys.stderr)
        return 130
    if not parsed.quiet:
        result = summary["validation"]
        print(
            f"best policy, after {summary['best_steps']:,} of {summary['steps']:,} steps: "
            f"captured {100 * result['captured']:.1f} % of {result['episodes']} validation goals, "
            f"final attitude {result['final_attitude']:.2f} deg; {summary['wall_s']:.0f} s\n{folder.policy}"
        )
        if summary["improved"] is False:
            start = summary["start"]
            print(
                f"it is not better than the policy that the run started from, which captured "
                f"{100 * start['captured']:.1f} % with a return of {start['episode_return']:.2f} "
                f"(here {result['episode_return']:.2f})"
            )
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="train.py",
        description=DESCRIPTION,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add("--algo", metavar="NAME", help=f"{', '.join(ALGORITHMS)}; default ppo")
    add("--env", metavar="ID", help=f"environment id; default {DEFAULT_ENV}")
    add("--init", metavar="RUN", help="ppo: run folder or policy file to start from, or none")
    add(
        "--expert", metavar="NAME", help="bc, and ppo without --init: policy to clone; default from the table"
    )
    add(
        "--steps",
        type=int,
        metavar="N",
        help="control steps of all environments together, rounded up to whole rounds of the algorithm; "
        "default from the table",
    )
    add(
        "--minutes", type=float, metavar="M", help="stop after so much wall time, if --steps has not ended it"
    )
    add("--seed", type=int, metavar="S", help="of everything random; default 0")
    add("--num-envs", type=int, metavar="N", help="episodes simulated together; default from the table")
    add("--difficulty", metavar="NAME", help=f"{', '.join(DIFFICULTIES)}; default medium")
    add("--control-mode", metavar="NAME", help=f"{', '.join(CONTROL_MODES)}; default joint_velocity")
    add(
        "--output",
        type=output_path,
        metavar="FOLDER",
        help="run folder, default runs/ALGO-ID-TIME; of several runs what holds their folders, default "
        "runs/ALGO-ID or runs/ and the sweep file's name",
    )
    add(
        "--resume",
        metavar="RUN",
        help="continue this run; takes --steps and --minutes, and nothing else of a run",
    )
    add("--device", metavar="NAME", help="of torch; default cpu, which is the fastest for these networks")
    add(
        "--validation-episodes",
        type=int,
        default=EPISODES,
        metavar="N",
        help="goals of a validation; default %(default)s",
    )
    add("--quiet", action="store_true", help="neither progress bar nor lines")
    add_options(parser)
    return parser


def _begun(parsed: argparse.Namespace) -> RunFolder:
    """A new run, written down after all of its input was found to be good."""
    _check_episodes(parsed)
    settings, parameters = Options(**{name: getattr(parsed, name) for name in OPTIONS}).settle()
    name = f"{settings.algorithm}-{settings.env_id.split('/')[-1]}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    folder = RunFolder(Path(parsed.output or Path("runs") / name))
    if not folder.exists():
        check_free(folder.path, RUN)
    folder.begin(settings, parameters)
    folder.note_command(command_line())
    _tell_rounding(parameters, parsed)
    return folder


def _resumed(parsed: argparse.Namespace) -> RunFolder:
    """A run that exists, with more steps or minutes where they were given."""
    if given := [f"--{name.replace('_', '-')}" for name in _FIXED if getattr(parsed, name) is not None]:
        raise ConfigurationError(f"--resume takes the run's own settings; leave out {', '.join(given)}")
    _check_episodes(parsed)
    folder = RunFolder(Path(parsed.resume))
    settings, parameters = folder.restore()
    check_device(settings.device)
    parameters = limited(parameters, parsed.steps, parsed.minutes)
    folder.note_command(command_line(), parameters)
    _tell_rounding(parameters, parsed)
    return folder


def _tell_rounding(parameters: AnyHyperparameters, parsed: argparse.Namespace) -> None:
    if not parsed.quiet and (message := rounding(parameters, parsed.steps)):
        print(message)


def _check_episodes(parsed: argparse.Namespace) -> None:
    if not 1 <= parsed.validation_episodes <= EPISODES:
        raise ConfigurationError(
            f"validation-episodes must lie in 1..{EPISODES}, got {parsed.validation_episodes}"
        )
