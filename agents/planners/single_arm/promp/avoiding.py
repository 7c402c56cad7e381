"""Motions around keep-out spheres from the variance of ProMPs (`promp_avoiding`): sample, reject, refine.

Beyond shyam2020. The ProMPs of demonstrated.py, conditioned on the goal, are widened; their samples,
projected onto the goal, pass the spheres on different sides. Those that enter spheres least are refined: the
optimiser moves them to the optimum on their side within all limits.
"""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.inequalities.spheres import SPHERE_MARGIN, Spheres
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan, require_rest
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, Rows, minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import link_ends, sphere_gaps

METHOD = "promp_avoiding"
GROUPS = 4  # ProMPs
SPREADS = (1.0, 3.0, 6.0)  # factors on their standard deviations
SAMPLES = 50  # of each ProMP at each spread
REFINED = 6  # samples
SUFFICIENT = 2  # refined motions that are clear, of which the better one is taken
LEAST_DISTANCE = 0.1  # in coordinates, between samples that count as different
LEAST_CLEARANCE = 5e-3  # m, to every sphere on the dense grid; tracking moves links by less
DENSE = 201  # times of that grid
COST_TOLERANCE = 3e-3  # relative gain of an iteration below which a refinement ends
ITERATIONS = 40


class AvoidingPlanner:
    """Plans for one robot and set of limits, from a library of optimal motions without spheres.

    Args:
        robot: of one arm. limits: of plans. library: that ProMPs are fitted to. seed: of the samples.
        spreads: factors on standard deviations of the sampled ProMPs.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits,
        library: Library,
        seed: int = 0,
        spreads: tuple[float, ...] = SPREADS,
    ) -> None:
        self._robot, self._seed, self._spreads = robot, seed, spreads
        self._demonstrated = DemonstratedPlanner(robot, limits, library, groups=GROUPS)

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """Plan the best of the refined motions that are clear of all spheres.

        Raises:
            ConfigurationError: for a malformed problem or a moving goal.
        """
        reach = reach.checked(self._robot)
        require_rest(METHOD, reach)
        planner = self._demonstrated.planner
        space, bounds, rows = planner.setting(reach)
        starts = self._starts(reach, space, bounds)
        if not len(starts):
            return Failure(METHOD, Cause.SOLVER, f"none of {GROUPS} ProMPs could be conditioned on the goal")
        clear: list[ReachPlan] = []
        nearest, unsolved = -np.inf, 0
        for tried, start in enumerate(starts, 1):
            found = minimise(space, bounds, start, reach.keep_attitude, rows, COST_TOLERANCE, ITERATIONS)
            if found.goal_error > 10.0 * GOAL_TOLERANCE or _violation(bounds, rows, found.y) > 0.1:
                unsolved += 1
                continue
            motion = planner.motion(space, found)
            gap = self._gap(reach, motion)
            nearest = max(nearest, gap)
            if gap >= LEAST_CLEARANCE:
                note = f"refined sample {tried} of {len(starts)}, gap {1e3 * gap:.0f} mm"
                clear.append(replace(motion, method=METHOD, notes=note))
            if len(clear) == SUFFICIENT:
                break
        if clear:
            return min(clear, key=lambda motion: motion.cost)
        if unsolved == len(starts):
            reason = f"none of {unsolved} samples could be refined to the goal within the limits"
            return Failure(METHOD, Cause.SOLVER, reason)
        reason = (
            f"of {len(starts) - unsolved} refined motions the clearest has a gap of {1e3 * nearest:.1f} mm"
        )
        return Failure(METHOD, Cause.CLEARANCE, f"{reason}; {1e3 * LEAST_CLEARANCE:.0f} mm are asked for")

    def _starts(self, reach: Reach, space: WeightSpace, bounds: Bounds) -> Array:
        """Coordinates (REFINED, n, m) of different samples that enter spheres least."""
        y = self._samples(reach, space, bounds)
        if not len(y) or reach.spheres is None or not len(reach.spheres):
            return y[:1]
        spheres = Spheres(space, self._robot, reach.spheres, reach.link_radius)
        # Order by the depth inside spheres, summed over the grid, then by cost.
        inside = np.maximum(SPHERE_MARGIN - spheres.gaps(y), 0.0).sum(axis=(1, 2, 3))
        excess = np.array([max(0.0, float(bounds.excess(one).max())) for one in y])
        cost = space.values(y)[0]
        order = np.lexsort((cost, np.round(inside + excess, 2)))
        chosen: list[int] = []
        for k in order:
            if all(np.linalg.norm(y[k] - y[other]) > LEAST_DISTANCE for other in chosen):
                chosen.append(int(k))
            if len(chosen) == REFINED:
                break
        return y[chosen]

    def _samples(self, reach: Reach, space: WeightSpace, bounds: Bounds) -> Array:
        """Coordinates (S, n, m) of conditional means and projected samples, ordered by the means' costs."""
        rng = np.random.default_rng(self._seed)
        parts = []
        for spread in self._spreads:
            for one in self._demonstrated.distributions(reach, space, bounds, spread).found:
                samples, projected = one.sample(rng, SAMPLES)
                parts.append(np.concatenate([one.promp.mean[None], samples[projected]]))
        if not parts:
            return np.zeros((0, self._robot.n_joints, space.free))
        return space.coordinates(np.concatenate(parts))

    def _gap(self, reach: Reach, motion: ReachPlan) -> float:
        """Least clearance to any sphere, m, by an independent roll-out on a dense grid."""
        if reach.spheres is None or not len(reach.spheres):
            return np.inf
        time = np.linspace(0.0, reach.duration, DENSE)
        q, qdot, _ = motion.sample(time)
        base = roll_out_base(self._robot, q, qdot, float(time[1]))
        ends = link_ends(self._robot, q, *base)
        return float(sphere_gaps(ends, reach.spheres, reach.link_radius).min())


def _violation(bounds: Bounds, rows: tuple[Rows, ...], y: Array) -> float:
    """Sum of the violations of bounds and rows at coordinates (n, m)."""
    return max(0.0, float(bounds.excess(y).max())) + sum(row.violation(y) for row in rows)
