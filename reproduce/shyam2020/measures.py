"""Measures of a joint motion, the same for every planner and independent of the planners' own code."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import JointPath
from agents.planners.single_arm.check import joint_torques
from reproduce.shyam2020.cases import C, GoalCase, context
from space_envs.dynamics import attitude_cost, roll_out_base
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, logarithm, multiply, rotate

SAMPLES = 1001  # of a motion; every 10 ms of 10 s
EVERY = 5  # samples between those at which torques are measured
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Course:
    """A motion of the free-floating robot, K samples.

    Attributes:
        time: (K,) s. joints, rate, acceleration: (K, 7). twist: (K, 6) of the base [v; w], its own axes.
        base: (K, 3) m and attitude: (K, 4) of the base, inertial. end_effector: (K, 3) m, inertial.
        final_attitude: (4,) of the end-effector at the end.
        running: (K,) m^2/s, eq. 20 times dt so far.
    """

    time: Array
    joints: Array
    rate: Array
    acceleration: Array
    twist: Array
    base: Array
    attitude: Array
    end_effector: Array
    final_attitude: Array
    running: Array

    @property
    def angle(self) -> Array:
        """Angle (K,) of the base from its initial attitude, rad."""
        return angle_between(self.attitude, np.broadcast_to(IDENTITY, self.attitude.shape))

    @property
    def rotation(self) -> Array:
        """Rotation vector (K, 3) of the base from its initial attitude, inertial axes, rad."""
        return logarithm(self.attitude)

    @property
    def cost(self) -> float:
        """Base disturbance: eq. 20 times dt, m^2/s."""
        return float(self.running[-1])


@dataclass(frozen=True)
class LinkVectors:
    """The vectors of the paper's Fig. 2, satellite's axes, m; body 0 is the satellite.

    Attributes:
        centre: (8, 3) r, from the system's centre of mass to those of the bodies.
        inward: (7, 3) a of links 1 to 7, from the joint to the link's centre of mass.
        outward: (8, 3) b, from a body's centre of mass to the next joint; of link 7, to the end-effector.
    """

    centre: Array
    inward: Array
    outward: Array

    @property
    def joint(self) -> Array:
        """Positions (8, 3) of joints 1 to 7 and of the end-effector, m."""
        return self.centre + self.outward


def link_vectors(joints: Array) -> LinkVectors:
    """The vectors at joint angles (7,) rad."""
    arm = context().arm
    now = arm.kinematics(joints)
    place = np.vstack([now.position, arm.end_effector_pose(joints)[0]])
    centre = np.vstack([arm.com[0], now.com])
    origin = arm.mass @ centre / arm.mass.sum()
    return LinkVectors(centre - origin, now.com - now.position, place - centre)


def course(motion: JointMotion | JointPath, samples: int = SAMPLES) -> Course:
    """Sample one motion densely and roll it out; sampled motions run as cubics between their samples."""
    if isinstance(motion, JointPath):
        time = np.linspace(0.0, float(motion.time[-1]), samples)
        q, rate, acceleration = motion.sample(time)
    else:
        nodes = motion.dt * np.arange(len(motion.position))
        time = np.linspace(0.0, float(nodes[-1]), samples)
        spline = CubicHermiteSpline(nodes, motion.position, motion.velocity)
        q, rate, acceleration = spline(time), spline(time, 1), spline(time, 2)
    robot, dt = context().arm, float(time[1])
    twist = robot.base_twist(q, rate)
    base, attitude = roll_out_base(robot, q, rate, dt, twist=twist)
    local, axes = robot.end_effector_pose(q)
    integrand = attitude_cost(twist[:, None, :], 1.0, C)
    running = np.concatenate([[0.0], np.cumsum(0.5 * dt * (integrand[1:] + integrand[:-1]))])
    return Course(
        time,
        q,
        rate,
        acceleration,
        twist,
        base,
        attitude,
        base + rotate(attitude, local),
        multiply(attitude[-1], from_matrix(axes[-1])),
        running,
    )


def figures(course: Course, case: GoalCase) -> Mapping[str, float]:
    """Figures that claims and tables are made of, plain floats.

    duration, s; cost, m^2/s, eq. 20 times dt; end_attitude, peak_attitude, rad, and shift, m, largest, of the
    base; position_error, m, and rotation_error, rad, of the end-effector at the end; end_rate, rad/s, of the
    joints there; peak_rate, rad/s; peak_acceleration, rad/s^2; peak_torque, N m, of any joint.
    """
    rows = slice(None, None, EVERY)
    torque = joint_torques(
        context().model, course.joints[rows], course.rate[rows], course.acceleration[rows], course.twist[rows]
    )
    return {
        "duration": float(course.time[-1]),
        "cost": course.cost,
        "end_attitude": float(course.angle[-1]),
        "peak_attitude": float(course.angle.max()),
        "shift": float(np.linalg.norm(course.base, axis=1).max()),
        "position_error": float(np.linalg.norm(course.end_effector[-1] - case.position)),
        "rotation_error": float(angle_between(course.final_attitude, case.quaternion)),
        "end_rate": float(np.abs(course.rate[-1]).max()),
        "peak_rate": float(np.abs(course.rate).max()),
        "peak_acceleration": float(np.abs(course.acceleration).max()),
        "peak_torque": float(np.abs(torque).max()),
    }
