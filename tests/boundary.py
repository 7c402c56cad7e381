"""What tests of the environments' boundary share: what is soon, what has moved, an untrusted object."""

import time
from contextlib import contextmanager
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np

import space_envs  # noqa: F401  (registers the ids)
from space_envs.errors import SpaceEnvsError

# Of any type: a type checker cannot see what is behind them.
gym_make: Any = gym.make
gym_make_vec: Any = gym.make_vec
SINGLE, CLUTTERED = "SpaceCapture/SingleArm-v0", "SpaceCapture/SingleArmCluttered-v0"
PLANAR, SPATIAL = "SpaceCapture/DualArmPlanar-v0", "SpaceCapture/DualArmSpatial-v0"
SOON = 1.0  # s of processor time
LONGEST = 400  # characters of a message, but for the names that it lists


@contextmanager
def soon():
    """Fail if what is done takes long."""
    begin = time.process_time()
    yield
    assert time.process_time() - begin < SOON


class Strange:
    """An object of an untrusted class, on which everything fails."""

    def __repr__(self):
        raise RuntimeError("no name")

    def __array__(self, *_, **__):
        raise RuntimeError("no array")

    def __eq__(self, other):
        raise RuntimeError("no comparison")


GOALS = {
    SINGLE: {"goal_position": [0.0, 1.0, 2.0], "goal_quaternion": [1.0, 0.0, 0.0, 0.0]},
    CLUTTERED: {
        "goal_position": [0.0, 1.0, 2.0],
        "goal_quaternion": [1.0, 0.0, 0.0, 0.0],
        "obstacle_position": [-1.5, 1.5, 0.0, -1.5, -1.5, 0.0, 0.0, -1.5, -1.5],
        "obstacle_radius": [0.1, 0.1, 0.1],
    },
    PLANAR: {"target_position": [2.0, 1.0], "target_angle": [0.1], "target_angular_velocity": [0.01]},
    SPATIAL: {"target_position": [0.0, 1.6, 0.0], "target_angular_velocity": [0.01, 0.0, 0.0]},
}


@cache
def pair(env_id):
    """Two environments in the same state."""
    made = [gym_make_vec(env_id, num_envs=2, threads=1, horizon=50) for _ in range(2)]
    for env in made:
        env.reset(seed=1)
    return made


def check(env_id, call, error=SpaceEnvsError):
    """The call goes well, or ends soon in one of our errors and leaves everything as it was; which it was."""
    env, twin = pair(env_id)
    before = [env.simulation.state(row) for row in range(2)]
    said = None
    with soon():
        try:
            call(env)
        except error as caught:
            said = str(caught)
    if said is None:
        for each in (env, twin):
            each.reset(seed=1)
        return None
    assert len(said) < LONGEST + 200, said
    for row in range(2):
        np.testing.assert_array_equal(env.simulation.state(row), before[row])
    assert env.np_random_seed == twin.np_random_seed
    action = np.full(env.action_space.shape, 0.1)
    for one, other in zip(env.step(action)[:4], twin.step(action)[:4], strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])
    return said
