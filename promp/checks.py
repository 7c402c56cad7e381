"""Validation at the boundary of the package: arrays of the right shape, finite, in range."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from promp.errors import PrompError

Array = NDArray[np.float64]

PHASE_SLACK = 1e-9  # k * dt / duration may pass 1 by rounding; anything more is a mistake


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...] | None = None) -> Array:
    """`value` as finite float64 of `shape` (None: any length; no shape: any shape), or PrompError."""
    try:
        raw = np.asarray(value)
        if raw.dtype.kind not in "iuf":
            raise TypeError(f"numbers of type {raw.dtype}")  # text, complex numbers, flags, objects
        array = np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise PrompError(f"{name}: expected an array of real numbers, got {type(value).__name__}") from error
    if shape is not None:
        fits = array.ndim == len(shape) and all(
            want is None or want == got for want, got in zip(shape, array.shape, strict=True)
        )
        if not fits:
            lengths = ["any" if length is None else str(length) for length in shape]
            expected = f"({lengths[0]},)" if len(lengths) == 1 else f"({', '.join(lengths)})"
            raise PrompError(f"{name}: expected shape {expected}, got {array.shape}")
    if not np.isfinite(array).all():
        raise PrompError(f"{name}: expected finite numbers, got NaN or infinity")
    return array


def number(name: str, value: float, minimum: float, *, strict: bool = False) -> float:
    """`value` as a finite float of at least `minimum` (above it if `strict`), or PrompError."""
    result = float(finite_array(name, value, ()))
    if result < minimum or (strict and result == minimum):
        raise PrompError(
            f"{name}: expected a number {'above' if strict else 'of at least'} {minimum}, got {result}"
        )
    return result


def count(name: str, value: int, minimum: int = 1, maximum: int = 10**9) -> int:
    """`value` as an int from `minimum` to `maximum`, or PrompError."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not minimum <= value <= maximum:
        raise PrompError(f"{name}: expected an integer from {minimum} to {maximum}, got {value!r}")
    return int(value)


def flag(name: str, value: bool) -> bool:
    """`value` as a bool, if it is one, or PrompError."""
    if not isinstance(value, bool | np.bool_):
        raise PrompError(f"{name}: expected True or False, got {value!r}")
    return bool(value)


def phase_array(value: ArrayLike, shape: tuple[int | None, ...] | None = None) -> Array:
    """Phases in [0, 1], of any shape unless `shape` is given, or PrompError."""
    phase = finite_array("phase", value, shape)
    if phase.size and (phase.min() < -PHASE_SLACK or phase.max() > 1 + PHASE_SLACK):
        raise PrompError(f"phase: expected values in [0, 1], got {phase.min():g} to {phase.max():g}")
    return phase
