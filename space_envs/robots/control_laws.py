"""Compiled laws of the joint drives and the control modes, `control_laws.c`.

Each has its formulas in numpy in `space_envs.drives` or `space_envs.control`, which run where there is no
compiler and agree with it to rounding.
"""

from ctypes import CDLL, Structure, byref, c_double, c_longlong, c_void_p
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from space_envs.codegen.cache import LibraryError
from space_envs.codegen.libraries import load_library, warn_uncompiled
from space_envs.dynamics.rotations import Array

_POINTER, _WHOLE = c_void_p, c_longlong
_ARGUMENTS = {
    "accelerate": [*[_POINTER] * 3, _WHOLE, *[_POINTER] * 3],
    "forward": [_POINTER] * 4,
    "reactionless": [_POINTER, _POINTER, _WHOLE, _POINTER, _WHOLE, *[_POINTER] * 6],
    "end_effectors": [_WHOLE, *[_POINTER] * 4],
}


class _Numbers(Structure):
    """`Law` of the compiled code."""

    _fields_ = [
        *((name, c_double) for name in ("period", "share", "lost", "gain", "regularisation")),
        *((name, c_longlong) for name in ("joints", "base", "first_angular", "angulars")),
        *((name, c_void_p) for name in ("torque", "fastest", "acceleration", "rates", "scale")),
    ]


@cache
def _library() -> CDLL | None:
    """The compiled code; None, with a warning, where there is no compiler."""
    try:
        library = load_library((files("space_envs") / "robots" / "control_laws.c").read_text(), native=True)
    except LibraryError as error:
        warn_uncompiled(str(error))
        return None
    for name, arguments in _ARGUMENTS.items():
        function = getattr(library, name)
        function.argtypes, function.restype = [c_longlong, c_void_p, *arguments], None
    return library


class ControlLaws:
    """Compiled laws of one robot for N simulations of n joints, whose base has b velocity components.

    A simulation's result does not depend, to the last bit, on those next to it.

    Args:
        period: s, of control. base: b.
        coriolis: shares of a drive's torque, from which Coriolis forces slow the arm, and from which they are
            not compensated.
        torque_limit, fastest, acceleration_limit: (n,) N m, rad/s and rad/s^2.
        rates: (n,) rad/s, by how much motions may violate limits when made reactionless, or rate limits.
        scale: (m,) units per unit action. gain: 1/s. regularisation: added to squared Jacobians.
    """

    def __init__(
        self,
        period: float,
        base: int,
        coriolis: tuple[float, float],
        torque_limit: Array,
        fastest: Array,
        acceleration_limit: Array,
        rates: Array,
        scale: Array,
        gain: float = 0.0,
        regularisation: float = 0.0,
    ) -> None:
        given = torque_limit, fastest, acceleration_limit, rates, scale
        self._kept = [np.array(x, dtype=np.float64) for x in given]  # their addresses are used
        n, angular = len(torque_limit), (2, 1) if base == 3 else (3, 3)
        places = [x.ctypes.data for x in self._kept]
        self._numbers = _Numbers(period, *coriolis, gain, regularisation, n, base, *angular, *places)
        self._law, self._shape = byref(self._numbers), n
        self._library = _library()

    @property
    def compiled(self) -> bool:
        """Whether there is compiled code; the laws can be called only then."""
        return self._library is not None

    def accelerate(self, mass: Array, bias: Array, now: Array, acceleration: Array, late: NDArray) -> Array:
        """Torques (N, n) of `Drive.accelerate`.

        Args:
            mass, bias: (N, b + n, b + n) and (N, b + n). now, acceleration: (N, n) rates and accelerations.
            late: (N, n), joints that brake first.
        """
        torque = np.empty(acceleration.shape)
        inputs = _place(mass), _place(bias), *_strided(now), _place(acceleration), _place(late)
        self._library.accelerate(len(torque), self._law, *inputs, _place(torque))  # type: ignore[union-attr]
        return torque

    def forward(self, mass: Array, bias: Array, torque: Array) -> Array:
        """Joint accelerations (N, n) for torques (N, n)."""
        acceleration = np.empty(torque.shape)
        inputs = _place(mass), _place(bias), _place(torque)
        self._library.forward(len(torque), self._law, *inputs, _place(acceleration))  # type: ignore[union-attr]
        return acceleration

    def reactionless(
        self, ahead: Array, attitude: Array, now: Array, action: Array, low: Array, high: Array, late: NDArray
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Joint accelerations (N, n) of mode reactionless, and which motions (N,) are too far from it.

        Args:
            ahead: (N, b, b + n), rows of the base in the mass matrix. attitude: (N, 4 or 1) of the base.
            now, low, high: (N, n) present rates and their limits. action: (N, n). late: (N, n) bool.
        """
        acceleration, away = np.empty(action.shape), np.empty(len(action), dtype=np.bool_)
        state = _place(ahead), *_strided(attitude), *_strided(now)
        inputs = [_place(x) for x in (action, low, high, late)]
        results = _place(acceleration), _place(away)
        self._library.reactionless(len(action), self._law, *state, *inputs, *results)  # type: ignore[union-attr]
        return acceleration, away

    def end_effectors(self, ahead: Array, jacobian: Array, action: Array) -> Array:
        """Joint rates (N, n) of mode end_effector_velocity.

        Args:
            ahead: (N, b, b + n), rows of the base in the mass matrix. jacobian: (N, m, b + n), overwritten.
            action: (N, m).
        """
        rate = np.empty((len(action), self._shape))
        inputs = [_place(x) for x in (ahead, jacobian, action, rate)]
        self._library.end_effectors(len(action), self._law, action.shape[1], *inputs)  # type: ignore[union-attr]
        return rate


def _place(x: NDArray) -> int:
    """Address of the first number of a contiguous array.

    Raises:
        ValueError: for another array.
    """
    if not x.flags.c_contiguous:
        raise ValueError(f"expected a contiguous array, got strides {x.strides} of shape {x.shape}")
    return x.__array_interface__["data"][0]


def _strided(x: Array) -> tuple[int, int]:
    """Address of the first number of contiguous rows, and the step to the next row, in numbers."""
    return x.__array_interface__["data"][0], x.strides[0] // 8
