"""Command line of training."""

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

from agents.hyperparameters import ALGORITHMS, BC, PPO, TABLES, AnyHyperparameters, hyperparameters
from agents.registry import check_task, control_modes, policy_class
from agents.training.runs import RunFolder, Settings, command_line
from agents.training.validation import EPISODES
from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, SpaceEnvsError, unknown_name
from space_envs.tasks.common import DIFFICULTIES

VALIDATIONS = 10  # at least so many in a run
DEFAULT_ENV = "SpaceCapture/SingleArm-v0"
DESCRIPTION = """\
Train a policy and keep the best one on the validation split (the held-out part of the train split).

  train.py                                   ppo: clones the expert gjm for half a minute, then improves on it
  train.py --algo bc --expert mpc            behaviour cloning alone, of any expert
  train.py --algo ppo --init runs/my-bc      ppo from a policy that was trained before
  train.py --algo ppo --init none            ppo from random weights
  train.py --resume runs/my-ppo              go on with a run that was stopped or killed

The run's folder holds config.json, policy.npz (the best policy; evaluate.py takes the folder as a policy),
checkpoint.npz, validation.json, summary.json and TensorBoard's logs. All of them are data without code.
"""
# What --resume cannot change; None in the arguments means that it was not given.
_FIXED = (
    "algo",
    "env",
    "init",
    "expert",
    "seed",
    "num_envs",
    "difficulty",
    "control_mode",
    "output",
    "device",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Train; returns the exit status: 0, 2 for bad input (one line says what), 130 when interrupted."""
    parsed = _parser().parse_args(arguments)
    try:
        folder = _resumed(parsed) if parsed.resume else _begun(parsed)
    except SpaceEnvsError as error:
        print(f"train.py: {error}", file=sys.stderr)
        return 2
    # Torch takes seconds to import; bad input has been refused by now.
    from agents.learning import learn

    if not parsed.quiet:
        print(f"run folder: {folder.path}")
    try:
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
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="train.py", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
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
        help="control steps of all environments together; default from the table",
    )
    add(
        "--minutes", type=float, metavar="M", help="stop after so much wall time, if --steps has not ended it"
    )
    add("--seed", type=int, metavar="S", help="of everything random; default 0")
    add("--num-envs", type=int, metavar="N", help="episodes simulated together; default from the table")
    add("--difficulty", metavar="NAME", help=f"{', '.join(DIFFICULTIES)}; default medium")
    add("--control-mode", metavar="NAME", help=f"{', '.join(CONTROL_MODES)}; default joint_velocity")
    add("--output", metavar="FOLDER", help="run folder; default runs/ALGO-ID-TIME")
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
    return parser


def _begun(parsed: argparse.Namespace) -> RunFolder:
    """A new run, written down after all of its input was found to be good."""
    env_id = parsed.env or DEFAULT_ENV
    algorithm = parsed.algo or "ppo"
    if env_id not in TABLES:
        raise unknown_name("environment id", env_id, TABLES)
    if algorithm not in ALGORITHMS:
        raise unknown_name("algorithm", algorithm, ALGORITHMS)
    settings = Settings(
        algorithm=algorithm,
        env_id=env_id,
        control_mode=parsed.control_mode or "joint_velocity",
        difficulty=parsed.difficulty or "medium",
        seed=0 if parsed.seed is None else parsed.seed,
        device=parsed.device or "cpu",
        init=None if parsed.init in (None, "none") else parsed.init,
    )
    parameters = _limited(_chosen(parsed, settings), parsed)
    _check(settings, parameters, parsed)
    name = f"{algorithm}-{env_id.split('/')[-1]}-{datetime.now(UTC):%Y%m%d-%H%M%S}"
    folder = RunFolder(Path(parsed.output or Path("runs") / name))
    folder.begin(settings, parameters)
    folder.note_command(command_line())
    return folder


def _resumed(parsed: argparse.Namespace) -> RunFolder:
    """A run that exists, with more steps or minutes where they were given."""
    if given := [f"--{name.replace('_', '-')}" for name in _FIXED if getattr(parsed, name) is not None]:
        raise ConfigurationError(f"--resume takes the run's own settings; leave out {', '.join(given)}")
    _check_episodes(parsed)
    folder = RunFolder(Path(parsed.resume))
    settings, parameters = folder.restore()
    _check_device(settings.device)
    parameters = _limited(parameters, parsed)
    folder.note_command(command_line(), parameters)
    return folder


def _chosen(parsed: argparse.Namespace, settings: Settings) -> AnyHyperparameters:
    """The table's hyperparameters with what the command line says about the algorithm."""
    parameters = hyperparameters(settings.env_id, settings.algorithm)
    if parsed.num_envs is not None:
        parameters = replace(parameters, num_envs=parsed.num_envs)
    if parsed.init is not None:
        if not isinstance(parameters, PPO):
            raise ConfigurationError("--init is for ppo alone; the others start from random weights")
        if parsed.expert is not None:
            raise ConfigurationError("give either --init or --expert")
        return replace(parameters, expert=None)
    if parsed.expert is None:
        return parameters
    if not isinstance(parameters, PPO | BC):
        raise ConfigurationError("--expert is for bc and ppo alone")
    return replace(parameters, expert=parsed.expert)


def _limited(parameters: AnyHyperparameters, parsed: argparse.Namespace) -> AnyHyperparameters:
    """Hyperparameters with the steps and minutes of the command line; a shorter run is validated sooner."""
    if parsed.steps is not None:
        interval = max(1, min(parameters.interval, parsed.steps // VALIDATIONS))
        parameters = replace(parameters, steps=parsed.steps, interval=interval)
    return parameters if parsed.minutes is None else replace(parameters, minutes=parsed.minutes)


def _check(settings: Settings, parameters: AnyHyperparameters, parsed: argparse.Namespace) -> None:
    """Refuse what would fail later."""
    if settings.control_mode not in CONTROL_MODES:
        raise unknown_name("control mode", settings.control_mode, CONTROL_MODES)
    if settings.difficulty not in DIFFICULTIES:
        raise unknown_name("difficulty", settings.difficulty, DIFFICULTIES)
    if not 0 <= settings.seed < 2**32:
        raise ConfigurationError(f"seed must lie in 0..2^32 - 1, got {settings.seed}")
    _check_episodes(parsed)
    _check_device(settings.device)
    if isinstance(parameters, PPO | BC) and parameters.expert is not None:
        policy_class(parameters.expert)
        check_task(parameters.expert, settings.env_id)
        modes = control_modes(parameters.expert)
        if settings.control_mode not in modes:
            raise ConfigurationError(
                f"expert {parameters.expert!r} acts in control mode {' or '.join(map(repr, modes))}, not "
                f"{settings.control_mode!r}; "
                "name another --expert, or for ppo --init none"
            )
    if isinstance(parameters, PPO) and settings.init is not None:
        from agents.learning import starting_policy

        starting_policy(settings, parameters)


def _check_episodes(parsed: argparse.Namespace) -> None:
    if not 1 <= parsed.validation_episodes <= EPISODES:
        raise ConfigurationError(
            f"validation-episodes must lie in 1..{EPISODES}, got {parsed.validation_episodes}"
        )


def _check_device(device: str) -> None:
    if device == "cpu":
        return
    import torch as th

    try:
        th.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:
        raise ConfigurationError(f"device {device!r} cannot be used: {str(error).splitlines()[0]}") from None
