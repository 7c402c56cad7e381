"""Solutions of the collocation program of one problem, and the motions they represent."""

from dataclasses import dataclass

import numpy as np

from agents.planners.common.plans import Cause, Failure, JointPath, Limits
from agents.planners.common.solutions import Solution, solved
from agents.planners.common.splines import DEGREE
from agents.planners.single_arm.collocation.assembly import SCALE, OptionalConstraints
from agents.planners.single_arm.collocation.layout import FIXED
from agents.planners.single_arm.collocation.mesh import INTERVALS, MESH
from agents.planners.single_arm.collocation.model import SingleArm
from agents.planners.single_arm.collocation.program import ReachProgram
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array, conjugate, rotate, to_matrix
from space_envs.tasks.goals.kinds import GOAL_ROWS

METHOD = "ocp"
STEPS = 10  # of a roll-out, in an interval
FOLLOWING = 6  # times that a program is solved again with other rates at the end
RATE_TOLERANCE = 1e-5  # rad/s, of these rates
MARGIN = 1e-6  # relative, to the limits
CLEARANCE = 0.002  # m, initial margin to spheres at the nodes: in between a link may come nearer
TIGHTENING = 1.5  # times its violation is taken off a limit
LEAST_FRACTION = 0.5  # of a limit after one tightening
TOLERANCE = 1e-5  # on the violation of a program's constraints, in their units or relative to large bounds


@dataclass(frozen=True, eq=False)
class ReachSolution(Solution):
    """Solution whose motion ends with joint rates `end_rate` (n,), rad/s."""

    end_rate: Array


class ReachSolver:
    """Solver of one problem, as `Reach.checked` returns it.

    To a moving goal it is solved again with the joint rates at the end that have the goal's twist in the last
    solution's configuration, the smallest ones, until they do not change any more.
    """

    def __init__(self, robot: FloatingRobot, reach: Reach, limits: Limits) -> None:
        self.reach, self.model, self._limits = reach, SingleArm.of(robot), limits
        self._robot = robot
        self._spheres = np.zeros((0, 4)) if reach.spheres is None else reach.spheres
        self._torques: dict[str, Array] = {}  # (n,) N m, limits on torques that the program has so far
        self._clearance = CLEARANCE
        first = MESH.breaks[1] / DEGREE  # Greville abscissa of the second coefficient
        self._fixed = np.stack([reach.start, reach.start + first * reach.duration * reach.rate])
        self._com = self.model.com(reach.start).full()[:, 0]
        self._last = (1.0 - MESH.breaks[-2]) / DEGREE * reach.duration  # s, from end rate to coefficients

    @property
    def torque_limited(self) -> bool:
        """Whether the program has limits on torques so far."""
        return bool(self._torques)

    @property
    def abscissae(self) -> Array:
        """(size,) Greville abscissae of the coefficients of a path."""
        return MESH.greville

    def variables(self, path: Array) -> Array:
        """The program's variables for joint angles (size, n) at the abscissae, with constant attitude."""
        return np.concatenate([path[FIXED:-1].ravel(), np.zeros(3 * INTERVALS)])

    def fitted(self, path: JointPath) -> Array:
        """The program's variables for the splines nearest to a joint motion, with their attitudes."""
        t, value = self.reach.duration, MESH.basis(MESH.nodes)
        free = np.column_stack([value[:, FIXED:-2], value[:, -2:].sum(axis=1)])
        angles, _, _ = path.sample(MESH.nodes * t)
        end_rate = path.rate[-1]
        fixed = value[:, :FIXED] @ self._fixed + value[:, -1:] * self._last * end_rate
        coefficients = np.linalg.lstsq(free, angles - fixed)[0]
        time = np.linspace(0.0, 1.0, INTERVALS * STEPS + 1)
        everything = self._complete(coefficients, end_rate)
        q, rate = (MESH.basis(time, k) @ everything / t**k for k in range(2))
        attitude = roll_out_base(self._robot, q, rate, float(time[1]) * t)[1][STEPS::STEPS]
        return np.concatenate([coefficients.ravel(), (attitude[:, 1:] / attitude[:, :1]).ravel()])

    def solve(self, guess: Array) -> ReachSolution | Failure:
        """Solve from variables of the program."""
        rest = np.zeros(self._robot.n_joints)
        found = self._solved(guess, rest)
        if not self.reach.goal.moves:
            return found
        for _ in range(FOLLOWING):
            if isinstance(found, Failure):
                return found
            asked = self._end_rate(found)
            limit = np.inf if self._limits.rate is None else self._limits.rate
            if (np.abs(asked) > limit).any():
                reason = f"the goal's twist asks for joint rates of up to {np.abs(asked).max():.3g} rad/s"
                return Failure(METHOD, Cause.INFEASIBLE, reason)
            if np.abs(asked - found.end_rate).max() < RATE_TOLERANCE:
                return found
            found = self._solved(found.variables, asked)
        return found

    def _solved(self, guess: Array, end_rate: Array) -> ReachSolution | Failure:
        """Solve from variables of the program with joint rates (n,) at the end."""
        inputs = self.inputs(guess, end_rate)
        low, high = inputs.pop("lbg"), inputs.pop("ubg")
        # Ipopt relaxes bounds in proportion to their size.
        size = np.minimum(np.abs(low), np.abs(high))
        scale = np.where(np.isfinite(size), np.maximum(size, 1.0), 1.0)
        found = solved(METHOD, self._program().solver, (low, high), TOLERANCE, scale, **inputs)
        if isinstance(found, Failure):
            return found
        return ReachSolution(found.cost / SCALE / self.reach.duration, found.variables, end_rate)

    def inputs(self, guess: Array, end_rate: Array) -> dict[str, Array]:
        """Inputs of the program's solver, from its variables and joint rates (n,) at the end, rad/s."""
        program = self._program()
        low, high = self._constraint_bounds(program)
        low_x, high_x = self._variable_bounds(program, len(guess))
        bounds = {"lbx": low_x, "ubx": high_x, "lbg": low, "ubg": high}
        return {"x0": guess, "p": self._parameters(end_rate), **bounds}

    def _end_rate(self, solution: ReachSolution) -> Array:
        """Smallest joint rates (n,), rad/s, with the goal's twist in the final configuration."""
        q = self._coefficients(solution)[-1]
        back = conjugate(np.append(1.0, solution.variables[-3:]))
        back = back / np.linalg.norm(back)
        end = self.reach.end
        local = np.concatenate([rotate(back, end.linear_velocity), rotate(back, end.angular_velocity)])
        return np.linalg.lstsq(self._robot.generalized_jacobian(q), local)[0]

    def _coefficients(self, solution: ReachSolution) -> Array:
        """All coefficients (size, n) of a solution."""
        free = solution.variables[: -3 * INTERVALS].reshape(-1, self._robot.n_joints)
        return self._complete(free, solution.end_rate)

    def _complete(self, free: Array, end_rate: Array) -> Array:
        """All coefficients (size, n) from the free ones and the joint rates (n,) at the end."""
        return np.concatenate([self._fixed, free, free[-1:] + self._last * end_rate])

    def motion(self, solution: ReachSolution) -> ReachPlan:
        """The motion of a solution, not yet checked."""
        t = self.reach.duration
        coefficients = self._coefficients(solution)
        q, rate, acceleration = (MESH.basis(MESH.breaks, k) @ coefficients / t**k for k in range(3))
        return ReachPlan(METHOD, MESH.breaks * t, q, rate, acceleration, cost=solution.cost)

    def tightened(self, solution: ReachSolution, excess: dict[str, float]) -> ReachSolution | Failure:
        """Solve again from a solution, with tighter limits on what was measured to be violated."""
        for name in ("torque", "coriolis"):
            if name in excess:
                limit = self._torques.get(name)
                if limit is None:
                    self._torques[name] = np.broadcast_to(getattr(self._limits, name), self._robot.n_joints)
                else:  # between the nodes a torque may exceed its limit by more than the limit itself
                    self._torques[name] = np.maximum(
                        limit - TIGHTENING * excess[name], LEAST_FRACTION * limit
                    )
        if "clearance" in excess:
            self._clearance += TIGHTENING * excess["clearance"]
        return self.solve(solution.variables)

    def _program(self) -> ReachProgram:
        rates = self._limits.rate is not None or self._limits.acceleration is not None
        torques = tuple(name == "torque" for name in self._torques)
        constraints = OptionalConstraints(rates, torques, len(self._spheres), self.reach.kind)
        return ReachProgram.of(self._robot, constraints)

    def _parameters(self, end_rate: Array) -> Array:
        axes = to_matrix(self.reach.end.quaternion)
        pose = [self.reach.end.position, axes.T.ravel()]
        return np.concatenate(
            [
                self._fixed.ravel(),
                self._last * end_rate,
                self._com,
                *pose,
                [self.reach.c**2],
                self._spheres.ravel(),
            ]
        )

    def _variable_bounds(self, program: ReachProgram, size: int) -> tuple[Array, Array]:
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        angles = program.free * program.joints
        sides = self._limits.angles(program.joints).T
        low[:angles], high[:angles] = (np.tile(side, program.free) for side in sides)
        if self.reach.keep_attitude:
            low[-3:] = high[-3:] = 0.0
        return low, high

    def _constraint_bounds(self, program: ReachProgram) -> tuple[Array, Array]:
        t, n, limits = self.reach.duration, program.joints, self._limits
        rate = np.inf if limits.rate is None else limits.rate * t * (1.0 - MARGIN)
        acceleration = np.inf if limits.acceleration is None else limits.acceleration * t**2 * (1.0 - MARGIN)
        torques = [most * t**2 * (1.0 - MARGIN) for most in self._torques.values()]
        rows = [*zip(program.linear, (rate, acceleration), strict=True)]
        rows += [(program.torques // n, most) for most in torques]
        symmetric = np.concatenate(
            [
                np.zeros(3 * INTERVALS + GOAL_ROWS[self.reach.kind]),
                *(np.broadcast_to(bound, (count, n)).ravel() for count, bound in rows),
            ]
        )
        radii = np.broadcast_to(self.reach.link_radius, self._robot.n_joints)[list(self.model.links)]
        least = self._spheres[:, 3, None] + radii + self._clearance
        squares = np.repeat(least**2, INTERVALS, axis=0).ravel()
        low, high = np.concatenate([-symmetric, squares]), np.full(len(squares), np.inf)
        return low, np.concatenate([symmetric, high])
