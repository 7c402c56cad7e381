"""Recorded episodes as states that can be drawn, one after the other."""

from collections.abc import Iterator

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.evaluation.replay.replay import Replay

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


def model_states(replay: Replay, model: mujoco.MjModel, between: int = 1) -> Iterator[Array]:
    """Integration states (S,) of a model from the first to the last recorded one, with their times.

    Args:
        model: the `model` of a `Renderer` of the task's `render_model`; it takes the sizes of the goal.
        between: states for each recorded step; between two recorded ones, rotation and translation are even.
    """
    data = mujoco.MjData(model)
    replay.task.update_visuals(model, data, replay.goals, 0)
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    difference = np.empty(model.nv)
    scene = np.asarray(replay.scene, dtype=np.float64)
    last = len(scene) - 1
    for number in range(last * between + 1):
        step, part = divmod(number, between)
        data.qpos[:] = scene[step]
        if part:
            mujoco.mj_differentiatePos(model, difference, 1.0, scene[step], scene[step + 1])
            mujoco.mj_integratePos(model, data.qpos, difference, part / between)
        data.time = replay.task.control_period * number / between
        mujoco.mj_getState(model, data, state, _STATE)
        yield state.copy()
