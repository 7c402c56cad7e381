"""ProMPs fitted to optimal motions, conditioned on a goal in task space (`promp_demonstrated`).

Optimal motions to neighbouring goals lie in several basins, so that one Gaussian over all of them is a poor
prior. Here a ProMP is fitted to each of a few groups of stored motions: those to goals near the one asked for
that resemble each other. Each is conditioned on the goal, through the base's roll-out; samples of the one
with the cheapest mean are projected, so that they all meet the goal, and the best by eq. 20 is taken.
"""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.promp_optimal import Planner
from agents.planners.single_arm.weights.quadratic import Bounds, QuadraticProgram
from agents.planners.single_arm.weights.sqp import Rows, SqpResult
from agents.planners.single_arm.weights.task_space import PoseTarget
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import ConditioningError, GaussianBasis, ProMP
from promp.nonlinear import Conditioned, NonlinearTarget, condition_nonlinear
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix

METHOD = "promp_demonstrated"
SAMPLES = 100
NEAR = 60  # stored motions whose goals are near, from which groups are formed
GROUP = 20  # motions of a group
GROUPS = 4
# Standard deviation of each coordinate (weight_space.py) besides what a group varies by: so
# small that it changes motions only where the group has no way to the goal or into the limits.
UNLIKE = 0.03
SHARED = 0.5  # share of a group that an earlier one may hold
LIMIT_ROUNDS = 24  # of linearisation, until the most likely motion within the limits rests
SHRINKING, LEAST_SHARE = 0.8, 0.25  # a step of more than that share of the last is halved, at most twice
STILL = 1e-4  # in coordinates, of a step that is the last
MET = 1e-5  # m and rad, within which a sample meets the goal
OVER = 0.02  # share of a limit's half width by which a motion may break it; the drives make that good


class Distributions:
    """The conditioned ProMPs of one problem.

    Attributes:
        space: of the problem's motions. found: the conditioned ProMPs, cheapest mean first.
        miss: m or rad, least that conditioning left where it failed; infinite if it did not fail.
    """

    def __init__(self, space: WeightSpace, found: list[Conditioned], miss: float) -> None:
        self.space, self.miss = space, miss
        means = [one.promp.mean for one in found]
        order = np.argsort(space.values(space.coordinates(np.array(means)))[0]) if found else []
        self.found = [found[int(k)] for k in order]


class DemonstratedPlanner:
    """Plans for one robot and set of limits, from a library of optimal motions.

    Args:
        robot: of one arm. limits: that plans keep. library: what ProMPs are fitted to.
        samples: to choose from; 0 takes the conditional mean. groups: number of ProMPs; 1 fits a single one
            to the GROUP nearest motions. seed: of the samples, which are the same for every plan.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits,
        library: Library,
        samples: int = SAMPLES,
        groups: int = GROUPS,
        seed: int = 0,
    ) -> None:
        self._robot, self._library, self._basis = robot, library, GaussianBasis()
        self._samples, self._groups, self._seed = samples, groups, seed
        self.planner = Planner(robot, limits, library, self._basis)

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """The best sample within the limits, or why there is none."""
        reach = reach.checked(self._robot)
        space, bounds, rows = self.planner.setting(replace(reach, spheres=None))
        known = self.distributions(reach, space, bounds)
        if not known.found:
            reason = (
                f"no ProMP of {self._groups} could be conditioned on the goal; {known.miss:.3g} m or rad left"
            )
            return Failure(METHOD, Cause.SOLVER, reason)
        least = np.inf
        for found in known.found:
            motion, over = self._best(self._within(found, space, bounds), space, bounds, rows)
            if motion is not None:
                return motion
            least = min(least, over)
        reason = f"of {len(known.found)} ProMPs the best motion breaks a limit by {100 * least:.1f} % of it"
        return Failure(METHOD, Cause.INFEASIBLE, reason)

    def _best(
        self, found: Conditioned, space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...]
    ) -> tuple[ReachPlan | None, float]:
        """The cheapest of the mean and the samples within the limits, and by what the best breaks them."""
        rng = np.random.default_rng(self._seed)
        samples, met = found.project(found.promp.sample(rng, self._samples), MET)
        y = space.coordinates(np.concatenate([found.promp.mean[None], samples[met]]))
        cost, miss = space.values(y)
        over = np.array([max(0.0, float(bounds.excess(one).max())) for one in y])
        # Torques take longer: they are looked at in the order of cost, until a motion keeps them too.
        chosen = None
        for k in sorted(np.flatnonzero(over <= OVER), key=lambda k: cost[k]):
            over[k] += sum(row.violation(y[k]) for row in rows)
            if over[k] <= OVER:
                chosen = int(k)
                break
        if chosen is None:
            return None, float(over.min())
        left, beyond = float(np.abs(miss[chosen]).max()), float(over[chosen])
        solution = SqpResult(y[chosen], float(cost[chosen]), left, beyond, found.iterations, "sampled")
        note = f"sample {chosen} of {len(y) - 1}" if chosen else "conditional mean"
        return replace(self.planner.motion(space, solution), method=METHOD, notes=note), 0.0

    def distributions(
        self, reach: Reach, space: WeightSpace, bounds: Bounds, spread: float = 1.0
    ) -> Distributions:
        """ProMPs conditioned on the goal.

        Args:
            reach: checked. space, bounds: of it. spread: factor on the ProMPs' standard deviations.
        """
        targets = [
            NonlinearTarget(
                PoseTarget(
                    self._robot,
                    self._basis,
                    reach.duration,
                    reach.position,
                    to_matrix(reach.quaternion),
                    np.eye(3) if reach.keep_attitude else None,
                )
            )
        ]
        found, miss = [], np.inf
        for prior in self.priors(reach, space, spread):
            try:
                found.append(condition_nonlinear(prior, targets))
            except ConditioningError as error:
                miss = min(miss, float(np.abs(error.residual).max()))
        return Distributions(space, found, miss)

    def priors(self, reach: Reach, space: WeightSpace, spread: float = 1.0) -> list[ProMP]:
        """ProMPs of groups of stored motions to goals near a checked one.

        The motions are moved to the start that was observed, and its rate, by the quietest change: that is
        what conditioning on the start gives if the prior's starts vary by such changes.
        """
        near = self._library.order(reach.position, reach.quaternion)[: NEAR if self._groups > 1 else GROUP]
        coordinates = self._library.coordinates[near]
        weights, flat = space.weights(coordinates), coordinates.reshape(len(near), -1)
        free = np.kron(np.eye(self._robot.n_joints), space.shapes.free)
        others = UNLIKE**2 * free @ free.T
        priors: list[ProMP] = []
        taken: list[set[int]] = []
        for seed in range(len(near)):
            away = ((flat - flat[seed]) ** 2).sum(axis=1)
            members = np.argsort(away, kind="stable")[:GROUP]
            if all(len(earlier & set(members.tolist())) <= SHARED * GROUP for earlier in taken):
                taken.append(set(members.tolist()))
                fitted = ProMP.fit_weights(weights[members], self._basis)
                covariance = spread**2 * (fitted.covariance + others)
                priors.append(ProMP(fitted.mean, covariance, self._basis))
            if len(priors) == self._groups:
                break
        return priors

    def _within(self, found: Conditioned, space: WeightSpace, bounds: Bounds) -> Conditioned:
        """Conditioned also on the limits that the most likely motion within all limits touches."""
        mean = space.coordinates(found.promp.mean)
        if bounds.excess(mean).max() <= 0.0:
            return found
        active, nearest = self._touched(found, space, bounds, mean)
        if not active:
            return found
        edge = NonlinearTarget(Edge(space, bounds, active, nearest))
        try:
            return condition_nonlinear(found.prior, [*found.targets, edge], space.weights(nearest))
        except ConditioningError:
            return found

    def _touched(
        self, found: Conditioned, space: WeightSpace, bounds: Bounds, y: Array
    ) -> tuple[set[tuple[int, int]], Array]:
        """Bounds on the most likely motion within all, and its coordinates (n, m), found from y.

        Linearisation and quadratic program in turn, with steps that are shortened where they do not shrink.
        """
        expected, free = space.coordinates(found.prior.mean), space.shapes.free
        out = np.kron(np.eye(len(y)), free)
        into = np.kron(np.eye(len(y)), np.linalg.pinv(free))
        precision = np.linalg.inv(into @ found.prior.covariance @ into.T)
        program, share, last = QuadraticProgram(bounds), 1.0, np.inf
        for _ in range(LIMIT_ROUNDS):
            missed, slope = found.targets[0].function(space.weights(y)[None])
            pull = precision @ (y - expected).ravel()
            solved = program.solve(precision, pull, slope[0] @ out, -missed[0], y)
            if solved is None:
                return set(), y
            size = float(np.abs(solved[0]).max())
            if size > SHRINKING * last:
                share = max(0.5 * share, LEAST_SHARE)
            y, last = y + share * solved[0].reshape(y.shape), size
            if np.abs(missed).max() <= MET and size <= STILL:
                break
        return program.pressing, y


class Edge:
    """Limits that motions shall touch, as a function of the weights; linear.

    Args:
        active: rows and joints of the bounds. y: coordinates (n, m) that say which of its sides each is.
    """

    def __init__(self, space: WeightSpace, bounds: Bounds, active: set[tuple[int, int]], y: Array) -> None:
        matrix, low, high = bounds.linear(np.zeros_like(y), active)
        value = matrix @ y.ravel()
        self._bound = np.where(value > 0.5 * (low + high), high, low)
        inverse = np.linalg.pinv(space.shapes.free)  # (m, nb)
        self._space, self._matrix = space, matrix
        self._slope = (matrix.reshape(len(matrix), *y.shape) @ inverse).reshape(len(matrix), -1)

    def __call__(self, weights: Array) -> tuple[Array, Array]:
        """How far weights (S, n, nb) are beyond the bounds (S, k), in half widths, with slopes."""
        y = self._space.coordinates(weights).reshape(len(weights), -1)
        slope = np.broadcast_to(self._slope, (len(weights), *self._slope.shape))
        return y @ self._matrix.T - self._bound, slope
