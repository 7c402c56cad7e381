"""Command line that adds a trained policy to those shipped with the project (for maintainers)."""

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from agents.learning.runs.folder import RunFolder
from agents.learning.runs.settings import Settings
from agents.learning.validation import Validator
from agents.planners.common.robot_files import SHIPPED, shipped_file, variant_name
from agents.policies.learned.learned_policy import (
    load_shipped,
    shipped_path,
    shipped_policies,
)
from agents.policies.learned.policy_file import PolicyFile, load_policy_file
from agents.policies.learned.trained import trained_policy
from space_envs.errors import ConfigurationError
from space_envs.registration import make_task
from space_envs.robots.robot import Robot
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.files import write_json
from space_envs.system.reading import parse_json

TEST_EPISODES = 512
VARIANTS = (None, "physical")  # of the ids' robots; those that a robot lacks are left out


def main(arguments: Sequence[str] | None = None) -> int:
    """Ship a policy; returns the exit status."""
    parser = Parser(
        prog="python -m agents.commands.training.ship",
        description="Evaluate a finished run's policy on the test split, once, and put it with its "
        "provenance into agents/data/policies of this checkout.",
    )
    text = "folder of a finished run; with --again, the id that the policy is for"
    parser.add_argument("run", nargs="?", help=text)
    parser.add_argument("name", nargs="?", help="name of the policy, as the registry has it")
    text = "only write the digests of the ids' robots into what ships, after a change of a robot"
    parser.add_argument("--stamp", action="store_true", help=text)
    parser.add_argument(
        "--again",
        action="store_true",
        help="only evaluate the shipped policy again, after a change of the task",
    )
    return exit_status("python -m agents.commands.training.ship", lambda: _run(parser.parse_args(arguments)))


def _run(parsed: argparse.Namespace) -> None:
    if parsed.stamp:
        return stamp()
    if parsed.run is None or parsed.name is None:
        raise ConfigurationError("give a run and the name of its policy, or --stamp")
    if parsed.again:
        written = evaluate_again(parsed.run, parsed.name)
    else:
        written = ship(RunFolder(Path(parsed.run)), parsed.name)
    print(json.dumps(written["test"], indent=2))


def ship(run: RunFolder, name: str) -> dict[str, Any]:
    """Copy the policy and write its provenance next to it; returns the provenance.

    Raises:
        ConfigurationError: if the run has not finished, or did not improve its initial policy.
        PolicyError: if its policy is invalid.
    """
    config, summary = run.config(), run.summary()
    if summary is None:
        raise ConfigurationError(f"{run.path} has not finished")
    if summary["improved"] is False:
        raise ConfigurationError(f"{run.path}: its policy is not better than the one that it started from")
    if not name.isidentifier():
        raise ConfigurationError(f"a policy's name must be an identifier, got {name!r}")
    settings, _ = run.restore()
    file = load_policy_file(run.policy)
    provenance = {
        "commands": [_portable(command) for command in config["commands"]],
        "settings": config["settings"],
        "hyperparameters": config["hyperparameters"],
        "versions": config["versions"],
        "commit": config["commit"],
        "created": config["created"],
        "summary": summary,
        "test": _tested(file, settings),
    }
    path = shipped_path(settings.env_id, name)
    file.save(path)
    write_json(path.with_suffix(".json"), provenance)
    return provenance


def evaluate_again(env_id: str, name: str) -> dict[str, Any]:
    """Update the test result in a shipped policy's provenance; returns the provenance.

    Raises:
        ConfigurationError: if no policy of that name is shipped for the id.
    """
    file, path = load_shipped(env_id, name), shipped_path(env_id, name).with_suffix(".json")
    provenance = parse_json(path.read_text("utf-8"))
    provenance["test"] = _tested(file, Settings(**provenance["settings"]))
    write_json(path, provenance)
    return provenance


def stamp() -> None:
    """Write the digests of the robots that the shipped files are for into these, after a change of them."""
    robots: dict[str, str] = {}
    for folder in sorted(shipped_file("policies").iterdir()):
        env_id = f"SpaceCapture/{folder.name}"
        known = {robot.digest: variant_name(robot) for robot in _own_robots(env_id)}
        for name in shipped_policies(env_id):
            replace(load_shipped(env_id, name), robots=known).save(shipped_path(env_id, name))
        robots |= known
    write_json(shipped_file(SHIPPED), robots)


def _own_robots(env_id: str) -> Iterator[Robot]:
    """The robot of an id in all its variants."""
    for variant in VARIANTS:
        with suppress(ConfigurationError):
            yield make_task(env_id, {} if variant is None else {"variant": variant}).robot


def _tested(file: PolicyFile, settings: Settings) -> dict[str, Any]:
    """Validation of a policy on the first goals of the test split, as plain JSON values."""
    test = Validator(settings.env_id, TEST_EPISODES, "test", **settings.environment)
    return test(trained_policy(file, test.context)).to_json()


def _portable(command: list[str]) -> list[str]:
    """The command without folders of the machine and without options that only affect progress messages."""
    words, skip = [], False
    for word in command:
        if not skip and word not in ("--output", "--quiet"):
            words.append(Path(word).name if "/" in word and Path(word).exists() else word)
        skip = word == "--output"
    return words


if __name__ == "__main__":
    raise SystemExit(main())
