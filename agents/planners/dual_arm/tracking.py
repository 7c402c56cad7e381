"""Simulation of plans at torque level in MuJoCo, by computed torque with feed-forward and feedback.

It measures the base rate independently: that of a plan is zero by construction, while here torques are held
over a control period, the base floats freely, and momentum is simulated.
"""

from dataclasses import dataclass

import mujoco
import numpy as np
from tqdm import tqdm

from agents.planners.dual_arm.problem import CapturePlan
from space_envs.checks import non_negative
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array, rotation_angle
from space_envs.errors import ConfigurationError, positive
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.robot import Robot
from space_envs.simulation import Simulation


@dataclass(frozen=True)
class Tracking:
    """Settings of the tracking controller.

    Attributes:
        timestep: of the simulation (RK4), s. control_period: s, a multiple of timestep.
        joint_gain: 1/s^2, on the joint angles' error. attitude_gain: 1/s, on the satellite's attitude error,
            which is fed back as joint rates.
    """

    timestep: float = 0.02
    control_period: float = 0.02
    joint_gain: float = 1.0
    attitude_gain: float = 0.0

    def __post_init__(self) -> None:
        for name in ("timestep", "control_period"):
            positive(name, getattr(self, name))
        for name in ("joint_gain", "attitude_gain"):
            non_negative(name, getattr(self, name))
        substeps = self.control_period / self.timestep
        if not substeps > 0.5 or abs(substeps - round(substeps)) > 1e-9 * substeps:
            raise ConfigurationError(
                f"control_period must be a multiple of timestep, got {self.control_period} and "
                f"{self.timestep} s"
            )

    @property
    def substeps(self) -> int:
        """Steps of the simulation in a control period."""
        return round(self.control_period / self.timestep)


# docs/physics.md: settings that reach the order of the paper's 1e-9 rad/s.
FINE = Tracking(timestep=0.002, control_period=0.002, attitude_gain=0.1)


@dataclass(frozen=True, eq=False)
class Tracked:
    """Trajectories at every step of the simulation.

    Attributes:
        time: (S,) s. base_rate: (S, 3) rad/s, base axes. attitude: (S,) rad, angle from the start.
        momentum: (S,) largest component of the total momentum, N s or N m s.
        torque: (S, n) N m. position, rate: (S, n) rad and rad/s of the joints.
        joint_error: (S,) rad, largest difference from the plan.
    """

    time: Array
    base_rate: Array
    attitude: Array
    momentum: Array
    torque: Array
    position: Array
    rate: Array
    joint_error: Array

    @property
    def peak_base_rate(self) -> float:
        """rad/s, largest component."""
        return float(np.abs(self.base_rate).max())


def track(
    plan: CapturePlan,
    robot: Robot,
    how: Tracking = Tracking(),
    *,
    progress: bool = False,
) -> Tracked:
    """Simulate a plan from its first configuration at rest.

    The torque tau = M* a + h* reaches, at the end of the control period, the plan's rate there, corrected by
    the feedback; M* and h*, which are the mass matrix and the bias with the base eliminated, are those at
    the middle of the period, extrapolated from the last two.

    Args:
        plan: of a robot with two arms. robot: the same.
    """
    model = robot_model(robot, SceneOptions(timestep=how.timestep))
    simulation = _started(model, plan.position[0])
    n, b, period = simulation.n_joints, simulation.n_base, how.control_period
    periods = max(1, round(plan.time[-1] / period))
    starts = np.arange(periods) * period
    position, *_ = plan.sample(starts)
    _, rate, _ = plan.sample(np.minimum(starts + period, plan.time[-1]))
    size = periods * how.substeps
    state = np.empty((size, 7 + 6 + n + n))
    torque, momentum = np.empty((size, n)), np.empty(size)
    last = simulation.mass_matrix()[0], simulation.bias()[0].copy()
    step = 0
    for period_number in tqdm(range(periods), disable=not progress, leave=False, unit="period"):
        mass, bias = simulation.mass_matrix()[0], simulation.bias()[0].copy()
        middle, force = 1.5 * mass - 0.5 * last[0], 1.5 * bias - 0.5 * last[1]
        last = mass, bias
        now = simulation.joint_velocity[0]
        desired = rate[period_number] + _attitude_feedback(simulation, mass, how.attitude_gain)
        acceleration = (desired - now) / period + how.joint_gain * (
            position[period_number] - simulation.joint_position[0]
        )
        joints = middle[:, b:] @ acceleration + force
        simulation.ctrl[0] = joints[b:] - middle[b:, :b] @ np.linalg.solve(middle[:b, :b], joints[:b])
        for _ in range(how.substeps):
            simulation.step(1)
            qpos, qvel = simulation.robot_state()
            state[step] = np.concatenate([qpos[0, :7], qvel[0, :6], qpos[0, 7:], qvel[0, 6:]])
            torque[step] = simulation.ctrl[0]
            momentum[step] = _momentum(simulation)
            step += 1
    time = (1 + np.arange(size)) * how.timestep
    planned, *_ = plan.sample(np.minimum(time, plan.time[-1]))
    return Tracked(
        time=time,
        base_rate=state[:, 10:13],
        attitude=rotation_angle(state[:, 3:7]),
        momentum=momentum,
        torque=torque,
        position=state[:, 13 : 13 + n],
        rate=state[:, 13 + n :],
        joint_error=np.abs(state[:, 13 : 13 + n] - planned).max(axis=1),
    )


def _started(model: mujoco.MjModel, joints: Array) -> Simulation:
    simulation = Simulation(model, 1)
    simulation.reset(np.array([0]))
    simulation.joint_position[0] = joints
    simulation.refresh()
    return simulation


def _attitude_feedback(simulation: Simulation, mass: Array, gain: float) -> Array:
    """Smallest joint rates (n,) that rotate the satellite back to its initial attitude."""
    if gain == 0.0:
        return np.zeros(simulation.n_joints)
    b = simulation.n_base
    rotation_per_rate = -np.linalg.solve(mass[:b, :b], mass[:b, b:])[simulation.angular]
    attitude = simulation.base_attitude[0]
    if not simulation.planar:
        attitude = 2.0 * attitude[1:] * np.copysign(1.0, attitude[0])
    return reactionless_projection(rotation_per_rate, np.zeros(simulation.n_joints), -gain * attitude)


def _momentum(simulation: Simulation) -> float:
    """Largest component of the momentum [p; L about the satellite's centre of mass], which should be 0."""
    b = simulation.n_base
    velocity = simulation.qvel[0, : b + simulation.n_joints]
    return float(np.abs(simulation.mass_matrix()[0, :b] @ velocity).max())
