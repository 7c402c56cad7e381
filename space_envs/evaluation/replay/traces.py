"""Traces: how the first episodes of a policy went in time, stored as npz without pickles."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Self

import numpy as np

from space_envs.dynamics.rotations import logarithm
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.rollout import Rollout
from space_envs.system.files import atomic_write
from space_envs.system.reading import read_arrays
from space_envs.tasks.base import CaptureTask

TRACED = 30  # episodes of a policy whose course in time is kept

# Shape of each array in terms of K episodes, T steps and n joints.
_SHAPES: dict[str, tuple[str | int, ...]] = {
    "time": ("T+1",),
    "length": ("K",),
    "attitude": ("K", "T+1"),
    "base_rotation": ("K", "T+1", 3),
    "base_position": ("K", "T+1", 3),
    "position_error": ("K", "T+1"),
    "orientation_error": ("K", "T+1"),
    "joint_position": ("K", "T+1", "n"),
}


@dataclass(frozen=True)
class Traces:
    """Arrays over K episodes of T steps; an episode that ended early repeats its last value to the end.

    Every number is finite. Building one checks shapes and values and raises ConfigurationError.
    """

    time: np.ndarray  # (T+1,) s
    length: np.ndarray  # (K,) steps done before the end of each episode, 0 to T
    attitude: np.ndarray  # (K, T+1) deg, angle of the base from where it started
    base_rotation: np.ndarray  # (K, T+1, 3) deg, rotation vector from the start, inertial frame
    base_position: np.ndarray  # (K, T+1, 3) m, from the start, inertial frame
    position_error: np.ndarray  # (K, T+1) m
    orientation_error: np.ndarray  # (K, T+1) deg
    joint_position: np.ndarray  # (K, T+1, n) rad

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name, shape in _SHAPES.items():
            array = np.asarray(getattr(self, name))
            if array.dtype.kind not in "iuf":
                raise ConfigurationError(f"traces: {name} must hold real numbers, got {array.dtype}")
            array = np.array(array, dtype=np.int64 if name == "length" else np.float64)
            array.setflags(write=False)
            object.__setattr__(self, name, array)
            # The first array with a letter fixes it; all later ones must agree.
            expected = (
                tuple(
                    axis if isinstance(axis, int) else sizes.setdefault(axis, got)
                    for axis, got in zip(shape, array.shape, strict=True)
                )
                if array.ndim == len(shape)
                else shape
            )
            if array.shape != expected:
                raise ConfigurationError(f"traces: {name} must have shape {expected}, got {array.shape}")
            if not np.all(np.isfinite(array)):
                raise ConfigurationError(f"traces: {name} holds NaN or infinity")
        if sizes["T+1"] < 1 or np.any(self.length < 0) or np.any(self.length >= sizes["T+1"]):
            raise ConfigurationError(f"traces: length must lie in 0..{sizes['T+1'] - 1}, got {self.length}")

    @property
    def episodes(self) -> int:
        """K, the number of episodes."""
        return len(self.length)

    def save(self, path: str | Path) -> None:
        """Write an npz file, whole or not at all; equal traces give equal bytes."""
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, **{item.name: getattr(self, item.name) for item in fields(self)})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises ConfigurationError that names the file; never unpickles anything."""
        try:
            arrays = read_arrays(path)
            if set(arrays) != set(_SHAPES):
                raise ConfigurationError(f"holds {sorted(arrays)}, expected {sorted(_SHAPES)}")
            return cls(**arrays)
        except (OSError, ConfigurationError) as error:
            raise ConfigurationError(f"{path}: not a file of traces: {error}") from error


def episode_traces(rollout: Rollout, task: CaptureTask) -> Traces:
    """The course of the first episodes in time."""
    k = slice(0, TRACED)
    position = rollout.qpos[k, :, :3]
    return Traces(
        time=task.control_period * np.arange(rollout.qpos.shape[1]),
        length=rollout.length[k],
        attitude=rollout.attitude[k],
        base_rotation=np.rad2deg(logarithm(rollout.qpos[k, :, 3:7])),
        base_position=position - position[:, :1],
        position_error=rollout.position_error[k],
        orientation_error=rollout.orientation_error[k],
        joint_position=rollout.qpos[k, :, 7:],
    )
