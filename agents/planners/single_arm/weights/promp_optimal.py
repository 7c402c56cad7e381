"""Optimal motions in the weights of a ProMP, in milliseconds: from stored optimal motions to new goals."""

from collections.abc import Sequence

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.inequalities import Spheres, Torques
from agents.planners.single_arm.weights.quadratic import Bounds
from agents.planners.single_arm.weights.sqp import MISS, Rows, SqpResult, minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import GaussianBasis
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.errors import positive_integer
from space_envs.robots.parameters import SINGLE_ARM

METHOD = "promp_optimal"
ROOM = 0.99  # share of rates and accelerations used at the sampling times; between them is a little more
ANGLE_ROOM = 1e-3  # rad, kept from the joint limits
NEAREST = 8  # stored motions that are looked at
TRIED = 1  # of them, that are improved; the others follow where these do not lead to the goal
MOST_LOOKED_AT = 10_000
MOST = 2  # of them, that are improved where costs disappoint
DISAPPOINTING = 1.5  # times what the best of them promised, or a quarter of them cost, from which a cost does
BROKEN = 1e-2  # share of a torque, or m, that a solution may lack in sum over the motion
PERTURBED = 6  # starts around the attitude-free motion where nothing stored leads to the goal
SPREAD = 0.1  # of these, in coordinates (the root of the integral of a joint's squared rate, per function)
NODES = 101  # of the motion that is handed out


class Planner:
    """Plans for one robot and set of limits.

    Args:
        robot: of one arm. limits: that plans keep. library: of stored motions to start from; None starts from
            rest, or from around the attitude-free motion. basis: of the weights. nearest: stored motions
            that are looked at. tried: those of them that are improved, the most promising first; the others
            follow where these do not lead to the goal.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits = Limits(),
        library: Library | None = None,
        basis: GaussianBasis = GaussianBasis(),
        nearest: int = NEAREST,
        tried: int = TRIED,
    ) -> None:
        self._robot, self._limits, self._library, self._basis = robot, limits.checked(robot), library, basis
        self._nearest, self._tried = (
            positive_integer(name, value, MOST_LOOKED_AT)
            for name, value in (("nearest", nearest), ("tried", tried))
        )

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """The cheapest motion found, or why there is none."""
        reach = reach.checked(self._robot)
        if (failure := self._out_of_reach(reach)) is not None:
            return failure
        space, bounds, rows = self.setting(reach)
        found = self._from_library(space, bounds, rows, reach)
        best = _best(found)
        if best is None:
            found += self._from_nothing(space, bounds, rows, reach.keep_attitude)
            best = _best(found)
        if best is None:
            return _failure(found, reach.duration)
        return self.motion(space, best)

    def setting(self, reach: Reach) -> tuple[WeightSpace, Bounds, tuple[Rows, ...]]:
        """The motions, bounds and further inequalities of a checked problem."""
        space = WeightSpace(
            self._robot,
            self._basis,
            reach.start,
            np.zeros_like(reach.start) if reach.rate is None else reach.rate,
            reach.duration,
            reach.position,
            to_matrix(reach.quaternion),
            reach.c,
        )
        limits, n = self._limits, self._robot.n_joints
        angles = np.tile([-np.inf, np.inf], (n, 1)) if limits.position is None else limits.position
        angles = angles + ANGLE_ROOM * np.array([1.0, -1.0])
        most = np.array([np.inf if x is None else ROOM * x for x in (limits.rate, limits.acceleration)])
        low = np.concatenate([angles[None, :, 0], np.repeat(-most[:, None], n, axis=1)])
        high = np.concatenate([angles[None, :, 1], np.repeat(most[:, None], n, axis=1)])
        rows: list[Rows] = []
        if limits.torque is not None:
            rows.append(Torques(space, limits.torque))
        if limits.coriolis is not None:
            rows.append(Torques(space, limits.coriolis, accelerating=False))
        if reach.spheres is not None and len(reach.spheres):
            rows.append(Spheres(space, self._robot, reach.spheres, SINGLE_ARM.link_radius))
        return space, Bounds(space.even, space.even_fixed, low, high), tuple(rows)

    def motion(self, space: WeightSpace, solution: SqpResult) -> ReachPlan:
        """The motion of a solution."""
        phase = np.linspace(0.0, 1.0, NODES)
        columns, t = space.weights(solution.y).T, space.duration
        return ReachPlan(
            METHOD,
            phase * t,
            self._basis.value(phase) @ columns,
            self._basis.derivative(phase) @ columns / t,
            self._basis.second_derivative(phase) @ columns / t**2,
            float(space.dense_cost(solution.y[None])[0]),
            notes=f"{solution.iterations} iterations",
        )

    def _from_library(
        self, space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...], reach: Reach
    ) -> list[SqpResult]:
        """Solutions from the stored motions that promise most."""
        if self._library is None:
            return []
        keep = reach.keep_attitude
        near = self._library.order(reach.position, reach.quaternion)[: self._nearest]
        starts = self._library.coordinates[near]
        promise = one_step(space, starts, keep)
        hoped = max(promise.min(), float(np.quantile(self._library.cost[near], 0.25)))
        found: list[SqpResult] = []
        for number, k in enumerate(np.argsort(promise, kind="stable")):
            if number >= self._tried and (best := _best(found)) is not None:
                if number >= MOST or best.cost <= DISAPPOINTING * hoped:
                    break
            found.append(minimise(space, bounds, starts[k], keep, rows))
        if rows and _best(found) is None:
            # Torques and balls bend the way; without them the goal is met first.
            for k in range(len(starts)):
                bare = minimise(space, bounds, starts[k], keep)
                if bare.miss < MISS:
                    found.append(minimise(space, bounds, bare.y, keep, rows))
        return found

    def _from_nothing(
        self, space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...], keep_attitude: bool
    ) -> list[SqpResult]:
        """Solutions without stored motions. Arms at rest cannot turn the base back to first order, so the
        attitude-kept ones start around the attitude-free one."""
        rest = np.zeros((self._robot.n_joints, space.free))
        free = minimise(space, bounds, rest, False, rows)
        if not keep_attitude:
            return [free]
        rng = np.random.default_rng(0)
        begins = free.y + SPREAD * rng.standard_normal((PERTURBED, *rest.shape))
        return [minimise(space, bounds, begin, True, rows) for begin in begins]

    def _out_of_reach(self, reach: Reach) -> Failure | None:
        """A failure if the goal is beyond a straight arm."""
        robot = self._robot
        com = robot.kinematics(reach.start).com
        centre = (robot.mass[1:] @ com + robot.mass[0] * robot.com[0]) / robot.mass.sum()
        distance, longest = float(np.linalg.norm(reach.position - centre)), robot.reach()
        if distance <= longest:
            return None
        reason = f"the goal is {distance:.2f} m from the centre of mass, the arm reaches {longest:.2f} m"
        return Failure(METHOD, Cause.OUT_OF_REACH, reason)


def one_step(space: WeightSpace, starts: Array, keep_attitude: bool) -> Array:
    """What one Gauss-Newton step from each of the starts (S, n, m) promises as cost, (S,)."""
    asked = 9 if keep_attitude else 6
    at = space.disturbance(starts)
    jacobian, equations = at.residual_slope, at.miss_slope[:, :asked]
    size, count = space.size, len(starts)
    matrix = np.zeros((count, size + asked, size + asked))
    matrix[:, :size, :size] = jacobian.swapaxes(1, 2) @ jacobian + 1e-5 * np.eye(size)
    matrix[:, size:, :size], matrix[:, :size, size:] = equations, equations.swapaxes(1, 2)
    pull = (at.residual[:, None] @ jacobian)[:, 0]
    right = np.concatenate([-pull, -at.miss[:, :asked]], axis=1)
    step = np.linalg.solve(matrix, right[..., None])[:, :size]
    left = at.residual + (jacobian @ step)[..., 0]
    return (left * left).sum(axis=1)


def _best(found: Sequence[SqpResult]) -> SqpResult | None:
    """The cheapest solution that reaches its goal."""
    usable = [one for one in found if one.miss < 10.0 * MISS and one.broken < BROKEN]
    return min(usable, key=lambda solution: solution.cost, default=None)


def _failure(found: Sequence[SqpResult], duration: float) -> Failure:
    nearest = min(found, key=lambda solution: solution.miss)
    if not np.isfinite(nearest.miss):
        return Failure(METHOD, Cause.INFEASIBLE, f"the limits leave no motion of {duration:.3g} s")
    if nearest.status == "infeasible" or nearest.miss < 10.0 * MISS:
        reason = f"no step keeps the limits; {nearest.miss:.3g} m or rad were left"
        return Failure(METHOD, Cause.INFEASIBLE, reason)
    reason = f"of {len(found)} starts the best left {nearest.miss:.3g} m or rad ({nearest.status})"
    return Failure(METHOD, Cause.SOLVER, reason)
