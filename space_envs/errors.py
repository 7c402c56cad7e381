"""Every exception that users of the suite see, and the hint that names the nearest valid name."""

import difflib
from collections.abc import Iterable


class SpaceEnvsError(Exception):
    """Base of all errors raised on purpose by this suite."""


class ConfigurationError(SpaceEnvsError, ValueError):
    """A keyword, option, name or file content is not one that the suite knows or accepts."""


class ActionError(SpaceEnvsError, ValueError):
    """An action has the wrong shape or type, or holds NaN or infinity."""


class GoalError(SpaceEnvsError, ValueError):
    """A goal is malformed or cannot be reached by the robot from any configuration."""


class RenderingError(SpaceEnvsError, RuntimeError):
    """A picture was asked for on a machine that cannot draw one."""


class PlanningError(SpaceEnvsError, RuntimeError):
    """A planner found no plan; the message says why."""


class PolicyError(SpaceEnvsError, RuntimeError):
    """A policy could not be loaded, or returned something that is not an action."""


def positive(name: str, value: object) -> float:
    """`value` as a float, if it is a finite positive number.

    Raises:
        ConfigurationError: naming what was got.
    """
    number = isinstance(value, int | float) or (hasattr(value, "dtype") and getattr(value, "ndim", 1) == 0)
    if not number or isinstance(value, bool) or not 0 < float(value) < float("inf"):  # type: ignore[arg-type]
        raise ConfigurationError(f"{name} must be a finite positive number, got {value!r}")
    return float(value)  # type: ignore[arg-type]


def positive_integer(name: str, value: object, largest: int | None = None) -> int:
    """`value` as an int, if it is a whole number from 1 to `largest`.

    Raises:
        ConfigurationError: naming what was got.
    """
    whole = isinstance(value, int) or type(value).__module__ == "numpy" and hasattr(value, "__index__")
    if isinstance(value, bool) or not whole or not 1 <= int(value) <= (largest or int(value)):  # type: ignore[arg-type, call-overload]
        limit = "" if largest is None else f" of at most {largest}"
        raise ConfigurationError(f"{name} must be a positive integer{limit}, got {value!r}")
    return int(value)  # type: ignore[arg-type, call-overload]


def unknown_name(kind: str, got: object, valid: Iterable[str]) -> ConfigurationError:
    """Build the error for an unknown name: what was got, what is valid, and the nearest valid name."""
    names = list(valid)
    close = difflib.get_close_matches(str(got), names, n=1, cutoff=0.5)
    hint = f" Did you mean {close[0]!r}?" if close else ""
    return ConfigurationError(f"unknown {kind} {got!r}; valid are {', '.join(map(repr, names))}.{hint}")
