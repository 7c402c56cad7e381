"""Command line that puts a trained policy among those that ship with the project (for maintainers)."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from agents.learned_policy import shipped_path
from agents.policy_file import load_policy_file
from agents.training.runs import RunFolder
from agents.training.validation import Validator
from space_envs.command_line import ended
from space_envs.errors import ConfigurationError
from space_envs.files import atomic_write_text

TEST_EPISODES = 512


def main(arguments: Sequence[str] | None = None) -> int:
    """Ship a policy; returns the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m agents.commands.ship",
        description="Evaluate a finished run's policy on the test split, once, and put it with its "
        "provenance into agents/data/policies of this checkout.",
    )
    parser.add_argument("run", help="folder of a finished run")
    parser.add_argument("name", help="name of the policy, as the registry has it")
    return ended("python -m agents.commands.ship", lambda: _run(parser.parse_args(arguments)))


def _run(parsed: argparse.Namespace) -> None:
    written = ship(RunFolder(Path(parsed.run)), parsed.name)
    print(json.dumps(written["test"], indent=2))


def ship(run: RunFolder, name: str) -> dict[str, Any]:
    """Copy the policy and write its provenance beside it; returns the provenance.

    Raises:
        ConfigurationError: if the run has not finished, or did not improve on the policy that it started
            from. PolicyError: if its policy is not sound.
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
    view = file.view(Validator(settings.env_id, 1, **settings.environment).env.task.layout)
    test = Validator(settings.env_id, TEST_EPISODES, "test", **settings.environment)
    result = test(lambda observation: file.network.actions(view(observation)))
    provenance = {
        "commands": [_portable(command) for command in config["commands"]],
        "settings": config["settings"],
        "hyperparameters": config["hyperparameters"],
        "versions": config["versions"],
        "commit": config["commit"],
        "created": config["created"],
        "summary": summary,
        "test": result.to_json(),
    }
    path = shipped_path(settings.env_id, name)
    file.save(path)
    atomic_write_text(path.with_suffix(".json"), json.dumps(provenance, indent=2) + "\n")
    return provenance


def _portable(command: list[str]) -> list[str]:
    """The command without the folders of the machine it ran on and without what only shows progress."""
    kept, skip = [], False
    for word in command:
        if not skip and word not in ("--output", "--quiet"):
            kept.append(Path(word).name if "/" in word and Path(word).exists() else word)
        skip = word == "--output"
    return kept


if __name__ == "__main__":
    raise SystemExit(main())
