"""Interception of grapples on bodies that rotate at 5 deg/s, with every policy that takes moving goals."""

import sys
import time
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from tqdm import tqdm

from agents.policies.registry import POLICIES, control_mode, make_policy, policies_for
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import Array, rotate
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.registration import register
from space_envs.robots.models import MovingTarget
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.goals.poses import MovingPoseGoals
from space_envs.tasks.single_arm import SingleArmTask

RATE = np.deg2rad(5.0)
RADIUS = 0.25  # m, of the grapple from the centre of mass, along its approach axis
REACHED = 10.0  # s, at which the grapple has the pose of a goal of SingleArm
INERTIA = (10.0, 16.0, 22.0)  # kg m^2
# An interception: m, deg, m/s and deg/s relative to the grapple, for s.
TOLERANCES = {"position": 0.01, "orientation": 1.0, "linear_velocity": 0.01, "angular_velocity": 1.0}
HOLD = 0.1


@dataclass(frozen=True)
class CirclingTask(SingleArmTask):
    """The grapple circles about a principal axis of its body."""

    moving_target = MovingTarget(INERTIA, centre=(0.0, 0.0, RADIUS))
    axis: ClassVar[tuple[float, float, float]] = (1.0, 0.0, 0.0)  # of rotation at that time, grapple's axes

    def goal_block(self, split: str, block: int) -> MovingPoseGoals:
        """Motions whose grapple has the poses of SingleArm when it is reached."""
        return _moving(type(self), self.difficulty, split, block)


@dataclass(frozen=True)
class TumblingTask(CirclingTask):
    """The body rotates about its unstable axis, nearly."""

    axis = (-0.3, 0.9, 0.3)


@lru_cache(maxsize=8)
def _moving(task: type[CirclingTask], difficulty: str, split: str, block: int) -> MovingPoseGoals:
    pose = SingleArmTask(difficulty=difficulty).goal_block(split, block)
    turn = pose.quaternion
    spin = rotate(turn, RATE * np.array(task.axis) / np.linalg.norm(task.axis))
    centre = pose.position + rotate(turn, np.array([0.0, 0.0, RADIUS]))
    body = PoseTwist(centre, turn, np.zeros_like(centre), spin)
    start = Grapple.on_body(body, np.array(INERTIA), pose.position, turn).at(-REACHED)
    common = {field.name: getattr(pose, field.name) for field in fields(pose)}
    return MovingPoseGoals(**{**common, **start._asdict()})


IDS: dict[str, type[CirclingTask]] = {
    "MovingGoals/Circling-v0": CirclingTask,
    "MovingGoals/Tumbling-v0": TumblingTask,
}


@dataclass(frozen=True, eq=False)
class Interceptions:
    """Episodes (K,) of a policy.

    Attributes:
        time: (K,) s, of the interception; NaN without one.
        errors: (K, 4) then: m, deg, m/s and deg/s, relative to the grapple.
        planning: s, processor time of the first action, per episode.
    """

    time: Array
    errors: Array
    planning: float

    def cells(self) -> list[str]:
        """A row of the table, after its names."""
        met = np.isfinite(self.time)
        share = f"{100.0 * met.mean():.1f}"
        if not met.any():
            return [share, *["-"] * 5, f"{1e3 * self.planning:.0f}"]
        units = np.array([1e3, 1.0, 1e3, 1.0])
        median = np.median(self.errors[met], axis=0) * units
        times = f"{np.median(self.time[met]):.1f}"
        return [share, times, *(f"{value:.2g}" for value in median), f"{1e3 * self.planning:.0f}"]


def play(env_id: str, name: str, goals: int, **keywords: Any) -> Interceptions:
    """Episodes of a policy on the first goals of a split."""
    tight: Any = {f"{limit}_tolerance": most for limit, most in TOLERANCES.items()} | {"hold_time": HOLD}
    env = CaptureVectorEnv(env_id, goals, control_mode(name), "disabled", **tight, **keywords)
    observation, _ = env.reset(options={"index": np.arange(goals)})
    policy, state = make_policy(name, PolicyContext.from_env(env), 0), None
    met, errors = np.full(goals, np.nan), np.full((goals, 4), np.nan)
    before = time.process_time()
    planning = 0.0
    for step in range(env.task.horizon):
        action, state = policy.predict(observation, state)
        if not step:
            planning = (time.process_time() - before) / goals
        observation, _, _, _, info = env.step(action.astype(np.float32))
        new = np.flatnonzero(info["is_success"] & np.isnan(met))
        met[new] = (step + 1) * env.task.control_period
        found = env.task.errors(observation[new])
        errors[new] = np.stack(
            [
                found.position,
                np.rad2deg(found.orientation),
                found.linear_velocity,
                np.rad2deg(found.angular_velocity),
            ],
            axis=1,
        )
        if np.isfinite(met).all():
            break
    env.close()
    return Interceptions(met, errors, planning)


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.moving_goals", description=__doc__)
    parser.add_argument("--goals", type=whole, default=100, help="of the split (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    parser.add_argument("--difficulty", default="medium", help="default %(default)s")
    options = parser.parse_args()
    for env_id, task in IDS.items():
        register(env_id, task)
    check_goals(next(iter(IDS)), options.split, options.goals)
    names = [name for name in policies_for(next(iter(IDS))) if POLICIES[name].expert]
    table = []
    with tqdm(total=len(IDS) * len(names), unit="policy", leave=False) as bar:
        for env_id, task in IDS.items():
            body = task.__name__.removesuffix("Task").lower()
            for name in names:
                keywords = {"split": options.split, "difficulty": options.difficulty}
                table.append([body, name, *play(env_id, name, options.goals, **keywords).cells()])
                bar.update()
    head = ["grapple", "policy", "intercepted, %", "after, median, s", "position error, mm"]
    head += ["orientation, deg", "velocity, mm/s", "angular velocity, deg/s", "processor time of a plan, ms"]
    print(markdown_table(head, table))
    print(
        f"\n{options.goals} {options.difficulty} goals of split {options.split}; bodies rotate at "
        f"{np.rad2deg(RATE):g} deg/s, {RADIUS:g} m off the grapple. An interception is within 10 mm, 1 deg, "
        f"10 mm/s and 1 deg/s at once; errors are medians at that time. {machine_class()}."
    )


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.moving_goals", main))
