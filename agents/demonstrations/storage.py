"""Files of demonstrations: made in parallel, resumable, checked."""

import json
import platform
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from agents.demonstrations.controller import Demonstrations, demonstrate
from agents.demonstrations.variations import DemonstratorConfig
from agents.planners.common.robot_files import described_robot, refuse_other_robot, robot_options
from promp.storage import checksum
from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Robot
from space_envs.system.files import write_arrays
from space_envs.system.parallel import here
from space_envs.system.reading import parse_json, read_arrays

FORMAT = "space-capture-demonstrations"
VERSION = 1
CHUNK = 60  # demonstrations a file of partial results
COUNT = 540  # of the shipped prior


def save(path: Path, demonstrations: Demonstrations, provenance: dict[str, Any]) -> None:
    """Write an npz without pickles, with a checksum over all of it; a reader sees all of the file or none."""
    content: dict[str, Any] = {
        field.name: getattr(demonstrations, field.name) for field in fields(Demonstrations)
    }
    content["provenance"] = np.array(json.dumps(provenance, sort_keys=True))
    header = {"format": np.array(FORMAT), "version": np.array(VERSION), "sha256": np.array(checksum(content))}
    write_arrays(path, {**header, **content})


def load(path: str | Path) -> tuple[Demonstrations, dict[str, Any]]:
    """Demonstrations and provenance from a file that `save` wrote.

    Raises:
        ConfigurationError: if it is not whole, was changed, or is of another format.
    """
    names = [field.name for field in fields(Demonstrations)]
    try:
        stored = read_arrays(path)
    except ConfigurationError as error:
        raise ConfigurationError(
            f"{path}: not a file of demonstrations, or a damaged one: {error}"
        ) from error
    kind, number, claimed = (str(stored.pop(name, None)) for name in ("format", "version", "sha256"))
    if (kind, number) != (FORMAT, str(VERSION)):
        raise ConfigurationError(f"{path}: expected {FORMAT} version {VERSION}, got {kind} version {number}")
    if set(stored) != {*names, "provenance"}:
        raise ConfigurationError(f"{path}: expected the arrays {names}, got {sorted(stored)}")
    if checksum(stored) != claimed:
        raise ConfigurationError(
            f"{path}: its content does not match its checksum; it was changed or damaged. Delete it, and the "
            "same command makes it again"
        )
    try:
        provenance = parse_json(str(stored["provenance"]))
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: its provenance is {error}") from None
    if not isinstance(provenance, dict):
        raise ConfigurationError(f"{path}: its provenance must be an object, got {provenance!r}")
    return Demonstrations(*[stored[name] for name in names]), provenance


def recipe(robot: Robot, config: DemonstratorConfig, seed: int) -> dict[str, Any]:
    """Values that determine demonstrations: two files of one recipe belong together."""
    return {"robot": described_robot(robot), "seed": seed, "config": config.as_dict()}


def provenance(robot: Robot, config: DemonstratorConfig, seed: int, count: int) -> dict[str, Any]:
    """The recipe, the command that repeats it and the versions it ran on."""
    command = (
        f"python -m agents.demonstrations {robot_options(robot)} --count {count} --seed {seed} "
        f"--difficulty {config.difficulty}"
    )
    if config.bands != DemonstratorConfig().bands:
        command += f" --bands {config.bands}"
    versions = {"python": platform.python_version()} | {
        name: version(name) for name in ("numpy", "scipy", "mujoco")
    }
    return recipe(robot, config, seed) | {"command": command, "versions": versions}


def generate(
    output: str | Path,
    robot: Robot,
    count: int = COUNT,
    seed: int = 0,
    config: DemonstratorConfig | None = None,
    jobs: int = 1,
    resume: bool = True,
    progress: bool = False,
) -> Demonstrations:
    """Make `count` demonstrations of a robot into the folder `output`, and demonstrations.npz of all of them.

    Each is determined by the robot, its number, the seed and the config, whatever `jobs` and however often
    interrupted.

    Args:
        jobs: processes. resume: keep the parts that are there. progress: show a bar.

    Raises:
        ConfigurationError: for a count, seed or jobs that is not valid, or if `resume` meets a part that is
            damaged, or of another robot or recipe.
        PlanningError: if a demonstration cannot be drawn.
    """
    for name, value, least in (("count", count, 1), ("seed", seed, 0), ("jobs", jobs, 1)):
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise ConfigurationError(f"{name} must be an integer of at least {least}, got {value!r}")
    config = DemonstratorConfig() if config is None else config
    folder = Path(output)
    parts = {
        folder / "parts" / f"{first:06d}-{size:03d}.npz": (first, size)
        for first in range(0, count, CHUNK)
        for size in [min(CHUNK, count - first)]
    }
    missing = [path for path in parts if not (resume and _belongs(path, robot, config, seed))]
    work = (delayed(_make_part)(path, robot, config, seed, *parts[path]) for path in missing)
    with here(), tqdm(total=count, unit="demonstration", disable=not progress) as bar:
        bar.update(count - sum(parts[path][1] for path in missing))
        for made in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
            bar.update(made)
    loaded = [load(path)[0] for path in parts]
    merged = Demonstrations(
        loaded[0].time,
        *[
            np.concatenate([getattr(part, f.name) for part in loaded])
            for f in fields(Demonstrations)
            if f.name != "time"
        ],
    )
    save(folder / "demonstrations.npz", merged, provenance(robot, config, seed, count))
    return merged


def _belongs(path: Path, robot: Robot, config: DemonstratorConfig, seed: int) -> bool:
    """Whether a part is there already."""
    if not path.exists():
        return False
    found = load(path)[1]
    refuse_other_robot(str(path), found.get("robot"), robot)
    expected = recipe(robot, config, seed)
    if any(found.get(key) != expected[key] for key in ("seed", "config")):
        raise ConfigurationError(
            f"{path}: made from another seed or config; take another folder or do not resume"
        )
    return True


def _make_part(path: Path, robot: Robot, config: DemonstratorConfig, seed: int, first: int, size: int) -> int:
    with threadpool_limits(1):  # several threads of BLAS give other bits
        made = demonstrate(robot, config, seed, first, size)
    save(path, made, provenance(robot, config, seed, first + size))
    return size
