"""Momentum-level mathematics of a robot as CasADi functions."""

from space_envs.dynamics.symbolic.robot import SymbolicRobot

__all__ = ["SymbolicRobot"]
