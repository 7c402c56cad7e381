"""Tests of single steps and claims of the paper's algorithm, each on one goal."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.inverse_kinematics import (
    JointMotion,
    floating_inverse_kinematics,
    inverse_kinematics,
)
from agents.planners.common.plans import Failure
from agents.policies.clearance import link_radii
from agents.policies.single_arm.minimum_jerk import minimum_jerk_profile
from agents.policies.single_arm.promp import prior_of
from agents.policies.single_arm.reaching import motion_times
from promp import ProMP, ViaPoint
from reproduce.shyam2020.cases import GoalCase, context
from reproduce.shyam2020.measures import IDENTITY, Course, course
from reproduce.shyam2020.methods import planner
from reproduce.shyam2020.sampling import DrawnSamples, prior
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.dynamics.spheres import link_ends, sphere_gaps

SPHERE_RADIUS = 0.1  # m, of the sphere in the path of the arm
ROOM = 0.03  # m, that the links have from it at start and goal; else the case is not asked about
PLACES = 50  # times at which places for it are looked for
LOCKED_STARTS = 25  # of the search with a joint locked
BEND = 0.1  # rad, of every joint at the via-point, away from the mean


def via_point_figures(case: GoalCase, goal: Array) -> dict[str, float]:
    """Largest error, rad, of a ProMP conditioned on start, goal and a via-point, at these."""
    bare, rest = prior_of(context().robot), np.zeros_like(goal)
    duration = float(prior().times[-1])
    ends = [ViaPoint(0.0, case.start, rest, duration), ViaPoint(1.0, goal, rest, duration)]
    between = bare.condition_on(ends).position(0.5) + BEND
    through = bare.condition_on([*ends, ViaPoint(0.5, between)])
    asked = ((0.0, case.start), (0.5, between), (1.0, goal))
    return {"via_point": max(float(np.abs(through.position(z) - value).max()) for z, value in asked)}


def literal_figures(case: GoalCase) -> dict[str, float]:
    """Goal errors, m and rad, where the joint goal is found as if the base did not move."""
    at, arm = prior(), context().arm
    start = case.start[None]
    found = inverse_kinematics(
        arm, case.position[None], case.quaternion[None], start, context().joint_limits, start
    )
    weights = at.weights(start, np.zeros_like(start), found.position)[0]
    motion = at.motion(weights)
    done = course(motion)
    return {
        "position_error": float(np.linalg.norm(done.end_effector[-1] - case.position)),
        "rotation_error": float(angle_between(done.final_attitude, case.quaternion)),
    }


def encoding_figures(motion: JointMotion) -> dict[str, float]:
    """A motion of the demonstrating controller in the ProMP's weights.

    Figures are the largest error over the largest joint displacement, and the numbers that the motion and its
    weights have.
    """
    positions, velocities = motion.position[None], motion.velocity[None]
    basis, duration = prior_of(context().robot).basis, motion.dt * (len(motion.position) - 1)
    fitted = ProMP.fit(positions, velocities, duration=duration, basis=basis)
    error = fitted.position(np.linspace(0.0, 1.0, len(motion.position))) - motion.position
    size = np.abs(motion.position - motion.position[0]).max()
    return {
        "error": float(np.abs(error).max() / size),
        "numbers": 2 * motion.position.size,
        "weights": fitted.mean.size,
    }


def locked_figures(case: GoalCase, starts: int = LOCKED_STARTS) -> dict[str, int]:
    """Number of joints without which a minimum-jerk motion to the goal is found, each locked by itself.

    The search is local, so that a failure from one start proves nothing: it is made from `starts` joint
    goals, the first the start itself, the others drawn within the joint limits. What none of them finds may
    exist all the same.
    """
    profile = minimum_jerk_profile(motion_times(context()))
    found_with = 0
    for joint in range(len(case.start)):
        bounds = context().joint_limits.copy()
        bounds[joint] = case.start[joint]
        drawn = np.random.default_rng(joint).uniform(
            bounds[:, 0], bounds[:, 1], (starts - 1, len(case.start))
        )
        begins = np.concatenate([case.start[None], drawn])

        def motion(goal: Array, rows: NDArray[np.int64]) -> JointMotion:
            begin = np.broadcast_to(case.start, goal.shape)
            return profile.motion(begin, np.zeros_like(begin), goal)

        for some in (begins[:1], begins[1:]):  # the first is mostly enough
            found = floating_inverse_kinematics(
                context().arm,
                np.tile(case.position, (len(some), 1)),
                np.tile(case.quaternion, (len(some), 1)),
                motion,
                np.zeros((len(some), 3)),
                np.tile(IDENTITY, (len(some), 1)),
                some,
                bounds,
            )
            if found.converged.any():
                found_with += 1
                break
    return {"still": found_with, "of": len(case.start), "starts": starts}


def sphere_in_the_path(mean: Course) -> Array | None:
    """A sphere (1, 4) in the path of a link along the mean, as far as possible from the arm at both ends.

    None where no place is far enough from both.
    """
    robot = context().arm
    ends = link_ends(robot, mean.joints, mean.base, mean.attitude)
    passed = ends[:: len(ends) // PLACES].reshape(-1, 3)
    spheres = np.column_stack([passed, np.full(len(passed), SPHERE_RADIUS)])
    gaps = sphere_gaps(ends[[0, -1]], spheres[None], _radii()).min(axis=(0, 1))
    best = int(gaps.argmax())
    return spheres[best : best + 1] if gaps[best] >= ROOM else None


def sphere_figures(case: GoalCase, drawn: DrawnSamples) -> Mapping[str, Any] | None:
    """Figures of a sphere in the mean's path: how many samples are clear of it, and a plan in the weights.

    None where there is no place for a sphere.
    """
    sphere = sphere_in_the_path(course(prior().motion(drawn.weights.mean(axis=0))))
    if sphere is None:
        return None
    ends = link_ends(context().arm, drawn.motion.position, drawn.base, drawn.attitude)
    clear = sphere_gaps(ends, sphere, _radii()).min(axis=(1, 2, 3)) > 0.0
    usable = clear & drawn.within
    found = planner(False).plan(case.reach(spheres=sphere))
    refined: dict[str, Any]
    if isinstance(found, Failure):
        refined = {"cause": str(found.cause), "reason": found.reason}
    else:
        done = course(found)
        refined = {"cost": done.cost, "gap": float(_gaps(done, sphere).min())}
    return {
        "clear": int(clear.sum()),
        "usable": int(usable.sum()),
        "cost": float(drawn.cost[usable].min()) if usable.any() else None,
        "optimal": refined,
    }


def _radii() -> Array:
    """Radii (n,) of the links, m."""
    return link_radii(context().robot)


def _gaps(done: Course, sphere: Array) -> Array:
    """Least gap (K,) m between any link and the sphere."""
    ends = link_ends(context().arm, done.joints, done.base, done.attitude)
    return sphere_gaps(ends, sphere, _radii()).min(axis=(1, 2))
