"""Environments: single and vector, options of `reset`, and validation of initial states."""

from space_envs.envs.single import CaptureEnv
from space_envs.envs.vector import CaptureVectorEnv

__all__ = ["CaptureEnv", "CaptureVectorEnv"]
