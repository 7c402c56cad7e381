"""Measures of a plan for figures and claims, independent of the planners' own code.

Quantities are recomputed from the plan's joint motion alone, with the momentum-level mathematics of
`space_envs.dynamics`, between the planner's own nodes too.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate import cumulative_simpson

from agents.planners.dual_arm.prescribed_paths.check import null_velocities
from agents.planners.dual_arm.problem import CapturePlan
from reproduce.shah2013.cases import CaptureCase, planar_robot
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot

SAMPLES = 1001  # of a motion; every 20 ms of 20 s


@dataclass(frozen=True, eq=False)
class Curves:
    """Curves of a plan, K samples.

    Attributes:
        time: (K,) s. position, rate: (K, 6) rad and rad/s of the joints. base: (K, 2) m, the satellite's
            centre of mass, which moves since the system's stays.
        velocity: (K, 4) m/s of the end-effectors: v1x, v1y, v2x, v2y, the independent velocities.
        place: (K, 2, 2) m, end-effectors. angular: (K, 2) rad/s, w1z and w2z, the dependent velocities.
        zeta: (K, 2) rad/s, the part of `angular` in the null space of eq. 9; the rest of the paper's
            zeta has no effect.
        base_rate: (K,) rad/s of the base at zero momentum: the re-integration that the paper shows.
        cost: (K,) J, thetadot' I_m thetadot, the integrand of eq. 15. energy: (K,) J s, its integral so far.
        torque: (K, 6) N m. power: (K,) W, sum over the joints of |torque rate|; net: (K,) W, of torque rate.
    """

    time: Array
    position: Array
    rate: Array
    base: Array
    velocity: Array
    place: Array
    angular: Array
    zeta: Array
    base_rate: Array
    cost: Array
    energy: Array
    torque: Array
    power: Array
    net: Array


def curves(plan: CapturePlan, samples: int = SAMPLES) -> Curves:
    """Sample a plan of the planar robot at equal times."""
    robot = planar_robot()
    time = np.linspace(0.0, float(plan.time[-1]), samples)
    position, rate, acceleration = plan.sample(time)
    now = end_effectors(robot, position)
    twist = robot.base_twist(position, rate)
    base = robot.centre_of_mass(robot.kinematics(position[:1])) - robot.centre_of_mass(
        robot.kinematics(position)
    )
    columns = np.ascontiguousarray(position.T), np.ascontiguousarray(rate.T)
    cost = 2.0 * np.array(_symbolic().kinetic_energy(*columns, np.ascontiguousarray(twist.T))).ravel()
    forces = np.array(_symbolic().inverse_dynamics(*columns, np.ascontiguousarray(acceleration.T))).T
    angular = _along(now.angular, rate)[:, :, 2]
    each = forces * rate
    return Curves(
        time=time,
        position=position,
        rate=rate,
        base=base[:, :2],
        velocity=_along(now.linear, rate)[:, :, :2].reshape(-1, 4),
        place=(now.position + base[:, None])[:, :, :2],
        angular=angular,
        zeta=null_velocities(robot, position, rate),
        base_rate=twist[:, 5],
        cost=cost,
        energy=np.asarray(cumulative_simpson(cost, x=time, initial=0.0)),
        torque=forces,
        power=np.abs(each).sum(axis=1),
        net=each.sum(axis=1),
    )


def polynomial(case: CaptureCase, start: Array, time: Array) -> Array:
    """Eq. 10: positions (K, 2, 2) m of the end-effectors from `start` (2, 2) to the grapple points."""
    goal, s = case.capture, (time / case.duration)[:, None, None]
    end, speed = goal.position[:, :2], goal.velocity[:, :2]
    v = (end - start) / case.duration
    b, c, d = 10.0 * v - 4.0 * speed, -15.0 * v + 7.0 * speed, 6.0 * v - 3.0 * speed
    return start + case.duration * (b * s**3 + c * s**4 + d * s**5)


def free_direction(robot: FloatingRobot, position: Array) -> Array:
    """Unit joint rates (K, 6) that move no end-effector and do not rotate the base."""
    return np.linalg.svd(task_rows(robot, position))[2][..., -1, :]


def task_rows(robot: FloatingRobot, position: Array) -> Array:
    """[J_g linear; I_bm~ up to a factor] (K, 5, 6): constraints of v and w0 = 0 on the joint rates."""
    now = end_effectors(robot, position)
    return np.concatenate([now.linear[..., :2, :].reshape(-1, 4, 6), now.base_angular[..., 2:, :]], axis=-2)


def record(plan: CapturePlan, course: Curves, case: CaptureCase) -> dict[str, Any]:
    """The figures of a plan that claims are decided by, plain floats.

    energy, J s (of the planner); energy_check, J s (quadrature of `Curves`); start_energy, J, kinetic, that a
    jump of the rates at t = 0 needs; work, J, of the drives, that included; peak_power, W; base_rate, rad/s,
    largest; path, m, largest distance from eq. 10 along x or y; end_position, m, and end_velocity, m/s,
    missed; spin_error, rad/s, of the end-effectors against the target; jolt, rad/s^2, fastest change of the
    dependent velocities, at jolt_time, s, and jolt_ratio, over its mean; arm1_jolt, arm2_jolt and so on, the
    same of one arm's alone, and zeta_jolt and so on of zeta; gradient, the cosine between the joint rates and
    the free direction in the metric of I_m: zero where the instantaneous energy cannot be lowered;
    least_singular, of the task's rows.
    """
    robot, goal = planar_robot(), case.capture
    start = 0.5 * float(course.cost[0])
    return {
        "energy": float(plan.energy),
        "energy_check": float(course.energy[-1]),
        "start_energy": start,
        "work": start + float(np.trapezoid(course.power, course.time)),
        "peak_power": float(course.power.max()),
        "base_rate": float(np.abs(course.base_rate).max()),
        "path": float(np.abs(course.place - polynomial(case, course.place[0], course.time)).max()),
        "end_position": float(np.abs(course.place[-1] - goal.position[:, :2]).max()),
        "end_velocity": float(np.abs(course.velocity[-1] - goal.velocity[:, :2].ravel()).max()),
        "spin_error": float(np.abs(course.angular[-1] - case.spin).max()),
        **_jolt("jolt", course.time, course.angular),
        **_jolt("arm1_jolt", course.time, course.angular[:, :1]),
        **_jolt("arm2_jolt", course.time, course.angular[:, 1:]),
        **_jolt("zeta_jolt", course.time, course.zeta),
        "gradient": _gradient(robot, course),
        "least_singular": float(np.linalg.svd(task_rows(robot, course.position))[1][:, -1].min()),
    }


def _jolt(name: str, time: Array, velocity: Array) -> dict[str, float]:
    """Fastest change of a velocity (K, m), its time, and its ratio to the mean."""
    step = time[1] - time[0]
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1) / step
    fastest, mean = int(change.argmax()), float(change.mean())
    offset = 0.0  # of the peak from its largest sample, by the parabola through its neighbours
    if 0 < fastest < len(change) - 1:
        before, at, after = change[fastest - 1 : fastest + 2].tolist()
        offset = 0.5 * (before - after) / (before - 2.0 * at + after) if before + after < 2.0 * at else 0.0
    return {
        name: float(change.max()),
        f"{name}_time": float(time[fastest] + (0.5 + offset) * step),
        f"{name}_ratio": float(change.max()) / mean if mean > 1e-9 else 0.0,
    }


def _gradient(robot: FloatingRobot, course: Curves) -> float:
    mass = np.array(_symbolic().reduced_mass(np.ascontiguousarray(course.position.T)))
    mass = mass.reshape(6, -1, 6).transpose(1, 0, 2)
    free = free_direction(robot, course.position)
    pushed = (mass @ free[..., None])[..., 0]
    slope = (pushed * course.rate).sum(axis=1)
    scale = np.sqrt((pushed * free).sum(axis=1) * np.maximum(course.cost, 1e-12))
    return float(np.abs(slope / scale)[course.cost > 1e-9].max(initial=0.0))


def _along(jacobian: Array, rate: Array) -> Array:
    return (jacobian @ rate[:, None, :, None])[..., 0]


@cache
def _symbolic() -> SymbolicRobot:
    return SymbolicRobot(planar_robot())
