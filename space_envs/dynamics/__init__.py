"""Momentum-level mathematics of free-floating robots, batched (numpy) and symbolic (CasADi).

`space_envs.dynamics.symbolic` is not imported from here: it needs CasADi, which is slow to import.
"""

from space_envs.codegen.libraries import NoCompiledCodeWarning
from space_envs.dynamics.compiled import base_twist
from space_envs.dynamics.floating import FloatingRobot, Kinematics
from space_envs.dynamics.trajectories import attitude_cost, minimum_jerk, roll_out_base, trajectory_cost

__all__ = [
    "FloatingRobot",
    "Kinematics",
    "NoCompiledCodeWarning",
    "attitude_cost",
    "base_twist",
    "minimum_jerk",
    "roll_out_base",
    "trajectory_cost",
]
