"""Batches of no rows: every batched function gives arrays of the shapes that it gives for some rows.

Each case is a function of a number of rows. What it returns for two rows says what it has to return for
none.
"""

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from dynamics_models import robot_and_model
from offenders import assert_none

from agents.demonstrations.elastic_bands import BandObstacles, joint_detour, relax, straight_path, task_detour
from agents.planners.common.inverse_kinematics import (
    JointMotion,
    floating_inverse_kinematics,
    inverse_kinematics,
    pose_error,
)
from agents.planners.common.linear_quadratic import closed_loop, receding_gains, riccati_step, terminal_weight
from agents.planners.common.plans import JointPath
from agents.planners.dual_arm.check import held_dynamics
from agents.planners.dual_arm.prescribed_paths.check import null_velocities
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.single_arm.inequalities.spheres import Spheres
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.ranking import predicted_costs
from agents.planners.single_arm.weights.task_space import PoseTarget
from agents.planners.single_arm.weights.weight_space import WeightSpace
from agents.policies.registry import control_mode, make_policy, policies_for
from promp import GaussianBasis, ProMP
from promp.nonlinear import NonlinearTarget, condition_nonlinear
from space_envs.dynamics import (
    FloatingRobot,
    attitude_cost,
    base_twist,
    minimum_jerk,
    reactionless,
    rigid_body,
    roll_out_base,
    rotations,
    spheres,
    trajectory_cost,
)
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.capsules import box_distance, point_segment, segment_distance
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES, make_task

LIMITS = np.tile([-3.0, 3.0], (7, 1))
BASIS = GaussianBasis()
PROMP = ProMP(np.zeros((7, 10)), 0.01 * np.eye(70))


def arm() -> FloatingRobot:
    return robot_and_model("single arm")[0]


@lru_cache
def arms(task: str) -> FloatingRobot:
    return make_task(f"SpaceCapture/DualArm{task}-v0", {}).mechanics


def numbers(*shape: int) -> Array:
    return np.random.default_rng(0).uniform(-1.0, 1.0, shape)


def quaternions(*shape: int) -> Array:
    q = np.random.default_rng(1).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


@lru_cache
def space() -> WeightSpace:
    robot = arm()
    place, turn = robot.end_effector_pose(robot.home + 0.1)
    return WeightSpace(robot, BASIS, robot.home, np.zeros(7), 10.0, place, turn, 1.0)


@lru_cache
def pose_target() -> PoseTarget:
    place, turn = arm().end_effector_pose(arm().home + 0.1)
    return PoseTarget(arm(), BASIS, 10.0, place, turn)


@lru_cache
def conditioned() -> Any:
    def ends(weights: Array) -> tuple[Array, Array]:
        slope = np.broadcast_to(np.kron(np.eye(7), BASIS.value(1.0)), (len(weights), 7, 70))
        return weights @ BASIS.value(1.0) - 0.1, slope

    return condition_nonlinear(PROMP, [NonlinearTarget(ends)])


def shapes(value: Any, rows: int) -> list[tuple[int, ...]]:
    """Shapes of all arrays of a result, which have the rows first."""
    if is_dataclass(value):
        value = [getattr(value, field.name) for field in fields(value)]
    if isinstance(value, (tuple, list)):
        return [shape for part in value for shape in shapes(part, rows)]
    array = np.asarray(value)
    assert array.dtype != object and array.shape[0] == rows
    return [array.shape[1:]]


def direct(q: Array, rows: Array) -> JointMotion:
    """A straight joint motion from rest at zero to q."""
    start = np.zeros_like(q)
    return JointMotion(*minimum_jerk(start, q, 10.0, 11))


def straight_ends(n: int, function: Callable[..., Any]) -> Any:
    """Inverse kinematics of n rows whose goals are the end of straight motions, base at the origin."""
    q = arm().home + 0.1 * numbers(n, 7)
    place, turn = arm().end_effector_pose(q)
    start = np.broadcast_to(arm().home, (n, 7))
    goals = place, rotations.from_matrix(turn)
    if function is inverse_kinematics:
        return function(arm(), *goals, start, LIMITS)
    return function(arm(), *goals, direct, np.zeros((n, 3)), quaternions(n), start, LIMITS)


def linear_quadratic(n: int) -> Any:
    q, r = np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(2), (n, 1, 1))
    a, b = np.eye(4) + 0.1 * np.eye(4, k=2), np.concatenate([0.005 * np.eye(2), 0.1 * np.eye(2)])
    gains, costs = receding_gains(q, r, 0.1 * np.arange(11))
    closed = closed_loop(gains, 0.1, np.zeros((11, n, 2)))
    by_time = [np.moveaxis(array, 1, 0) for array in (gains, costs, *closed)]
    return [terminal_weight(a, b, q, r), riccati_step(a, b, q, r, q), by_time]


def states(n: int) -> tuple[Array, Array]:
    place = np.concatenate([numbers(n, 4, 3), quaternions(n, 4), numbers(n, 4, 7)], axis=-1)
    return place, numbers(n, 4, 13)


def balls(n: int) -> BandObstacles:
    return BandObstacles(numbers(n, 3), 0.1 * np.ones(n))


def bands(n: int) -> tuple[Array, Array, BandObstacles]:
    return numbers(n, 7), 1.0 + numbers(n, 7), BandObstacles(0.5 * numbers(n, 7), 0.1 * np.ones(n))


CASES: dict[str, Callable[[int], Any]] = {
    "kinematics": lambda n: arm().kinematics(numbers(n, 7)),
    "momentum_matrices": lambda n: arm().momentum_matrices(numbers(n, 7)),
    "base_map": lambda n: arm().base_map(numbers(n, 7)),
    "momentum": lambda n: arm().momentum(numbers(n, 7), numbers(n, 7), numbers(n, 6)),
    "end_effector_pose": lambda n: arm().end_effector_pose(numbers(n, 7)),
    "end_effector_jacobians": lambda n: arm().end_effector_jacobians(numbers(n, 7)),
    "generalized_jacobian": lambda n: arm().generalized_jacobian(numbers(n, 7)),
    "base_twist": lambda n: base_twist(arm(), numbers(n, 7), numbers(n, 7)),
    "base_twist of the robot": lambda n: arm().base_twist(numbers(n, 7), numbers(n, 7)),
    "trajectory_cost": lambda n: trajectory_cost(arm(), numbers(n, 5, 7), numbers(n, 5, 7), 0.1),
    "attitude_cost": lambda n: attitude_cost(numbers(n, 5, 6), 0.1),
    "roll_out_base": lambda n: roll_out_base(arm(), numbers(n, 5, 7), numbers(n, 5, 7), 0.1),
    "minimum_jerk": lambda n: minimum_jerk(numbers(n, 7), numbers(n, 7), 10.0, 5)[:2],
    "link_ends": lambda n: spheres.link_ends(arm(), numbers(n, 7), numbers(n, 3), quaternions(n)),
    "sphere_gaps": lambda n: spheres.sphere_gaps(numbers(n, 8, 3), numbers(2, 4), 0.05),
    "body_motion": lambda n: body_motion(arm(), *states(n)),
    "momentum_drift": lambda n: momentum_drift(body_motion(arm(), *states(n))),
    "tumble": lambda n: rigid_body.tumble(quaternions(n), numbers(n, 3), np.ones(3), np.arange(3.0)),
    "point_motion": lambda n: rigid_body.point_motion(
        numbers(n, 3), quaternions(n), numbers(n, 3), numbers(n, 3)
    ),
    "Grapple": lambda n: tuple(
        Grapple.on_body(
            PoseTwist(numbers(n, 3), quaternions(n), numbers(n, 3), numbers(n, 3)),
            np.ones(3),
            numbers(n, 3),
            quaternions(n),
        ).at(np.arange(3.0))
    ),
    "end_effectors": lambda n: tuple(reactionless.end_effectors(arms("Spatial"), numbers(n, 14))),
    "reactionless_rates": lambda n: reactionless.reactionless_rates(
        reactionless.end_effectors(arms("Spatial"), numbers(n, 14)),
        numbers(n, 2, 3),
        numbers(n, 2, 3),
        numbers(n, 3),
    ),
    "reactionless_projection": lambda n: reactionless.reactionless_projection(
        numbers(n, 3, 14), numbers(n, 14)
    ),
    "axis_rotation": lambda n: reactionless.axis_rotation(numbers(n, 3), numbers(n, 3)),
    "reach": lambda n: tuple(
        reactionless.reach(arms("Spatial"), numbers(n, 14), numbers(n, 2, 3), numbers(n, 2, 3))
    ),
    "rotations": lambda n: [
        rotations.multiply(quaternions(n), quaternions(n)),
        rotations.rotate(quaternions(n), numbers(n, 3)),
        rotations.canonical(quaternions(n)),
        rotations.exponential(numbers(n, 3)),
        rotations.logarithm(quaternions(n)),
        rotations.angle_between(quaternions(n), quaternions(n)),
        rotations.to_matrix(quaternions(n)),
        rotations.from_matrix(rotations.to_matrix(quaternions(n))),
    ],
    "inverse_kinematics": lambda n: straight_ends(n, inverse_kinematics),
    "floating_inverse_kinematics": lambda n: straight_ends(n, floating_inverse_kinematics),
    "pose_error": lambda n: pose_error(arm(), numbers(n, 7), numbers(n, 3), quaternions(n)),
    "linear_quadratic": linear_quadratic,
    "elastic bands": lambda n: relax(straight_path(*bands(n)[:2]), bands(n)[2]),
    "joint detour": lambda n: joint_detour(*bands(n), np.linspace(0.0, 1.0, 9), 0.1),
    "task detour": lambda n: task_detour(
        arm(), *bands(n)[:2], balls(n), np.linspace(0.0, 1.0, 9), 0.1
    ),
    "WeightSpace.values": lambda n: space().values(numbers(n, 7, space().free)),
    "WeightSpace.disturbance": lambda n: space().disturbance(numbers(n, 7, space().free)),
    "WeightSpace.poses": lambda n: space().poses(numbers(n, 7, space().free)),
    "WeightSpace.displacements": lambda n: space().displacements(
        space().disturbance(numbers(n, 7, space().free)).influence
    ),
    "WeightSpace.weights": lambda n: space().coordinates(space().weights(numbers(n, 7, space().free))),
    "predicted_costs": lambda n: predicted_costs(space(), numbers(n, 7, space().free), True),
    "Spheres.gaps": lambda n: Spheres(space(), arm(), np.ones((2, 4)), 0.05).gaps(
        numbers(n, 7, space().free)
    ),
    "ArmFunctions.torque": lambda n: ArmFunctions.of(arm(), 16).torque(*(numbers(n, 7) for _ in range(3))),
    "ArmFunctions.torque_slope": lambda n: ArmFunctions.of(arm(), 16).torque_slope(
        *(numbers(n, 7) for _ in range(4))
    ),
    "PoseTarget": lambda n: pose_target()(numbers(n, 7, 10)),
    "JointPath.sample": lambda n: JointPath(
        "straight", np.array([0.0, 1.0]), np.eye(2), np.zeros((2, 2)), np.zeros((2, 2))
    ).sample(numbers(n)),
    "PolynomialPath": lambda n: PolynomialPath(
        np.zeros(4), np.ones(4), np.zeros(4), np.zeros(4), 1.0
    ).velocity(numbers(n)),
    "segment_distance": lambda n: segment_distance(*(numbers(n, 3) for _ in range(4))),
    "point_segment": lambda n: point_segment(*(numbers(n, 3) for _ in range(3))),
    "box_distance": lambda n: box_distance(numbers(n, 3), numbers(n, 3), np.ones(3)),
    "held_dynamics": lambda n: held_dynamics(arms("Spatial"), *(numbers(n, 14) for _ in range(3))),
    "null_velocities": lambda n: null_velocities(arms("Planar"), numbers(n, 6), numbers(n, 6)),
    "GaussianBasis": lambda n: [
        of(np.full(n, 0.5)) for of in (BASIS.value, BASIS.derivative, BASIS.second_derivative)
    ],
    "ProMP.sample": lambda n: PROMP.sample(np.random.default_rng(0), n),
    "ProMP.log_likelihood": lambda n: PROMP.log_likelihood(numbers(n, 7, 10)),
    "ProMP.trajectories": lambda n: tuple(PROMP.trajectories(numbers(n, 7, 10), np.linspace(0, 1, 5), 2.0)),
    "ProMP.state": lambda n: PROMP.state(np.full(n, 0.5), 2.0),
    "ProMP.state of a single motion": lambda n: ProMP(np.zeros((7, 10)), np.zeros((70, 70))).state(
        np.full(n, 0.5), 2.0
    ),
    "Conditioned.sample": lambda n: conditioned().sample(np.random.default_rng(0), n),
}  # fmt: skip


def test_no_rows_give_what_some_rows_give() -> None:
    assert_none(name for name, case in CASES.items() if shapes(case(0), 0) != shapes(case(2), 2))


@pytest.mark.parametrize("env_id", ENTRIES)
def test_policies_act_on_no_observations(env_id: str) -> None:
    for name in policies_for(env_id):
        env = CaptureVectorEnv(env_id, 1, control_mode(name))
        observation, _ = env.reset(seed=0)
        policy = make_policy(name, PolicyContext.from_env(env), 0)
        action, state = policy.predict(observation[:0])
        again, _ = policy.predict(observation[:0], state, np.zeros(0, dtype=bool))
        assert action.shape == again.shape == (0, *env.single_action_space.shape), name
