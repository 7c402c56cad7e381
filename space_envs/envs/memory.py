"""Whether a batch of episodes fits into this machine, asked before anything is made."""

import os

from space_envs.errors import ConfigurationError
from space_envs.tasks.base import CaptureTask

_FIXED = 4096  # bytes an episode takes apart from its arrays: generator, goal
_MATRICES = 10  # of the size of the mass matrix, an episode
_VECTORS = 10  # of the size of the observation, an episode


def needed(num_envs: int, task: CaptureTask) -> int:
    """Bytes that episodes of a task take, about, from above."""
    return num_envs * (8 * (_MATRICES * task.model.nv**2 + _VECTORS * task.layout.size) + _FIXED)


def check_memory(num_envs: int, task: CaptureTask) -> None:
    """Check that episodes of a task fit into this machine's memory.

    Raises:
        ConfigurationError: if they do not; the message says how many do.
    """
    if not hasattr(os, "sysconf"):
        return
    there = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed(num_envs, task) > there:
        raise ConfigurationError(
            f"num_envs={num_envs} would take about {needed(num_envs, task) / 1e9:.0f} GB, and this machine "
            f"has {there / 1e9:.0f} GB: at most {there // needed(1, task)} fit"
        )
