"""The base twist at zero momentum as compiled code, and the same with numpy where nothing can be compiled.

The C code of one sample is CasADi's, generated from `symbolic.py`; a loop over samples stands around it. A
robot's kernel is compiled at its first use (about 0.2 s), once per machine.
"""

import ctypes
import threading
import warnings

import numpy as np

from space_envs.codegen.c_library import LibraryError, load_library
from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array

_LOOP = """
void base_twists(const double* q, const double* qdot, double* twist, long long samples) {{
  casadi_int integers[{integers}];
  double work[{work}];
  for (long long i = 0; i < samples; ++i) {{
    const double* inputs[{inputs}] = {{q + {n} * i, qdot + {n} * i}};
    double* outputs[{outputs}] = {{twist + 6 * i}};
    base_twist(inputs, outputs, integers, work, 0);
  }}
}}
"""

_lock = threading.Lock()
_kernels: dict[str, "Kernel | None"] = {}
_warned = False


class NoCompiledCodeWarning(RuntimeWarning):
    """Nothing can be compiled on this machine: results are the same and come several times slower."""


class Kernel:
    """The compiled base twist of one robot.

    Raises:
        LibraryError: if it cannot be compiled or loaded, or what it computes is wrong.
    """

    def __init__(self, robot: FloatingRobot) -> None:
        self._run = load_library(kernel_source(robot)).base_twists
        self._run.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_longlong]
        self._run.restype = None
        # A compiler is not part of the project: its work is looked at before it is trusted.
        q = robot.home + np.linspace(-1.0, 1.0, 5)[:, None] * np.arange(1, robot.n_joints + 1)
        expected = robot.base_twist(q, np.cos(q))
        if not np.abs(self(q, np.cos(q)) - expected).max() < 1e-9 * np.abs(expected).max():
            raise LibraryError("the compiled code disagrees with numpy")

    def __call__(self, q: Array, qdot: Array) -> Array:
        """Twists (..., 6) for q, qdot (..., n) of one shape, float64."""
        q, qdot = (np.require(array, np.float64, ["C", "A"]) for array in (q, qdot))
        twist = np.empty((*q.shape[:-1], 6))
        self._run(q.ctypes.data, qdot.ctypes.data, twist.ctypes.data, twist.size // 6)
        return twist


def base_twist(robot: FloatingRobot, q: Array, qdot: Array) -> Array:
    """Base twist [v; w] (..., 6) at zero momentum, base axes, m/s and rad/s, by the fastest way there is.

    A sample's result does not depend, to the last bit, on the samples beside it. The compiled way and the
    numpy way agree to 1e-12.

    Args:
        q, qdot: (..., n) rad and rad/s; their leading shapes are broadcast.

    Warns:
        NoCompiledCodeWarning: once a process, if numpy has to do it, saying what is missing.
    """
    kernel = _kernel(robot)
    if kernel is None:
        return robot.base_twist(q, qdot)
    q, qdot = np.broadcast_arrays(robot.joint_array(q), robot.joint_array(qdot, "joint rates"))
    return kernel(q, qdot)


def kernel_source(robot: FloatingRobot) -> str:
    """C source of a robot's kernel.

    Raises:
        LibraryError: if CasADi is not installed.
    """
    try:
        import casadi as ca

        from space_envs.dynamics.symbolic import SymbolicRobot
    except ImportError as error:
        raise LibraryError(f"CasADi is not there to write the code ({error})") from error
    function = SymbolicRobot(robot).base_twist
    generator = ca.CodeGenerator("kernel")
    generator.add(function)
    sizes = {"integers": function.sz_iw() + 1, "work": function.sz_w() + 1}
    sizes |= {"inputs": function.sz_arg(), "outputs": function.sz_res()}
    # Static, so that the compiler can put the function into the loop.
    code = "#define CASADI_SYMBOL_EXPORT static\n" + generator.dump()
    return code + _LOOP.format(n=robot.n_joints, **sizes)


def warn_uncompiled(message: str) -> None:
    """Warn that compiled code is lacking: once a process, in one line without the source.

    Warns:
        NoCompiledCodeWarning: with the message.
    """
    global _warned
    if not _warned:
        _warned = True
        warnings.warn_explicit(message, NoCompiledCodeWarning, "space_envs", 1)


def _kernel(robot: FloatingRobot) -> Kernel | None:
    """The robot's kernel, made at first use; None where that is impossible, which is found out once."""
    name = robot.fingerprint
    if name in _kernels:
        return _kernels[name]
    with _lock:
        if name not in _kernels:
            try:
                _kernels[name] = Kernel(robot)
            except LibraryError as error:
                _kernels[name] = None
                warn_uncompiled(f"base twists are computed with numpy, several times slower: {error}")
        return _kernels[name]
