"""Base twist at zero momentum: compiled code, or numpy where no compiler is available.

CasADi generates the C code from `SymbolicRobot`. A robot's code is compiled at its first use, in about 0.2 s,
once per machine.
"""

from typing import TYPE_CHECKING

import numpy as np

from space_envs.codegen.libraries import warn_uncompiled
from space_envs.codegen.once import built_once
from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array

if TYPE_CHECKING:  # CasADi is slow to import
    from space_envs.codegen.functions import Batched


def base_twist(robot: FloatingRobot, q: Array, qdot: Array) -> Array:
    """Base twist [v; w] (..., 6) at zero momentum, base axes, m/s and rad/s.

    A sample's result does not depend, to the last bit, on the samples next to it. Compiled code and numpy
    agree to 1e-12.

    Args:
        q, qdot: (..., n) rad and rad/s; their leading shapes are broadcast.

    Warns:
        NoCompiledCodeWarning: once per process, if numpy is used; the message says why.
    """
    function = _compiled_twist(robot)
    if function is None:
        return robot.base_twist(q, qdot)
    (twist,) = function(*np.broadcast_arrays(robot.joint_array(q), robot.joint_array(qdot, "joint rates")))
    return twist


@built_once
def _compiled_twist(robot: FloatingRobot) -> "Batched | None":
    """Compiled base twist of a robot, None where numpy has to be used."""
    from space_envs.codegen.functions import batched
    from space_envs.dynamics.symbolic import SymbolicRobot

    function = batched({"base_twist": SymbolicRobot(robot).base_twist}, optimise=True)["base_twist"]
    if not function.compiled:
        return None
    # The compiler is not part of the project, so its output is checked against numpy before it is used.
    q = robot.home + np.linspace(-1.0, 1.0, 5)[:, None] * np.arange(1, robot.n_joints + 1)
    expected = robot.base_twist(q, np.cos(q))
    if not np.abs(function(q, np.cos(q))[0] - expected).max() < 1e-9 * np.abs(expected).max():
        warn_uncompiled("the compiled code disagrees with numpy")
        return None
    return function
