"""How the goals of a task are drawn, as part of its page: numbers from the code, distances from the goals."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from docs.reading import comments, described, number, section, table
from space_envs.dynamics.reactionless import tips
from space_envs.dynamics.rotations import Array, rotate
from space_envs.tasks import clutter, dual_arm, single_arm
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask
from space_envs.tasks.targets import Draws, TargetGoals

SPLIT_TEXT = {
    "train": "training and demonstrations",
    "validation": "held out, to choose among policies while they learn",
    "test": "the leaderboard",
    "ood": "out of distribution: goals beyond the ranges of the others, and satellites of other masses",
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
        "Goals are drawn from fixed seeds, so that a goal's index names it for ever. Without options, "
        "`reset` draws an index of the environment's split from the environment's generator.",
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
    said = comments(single_arm)["RADIUS"]
    start = task.robot.end_effector_pose(task.robot.home)[0]
    rows = []
    for difficulty in DIFFICULTIES:
        ways = [np.linalg.norm(_drawn(task, difficulty, split).position - start, axis=-1) for split in SHOWN]
        rows.append([f"`{difficulty}`", number(single_arm.RADIUS[difficulty]), *map(_spread, ways)])
    return "\n\n".join(
        [
            *_splits(task, single_arm.SPLIT_SEED),
            f"Out of distribution, the largest joint displacement is {_span(single_arm.OOD_RADIUS)} of the "
            f"radius, and the satellite's mass and inertia are {_span(single_arm.OOD_MASS)} of the nominal "
            "ones. Policies are given the nominal model all the same.",
            "Distances are those of the goals from where the end-effector starts: least, median, largest. "
            f"Radius: {said[0].lower()}{said[1:]}",
            table(("difficulty", "radius", *(f"{split}, m" for split in SHOWN)), rows),
        ]
    )


def _cluttered(task: SingleArmClutteredTask) -> str:
    robot = task.robot
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
            "Goals are drawn as those of [SingleArm](SingleArm-v0.md), by radii of the difficulties. Spheres "
            f"of {_span(clutter.SPHERE_RADIUS)} m are drawn around the minimum-jerk motion to the goal, of "
            f"{_span(clutter.OOD_SPHERE_RADIUS)} m out of distribution: one lies over that motion, so that "
            "it cannot be taken; the others lie beside it and may or may not be in the way. Which is which "
            "is not said. A scene is kept if a detour, a minimum-jerk motion with a bump in joint space, "
            "ends at the inertial goal clear of every sphere and within the limits of rate and acceleration; "
            "out of distribution, with the satellite's true mass. The numbers of scene, detour and spheres "
            "are stored with the project (`space_envs.tasks.freeze` finds them); the constants of "
            "`space_envs.tasks.clutter` say what counts:",
            table(("constant", "value", "meaning"), constants),
            f"Out of distribution, the largest joint displacement is {_span(single_arm.OOD_RADIUS)} of the "
            f"radius, and the satellite's mass and inertia are {_span(single_arm.OOD_MASS)} of the nominal "
            "ones. Policies are given the nominal model all the same.",
            "Distances of the goals from where the end-effector starts, and radii of the spheres: least, "
            "median, largest.",
            table(
                (
                    "difficulty",
                    "radius, rad",
                    *(f"{s}, {what}, m" for s in SHOWN for what in ("distance", "spheres")),
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
        if name not in ("centre", "half_width")
    ]
    measured = []
    for difficulty in DIFFICULTIES:
        cells = [f"`{difficulty}`"]
        for split in SHOWN:
            found = _drawn(task, difficulty, split)
            spin = np.rad2deg(np.linalg.norm(found.angular_velocity, axis=-1))
            cells += [_spread(_ways(task, found)), _spread(spin)]
        measured.append(cells)
    constants = [
        (f"`{name}`", number(getattr(dual_arm, name)), text)
        for name, text in comments(dual_arm).items()
        if name.isupper() and not name.startswith("_") and name != "DEFAULT_TIMESTEP"
    ]
    return "\n\n".join(
        [
            *_splits(task, task.seeds),
            f"The target's centre lies about ({number(draws.centre)}) m and its `half_width`, which is the "
            f"distance of the grapple points from the centre, {_span(draws.half_width)} m. The rest "
            "is drawn from ranges of the difficulty:",
            table(("range", *(f"`{d}`" for d in DIFFICULTIES), "what it is"), ranges),
            f"Out of distribution, the target lies {_span(dual_arm.OOD_FACTOR)} times as far from there as "
            f"these ranges go and spins up to {number(dual_arm.OOD_FACTOR[1])} times as fast, and the "
            f"satellite's mass and inertia are {_span(dual_arm.OOD_MASS)} of the nominal ones. Policies are "
            "given the nominal model all the same.",
            "Draws that no reactionless motion from rest reaches are drawn again. Which draw of each goal is "
            "the first that can be reached is stored with the project "
            "(`space_envs.tasks.freeze` finds it); the constants of `space_envs.tasks.dual_arm` "
            "say what counts:",
            table(("constant", "value", "meaning"), constants),
            "What comes of it: distance of an end-effector from its grapple point at the start, and rate of "
            "the target; least, median, largest.",
            table(("difficulty", *(f"{s}, {u}" for s in SHOWN for u in ("m", "deg/s"))), measured),
        ]
    )


def _ways(task: DualArmTask, goals: TargetGoals) -> Array:
    """Distances (K, 2) of the end-effectors from their grapple points at the start, m."""
    robot = task.robot
    points = rotate(goals.quaternion[:, None], task.grapples(goals.half_width))
    hands = tips(robot, goals.joint_position).position
    return np.linalg.norm(goals.position[:, None] + points - hands, axis=-1)


DESCRIPTIONS: dict[type[CaptureTask], Callable[[Any], str]] = {
    SingleArmClutteredTask: _cluttered,
    SingleArmTask: _single_arm,
    DualArmTask: _dual_arm,
}
