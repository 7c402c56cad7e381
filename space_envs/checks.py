"""Validation of values at public boundaries: numbers, flags and arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError, shown


def number(name: str, value: object) -> float:
    """`value` as a float, if it is a finite real number; text, flags and arrays are none.

    Raises:
        ConfigurationError: with the value that was given.
    """
    if not isinstance(value, int | float | np.integer | np.floating) or isinstance(value, bool):
        raise ConfigurationError(f"{name} must be a finite number, got {shown(value)}")
    try:
        result = float(value)
    except OverflowError:
        result = np.inf
    if not np.isfinite(result):
        raise ConfigurationError(f"{name} must be a finite number, got {shown(value)}")
    return result


def non_negative(name: str, value: object) -> float:
    """`value` as a float, if it is a finite number of at least 0; errors as in `number`."""
    result = number(name, value)
    if result < 0.0:
        raise ConfigurationError(f"{name} must be at least 0, got {shown(value)}")
    return result


def count(name: str, value: object, largest: int) -> int:
    """`value` as an int, if it is a whole number from 0 to `largest`.

    Raises:
        ConfigurationError: with the value that was given.
    """
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or not 0 <= int(value) <= largest:
        raise ConfigurationError(f"{name} must be an integer from 0 to {largest}, got {shown(value)}")
    return int(value)


def flag(name: str, value: object) -> bool:
    """`value` as a bool, if it is one: a text such as "no" would count as true.

    Raises:
        ConfigurationError: with the value that was given.
    """
    if not isinstance(value, bool | np.bool_):
        raise ConfigurationError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def array(value: Any) -> NDArray | None:
    """`value` as an array; None if it is none, such as a ragged list."""
    try:
        return np.asarray(value)
    except Exception:  # an untrusted object may raise anything
        return None


def numbers(value: Any) -> NDArray[np.float64] | None:
    """`value` as a new array of real numbers; None if it is none. Neither text nor booleans are numbers."""
    found = array(value)
    if found is None or found.dtype.kind not in "fiu" or _holds_boolean(value):
        return None
    return found.astype(np.float64)


def _holds_boolean(value: Any) -> bool:
    """Whether a list, however deep, holds a boolean, which numpy takes for a number next to numbers."""
    if isinstance(value, list | tuple):
        return any(map(_holds_boolean, value))
    return isinstance(value, bool | np.bool_)


def real_array(name: str, value: Any, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """`value` as a new float64 array of `shape`, where None stands for any length; it may hold infinity.

    Raises:
        ConfigurationError: for text, complex numbers, NaN, ragged lists or another shape.
    """
    expected = f"({', '.join('any' if length is None else str(length) for length in shape)})"
    found = numbers(value)
    if found is None:
        raise ConfigurationError(f"{name} must be an array of numbers, {expected}, got {shown(value)}")
    fits = found.ndim == len(shape) and all(
        length in (None, got) for length, got in zip(shape, found.shape, strict=True)
    )
    if not fits or np.isnan(found).any():
        raise ConfigurationError(f"{name} must be of shape {expected} without NaN, got {shown(value)}")
    return found


def finite_array(name: str, value: Any, shape: tuple[int | None, ...]) -> NDArray[np.float64]:
    """`value` as a new finite float64 array of `shape`; errors as in `real_array`, and for infinity."""
    array = real_array(name, value, shape)
    if not np.isfinite(array).all():
        raise ConfigurationError(f"{name} must be finite, got {shown(value)}")
    return array
