"""The folder of a training run: configuration, policy, checkpoint, validations, summary."""

import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from agents.learning.runs.hyperparameters import AnyHyperparameters, from_json, to_json
from agents.learning.runs.settings import Settings
from agents.planners.common.robot_files import described_robot, refuse_other_robot
from agents.policies.learned.learned_policy import POLICY_FILE
from space_envs.errors import ConfigurationError, no_path
from space_envs.system.files import write_json
from space_envs.system.provenance import commit, versions
from space_envs.system.reading import read_object

CONFIG, CHECKPOINT, VALIDATION, SUMMARY = "config.json", "checkpoint.npz", "validation.json", "summary.json"


@dataclass(frozen=True)
class RunFolder:
    """Files of a run; each is written whole or not at all."""

    path: Path

    @property
    def policy(self) -> Path:
        """The best policy on the validation split so far."""
        return self.path / POLICY_FILE

    @property
    def tensorboard(self) -> Path:
        """Folder of TensorBoard's event files."""
        return self.path / "tensorboard"

    def exists(self) -> bool:
        """Whether a run is here."""
        return (self.path / CONFIG).exists()

    def create(self, settings: Settings, parameters: AnyHyperparameters) -> None:
        """Make the folder and write its configuration.

        Raises:
            ConfigurationError: if it holds a run already, or cannot be made.
        """
        if self.exists():
            raise ConfigurationError(
                f"{self.path} holds a run already; continue it with --resume, or choose another --output"
            )
        config = {
            "settings": asdict(settings),
            "robot": described_robot(settings.task().robot),
            "hyperparameters": to_json(parameters),
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": versions(),
            "commit": commit(),
            "commands": [],
        }
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            write_json(self.path / CONFIG, config)
        except OSError as error:
            raise ConfigurationError(f"the run's folder {self.path} cannot be written: {error}") from None

    def note_command(self, command: list[str], parameters: AnyHyperparameters | None = None) -> None:
        """Add a command line to the configuration, with the hyperparameters that it changed."""
        config = self.config()
        config["commands"].append(command)
        if parameters is not None:
            config["hyperparameters"] = to_json(parameters)
        write_json(self.path / CONFIG, config)

    def config(self) -> dict[str, Any]:
        """The configuration that `create` wrote.

        Raises:
            ConfigurationError: if there is no run here, or its configuration is damaged.
        """
        try:
            config = read_object(self.path / CONFIG)
        except FileNotFoundError:
            if self.path.exists():
                raise ConfigurationError(f"{self.path} holds no run: there is no {CONFIG}") from None
            runs = [each.parent.name for each in sorted(self.path.parent.glob(f"*/{CONFIG}"))]
            raise no_path("run's folder", self.path, runs) from None
        except (OSError, ValueError) as error:
            raise ConfigurationError(f"{self.path / CONFIG} cannot be read: {error}") from None
        if not {"settings", "robot", "hyperparameters", "commands"} <= config.keys():
            raise ConfigurationError(f"{self.path / CONFIG} is not the configuration of a run")
        return config

    def restore(self) -> tuple[Settings, AnyHyperparameters]:
        """Settings and hyperparameters of the run that is here.

        Raises:
            ConfigurationError: as in `config`, or if the robot's description has changed since the run began.
        """
        config = self.config()
        given: Mapping[str, Any] = config["settings"]
        names = {field.name for field in fields(Settings)}
        if not isinstance(given, dict) or set(given) != names:
            raise ConfigurationError(f"{self.path / CONFIG}: settings must be {sorted(names)}")
        settings = Settings(**given)
        refuse_other_robot(str(self.path), config["robot"], settings.task().robot)
        return settings, from_json(settings.algorithm, config["hyperparameters"])

    def checkpoint(self) -> dict[str, Any] | None:
        """The last checkpoint, or None if there is none yet."""
        from agents.learning.runs.nested_npz import load_nested  # torch takes seconds to import

        path = self.path / CHECKPOINT
        return load_nested(path) if path.exists() else None

    def write_checkpoint(self, state: dict[str, Any]) -> None:
        """Replace the checkpoint."""
        from agents.learning.runs.nested_npz import save_nested

        save_nested(self.path / CHECKPOINT, state)

    def write_validation(self, history: list[dict[str, Any]]) -> None:
        """Replace the table of validations."""
        write_json(self.path / VALIDATION, history)

    def summary(self) -> dict[str, Any] | None:
        """Summary of a finished run, None if it has not finished."""
        path = self.path / SUMMARY
        return read_object(path) if path.exists() else None

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Mark the run as finished."""
        write_json(self.path / SUMMARY, summary)


def command_line() -> list[str]:
    """Words of the command as it was typed, with the program's name alone."""
    return [Path(sys.argv[0]).name, *sys.argv[1:]]
