"""Cost on clearances below the required ones, for the planner with free paths.

The nearest points of each pair of bodies are found first and then held fixed on their links: the distance
between them has the same first derivative as the least distance. The cost is the sum of squared deficits from
the required distances; remaining deficits are measured by `clearance.py`.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.smooth import Smooth
from agents.planners.dual_arm.clearance import Links
from agents.planners.dual_arm.free_paths.nearest_points import (
    FAR,
    SOFT,
    box_distance,
    crossing,
    nearest,
    nearest_to_box,
)
from agents.planners.dual_arm.surroundings import Surroundings
from space_envs.codegen.functions import compiled
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, rotate
from space_envs.dynamics.symbolic import SymbolicRobot

POSE = 3 + 9 + 1  # numbers at each time: centre from the system's centre of mass, rotation, counted fraction
# Half sides: target, satellite; required distances: arms, satellite, target; standing; of open grippers; the
# centre of the satellite's box.
SHARED = 3 + 3 + 3 + 1 + 1 + 3
PARAMETERS = POSE + SHARED + 1  # at each time, with the weight of deficits


@dataclass(frozen=True, eq=False)
class Nearness:
    """Functions of q (n), pose (13) and shared (14), compiled.

    Attributes:
        missing: -> (P,) m, deficit of each pair from its required distance, 0 if there is none.
        slope: -> that and its derivative by q (P, n).
    """

    missing: ca.Function
    slope: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot, planar: bool) -> "Nearness":
        """Build the functions of links of different arms, links and target, and satellite in space."""
        n = robot.n_joints
        q, pose, shared = ca.SX.sym("q", n), ca.SX.sym("pose", POSE), ca.SX.sym("shared", SHARED)
        pairs = _Pairs(robot, planar, q, pose, shared)
        missing = ca.fmax(ca.vertcat(*pairs.required) - ca.vertcat(*pairs.distances), 0.0)
        at = ca.vertcat(*pairs.phases)
        inputs = [q, pose, shared]
        find = ca.Function("nearest_points", inputs, list(ca.cse([ca.vertcat(*pairs.nearest)])))
        slope = ca.densify(ca.jacobian(missing, q))
        held = ca.Function("missing_held", [q, at, pose, shared], list(ca.cse([missing])))
        slope_held = ca.Function("slope_held", [q, at, pose, shared], list(ca.cse([missing, slope])))
        given = [ca.MX.sym("q", n), ca.MX.sym("pose", POSE), ca.MX.sym("shared", SHARED)]
        points = find(*given)
        functions = {
            "missing": ca.Function("missing", given, [held(given[0], points, *given[1:])]),
            "slope": ca.Function("missing_slope", given, list(slope_held(given[0], points, *given[1:]))),
        }
        return cls(**compiled(functions))

    def added_to(self, energy: Smooth, n: int) -> Smooth:
        """Sum energy + weight |missing|^2, a function of q, qdot and [pose; shared; weight], with the
        Gauss-Newton approximation of the second derivative."""
        y = [ca.MX.sym("q", n), ca.MX.sym("qdot", n)]
        p, factor = ca.MX.sym("p", PARAMETERS), ca.MX.sym("factor")
        pose, shared, weight = p[:POSE], p[POSE:-1], p[-1]
        missing = self.missing(y[0], pose, shared)
        deficit, slope = self.slope(y[0], pose, shared)
        gradient = ca.horzcat(2.0 * weight * (deficit.T @ slope), ca.MX.zeros(1, n))
        bend = ca.diagcat(2.0 * weight * factor * (slope.T @ slope), ca.MX.zeros(n, n))
        return Smooth(
            ca.Function("clear_value", [*y, p], [energy.value(*y) + weight * ca.dot(missing, missing)]),
            ca.Function("clear_slope", [*y, p], [energy.slope(*y) + gradient]),
            ca.Function("clear_bend", [*y, p, factor], [energy.bend(*y, factor) + ca.densify(bend)]),
        )


class _Pairs:
    """Pairs of bodies: their distances at given points, required distances, and nearest points.

    Attributes:
        distances, required: m. phases: symbols that give the points. nearest: values of the phases.
    """

    def __init__(self, robot: FloatingRobot, planar: bool, q: ca.SX, pose: ca.SX, shared: ca.SX) -> None:
        self._links, self._planar = Links.of(robot), planar
        self._pose, self._shared = pose, shared
        rotation, position, _, _, centre = SymbolicRobot(robot).kinematics(q)
        self._begin = [position[:, int(link) - 1] for link in self._links.link]
        self._end = [
            begin + rotation[:, 3 * (int(link) - 1) : 3 * int(link)] @ ca.DM(end)
            for begin, link, end in zip(self._begin, self._links.link, self._links.end, strict=True)
        ]
        self._target = ca.reshape(pose[3:12], 3, 3), pose[:3] + centre  # in the base frame
        self.distances, self.required = list[ca.SX](), list[ca.SX]()
        self.nearest, self.phases = list[ca.SX](), list[ca.SX]()
        self._add_arms()
        for link in range(len(self._links.link)):
            self._add_boxes(link)

    def _add(self, distance: ca.SX, required: ca.SX, nearest: ca.SX, phase: ca.SX) -> None:
        self.distances.append(distance)
        self.required.append(required)
        self.nearest.append(nearest)
        self.phases.append(phase)

    def _add_arms(self) -> None:
        """Pairs of links of different arms."""
        for one in np.flatnonzero(self._links.arm == 0):
            for other in np.flatnonzero(self._links.arm == 1):
                segments = self._begin[one], self._end[one], self._begin[other], self._end[other]
                for points in crossing(*segments) if self._planar else [nearest(*segments)]:
                    at = ca.SX.sym("at", 4)
                    gap = segments[0] + at[0] * (segments[1] - segments[0])
                    gap -= segments[2] + at[1] * (segments[3] - segments[2])
                    distance = at[2] * ca.sqrt(ca.dot(gap, gap) + SOFT**2) + at[3]
                    self._add(distance, self._shared[6], points, at)

    def _add_boxes(self, link: int) -> None:
        """A link and the target and, in space, the satellite."""
        shared, last, counted = self._shared, self._links.last[link], self._pose[12]
        axes, centre = self._target
        begin, end = self._begin[link], self._end[link]
        a, b = (axes.T @ (point - centre) for point in (begin, end))
        boxes = [(a, a + (counted if last else 1.0) * (b - a), shared[:3], shared[8])]
        if last:  # an open gripper counts by its centre line
            boxes.append((a + counted * (b - a), b, shared[:3], shared[10]))
        if not self._planar:
            counts = shared[9] <= float(self._links.order[link])
            first, second = (point - shared[11:14] for point in (begin, end))
            boxes.append((first, second, shared[3:6], ca.if_else(counts, shared[7], -FAR)))
        for a, b, half, required in boxes:
            at = ca.SX.sym("at")
            self._add(box_distance(a + at * (b - a), half), required, nearest_to_box(a, b, half), at)


def parameters(
    robot: FloatingRobot,
    around: Surroundings,
    start: Array,
    times: Array,
    duration: float,
    poses: tuple[Array, Array] | None,
    extra: float,
    weight: Array | float,
) -> Array:
    """Parameters [pose; shared; weight] (K, 28) of `Nearness.added_to` at times (K,) s of a plan.

    Args:
        poses: centre (K, 3) m and quaternion (K, 4) of the target at these times. extra: m, of clearance
            beyond the margin.
        weight: (K,) or one for all.
    """
    required = around.margin + extra + around.radius
    p = np.zeros((len(times), PARAMETERS))
    p[:, :3], p[:, 3:12:4], p[:, 12] = FAR, 1.0, 1.0
    target, bus = np.ones(3), np.full(3, -FAR)
    if around.target is not None and poses is not None:
        target = around.target
        centre, quaternion = poses
        p[:, :3] = centre - robot.centre_of_mass(robot.kinematics(start))
        columns = [rotate(quaternion, np.broadcast_to(unit, (len(times), 3))) for unit in np.eye(3)]
        p[:, 3:12] = np.concatenate(columns, axis=1)
        length = np.linalg.norm(robot.end_effector_offset[:1], axis=1)
        p[:, 12] = around.counted(length, times, duration)[:, 0]
    if around.bus is not None:
        bus = around.bus
    arms = required + around.radius if around.arms else -FAR
    line = required - around.radius
    distances = arms, required, required, around.standing, line
    p[:, POSE:-1] = [*target, *bus, *distances, *around.bus_centre]
    p[:, -1] = weight
    return p
