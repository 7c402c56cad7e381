"""Section of a task's page about its goals: splits, difficulties, and how goals are drawn."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from docs.reading import comments, described, number, section, table
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array, rotate
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.goals import clutter, poses, tumbling
from space_envs.tasks.goals.targets import Draws, TargetGoals
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask

SPLIT_TEXT = {
    "train": "training and demonstrations",
    "validation": "held out, for model selection during training",
    "test": "the leaderboard",
    "ood": "out of distribution: goals beyond the ranges of the others, and satellites with other masses",
}
SHOWN = ("test", "ood")  # splits whose goals are measured


def goals(task: CaptureTask) -> str:
    """Splits, difficulties, and how goals are drawn.

    Raises:
        TypeError: for a task of another kind than those described here.
    """
    for kind, describe in DESCRIPTIONS.items():
        if isinstance(task, kind):
            return describe(task)
    raise TypeError(f"docs/goals.py describes no task like {type(task).__name__}")


def _splits(task: CaptureTask, seeds: Any) -> list[str]:
    rows = [(f"`{s}`", str(task.split_size(s)), str(seeds[s]), SPLIT_TEXT[s]) for s in SPLITS]
    return [
        "## Splits and difficulties",
        "Goals are drawn from fixed seeds, so that a goal's index identifies it permanently. Without "
        "options, `reset` draws an index of the environment's split from the environment's generator.",
        table(("split", "goals", "seed", "for"), rows),
    ]


def _span(ends: Sequence[float]) -> str:
    return " to ".join(number(end) for end in ends)


def _spread(values: Array) -> str:
    return f"{values.min():.2f}, {np.median(values):.2f}, {values.max():.2f}"


def _drawn(task: Any, difficulty: str, split: str) -> Any:
    chosen = replace(task, difficulty=difficulty, split=split)
    return chosen.goals(split, np.arange(chosen.split_size(split)))


def _single_arm(task: SingleArmTask) -> str:
    said = comments(poses)["RADIUS"]
    start = task.mechanics.end_effector_pose(task.mechanics.home)[0]
    rows = []
    for difficulty in DIFFICULTIES:
        distances = [
            np.linalg.norm(_drawn(task, difficulty, split).position - start, axis=-1) for split in SHOWN
        ]
        rows.append([f"`{difficulty}`", number(poses.RADIUS[difficulty]), *map(_spread, distances)])
    return "\n\n".join(
        [
            *_splits(task, poses.SPLIT_SEED),
            f"Out of distribution, the largest joint displacement is {_span(poses.OOD_RADIUS)} of the "
            f"radius, and the satellite's mass and inertia are {_span(poses.OOD_MASS)} of the nominal "
            "ones. Policies are given the nominal model all the same.",
            "Distances are those of the goals from the initial end-effector position: minimum, median, "
            f"maximum. Radius: {said[0].lower()}{said[1:]}",
            table(("difficulty", "radius", *(f"{split}, m" for split in SHOWN)), rows),
        ]
    )


def _cluttered(task: SingleArmClutteredTask) -> str:
    robot = task.mechanics
    start = robot.end_effector_pose(robot.home)[0]
    rows = []
    for difficulty in DIFFICULTIES:
        cells = [f"`{difficulty}`", number(clutter.CLUTTERED_RADIUS[difficulty])]
        for split in SHOWN:
            found = _drawn(task, difficulty, split)
            cells += [
                _spread(np.linalg.norm(found.position - start, axis=-1)),
                _spread(found.obstacle_radius),
            ]
        rows.append(cells)
    constants = [
        (f"`{name}`", number(getattr(clutter, name)), text)
        for name, text in comments(clutter).items()
        if name.isupper() and not name.startswith("_") and isinstance(getattr(clutter, name), int | float)
    ]
    return "\n\n".join(
        [
            *_splits(task, clutter.CLUTTERED_SPLIT_SEED),
            "Goals are drawn as in [SingleArm](SingleArm-v0.md), with a radius for each difficulty. Spheres "
            f"of {_span(clutter.SPHERE_RADIUS)} m are drawn around the minimum-jerk motion to the goal, of "
            f"{_span(clutter.OOD_SPHERE_RADIUS)} m out of distribution: one blocks that motion; "
            "the others lie next to it and may or may not obstruct other motions. The observation does not "
            "distinguish them. A scene is accepted if a detour, a minimum-jerk motion with a bump in joint "
            "space, ends at the inertial goal clear of every sphere and within the limits of rate and "
            "acceleration; out of distribution, with the satellite's true mass. The indices of scene, detour "
            "and spheres are stored with the project (`space_envs.tasks.goals.freeze` finds them); the "
            "constants of `space_envs.tasks.goals.clutter` define the criteria:",
            table(("constant", "value", "meaning"), constants),
            f"Out of distribution, the largest joint displacement is {_span(poses.OOD_RADIUS)} of the "
            f"radius, and the satellite's mass and inertia are {_span(poses.OOD_MASS)} of the nominal "
            "ones. Policies are given the nominal model all the same.",
            "Distances of the goals from the initial end-effector position, and radii of the spheres: "
            "minimum, median, maximum.",
            table(
                (
                    "difficulty",
                    "radius, rad",
                    *(f"{s}, {quantity}, m" for s in SHOWN for quantity in ("distance", "spheres")),
                ),
                rows,
            ),
        ]
    )


def _dual_arm(task: DualArmTask) -> str:
    draws = task.draws
    about = described(section(Draws.__doc__, "Attributes"), vars(draws))
    ranges = [
        (f"`{name}`", *[number(v) for v in value], about[name].rstrip("."))
        for name, value in vars(draws).items()
        if name not in ("reach", "half_width", "along")
    ]
    measured = []
    for difficulty in DIFFICULTIES:
        cells = [f"`{difficulty}`"]
        for split in SHOWN:
            found = _drawn(task, difficulty, split)
            spin = np.rad2deg(np.linalg.norm(found.angular_velocity, axis=-1))
            cells += [_spread(_distances(task, found)), _spread(spin)]
        measured.append(cells)
    constants = [
        (f"`{name}`", number(getattr(tumbling, name)), text)
        for name, text in comments(tumbling).items()
        if name.isupper() and not name.startswith("_")
    ]
    return "\n\n".join(
        [
            *_splits(task, task.seeds),
            f"The target's centre lies near ({number(task.target.position)}) m and its `half_width`, which "
            f"is the distance of the grapple points from the centre, {_span(draws.half_width)} m. All other "
            "quantities are drawn from ranges that depend on the difficulty:",
            table(("range", *(f"`{d}`" for d in DIFFICULTIES), "quantity"), ranges),
            f"Out of distribution, the target lies {_span(tumbling.OOD_FACTOR)} times as far away as "
            f"these ranges allow and rotates up to {number(tumbling.OOD_FACTOR[1])} times as fast, and the "
            f"satellite's mass and inertia are {_span(tumbling.OOD_MASS)} of the nominal ones. Policies are "
            "given the nominal model all the same.",
            "Goals that cannot be reached by a reactionless motion from rest are drawn again. The index of "
            "the first reachable draw of each goal is stored with the project "
            "(`space_envs.tasks.goals.freeze` finds it); the constants of `space_envs.tasks.goals.tumbling` "
            "define the criteria:",
            table(("constant", "value", "meaning"), constants),
            "Resulting initial distances of the end-effectors from their grapple points, and angular "
            "velocities of the target: minimum, median, maximum.",
            table(("difficulty", *(f"{s}, {u}" for s in SHOWN for u in ("m", "deg/s"))), measured),
        ]
    )


def _distances(task: DualArmTask, goals: TargetGoals) -> Array:
    """Distances (K, 2) of the end-effectors from their grapple points at the start, m."""
    robot = task.mechanics
    points = rotate(goals.quaternion[:, None], task.grapples(goals.half_width))
    hands = end_effectors(robot, goals.joint_position).position
    return np.linalg.norm(goals.position[:, None] + points - hands, axis=-1)


DESCRIPTIONS: dict[type[CaptureTask], Callable[[Any], str]] = {
    SingleArmClutteredTask: _cluttered,
    SingleArmTask: _single_arm,
    DualArmTask: _dual_arm,
}
