"""First contacts in a control period: by compiled code, `contacts.c`, or numpy where there is no compiler."""

from collections.abc import Callable, Sequence
from ctypes import CDLL, c_longlong, c_void_p
from functools import cache
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.codegen.cache import LibraryError
from space_envs.codegen.libraries import load_library, warn_uncompiled
from space_envs.dynamics.rotations import Array

SHARES = np.linspace(0.0, 1.0, 9)  # of a control period, at which links are checked
_ROOT_3 = 3.0**0.5  # largest length of a vector whose components are at most 1


@cache
def contacts_library() -> CDLL | None:
    """The compiled code; None, with a warning, where there is no compiler."""
    try:
        return load_library((files("space_envs") / "robots" / "contacts.c").read_text())
    except LibraryError as error:
        warn_uncompiled(str(error))
        return None


class ContactChecks:
    """Checks of pairs of bodies at `SHARES` of a control period, in which points move straight.

    Args:
        functions: of `contacts.c`, each with its arguments after `pairs`, integers and arrays.
        gaps: the same in numpy, from sensors (K, s) to the gaps (K, pairs), m.
        points: columns of the sensors that are coordinates of moving points.
        codes: (pairs,) of the contacts.
    """

    def __init__(
        self,
        functions: Sequence[tuple[str, Sequence[int | NDArray]]],
        gaps: Callable[[Array], Array],
        points: NDArray[np.int64],
        codes: NDArray[np.int64],
    ) -> None:
        self._given = functions, gaps, points, codes
        self._gaps, self._points, self._codes = gaps, points, codes
        self._code_of = np.append(
            np.tile(codes, len(SHARES)), 0
        )  # by share * pairs + pair, the last for none
        library = contacts_library()
        self._calls = None if library is None else [_bound(library, *each) for each in functions]

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._given  # addresses are of this process

    def first(self, before: Array, after: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contacts, 0 for none; of simultaneous ones, that of the first pair.

        Args:
            before, after: sensors (N, s) at the beginning and at the end of the period.
        """
        if self._calls is None:
            return self._first_in_numpy(before, after)
        before, after = np.ascontiguousarray(before), np.ascontiguousarray(after)
        first = np.full(len(after), len(self._code_of) - 1)
        addresses = (x.__array_interface__["data"][0] for x in (before, after, first))
        sensors = *after.shape, *addresses, len(self._codes)
        for call, arguments, _ in self._calls:
            call(*sensors, *arguments)
        return self._code_of[first]

    def _first_in_numpy(self, before: Array, after: Array) -> NDArray[np.int64]:
        code, step = np.zeros(len(after), dtype=np.int64), after - before
        # No gap shrinks by more than twice the largest displacement of a point.
        move = 2.0 * _ROOT_3 * np.abs(step[:, self._points]).max(axis=1)
        rows = np.flatnonzero(self._gaps(after).min(axis=1, initial=np.inf) <= move)
        if len(rows):
            path = after[rows, None] - (1.0 - SHARES)[:, None] * step[rows, None]
            touching = (self._gaps(path.reshape(-1, after.shape[1])) <= 0.0).reshape(len(rows), -1)
            first = touching.argmax(axis=1) % len(self._codes)
            code[rows] = np.where(touching.any(axis=1), self._codes[first], 0)
        return code


def _bound(library: CDLL, name: str, given: Sequence[int | NDArray]) -> tuple[Any, list[int], list[Any]]:
    """A function of the library, its last arguments, and the arrays whose addresses are among these."""
    call = library[name]
    call.restype = None
    kinds = [c_longlong if isinstance(x, int) else c_void_p for x in given]
    call.argtypes = [c_longlong, c_longlong, c_void_p, c_void_p, c_void_p, c_longlong, *kinds]
    kept = [x if isinstance(x, int) else np.ascontiguousarray(x) for x in given]
    return call, [x if isinstance(x, int) else x.ctypes.data for x in kept], kept
