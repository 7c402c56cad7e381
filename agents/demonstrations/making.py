"""Demonstrations as files: made in parallel, resumable, checked; and the ProMP prior learned from them.

python -m agents.demonstrations.making --count 540 --output demonstrations --jobs 2 --seed 0 --fit prior.npz
"""

import argparse
import hashlib
import json
import platform
import sys
from collections.abc import Sequence
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from agents.demonstrations.demonstrator import Demonstrations, demonstrate
from agents.demonstrations.variations import BANDS, DemonstratorConfig
from promp import ProMP
from promp.storage import checksum
from space_envs.system.command_line import Parser, check_replaceable, exit_status, output_path
from space_envs.errors import ConfigurationError
from space_envs.system.parallel import here
from space_envs.system.files import atomic_write, atomic_write_text
from space_envs.system.output import held
from space_envs.system.reading import parse_json, read_arrays
from space_envs.tasks.common import DIFFICULTIES

FORMAT = "space-capture-demonstrations"
VERSION = 1
CHUNK = 60  # demonstrations a file of partial results
COUNT = 540  # as many as make the shipped prior
# rad, of every weight. All demonstrations leave home at rest; so much doubt lets a plan start elsewhere.
WEIGHT_NOISE = 1e-3


def save(path: Path, demonstrations: Demonstrations, provenance: dict[str, Any]) -> None:
    """Write an npz without pickles, with a checksum over all of it; a reader sees all of the file or none."""
    content: dict[str, Any] = {
        field.name: getattr(demonstrations, field.name) for field in fields(Demonstrations)
    }
    content["provenance"] = np.array(json.dumps(provenance, sort_keys=True))
    header = {"format": np.array(FORMAT), "version": np.array(VERSION), "sha256": np.array(checksum(content))}
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **header, **content)


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


def recipe(config: DemonstratorConfig, seed: int) -> dict[str, Any]:
    """What determines demonstrations: two files of one recipe belong together."""
    return {"seed": seed, "config": config.as_dict()}


def provenance(config: DemonstratorConfig, seed: int, count: int) -> dict[str, Any]:
    """The recipe, the command that repeats it and what it ran on."""
    command = (
        f"python -m agents.demonstrations.making --count {count} --seed {seed} --difficulty {config.difficulty}"
    )
    if config.bands != DemonstratorConfig().bands:
        command += f" --bands {config.bands}"
    versions = {"python": platform.python_version()} | {
        name: version(name) for name in ("numpy", "scipy", "mujoco")
    }
    return recipe(config, seed) | {"command": command, "versions": versions}


def generate(
    output: str | Path,
    count: int = COUNT,
    seed: int = 0,
    config: DemonstratorConfig | None = None,
    jobs: int = 1,
    resume: bool = True,
    progress: bool = False,
) -> Demonstrations:
    """Make `count` demonstrations into the folder `output`, and demonstrations.npz of all of them.

    Each is determined by its number, the seed and the config, whatever `jobs` and however often interrupted.

    Args:
        jobs: processes. resume: keep the parts that are there. progress: show a bar.

    Raises:
        ConfigurationError: for a count, seed or jobs that is not valid, or if `resume` meets a part that is
            damaged or of another recipe.
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
    missing = [path for path in parts if not (resume and _belongs(path, config, seed))]
    work = (delayed(_make_part)(path, config, seed, *parts[path]) for path in missing)
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
    save(folder / "demonstrations.npz", merged, provenance(config, seed, count))
    return merged


def fit_prior(demonstrations: Demonstrations) -> ProMP:
    """The ProMP of eq. 16 and 17; every demonstration's weights meet its first and last state exactly."""
    return ProMP.fit(
        demonstrations.position,
        demonstrations.velocity,
        duration=float(demonstrations.time[-1]),
        exact_ends=True,
        weight_noise=WEIGHT_NOISE,
    )


def save_prior(path: str | Path, prior: ProMP, origin: dict[str, Any]) -> None:
    """Write a prior to `path` and where it is from to the same name with suffix .json."""
    path = Path(path)
    prior.save(path)
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    origin = origin | {"file": path.name, "sha256": digest, "weight_noise": WEIGHT_NOISE}
    atomic_write_text(path.with_suffix(".json"), json.dumps(origin, indent=2, sort_keys=True) + "\n")


def _belongs(path: Path, config: DemonstratorConfig, seed: int) -> bool:
    """Whether a part is there already."""
    if not path.exists():
        return False
    found = load(path)[1]
    if {key: found.get(key) for key in ("seed", "config")} != recipe(config, seed):
        raise ConfigurationError(
            f"{path}: made from another seed or config; take another folder or do not resume"
        )
    return True


def _make_part(path: Path, config: DemonstratorConfig, seed: int, first: int, size: int) -> int:
    with threadpool_limits(1):  # several threads of BLAS give other bits
        made = demonstrate(config, seed, first, size)
    save(path, made, provenance(config, seed, first + size))
    return size


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit status."""
    parser = Parser(
        prog="python -m agents.demonstrations.making",
        description="Make demonstrations and learn a ProMP prior from them.",
    )
    parser.add_argument("--count", type=int, default=COUNT, help="how many (default %(default)s)")
    parser.add_argument(
        "--output", type=output_path, default=Path("demonstrations"), help="folder (default %(default)s)"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="default %(default)s")
    parser.add_argument("--difficulty", choices=DIFFICULTIES, default="medium", help="of the goals")
    what = "space of the elastic bands' obstacles: the paper's is task; the shipped prior has %(default)s"
    parser.add_argument("--bands", choices=BANDS, default=DemonstratorConfig().bands, help=what)
    parser.add_argument(
        "--resume", action=argparse.BooleanOptionalAction, default=True, help="keep what is there"
    )
    parser.add_argument(
        "--fit", type=output_path, metavar="PATH", help="write the ProMP prior there (npz, and json beside)"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace the prior that is there")
    goes_on = "stopped; the same command goes on from here"
    return exit_status("python -m agents.demonstrations.making", lambda: _run(parser.parse_args(arguments)), goes_on)


def _run(options: argparse.Namespace) -> None:
    config = DemonstratorConfig(difficulty=options.difficulty, bands=options.bands)
    if options.fit is not None:
        for path in (options.fit, options.fit.with_suffix(".json")):
            check_replaceable(path, options.overwrite)
    with held(options.output, "demonstrations"):
        made = generate(
            options.output, options.count, options.seed, config, options.jobs, options.resume, True
        )
    if options.fit is not None:
        save_prior(options.fit, fit_prior(made), provenance(config, options.seed, options.count))
    print(f"{len(made.kind)} demonstrations in {options.output / 'demonstrations.npz'}")
    print(f"{made.attempt.sum()} drawings were not fit to learn from and were drawn anew")
    print(f"mean eq. 20 cost: {1e4 * made.cost.mean():.1f} cm^2/s (c = 1 m/rad)")
    if options.fit is not None:
        print(f"prior in {options.fit}")


if __name__ == "__main__":
    sys.exit(main())
