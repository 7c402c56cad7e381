"""Scenes of SpaceCapture/SingleArmCluttered that were frozen, and environments to play them in."""

import numpy as np

from space_envs.envs import CaptureVectorEnv
from space_envs.tasks.goals import clutter, detours
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask, frozen_draws

ENV_ID = "SpaceCapture/SingleArmCluttered-v0"


def make(n, **keywords):
    """An environment whose ended rows stay as they are."""
    return CaptureVectorEnv(ENV_ID, n, autoreset_mode="disabled", **keywords)


def scene(variant, difficulty, split, indices):
    """Scenes, goals and detours that were frozen."""
    robot = SingleArmClutteredTask(variant=variant).robot
    draws = frozen_draws(variant, difficulty, split)[indices]
    scenes = clutter.draw_scenes(robot, difficulty, split, indices, draws[:, 0])
    vias = detours.draw_detours(robot, scenes, difficulty, split, indices, draws[:, 0])
    return robot, scenes, scenes.goals(draws[:, 2:]), vias[np.arange(len(indices)), draws[:, 1]]
