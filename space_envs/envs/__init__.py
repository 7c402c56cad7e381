"""The environments: one arm or many at a time, what a reset may ask for, and starts that can brake."""

from space_envs.envs.single import CaptureEnv
from space_envs.envs.vector import CaptureVectorEnv

__all__ = ["CaptureEnv", "CaptureVectorEnv"]
