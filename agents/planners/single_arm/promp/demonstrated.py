"""ProMPs fitted to optimal motions, conditioned on a goal in task space (`promp_demonstrated`).

Optimal motions to neighbouring goals lie in several basins, so that one Gaussian over all of them is a poor
prior. Here a ProMP is fitted to each of a few groups of similar stored motions to goals near the desired one.
Each is conditioned on the goal through a roll-out of the base; samples of the one with the least cost of the
mean are projected onto the goal, and the best by eq. 20 is the plan.
"""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan, require_rest
from agents.planners.single_arm.promp.limit_conditioning import GOAL_TOLERANCE, conditioned_on_limits
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.sqp import Ending, Rows, SqpResult
from agents.planners.single_arm.weights.task_space import PoseTarget
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import ConditioningError, GaussianBasis, ProMP
from promp.nonlinear import Conditioned, NonlinearTarget, condition_nonlinear
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import to_matrix

METHOD = "promp_demonstrated"
SAMPLES = 100
CANDIDATES = 60  # stored motions with the nearest goals, from which groups are formed
GROUP = 20  # motions of a group
GROUPS = 4
# Standard deviation of each coordinate (weight_space.py) in addition to the variation of a group: so small
# that it matters only where the group alone cannot reach the goal or satisfy the limits.
ADDED_DEVIATION = 0.03
MAX_OVERLAP = 0.5  # fraction of a group that an earlier group may contain
LIMIT_TOLERANCE = 0.02  # fraction of a limit's half width; the drives compensate such violations


class Distributions:
    """Conditioned ProMPs of one problem.

    Attributes:
        space: of the problem's motions. found: the conditioned ProMPs, in the order of the cost of their
            means.
        residual: m or rad, least goal error where conditioning failed; infinite if it never did.
    """

    def __init__(self, space: WeightSpace, found: list[Conditioned], residual: float) -> None:
        self.space, self.residual = space, residual
        means = [one.promp.mean for one in found]
        order = np.argsort(space.values(space.coordinates(np.array(means)))[0]) if found else []
        self.found = [found[int(k)] for k in order]


class DemonstratedPlanner:
    """Plans for one robot and set of limits, from a library of optimal motions.

    Args:
        robot: of one arm. limits: of plans. library: that ProMPs are fitted to.
        samples: number to choose from; 0 takes the conditional mean. groups: number of ProMPs; 1 fits one to
            the GROUP nearest motions. seed: of the samples, which are the same for every plan.
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
        self.planner = OptimalPlanner(robot, limits, library, self._basis)

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """Plan the best sample within the limits.

        Raises:
            ConfigurationError: for a malformed problem or a moving goal.
        """
        reach = reach.checked(self._robot)
        require_rest(METHOD, reach)
        space, bounds, rows = self.planner.setting(replace(reach, spheres=None))
        conditioned = self.distributions(reach, space, bounds)
        if not conditioned.found:
            left = f"{conditioned.residual:.3g} m or rad left"
            reason = f"no ProMP of {self._groups} could be conditioned on the goal; {left}"
            return Failure(METHOD, Cause.SOLVER, reason)
        least = np.inf
        for found in conditioned.found:
            plan = self._best(conditioned_on_limits(found, space, bounds), space, bounds, rows)
            if isinstance(plan, ReachPlan):
                return plan
            least = min(least, plan.residual)
        count = len(conditioned.found)
        reason = f"of {count} ProMPs the best motion breaks a limit by {100 * least:.1f} % of it"
        return Failure(METHOD, Cause.INFEASIBLE, reason)

    def _best(
        self, found: Conditioned, space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...]
    ) -> ReachPlan | Failure:
        """Plan of least cost of the mean and the samples within the limits; the residual is the violation."""
        rng = np.random.default_rng(self._seed)
        samples, projected = found.project(found.promp.sample(rng, self._samples), GOAL_TOLERANCE)
        y = space.coordinates(np.concatenate([found.promp.mean[None], samples[projected]]))
        cost, goal_error = space.values(y)
        excess = np.array([max(0.0, float(bounds.excess(one).max())) for one in y])
        # Torques take longer: they are evaluated in the order of cost, until a motion satisfies them too.
        chosen = None
        for k in sorted(np.flatnonzero(excess <= LIMIT_TOLERANCE), key=lambda k: cost[k]):
            excess[k] += sum(row.violation(y[k]) for row in rows)
            if excess[k] <= LIMIT_TOLERANCE:
                chosen = int(k)
                break
        if chosen is None:
            least = float(excess.min())
            return Failure(METHOD, Cause.INFEASIBLE, "no sample is within the limits", least)
        error = float(np.abs(goal_error[chosen]).max())
        solution = SqpResult(
            y[chosen], float(cost[chosen]), error, float(excess[chosen]), found.iterations, Ending.CONVERGED
        )
        note = f"sample {chosen} of {len(y) - 1}" if chosen else "conditional mean"
        return replace(self.planner.motion(space, solution), method=METHOD, notes=note)

    def distributions(
        self, reach: Reach, space: WeightSpace, bounds: Bounds, spread: float = 1.0
    ) -> Distributions:
        """Condition ProMPs on the goal.

        Args:
            reach: checked. space, bounds: of it. spread: factor on the ProMPs' standard deviations.
        """
        axes = to_matrix(reach.end.quaternion)
        target = PoseTarget(
            self._robot,
            self._basis,
            reach.duration,
            reach.end.position,
            axes if reach.kind == "pose" else None,
            np.eye(3) if reach.keep_attitude else None,
            approach=axes if reach.kind == "axis" else None,
        )
        targets = [NonlinearTarget(target)]
        found, residual = [], np.inf
        for prior in self.priors(reach, space, spread):
            try:
                found.append(condition_nonlinear(prior, targets))
            except ConditioningError as error:
                residual = min(residual, float(np.abs(error.residual).max()))
        return Distributions(space, found, residual)

    def priors(self, reach: Reach, space: WeightSpace, spread: float = 1.0) -> list[ProMP]:
        """ProMPs of groups of stored motions to goals near a checked one.

        The motions are moved to the observed start and its rate by the minimum-energy change: the result of
        conditioning on the start if the prior's starts vary by such changes.
        """
        near = self._library.order(reach)[: CANDIDATES if self._groups > 1 else GROUP]
        coordinates = self._library.coordinates[near]
        weights, flat = space.weights(coordinates), coordinates.reshape(len(near), -1)
        free = np.kron(np.eye(self._robot.n_joints), space.shapes.free)
        added = ADDED_DEVIATION**2 * free @ free.T
        priors: list[ProMP] = []
        groups: list[set[int]] = []
        for seed in range(len(near)):
            distance = ((flat - flat[seed]) ** 2).sum(axis=1)
            members = np.argsort(distance, kind="stable")[:GROUP]
            if all(len(earlier & set(members.tolist())) <= MAX_OVERLAP * GROUP for earlier in groups):
                groups.append(set(members.tolist()))
                fitted = ProMP.fit_weights(weights[members], self._basis)
                covariance = spread**2 * (fitted.covariance + added)
                priors.append(ProMP(fitted.mean, covariance, self._basis))
            if len(priors) == self._groups:
                break
        return priors
