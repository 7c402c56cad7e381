"""Values and exceptions of foreign code, such as a user's policy: checked, and described in plain text."""

import os
import signal
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError

LONGEST = 1000  # characters of a message that are kept
_REAL = "fiu"  # kinds of numpy's numbers that an action may have


def described(error: BaseException) -> str:
    """Type and message of an exception on one line, even if its `__str__` raises."""
    try:
        text = f"{type(error).__name__}: {error}"
    except BaseException:
        return "an exception that cannot be shown"
    return plain_text(text)


def plain_text(text: str) -> str:
    """Text that can be written anywhere: on one line, at most LONGEST characters, no lone surrogates."""
    whole = text[: 4 * LONGEST].encode("utf-8", "replace").decode("utf-8")
    return " ".join(whole.split())[:LONGEST]


def actions_and_state(returned: Any, shape: tuple[int, int]) -> tuple[Array, Any]:
    """Actions of a shape, a copy of the policy's array, and the state, from the value of its `predict`.

    The actions may hold NaN or infinity; the state is not checked.

    Raises:
        PolicyError: if it is not a pair, or its first element is not an array of real numbers of that shape.
    """
    if type(returned) not in (tuple, list) or len(returned) != 2:
        raise PolicyError(f"it returned {_kind(returned)}, expected a pair of actions and state")
    action = np.asarray(returned[0])
    if action.dtype.kind not in _REAL:
        raise PolicyError(f"it returned actions of type {action.dtype}, expected real numbers")
    if action.shape != shape:
        raise PolicyError(f"it returned actions of shape {action.shape}, expected {shape}")
    with np.errstate(all="ignore"):
        return np.array(action, dtype=np.float64), returned[1]


def _kind(value: Any) -> str:
    size = f" of {len(value)}" if type(value) in (tuple, list) else ""
    return f"a {type(value).__name__}{size}"


@contextmanager
def undisturbed() -> Iterator[None]:
    """Restore the state of the process that foreign code may change: working directory, umask, environment,
    search path, signal handlers, and the handling of warnings and floating-point errors.
    """
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    folder, environment, paths = os.getcwd(), dict(os.environ), list(sys.path)
    streams, mask = (sys.stdin, sys.stdout, sys.stderr), os.umask(0)
    os.umask(mask)
    errors = np.geterr()
    try:
        with warnings.catch_warnings():
            yield
    finally:
        os.chdir(folder)
        os.umask(mask)
        if dict(os.environ) != environment:
            os.environ.clear()
            os.environ.update(environment)
        sys.path[:] = paths
        sys.stdin, sys.stdout, sys.stderr = streams
        np.seterr(**errors)
        for number, handler in handlers.items():
            # Handlers can be changed in the main thread alone, and so can only be put back there.
            if signal.getsignal(number) is not handler and handler is not None:
                signal.signal(number, handler)
