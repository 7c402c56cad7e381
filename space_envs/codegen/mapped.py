"""CasADi functions over many samples at once, as compiled code where that is possible."""

import ctypes

import casadi as ca
import numpy as np

from space_envs.codegen.c_library import LibraryError, load_library
from space_envs.dynamics.compiled import warn_uncompiled
from space_envs.dynamics.rotations import Array

# Derivatives are long straight-line code: more optimisation takes minutes and wins little.
_PRAGMA = '#ifdef __GNUC__\n#pragma GCC optimize("O1")\n#endif\n#define CASADI_SYMBOL_EXPORT static\n'
_LOOP = """
void map_{name}(const double** in, double** out, long long samples) {{
  casadi_int integers[{integers}];
  double work[{work}];
  for (long long i = 0; i < samples; ++i) {{
    const double* inputs[{inputs}] = {{{given}}};
    double* outputs[{outputs}] = {{{made}}};
    {name}(inputs, outputs, integers, work, 0);
  }}
}}
"""


class Mapped:
    """A function of columns, applied to samples along leading axes.

    Outputs that are matrices come out transposed, as C stores them: declare a Jacobian (k, n) as its
    transpose to get (..., k, n).

    Attributes:
        function: of one sample.
    """

    def __init__(self, function: ca.Function) -> None:
        self.function = function
        self._inputs = [function.numel_in(i) for i in range(function.n_in())]
        self._outputs = [tuple(reversed(function.size_out(i))) for i in range(function.n_out())]
        self._run = None

    def __call__(self, *inputs: Array) -> list[Array]:
        """Outputs (..., rows, columns) for inputs (..., size), float64; columns come as (..., size)."""
        batch = inputs[0].shape[:-1]
        given = [np.ascontiguousarray(x, dtype=np.float64) for x in inputs]
        for x, size in zip(given, self._inputs, strict=True):
            if x.shape != (*batch, size):
                raise ValueError(f"expected an input of shape {(*batch, size)}, got {x.shape}")
        count = int(np.prod(batch))
        shapes = [(*batch, *shape) if shape[0] > 1 else (*batch, shape[1]) for shape in self._outputs]
        if count == 0:  # CasADi maps no function over nothing
            return [np.empty(shape) for shape in shapes]
        if self._run is None:
            columns = [x.reshape(count, size).T for x, size in zip(given, self._inputs, strict=True)]
            results = self.function.map(count)(*columns)
            results = results if isinstance(results, tuple) else (results,)
            # Samples stand side by side; a sample's columns one after the other are the transpose's rows.
            return [
                np.asarray(y).ravel(order="F").reshape(shape)
                for y, shape in zip(results, shapes, strict=True)
            ]
        made: list[Array] = [np.empty(shape) for shape in shapes]
        pointers = [
            (ctypes.c_void_p * len(arrays))(*[x.ctypes.data for x in arrays]) for arrays in (given, made)
        ]
        self._run(*pointers, count)
        return made


def mapped(functions: dict[str, ca.Function]) -> dict[str, Mapped]:
    """The functions in one library; in CasADi's virtual machine where nothing can be compiled.

    Warns:
        NoCompiledCodeWarning: in that case, saying what is missing.
    """
    made = {key: Mapped(function) for key, function in functions.items()}
    generator = ca.CodeGenerator("kernel")
    for function in functions.values():
        generator.add(function)
    loops = [
        _LOOP.format(
            name=f.name(),
            integers=f.sz_iw() + 1,
            work=f.sz_w() + 1,
            inputs=f.sz_arg(),
            outputs=f.sz_res(),
            given=", ".join(f"in[{i}] + {f.numel_in(i)} * i" for i in range(f.n_in())),
            made=", ".join(f"out[{i}] + {f.numel_out(i)} * i" for i in range(f.n_out())),
        )
        for f in functions.values()
    ]
    try:
        library = load_library(_PRAGMA + generator.dump() + "".join(loops))
    except LibraryError as error:
        message = f"planning runs in CasADi's virtual machine, twenty times slower: {error}"
        warn_uncompiled(message)
        return made
    for key, function in functions.items():
        run = getattr(library, f"map_{function.name()}")
        run.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_longlong]
        run.restype = None
        made[key]._run = run
    return made
