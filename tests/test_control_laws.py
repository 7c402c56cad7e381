"""Compiled control laws: the numbers of their formulas in numpy."""

import numpy as np
import pytest
from numpy.typing import NDArray

from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureVectorEnv
from space_envs.registration import ENTRIES
from space_envs.robots.control_laws import ControlLaws


def drawn_motion(env_id: str, mode: str) -> NDArray:
    """Observations (12, 6, size) under actions that reach the limits of torques and rates."""
    env = CaptureVectorEnv(env_id, 6, mode, "disabled")
    env.reset(seed=3)
    actions = np.random.default_rng(1).choice([-1.0, 0.3, 1.0], (4, *env.action_space.shape))
    return np.array([env.step(actions[step // 3])[0] for step in range(12)])


@pytest.mark.parametrize("env_id", ENTRIES)
def test_compiled_laws_are_those_in_numpy(env_id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = [drawn_motion(env_id, mode) for mode in CONTROL_MODES]
    monkeypatch.setattr(ControlLaws, "compiled", False)
    for mode, motion in zip(CONTROL_MODES, compiled, strict=True):
        np.testing.assert_allclose(motion, drawn_motion(env_id, mode), atol=1e-7, err_msg=mode)
