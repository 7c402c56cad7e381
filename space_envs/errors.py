"""Every exception that users of the suite see, and the hint that names the nearest valid name.

All of them are Gymnasium's `Error`, and where Gymnasium or Python has a class for the case, they are of that
class too, so that clients which know nothing of this suite catch what they expect.
"""

import difflib
import math
import numbers
from collections.abc import Iterable
from pathlib import Path

from gymnasium import error

_SHOWN = 100  # characters of a value in a message


class SpaceEnvsError(error.Error):
    """Base of all errors raised on purpose by this suite."""


class ConfigurationError(SpaceEnvsError, ValueError):
    """A keyword, option, name or file content is not one that the suite knows or accepts."""


class UnknownKeywordError(ConfigurationError, TypeError):
    """A keyword that the environment does not have."""


class UnknownIdError(ConfigurationError, error.UnregisteredEnv):
    """An environment id that is not registered."""


class ResetNeededError(ConfigurationError, error.ResetNeeded):
    """An environment was stepped or drawn before its first reset."""


class ActionError(SpaceEnvsError, ValueError, error.InvalidAction):
    """An action has the wrong shape or type, or holds NaN or infinity."""


class GoalError(SpaceEnvsError, ValueError):
    """A goal is malformed or cannot be reached by the robot from any configuration."""


class RenderingError(SpaceEnvsError, RuntimeError):
    """A picture was asked for on a machine that cannot draw one."""


class PlanningError(SpaceEnvsError, RuntimeError):
    """A planner found no plan; the message says why."""


class PolicyError(SpaceEnvsError, RuntimeError):
    """A policy could not be loaded, or returned something that is not an action."""


def shown(value: object) -> str:
    """A value as it stands in a message: its `repr`, cut where it is long, or its type if it has none."""
    try:
        text = repr(value)
    except Exception:  # of an untrusted class, or an integer of thousands of digits
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}..."


def positive(name: str, value: object, largest: float | None = None) -> float:
    """`value` as a float, if it is a finite positive number of at most `largest`.

    Raises:
        ConfigurationError: naming what was got.
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
        ConfigurationError: naming what was got.
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
    """Build the error for an unknown name: what was got, what is valid, and the nearest valid name."""
    return ConfigurationError(f"unknown {kind} {shown(got)}; {_hint(got, valid)}")


def unknown_keyword(got: str, valid: Iterable[str]) -> UnknownKeywordError:
    """Build the error for a keyword that there is not, in Python's words, with the nearest that there is."""
    return UnknownKeywordError(f"got an unexpected keyword argument {shown(got)}; {_hint(got, valid)}")


def unknown_id(got: object, valid: Iterable[str]) -> UnknownIdError:
    """Build the error for an environment id that there is not."""
    hint = f"{_hint(got, valid)} One that another package registers is named as module:id."
    return UnknownIdError(f"unknown environment id {shown(got)}; {hint}")


def no_path(kind: str, path: Path, beside: Iterable[str]) -> ConfigurationError:
    """Build the error for a path that there is not, with the nearest of the names that would do beside it."""
    near = difflib.get_close_matches(path.name, list(beside), n=1)
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
