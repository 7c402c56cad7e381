"""Measured time steps in the user's cache, by robot."""

from contextlib import suppress
from pathlib import Path

from space_envs.codegen.cache import LibraryError, usable_folder
from space_envs.errors import ConfigurationError, positive
from space_envs.robots.robot import StepLimits
from space_envs.system.digests import text_digest
from space_envs.system.files import write_json
from space_envs.system.provenance import versions
from space_envs.system.reading import read_object

MEASUREMENT = 2  # version of the measurement; what another one stored is ignored


def read_steps(robot: str) -> StepLimits | None:
    """Stored steps of the robot with a digest; None if there are none that can be read."""
    with suppress(OSError, LibraryError, ConfigurationError, KeyError):
        values = read_object(_path(robot))
        return StepLimits(*(positive(name, values[name]) for name in StepLimits._fields))
    return None


def write_steps(robot: str, steps: StepLimits) -> None:
    """Store the steps of the robot with a digest, if the cache can be written."""
    with suppress(OSError, LibraryError):
        write_json(_path(robot), steps._asdict())


def _path(robot: str) -> Path:
    """File of a robot's steps, one for each version of what they depend on."""
    measured_with = f"{MEASUREMENT} {versions()['mujoco']} {versions()['numpy']} {robot}"
    return usable_folder() / "steps" / f"{text_digest(measured_with)}.json"
