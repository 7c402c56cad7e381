"""`python -m space_envs.tasks.freeze`: find out which draws of the dual-arm goals can be reached.

A maintainer runs it when the robots or the ranges of their goals change; which draws it found is stored, so
that nobody else has to roll out motions before an episode can start.
"""

import argparse
import zipfile
from pathlib import Path

import numpy as np
from tqdm import tqdm

from space_envs.files import atomic_write
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.dual_arm import SPLIT_SIZE, DualArmTask, find_attempts
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.dual_arm_spatial import DualArmSpatialTask

PATH = Path(__file__).parent / "dual_arm_attempts.npz"
KINDS: tuple[type[DualArmTask], ...] = (DualArmPlanarTask, DualArmSpatialTask)


def main(arguments: list[str] | None = None) -> None:
    """Write the file."""
    argparse.ArgumentParser(prog="python -m space_envs.tasks.freeze", description=__doc__).parse_args(
        arguments
    )
    cases = [(kind, difficulty, split) for kind in KINDS for difficulty in DIFFICULTIES for split in SPLITS]
    found: dict[str, np.ndarray] = {}
    with tqdm(total=sum(SPLIT_SIZE[split] // BLOCK for *_, split in cases), unit="block") as bar:
        for kind, difficulty, split in cases:
            blocks = []
            for block in range(SPLIT_SIZE[split] // BLOCK):
                blocks.append(find_attempts(kind, None, difficulty, split, block))
                bar.update()
            found[f"{kind.kind}_{difficulty}_{split}"] = np.concatenate(blocks).astype(np.uint16)
    with atomic_write(PATH) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, attempts in found.items():
            with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as file:
                np.lib.format.write_array(file, attempts, allow_pickle=False)


if __name__ == "__main__":
    main()
