"""Training runs of a second or two, for the tests of everything that happens to a run."""

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from agents.learning.progress import Progress
from agents.learning.runs.defaults import default_hyperparameters
from agents.learning.runs.folder import RunFolder
from agents.learning.runs.hyperparameters import ALGORITHMS, CONTRIB, AnyHyperparameters
from agents.learning.runs.settings import Settings
from agents.learning.training import learn
from space_envs.registration import make_task

ENV_ID = "SpaceCapture/SingleArm-v0"
QUICK = ("--validation-episodes", "2", "--quiet")
_OFF_POLICY = {
    "num_envs": 4,
    "steps": 400,
    "validation_interval": 200,
    "learning_starts": 100,
    "gradient_steps": 2,
}
SMALL: dict[str, dict[str, Any]] = {
    "ppo": {
        "num_envs": 8,
        "steps": 512,
        "validation_interval": 256,
        "n_steps": 16,
        "critic_warm_up": 128,
        "expert": "gjm",
    },
    **dict.fromkeys(("sac", "td3", "tqc", "crossq"), _OFF_POLICY),
    "planner": {
        "goals": 64,
        "num_envs": 64,
        "steps": 4 * 64,
        "validation_interval": 2 * 64,
        "reuse": 2,
    },
    "bc": {
        "num_envs": 16,
        "steps": 4 * 320,
        "validation_interval": 2 * 320,
        "episode_steps": 20,
        "last_epochs": 4,
        "expert": "gjm",
    },
}


def installed_algorithms() -> dict[str, type[AnyHyperparameters]]:
    """Hyperparameters of the algorithms whose packages are installed, by name."""
    here = find_spec("sb3_contrib") is not None
    return {name: kind for name, kind in ALGORITHMS.items() if here or name not in CONTRIB}


def defaults(algorithm: str, env_id: str = ENV_ID, **changes: Any) -> AnyHyperparameters:
    """Hyperparameters of an id, with changes."""
    return default_hyperparameters(env_id, algorithm, make_task(env_id, {}).layout, changes)


def small(algorithm: str, **changes: Any) -> AnyHyperparameters:
    """Hyperparameters of a run of a second or two."""
    return defaults(algorithm, **{"hidden": (16, 16), "batch_size": 64, **SMALL[algorithm], **changes})


def begin(path: Path, algorithm: str, **changes: Any) -> RunFolder:
    """The folder of a small run; changes are of settings or of hyperparameters."""
    names = ("seed", "init", "difficulty", "env_kwargs")
    settings = {name: changes.pop(name) for name in names if name in changes}
    folder = RunFolder(path)
    folder.create(Settings(algorithm, ENV_ID, **settings), small(algorithm, **changes))
    return folder


def run(folder: RunFolder) -> dict[str, Any]:
    """Train to the end; the summary."""
    return learn(folder, episodes=4, quiet=True)


def interrupt(folder: RunFolder, monkeypatch: pytest.MonkeyPatch, after: int = 1) -> dict[str, Any]:
    """Train to the first checkpoint after `after` steps, then as if Ctrl-C had been pressed."""
    write: Callable[..., Any] = Progress.checkpoint

    def interrupted(progress: Progress, steps: int, *arguments: Any, **keywords: Any) -> None:
        write(progress, steps, *arguments, **keywords)
        if steps >= after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Progress, "checkpoint", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(folder)
    return folder.checkpoint() or {}


def history(folder: RunFolder) -> list[dict[str, Any]]:
    """Validations of a run without their times."""
    rows = (folder.checkpoint() or {})["history"]
    return [{name: value for name, value in row.items() if name != "wall_s"} for row in rows]


def same(a: Any, b: Any) -> bool:
    """Whether two trees are equal to the bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return np.array_equal(a, b)
