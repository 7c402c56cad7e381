"""Ways around keep-out spheres from the variance of ProMPs (`promp_avoiding`): sample, reject, refine.

The paper leaves this to future work. The ProMPs of demonstrated.py, conditioned on the goal, are widened;
their samples, projected onto the goal, go around spheres on many sides. Those that come least near are
refined: the optimiser takes them to the cheapest motion of their side within all limits.
"""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.weights.inequalities import ROOM_SPHERE, Spheres
from agents.planners.single_arm.weights.quadratic import Bounds
from agents.planners.single_arm.weights.sqp import MISS, Rows, minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.robots.parameters import SINGLE_ARM

METHOD = "promp_avoiding"
GROUPS = 4  # ProMPs
SPREADS = (1.0, 3.0, 6.0)  # factors on their standard deviations
SAMPLES = 50  # of each ProMP at each spread
REFINED = 6  # samples
ENOUGH = 2  # refined motions that are clear, of which the cheaper is taken
APART = 0.1  # in coordinates: samples nearer than that count as the same way
CLEAR = 5e-3  # m, gap to every sphere on the dense grid; tracking moves links by less
DENSE = 201  # times of that grid
FINE = 3e-3  # relative gain of an iteration below which a refinement is done
ITERATIONS = 40


class AvoidingPlanner:
    """Plans for one robot and set of limits, from a library of optimal motions without spheres.

    Args:
        robot: of one arm. limits: that plans keep. library: what ProMPs are fitted to. seed: of the samples.
            spreads: of the ProMPs that are sampled.
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
        """The cheapest of the refined motions that are clear of all spheres, or why there is none."""
        reach = reach.checked(self._robot)
        planner = self._demonstrated.planner
        space, bounds, rows = planner.setting(reach)
        starts = self._starts(reach, space, bounds)
        if not len(starts):
            return Failure(METHOD, Cause.SOLVER, f"none of {GROUPS} ProMPs could be conditioned on the goal")
        clear: list[ReachPlan] = []
        nearest, unsolved = -np.inf, 0
        for tried, start in enumerate(starts, 1):
            found = minimise(space, bounds, start, reach.keep_attitude, rows, FINE, ITERATIONS)
            if found.miss > 10.0 * MISS or _over(bounds, rows, found.y) > 0.1:
                unsolved += 1
                continue
            motion = planner.motion(space, found)
            gap = self._gap(reach, motion)
            nearest = max(nearest, gap)
            if gap >= CLEAR:
                note = f"refined sample {tried} of {len(starts)}, gap {1e3 * gap:.0f} mm"
                clear.append(replace(motion, method=METHOD, notes=note))
            if len(clear) == ENOUGH:
                break
        if clear:
            return min(clear, key=lambda motion: motion.cost)
        if unsolved == len(starts):
            reason = f"none of {unsolved} samples could be refined to the goal within the limits"
            return Failure(METHOD, Cause.SOLVER, reason)
        reason = (
            f"of {len(starts) - unsolved} refined motions the clearest has a gap of {1e3 * nearest:.1f} mm"
        )
        return Failure(METHOD, Cause.CLEARANCE, f"{reason}; {1e3 * CLEAR:.0f} mm are asked for")

    def _starts(self, reach: Reach, space: WeightSpace, bounds: Bounds) -> Array:
        """Coordinates (REFINED, n, m) of different samples that come least near to spheres."""
        y = self._samples(reach, space, bounds)
        if not len(y) or reach.spheres is None or not len(reach.spheres):
            return y[:1]
        spheres = Spheres(space, self._robot, reach.spheres, SINGLE_ARM.link_radius)
        # Depth inside spheres, summed over the grid, first; then the cost.
        inside = np.maximum(ROOM_SPHERE - spheres.gaps(y), 0.0).sum(axis=(1, 2, 3))
        over = np.array([max(0.0, float(bounds.excess(one).max())) for one in y])
        cost = space.values(y)[0]
        order = np.lexsort((cost, np.round(inside + over, 2)))
        chosen: list[int] = []
        for k in order:
            if all(np.linalg.norm(y[k] - y[other]) > APART for other in chosen):
                chosen.append(int(k))
            if len(chosen) == REFINED:
                break
        return y[chosen]

    def _samples(self, reach: Reach, space: WeightSpace, bounds: Bounds) -> Array:
        """Coordinates (S, n, m) of projected samples and conditional means, the cheapest mean first."""
        rng = np.random.default_rng(self._seed)
        parts = []
        for spread in self._spreads:
            for one in self._demonstrated.distributions(reach, space, bounds, spread).found:
                samples, met = one.sample(rng, SAMPLES)
                parts.append(np.concatenate([one.promp.mean[None], samples[met]]))
        if not parts:
            return np.zeros((0, self._robot.n_joints, space.free))
        return space.coordinates(np.concatenate(parts))

    def _gap(self, reach: Reach, motion: ReachPlan) -> float:
        """Least gap to any sphere, m, on a dense grid of another roll-out than the optimiser's."""
        if reach.spheres is None or not len(reach.spheres):
            return np.inf
        time = np.linspace(0.0, reach.duration, DENSE)
        q, qdot, _ = motion.sample(time)
        base = roll_out_base(self._robot, q, qdot, float(time[1]))
        ends = link_ends(self._robot, q, *base)
        return float(sphere_gaps(ends, reach.spheres, SINGLE_ARM.link_radius).min())


def _over(bounds: Bounds, rows: tuple[Rows, ...], y: Array) -> float:
    """By what coordinates (n, m) break bounds and rows together."""
    return max(0.0, float(bounds.excess(y).max())) + sum(row.violation(y) for row in rows)
