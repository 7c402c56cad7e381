"""Goals of the dual-arm tasks: tumbling targets that a reactionless motion of the resting robot reaches.

A goal is drawn as the pose of the target `RENDEZVOUS_TIME` after the start, and is accepted if the robot can
reach it from rest without rotating its satellite.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import Reached, reach, reach_rotating
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, canonical, conjugate, multiply, rotate
from space_envs.errors import GoalError
from space_envs.robots.robot import Robot
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES
from space_envs.tasks.dual_arm import DualArmTask
from space_envs.tasks.goals.scaling import around_home, distance_scale
from space_envs.tasks.goals.stored import search_bar, stored_draws
from space_envs.tasks.goals.targets import HALF_WIDTH, TargetGoals

RENDEZVOUS_TIME = 20.0  # s after the start, when the target has the drawn pose
ATTEMPTS = 2000  # to draw a goal that can be reached
TRIED, FEW = 2, 4  # the search ends if after TRIED draws of each goal of a block fewer than FEW are accepted
REACHED = (1e-3, np.deg2rad(0.2))  # m and rad, terminal error of the motion that proves a goal reachable
LIMIT_MARGIN = 0.25  # rad, of that motion's end from the joint limits
CLEARANCE = 0.04  # m, between links and other bodies, at the start and at the end of that motion
OOD_FACTOR = (1.0, 1.5)  # of the difficulty's largest spin and displacement
OOD_MASS = (0.8, 1.2)  # factor on the satellite's mass and inertia


@dataclass(frozen=True)
class TumblingTargetTask(DualArmTask):
    """A dual-arm task whose goals are tumbling targets, drawn from seeds."""

    def goal_block(self, split: str, block: int) -> TargetGoals:
        """Goals of a block."""
        return _goal_block(type(self), self.robot, self.frozen, self.difficulty, split, block)


@lru_cache(maxsize=512)
def _goal_block(
    kind: type[DualArmTask], robot: Robot, frozen: bool, difficulty: str, split: str, block: int
) -> TargetGoals:
    """Goals block * BLOCK to (block + 1) * BLOCK - 1 of a split, drawn from seeds."""
    rows = slice(block * BLOCK, (block + 1) * BLOCK)
    task = kind(robot=robot, difficulty=difficulty)
    if frozen:
        attempts = frozen_attempts(f"{kind.kind}_{difficulty}_{split}")[rows]
    else:
        name = f"{kind.kind}-v{kind.version}-{difficulty}-{split}-{block}"
        attempts = stored_draws(robot, name, lambda: find_attempts(task, split, block))
    goals = _drawn(task, split, np.arange(BLOCK) + rows.start, attempts)
    # From the rendezvous back to the start.
    attitude, spin = tumble(
        goals.quaternion, goals.angular_velocity, np.array(task.target.inertia), np.array([-RENDEZVOUS_TIME])
    )
    return replace(goals, quaternion=canonical(attitude[:, 0]), angular_velocity=spin[:, 0])


@lru_cache(maxsize=1)
def _frozen() -> dict[str, NDArray[np.int64]]:
    with np.load(str(files("space_envs") / "tasks" / "dual_arm_attempts.npz"), allow_pickle=False) as archive:
        return {name: archive[name].astype(np.int64) for name in archive.files}


def frozen_attempts(name: str) -> NDArray[np.int64]:
    """Stored number of the first reachable draw of each goal of a split of the id's own robot."""
    return _frozen()[name]


def find_attempts(task: DualArmTask, split: str, block: int) -> NDArray[np.int64]:
    """Number (BLOCK,) of the first reachable draw of each goal of a block.

    Raises:
        GoalError: if a goal has no reachable draw, or hardly any draw of a robot is reachable.
    """
    attempts, remaining = np.zeros(BLOCK, dtype=np.int64), np.arange(BLOCK)
    bar = search_bar(task.robot)
    while len(remaining) and attempts.max() < ATTEMPTS:
        tries = int(attempts[remaining].min())
        if not task.frozen and tries >= TRIED and BLOCK - len(remaining) < FEW:
            raise _unreachable(
                task, split, f"after {tries} draws of each {BLOCK - len(remaining)} of {BLOCK} are"
            )
        # Several attempts at a time when few goals remain: small batches take as long as large ones.
        ahead = np.arange(max(BLOCK // len(remaining), 1))
        index, attempt = np.repeat(remaining, len(ahead)), (attempts[remaining][:, None] + ahead).ravel()
        tried = _drawn(task, split, block * BLOCK + index, attempt)
        ok = _reachable(task, tried).reshape(len(remaining), len(ahead))
        found = ok.any(axis=1)
        attempts[remaining] += np.where(found, ok.argmax(axis=1), len(ahead))
        remaining = remaining[~found]
        bar.update(int(found.sum()))
    bar.close()
    if len(remaining):
        raise _unreachable(task, split, f"in {ATTEMPTS} draws {len(remaining)} of {BLOCK} are not")
    return attempts


def _unreachable(task: DualArmTask, split: str, what: str) -> GoalError:
    """Error of goals that cannot be drawn, with a remedy."""
    place = [round(value, 3) for value in task.target.position]
    return GoalError(
        f"goals of split {split!r}, difficulty {task.difficulty!r}, could not be drawn for "
        f"{task.robot.name!r}: {what} in reach from rest without rotating the satellite. Give a goal to "
        "reset, or choose mounts, home or target.position so that both hands are near the nominal target at "
        f"{place} m and clear of it"
    )


def _drawn(
    task: DualArmTask, split: str, indices: NDArray[np.int64], attempts: NDArray[np.int64]
) -> TargetGoals:
    """Goals (k) at the rendezvous, from seed, index and attempt."""
    level = DIFFICULTIES.index(task.difficulty)
    drawn = [
        _draw(task, level, split == "ood", np.random.default_rng([task.seeds[split], level, *pair]))
        for pair in zip(indices.tolist(), attempts.tolist(), strict=True)
    ]
    return TargetGoals(*(np.stack(part) for part in zip(*drawn, strict=True)))


def _draw(task: DualArmTask, level: int, ood: bool, rng: np.random.Generator) -> tuple[Array, ...]:
    """Draw the fields of one goal, at the rendezvous, in the order of `TargetGoals`."""
    draws, robot, target = task.draws, task.robot, task.target
    scale = rng.uniform(*OOD_MASS) if ood else 1.0
    start = around_home(robot, rng.uniform(-1.0, 1.0, robot.n_joints), draws.start[level])
    direction = rng.uniform(-1.0, 1.0, 3) * draws.along
    least = 0.0
    if ood:
        direction *= rng.uniform(*OOD_FACTOR) / np.abs(direction).max()
        least = 1.0
    centre = (
        np.array(target.position) + distance_scale(robot, draws.reach) * draws.displacement[level] * direction
    )
    attitude = multiply(np.array(target.orientation), task.draw_attitude(rng, draws.rotation[level]))
    spin = task.draw_angular_velocity(
        rng, least * draws.spin[level], (OOD_FACTOR[1] if ood else 1.0) * draws.spin[level]
    )
    width = rng.uniform(*draws.half_width) * (target.half_width / HALF_WIDTH)
    return np.array(scale), start, centre, attitude, spin, np.array(width)


def _reachable(task: DualArmTask, goals: TargetGoals) -> NDArray[np.bool_]:
    """Whether a motion from rest ends at the goals (K), clear of everything at both ends.

    The motion is reactionless, for a robot with enough joints: position and approach axis of both
    end-effectors and the attitude of the satellite are given.
    """
    mechanics = task.mechanics
    before, _ = tumble(
        goals.quaternion, goals.angular_velocity, np.array(task.target.inertia), np.array([-RENDEZVOUS_TIME])
    )
    ok = _clear(task, goals.joint_position, replace(goals, quaternion=before[:, 0]), False)
    rows = np.flatnonzero(ok)
    if not len(rows):
        return ok
    goals = goals.take(rows)
    points = goals.position[:, None] + rotate(goals.quaternion[:, None], task.grapples(goals.half_width))
    axes = None if task.approach_axes is None else rotate(goals.quaternion[:, None], task.approach_axes)
    move = reach if task.robot.n_joints >= attitude_conditions(task) else reach_rotating
    found = move(mechanics, goals.joint_position, points, axes)
    low, high = mechanics.range.T
    inside = (found.q > low + LIMIT_MARGIN) & (found.q < high - LIMIT_MARGIN)
    ok[rows] = (found.distance < REACHED[0]) & (found.angle < REACHED[1]) & inside.all(axis=1)
    ok[rows] &= _clear(task, found.q, _seen_from_base(mechanics, goals, found), True)
    return ok


def attitude_conditions(task: DualArmTask) -> int:
    """Number of joints that keep the satellite's attitude while both end-effectors reach their goals."""
    if task.planar:
        return 1 + 2 * 2
    return 3 + 2 * (3 if task.approach_axes is None else 5)


def _seen_from_base(mechanics: FloatingRobot, goals: TargetGoals, found: Reached) -> TargetGoals:
    """Goals (K) in the frame of the satellite at the end of a motion.

    Without rotation it has moved by centimetres, within the clearance, and counts as at its initial pose.
    """
    if (found.attitude[:, 0] == 1.0).all():
        return goals
    start, end = (mechanics.centre_of_mass(mechanics.kinematics(q)) for q in (goals.joint_position, found.q))
    back = conjugate(found.attitude)
    position = rotate(back, goals.position - start) + end
    return replace(goals, position=position, quaternion=multiply(back, goals.quaternion))


def _clear(task: DualArmTask, q: Array, goals: TargetGoals, gripper: bool) -> NDArray[np.bool_]:
    """Whether the arms at q (K, n) are clear of each other, the target and the satellite."""
    least = distance_scale(task.robot, task.draws.reach) * CLEARANCE
    return task.gaps(task.mechanics, q, goals, goals.quaternion, gripper).min(axis=1) > least
