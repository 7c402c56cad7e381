"""Exceptions of the suite, and error messages with the nearest valid name.

All are subclasses of Gymnasium's `Error` and, where Gymnasium or Python has a class for the case, of that
class too, so that generic clients catch what they expect.
"""

import difflib
import math
import numbers
from collections.abc import Iterable
from pathlib import Path

from gymnasium import error

_SHOWN = 100  # characters of a value in a message


class SpaceEnvsError(error.Error):
    """Base class of the errors of this suite."""


class ConfigurationError(SpaceEnvsError, ValueError):
    """A keyword, option, name or file content is unknown or invalid."""


class UnknownKeywordError(ConfigurationError, TypeError):
    """A keyword that the environment does not have."""


class UnknownIdError(ConfigurationError, error.UnregisteredEnv):
    """An environment id that is not registered."""


class UnfitRobotError(ConfigurationError):
    """A robot that does not fit a task; its arguments are the task's name and what it needs."""

    def __str__(self) -> str:
        return " ".join(self.args)


class ResetNeededError(ConfigurationError, error.ResetNeeded):
    """An environment was stepped or drawn before its first reset."""


class ActionError(SpaceEnvsError, ValueError, error.InvalidAction):
    """An action has the wrong shape or type, or holds NaN or infinity."""


class GoalError(SpaceEnvsError, ValueError):
    """A goal is malformed or cannot be reached by the robot from any configuration."""


class RenderingError(SpaceEnvsError, RuntimeError):
    """This machine cannot render images."""


class PlanningError(SpaceEnvsError, RuntimeError):
    """A planner found no plan; the message has the reason."""


class PolicyError(SpaceEnvsError, RuntimeError):
    """A policy could not be loaded, or returned something that is not an action."""


def shown(value: object) -> str:
    """Text of a value for a message: its `repr`, shortened, or its type if that fails."""
    try:
        text = repr(value)
    except Exception:  # of an untrusted class, or an integer of thousands of digits
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def positive(name: str, value: object, largest: float | None = None) -> float:
    """`value` as a float, if it is a finite positive number of at most `largest`.

    Raises:
        ConfigurationError: with the value that was given.
    """
    number = _scalar(value)
    try:
        number = float(number) if isinstance(number, numbers.Real) else math.nan
    except OverflowError:
        number = math.inf
    if not 0 < number < math.inf or largest is not None and number > largest:
        limit = "" if largest is None else f" of at most {largest:g}"
        raise ConfigurationError(f"{name} must be a finite positive number{limit}, got {shown(value)}")
    return number


def positive_integer(name: str, value: object, largest: int | None = None) -> int:
    """`value` as an int, if it is a whole number from 1 to `largest`.

    Raises:
        ConfigurationError: with the value that was given.
    """
    number = _scalar(value)
    if not isinstance(number, numbers.Integral) or not 1 <= int(number) <= (largest or int(number)):
        limit = "" if largest is None else f" of at most {largest}"
        raise ConfigurationError(f"{name} must be a positive integer{limit}, got {shown(value)}")
    return int(number)


def _scalar(value: object) -> object:
    """`value`, or what an array without axes holds; None for a boolean."""
    if getattr(value, "ndim", None) == 0 and hasattr(value, "item"):
        value = value.item()  # type: ignore[attr-defined]
    return None if isinstance(value, bool) else value


def unknown_name(kind: str, got: object, valid: Iterable[str]) -> ConfigurationError:
    """Error for an unknown name, with the valid names and the nearest one."""
    return ConfigurationError(f"unknown {kind} {shown(got)}; {_hint(got, valid)}")


def unknown_keyword(got: str, valid: Iterable[str]) -> UnknownKeywordError:
    """Error for an unknown keyword, in Python's wording, with the nearest valid one."""
    return UnknownKeywordError(f"got an unexpected keyword argument {shown(got)}; {_hint(got, valid)}")


def unknown_id(got: object, valid: Iterable[str]) -> UnknownIdError:
    """Error for an unknown environment id."""
    hint = f"{_hint(got, valid)} One that another package registers is named as module:id."
    return UnknownIdError(f"unknown environment id {shown(got)}; {hint}")


def no_path(kind: str, path: Path, names: Iterable[str]) -> ConfigurationError:
    """Error for a path that does not exist, with the nearest of the valid names in its folder."""
    near = difflib.get_close_matches(path.name, list(names), n=1)
    hint = f" Did you mean {str(path.parent / near[0])!r}?" if near else ""
    return ConfigurationError(f"there is no {kind} {str(path)!r}.{hint}")


def _hint(got: object, valid: Iterable[str]) -> str:
    names = list(valid)
    text = got[:_SHOWN] if isinstance(got, str) else shown(got)
    close = difflib.get_close_matches(text, names, n=1, cutoff=0.5)
    if not close and len(text) > 2:
        close = [name for name in names if text.lower() in name.lower()][:1]
    hint = f" Did you mean {close[0]!r}?" if close else ""
    return f"valid are {', '.join(map(repr, names))}.{hint}"
