"""Limits on the number of episodes in a batch, by this machine's memory."""

import os

from space_envs.errors import ConfigurationError, positive_integer
from space_envs.tasks.base import CaptureTask

MAX_ENVS = 2**20
_FIXED = 4096  # bytes per episode besides its arrays: generator, goal
_MATRICES = 10  # per episode, of the size of the mass matrix
_VECTORS = 10  # per episode, of the size of the observation


def needed_bytes(num_envs: int, task: CaptureTask) -> int:
    """Upper estimate of the memory of episodes of a task, bytes."""
    return num_envs * (8 * (_MATRICES * task.model.nv**2 + _VECTORS * task.layout.size) + _FIXED)


def checked_num_envs(num_envs: int, task: CaptureTask) -> int:
    """Validated number of episodes that fits into this machine's memory.

    Raises:
        ConfigurationError: if not; the message says how many fit.
    """
    num_envs = positive_integer("num_envs", num_envs, largest=MAX_ENVS)
    if not hasattr(os, "sysconf"):
        return num_envs
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    needed = needed_bytes(num_envs, task)
    if needed > memory:
        raise ConfigurationError(
            f"num_envs={num_envs} would take about {needed / 1e9:.0f} GB, and this machine "
            f"has {memory / 1e9:.0f} GB: at most {memory // needed_bytes(1, task)} fit"
        )
    return num_envs
