"""Folders of datasets, and a policy to fill them, for the tests of `evaluate.py dataset`."""

from pathlib import Path

import numpy as np

from agents.commands.dataset import main
from space_envs.registration import ENTRIES

SINGLE, CLUTTERED, PLANAR, SPATIAL = ENTRIES
CHEAP = {SINGLE: "gjm", CLUTTERED: "gjm", PLANAR: "reactionless_rate", SPATIAL: "reactionless_rate"}


class Wild:
    """Asks for more than there is, and writes into what it is given."""

    def __init__(self, context, seed=0):
        self.size = len(context.action_scale)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        action = np.tile(np.linspace(-3.0, 0.1, self.size), (len(observation), 1)) + observation[:, :1]
        observation[:] = 0.0
        return action, state


def folder(root: Path, env_id: str = SINGLE, policy: str = "gjm") -> Path:
    return root / "space-capture" / env_id.split("/")[1] / f"{policy}-medium-train-v0"


def run(root: Path, *words: str, jobs: str = "1") -> int:
    return main([*words, "--jobs", jobs, "--output", str(root)])


def contents(root: Path) -> dict[str, bytes]:
    return {
        path.relative_to(root).as_posix(): path.read_bytes()
        for path in sorted(root.rglob("*"))
        if path.is_file() and "/data/" not in path.as_posix()
    }
