"""CasADi functions as machine code, or in CasADi's interpreter if there is no compiler."""

import ctypes
import math
from collections.abc import Callable, Mapping

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from space_envs.codegen.cache import LibraryError
from space_envs.codegen.lanes import HEAD, lane_loop
from space_envs.codegen.libraries import load_library, warn_uncompiled

Array = NDArray[np.floating]

# Derivatives are long straight-line code: higher optimisation levels take minutes and gain little.
_LITTLE_OPTIMISATION = '#ifdef __GNUC__\n#pragma GCC optimize("O1")\n#endif\n'
# Static, so that the compiler can inline the functions into the loops.
_STATIC = "#define CASADI_SYMBOL_EXPORT static\n"
_LOOP = """
void map_{name}(const double** in, double** out, long long samples) {{
  casadi_int integers[{integers}];
  double work[{work}];
  for (long long i = 0; i < samples; ++i) {{
    const double* inputs[{inputs}] = {{{arguments}}};
    double* outputs[{outputs}] = {{{results}}};
    {name}(inputs, outputs, integers, work, 0);
  }}
}}
"""


class Batched:
    """A function of columns, applied to samples along leading axes.

    A sample's result does not depend on the samples next to it. Matrices come out transposed, as C stores
    them: declare a Jacobian (k, n) as its transpose to get (..., k, n).

    Args:
        function: of one sample. loop: the compiled loop over samples, None for CasADi's interpreter.

    Attributes:
        function: of one sample.
    """

    def __init__(self, function: ca.Function, loop: Callable[..., None] | None = None) -> None:
        self.function, self._loop = function, loop
        self._inputs = [function.numel_in(i) for i in range(function.n_in())]
        self._outputs = [tuple(reversed(function.size_out(i))) for i in range(function.n_out())]

    @property
    def compiled(self) -> bool:
        """Whether it runs as machine code."""
        return self._loop is not None

    def __call__(self, *inputs: Array) -> list[Array]:
        """Outputs (..., rows, columns) for inputs (..., size), float64; columns come as (..., size).

        Raises:
            ValueError: if an input has another shape.
        """
        batch = inputs[0].shape[:-1]
        arrays = [_contiguous(x) for x in inputs]
        for x, size in zip(arrays, self._inputs, strict=True):
            if x.shape != (*batch, size):
                raise ValueError(f"expected an input of shape {(*batch, size)}, got {x.shape}")
        count = math.prod(batch)
        shapes = [(*batch, *shape) if shape[0] > 1 else (*batch, shape[1]) for shape in self._outputs]
        if count == 0:  # CasADi cannot map a function over no samples
            return [np.empty(shape) for shape in shapes]
        if self._loop is None:
            return self._interpreted(arrays, count, shapes)
        results: list[Array] = [np.empty(shape) for shape in shapes]
        pointers = [(ctypes.c_void_p * len(side))(*map(address, side)) for side in (arrays, results)]
        self._loop(*pointers, count)
        return results

    def _interpreted(self, arrays: list[Array], count: int, shapes: list[tuple[int, ...]]) -> list[Array]:
        columns = [x.reshape(count, size).T for x, size in zip(arrays, self._inputs, strict=True)]
        results = self.function.map(count)(*columns)
        results = results if isinstance(results, tuple) else (results,)
        # Samples are next to each other; a sample's columns in sequence are the transpose's rows.
        return [
            np.asarray(y).ravel(order="F").reshape(shape) for y, shape in zip(results, shapes, strict=True)
        ]


def address(x: Array) -> int:
    """Address of the first number of an array."""
    return x.__array_interface__["data"][0]


def _contiguous(x: Array) -> Array:
    """An array as the compiled code reads it; itself where it is so already."""
    flags = x.flags
    if x.dtype == np.float64 and flags.c_contiguous and flags.aligned:
        return x
    return np.require(x, np.float64, ["C", "A"])


def batched(
    functions: Mapping[str, ca.Function], *, optimise: bool = False, vectorise: bool = False
) -> dict[str, Batched]:
    """The functions over batches, compiled in one library or interpreted if there is no compiler.

    Args:
        optimise: whether the compiler optimises fully; of use for short functions only.
        vectorise: whether eight samples are computed at once; for functions of scalars with plain arithmetic
            that are called with many samples.

    Warns:
        NoCompiledCodeWarning: if they are interpreted, with the reason.
    """
    pragma = "" if optimise else _LITTLE_OPTIMISATION
    if vectorise:
        source = pragma + HEAD + "".join(map(lane_loop, functions.values()))
    else:
        source = pragma + _STATIC + _code(functions) + "".join(map(_loop_source, functions.values()))
    try:
        library = load_library(source, native=vectorise)
    except LibraryError as error:
        warn_uncompiled(str(error))
        return {key: Batched(function) for key, function in functions.items()}
    found = {}
    for key, function in functions.items():
        loop = getattr(library, f"map_{function.name()}")
        loop.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_longlong]
        loop.restype = None
        found[key] = Batched(function, loop)
    return found


def compiled(functions: Mapping[str, ca.Function]) -> dict[str, ca.Function]:
    """The functions as compiled CasADi functions, to build on, or as they are if there is no compiler.

    Warns:
        NoCompiledCodeWarning: if they are interpreted, with the reason.
    """
    try:
        path = load_library(_LITTLE_OPTIMISATION + _code(functions))._name
    except LibraryError as error:
        warn_uncompiled(str(error))
        return dict(functions)
    return {key: ca.external(function.name(), path) for key, function in functions.items()}


def _code(functions: Mapping[str, ca.Function]) -> str:
    generator = ca.CodeGenerator("kernel")
    for function in functions.values():
        generator.add(function)
    return generator.dump()


def _loop_source(f: ca.Function) -> str:
    return _LOOP.format(
        name=f.name(),
        integers=f.sz_iw() + 1,
        work=f.sz_w() + 1,
        inputs=f.sz_arg(),
        outputs=f.sz_res(),
        arguments=", ".join(f"in[{i}] + {f.numel_in(i)} * i" for i in range(f.n_in())),
        results=", ".join(f"out[{i}] + {f.numel_out(i)} * i" for i in range(f.n_out())),
    )
