"""A training run: its settings, its folder and its budget."""

import json
import platform
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from agents.learning.hyperparameters import AnyHyperparameters, from_json, to_json
from agents.policies.learned.learned_policy import POLICY_FILE
from space_envs.errors import ConfigurationError, no_path
from space_envs.system.files import atomic_write_text
from space_envs.system.reading import read_object

CONFIG, CHECKPOINT, VALIDATION, SUMMARY = "config.json", "checkpoint.npz", "validation.json", "summary.json"
_PACKAGES = ("gymnasium", "mujoco", "numpy", "stable-baselines3", "torch")


@dataclass(frozen=True)
class Settings:
    """What is trained, apart from hyperparameters.

    Attributes:
        algorithm: ppo, sac, td3 or bc. env_id: registered id.
        control_mode, difficulty: of the environment. seed: of everything random. device: of torch.
        init: folder of a run or policy file that ppo starts from; None is none.
    """

    algorithm: str
    env_id: str
    control_mode: str = "joint_velocity"
    difficulty: str = "medium"
    seed: int = 0
    device: str = "cpu"
    init: str | None = None

    @property
    def environment(self) -> dict[str, Any]:
        """Keywords of the environment."""
        return {"control_mode": self.control_mode, "difficulty": self.difficulty}


@dataclass(frozen=True)
class RunFolder:
    """Where a run keeps its files; each is written whole or not at all."""

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

    def begin(self, settings: Settings, parameters: AnyHyperparameters) -> None:
        """Make the folder and write down what is run.

        Raises:
            ConfigurationError: if it holds a run already, or cannot be made.
        """
        if self.exists():
            raise ConfigurationError(
                f"{self.path} holds a run already; continue it with --resume, or choose another --output"
            )
        config = {
            "settings": asdict(settings),
            "hyperparameters": to_json(parameters),
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "versions": versions(),
            "commit": commit(),
            "commands": [],
        }
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._write(CONFIG, config)
        except OSError as error:
            raise ConfigurationError(f"the run's folder {self.path} cannot be written: {error}") from None

    def note_command(self, command: list[str], parameters: AnyHyperparameters | None = None) -> None:
        """Add a command line to the configuration, with the hyperparameters it changed."""
        config = self.config()
        config["commands"].append(command)
        if parameters is not None:
            config["hyperparameters"] = to_json(parameters)
        self._write(CONFIG, config)

    def config(self) -> dict[str, Any]:
        """What `begin` wrote.

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
        if not {"settings", "hyperparameters", "commands"} <= config.keys():
            raise ConfigurationError(f"{self.path / CONFIG} is not the configuration of a run")
        return config

    def restore(self) -> tuple[Settings, AnyHyperparameters]:
        """Settings and hyperparameters of the run that is here; errors as in `config`."""
        config = self.config()
        given: Mapping[str, Any] = config["settings"]
        names = {f.name for f in fields(Settings)}
        if not isinstance(given, dict) or set(given) != names:
            raise ConfigurationError(f"{self.path / CONFIG}: settings must be {sorted(names)}")
        settings = Settings(**given)
        return settings, from_json(settings.algorithm, config["hyperparameters"])

    def checkpoint(self) -> dict[str, Any] | None:
        """The last checkpoint, or None if there is none yet."""
        from agents.learning.trees import load_tree  # torch takes seconds to import

        path = self.path / CHECKPOINT
        return load_tree(path) if path.exists() else None

    def write_checkpoint(self, state: dict[str, Any]) -> None:
        """Replace the checkpoint."""
        from agents.learning.trees import save_tree

        save_tree(self.path / CHECKPOINT, state)

    def write_validation(self, history: list[dict[str, Any]]) -> None:
        """Replace the table of validations."""
        self._write(VALIDATION, history)

    def summary(self) -> dict[str, Any] | None:
        """What a finished run ended with, or None if it has not finished."""
        path = self.path / SUMMARY
        return read_object(path) if path.exists() else None

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Mark the run as finished."""
        self._write(SUMMARY, summary)

    def _write(self, name: str, value: Any) -> None:
        atomic_write_text(self.path / name, json.dumps(value, indent=2) + "\n")


@dataclass
class Budget:
    """Wall and processor time that a run has used, over all its sittings.

    Attributes:
        limit: s of wall time, None without limit. used, used_cpu: s in earlier sittings.
    """

    limit: float | None = None
    used: float = 0.0
    used_cpu: float = 0.0
    _start: float = field(default_factory=time.perf_counter)
    _start_cpu: float = field(default_factory=time.process_time)

    @property
    def wall(self) -> float:
        """Wall time, s."""
        return self.used + time.perf_counter() - self._start

    @property
    def cpu(self) -> float:
        """Processor time of all threads, s."""
        return self.used_cpu + time.process_time() - self._start_cpu

    @property
    def exhausted(self) -> bool:
        """Whether the limit is reached."""
        return self.limit is not None and self.wall >= self.limit

    def fraction(self, since: float) -> float:
        """Share used of the wall time that was left at `since` s."""
        if self.limit is None:
            return 0.0
        return min((self.wall - since) / max(self.limit - since, 1e-9), 1.0)


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that results depend on."""
    found = {"python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def commit() -> str | None:
    """The checkout's git commit, None outside of one."""
    try:
        result = subprocess.run(
            ["git", "rev-parse", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            timeout=10,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return result.stdout.strip() if result.returncode == 0 else None


def command_line() -> list[str]:
    """The command as it was typed, with the program's name alone."""
    return [Path(sys.argv[0]).name, *sys.argv[1:]]
