"""Policies of optimal motions in the environment: captures, attitude, failures that are told."""

import numpy as np
import pytest

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.policies.single_arm.optimal import OptimalPolicy
from agents.policies.single_arm.weights import PrompOptimal, PrompOptimalKept
from space_envs.dynamics.rotations import multiply, rotate
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.robots.zoo import find_robot

ID = "SpaceCapture/SingleArm-v0"
ROBOT = find_robot("shyam2020")


def played(policy: OptimalPolicy, env: CaptureVectorEnv, goals: int) -> dict[str, np.ndarray]:
    """Final attitudes, deg, and position errors, m, of whole motions; the reset is that of the caller."""
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(goals)})
    state, start = None, None
    attitude, miss = np.empty(goals), np.empty(goals)
    for _ in range(101):
        action, state = policy.predict(observation, state, start)
        start = np.zeros(goals, dtype=bool)
        observation, *_ = env.step(action)
    quaternion = policy.context.layout.read(observation, "base_quaternion")
    attitude = np.rad2deg(2.0 * np.arccos(np.clip(np.abs(quaternion[:, 0]), 0.0, 1.0)))
    miss = np.linalg.norm(policy.context.layout.read(observation, "position_error"), axis=1)
    return {"attitude": attitude, "miss": miss}


def test_tracked_motions_keep_the_attitude_and_meet_the_goal() -> None:
    goals = 16
    for kind, most in ((PrompOptimal, np.inf), (PrompOptimalKept, 0.1)):
        # A hold that no motion fulfils: the episode goes on after the goal is reached.
        env = CaptureVectorEnv(ID, goals, hold_time=100.0)
        result = played(kind(PolicyContext.from_env(env)), env, goals)
        assert result["attitude"].max() < most
        assert result["miss"].max() < 3e-3


def test_start_and_frame_are_those_of_the_observation() -> None:
    """A satellite that stands elsewhere and turned has the same plan for a goal that moved along."""
    env = CaptureVectorEnv(ID, 1)
    context = PolicyContext.from_env(env)
    observation, _ = env.reset(options={"split": "validation", "index": np.array([3])})
    moved, layout = observation.copy(), context.layout
    turn, shift = np.array([0.6, 0.0, 0.8, 0.0]), np.array([1.0, -2.0, 0.5])
    for name in ("base", "goal"):
        place, quaternion = f"{name}_position", f"{name}_quaternion"
        moved[:, layout.slices[place]] = rotate(turn, layout.read(observation, place)) + shift
        moved[:, layout.slices[quaternion]] = multiply(turn, layout.read(observation, quaternion))
    plans = [PrompOptimal(context).predict(seen)[1] for seen in (observation, moved)]
    np.testing.assert_allclose(plans[0].position, plans[1].position, atol=2e-3)


class Refusing(OptimalPolicy):
    """Has a plan for every other row."""

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Failures and motions that rest."""
        made = []
        for number, reach in enumerate(asked):
            rest = np.tile(reach.start, (2, 1))
            motion = ReachPlan("rest", np.array([0.0, 10.0]), rest, 0.0 * rest, 0.0 * rest, 0.0)
            made.append(motion if number % 2 else Failure("rest", Cause.SOLVER, "does not want to"))
        return made


def test_failures_reach_the_record_and_the_arm_rests() -> None:
    env = CaptureVectorEnv(ID, 4)
    policy = Refusing(PolicyContext.from_env(env))
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(4)})
    action, state = policy.predict(observation)
    assert state.failures[1] is None
    assert (state.failures[2].cause, state.failures[2].reason) == ("solver", "does not want to")
    assert np.abs(action[2]).max() == 0.0


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_stored_motions_are_of_train_goals_only(keep_attitude: bool) -> None:
    library = library_of(ROBOT, keep_attitude)
    env = CaptureVectorEnv(ID, 256)
    for split in ("validation", "test"):
        goals = env.task.goals(split, np.arange(256))
        distance = np.linalg.norm(library.position[:, None] - goals.position, axis=-1)
        assert distance.min() > 1e-4
