"""`python -m space_envs.tasks.goals.freeze`: find the reachable draws of the goals.

A maintainer runs it when the robots or the ranges of their goals change. The numbers of the draws are stored,
so that no motion has to be simulated before an episode starts.
"""

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from tqdm import tqdm

from space_envs.system.command_line import Parser
from space_envs.system.files import atomic_write
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.dual_arm import SPLIT_SIZE
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.dual_arm_spatial import DualArmSpatialTask
from space_envs.tasks.goals.detours import find_draws
from space_envs.tasks.goals.tumbling import TumblingTargetTask, find_attempts
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.tasks.single_arm_cluttered import CLUTTERED_SPLIT_SIZE

FOLDER = Path(__file__).parents[1]
KINDS: tuple[type[TumblingTargetTask], ...] = (DualArmPlanarTask, DualArmSpatialTask)
SINGLE_ARM_VARIANTS = ("paper", "physical")
Find = Callable[[int], np.ndarray]  # from the number of a block to its draws


def _dual_arm() -> dict[str, tuple[int, Find]]:
    """Size of every split by name, and the function that finds its draws."""
    return {
        f"{kind.kind}_{difficulty}_{split}": (
            SPLIT_SIZE[split],
            partial(find_attempts, kind(difficulty=difficulty), split),
        )
        for kind in KINDS
        for difficulty in DIFFICULTIES
        for split in SPLITS
    }


def _cluttered() -> dict[str, tuple[int, Find]]:
    return {
        f"{variant}_{difficulty}_{split}": (
            CLUTTERED_SPLIT_SIZE[split],
            partial(find_draws, SingleArmTask(variant=variant).robot, difficulty, split),
        )
        for variant in SINGLE_ARM_VARIANTS
        for difficulty in DIFFICULTIES
        for split in SPLITS
    }


FILES = {"dual_arm_attempts": _dual_arm, "single_arm_cluttered_draws": _cluttered}


def main(arguments: list[str] | None = None) -> None:
    """Write the files."""
    parser = Parser(prog="python -m space_envs.tasks.goals.freeze", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(FILES)}; default: all")
    names = parser.parse_args(arguments).names
    for name in names:
        if name not in FILES:
            parser.error(f"there is no file {name!r}")
    for name in names or FILES:
        _write(FOLDER / f"{name}.npz", FILES[name]())


def _write(path: Path, cases: dict[str, tuple[int, Find]]) -> None:
    found: dict[str, np.ndarray] = {}
    with tqdm(total=sum(size // BLOCK for size, _ in cases.values()), unit="block", desc=path.stem) as bar:
        for name, (size, find) in cases.items():
            blocks = []
            for block in range(size // BLOCK):
                blocks.append(find(block))
                bar.update()
            found[name] = np.concatenate(blocks).astype(np.uint16)
    with atomic_write(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, attempts in found.items():
            entry = zipfile.ZipInfo(f"{name}.npy")
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w") as file:
                np.lib.format.write_array(file, attempts, allow_pickle=False)


if __name__ == "__main__":
    main()
