"""Solutions of the single arm's programs, and the motions that they are."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from agents.planners.common.plans import JointPath, Limits
from agents.planners.common.splines import DEGREE, Mesh
from agents.planners.single_arm.collocation.model import SingleArm, Torque
from agents.planners.single_arm.collocation.program import GIVEN, SCALE, ReachProgram, build
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.robots.parameters import SINGLE_ARM

METHOD = "ocp"
INTERVALS = 20  # of the splines: 0.5 s each where a motion takes 10 s
STEPS = 10  # of a roll-out, in an interval
ROOM = 1e-6  # relative, that is kept from the limits
CLEAR = 0.002  # m, that is kept from balls at the nodes at first: between them a link may come nearer
MORE = 1.5  # times what a limit was passed by is taken off it
LEAST = 0.5  # share of a limit that is left of it at once
LEFT = 1e-5  # largest violation of a program's constraint, in its units or of its bound, of a solution

# The barrier falls from a low value at a fixed pace: adapted, it loses motions that are nearly feasible.
_IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 150, "mu_init": 1e-2}


class ReachPrograms:
    """Programs of one robot, made at first use and kept."""

    def __init__(self, robot: FloatingRobot) -> None:
        self.robot, self.model = robot, SingleArm.of(robot)
        self.mesh = Mesh.graded(INTERVALS, 1.0, 0)
        self._built: dict[tuple[bool, tuple[bool, ...], int], ReachProgram] = {}

    @classmethod
    def of(cls, robot: FloatingRobot) -> "ReachPrograms":
        """Those of a robot.

        Warns:
            NoCompiledCodeWarning: if they have to run in CasADi's virtual machine, twenty times slower.
        """
        return _programs(robot)

    @cached_property
    def torque(self) -> Torque:
        """Joint torques."""
        return Torque(self.robot)

    def program(self, moving: bool, loads: tuple[bool, ...], spheres: int) -> ReachProgram:
        """The program with or without limits on rates and accelerations, those on torques, and with balls.

        Args:
            loads: as of `build`.
        """
        key = moving, loads, spheres
        if key not in self._built:
            options = {"print_time": False, "ipopt": _IPOPT}
            torque = self.torque if loads else None
            n = self.robot.n_joints
            self._built[key] = build(self.model, torque, loads, n, self.mesh, moving, spheres, options)
        return self._built[key]


@built_once
def _programs(robot: FloatingRobot) -> ReachPrograms:
    return ReachPrograms(robot)


@dataclass(frozen=True, eq=False)
class ReachSolution:
    """A solution of a program: eq. 20 in m^2/s, and the program's variables."""

    cost: float
    variables: Array


@dataclass(frozen=True)
class ReachUnsolved:
    """Ipopt's status, and the largest violation of a constraint that it left."""

    status: str
    left: float


class ReachSolver:
    """The programs of one reach, as `Reach.checked` gives it."""

    def __init__(self, robot: FloatingRobot, reach: Reach, limits: Limits) -> None:
        self._programs = ReachPrograms.of(robot)
        self.reach, self.model, self._limits = reach, self._programs.model, limits
        self._robot = robot
        self._spheres = np.zeros((0, 4)) if reach.spheres is None else reach.spheres
        self._loads: dict[str, float] = {}  # N m, of the limits on torques that the program has by now
        self._moving = limits.rate is not None or limits.acceleration is not None
        self._clear = CLEAR
        mesh = self._programs.mesh
        first = mesh.breaks[1] / DEGREE  # where the second coefficient stands
        self._given = np.stack([reach.start, reach.start + first * reach.duration * reach.rate])
        self._com = self.model.com(reach.start).full()[:, 0]

    def variables(self, path: Array) -> Array:
        """The program's variables from joint angles (size, n) at the splines' abscissae; no attitude yet."""
        return np.concatenate([path[GIVEN:-1].ravel(), np.zeros(3 * INTERVALS)])

    def fitted(self, path: JointPath) -> Array:
        """The program's variables whose splines come nearest to a joint motion, with the attitudes that
        they lead to."""
        mesh, t = self._programs.mesh, self.reach.duration
        value = mesh.basis(mesh.nodes)
        free = np.column_stack([value[:, GIVEN:-2], value[:, -2:].sum(axis=1)])
        angles, _, _ = path.sample(mesh.nodes * t)
        coefficients = np.linalg.lstsq(free, angles - value[:, :GIVEN] @ self._given)[0]
        time = np.linspace(0.0, 1.0, INTERVALS * STEPS + 1)
        all_of_them = np.concatenate([self._given, coefficients, coefficients[-1:]])
        q, rate = (mesh.basis(time, k) @ all_of_them / t**k for k in range(2))
        attitude = roll_out_base(self._robot, q, rate, float(time[1]) * t)[1][STEPS::STEPS]
        return np.concatenate([coefficients.ravel(), (attitude[:, 1:] / attitude[:, :1]).ravel()])

    @property
    def loaded(self) -> bool:
        """Whether the program has limits on torques by now."""
        return bool(self._loads)

    @property
    def abscissae(self) -> Array:
        """(size,) values of s at which the coefficients of a path stand."""
        return self._programs.mesh.greville

    def solve(self, begin: Array) -> ReachSolution | ReachUnsolved:
        """Solve from variables."""
        program = self._programs.program(
            self._moving, tuple(name == "torque" for name in self._loads), len(self._spheres)
        )
        low, high = self._sides(program)
        size, n = len(begin), program.joints
        low_x, high_x = np.full(size, -np.inf), np.full(size, np.inf)
        if self._limits.position is not None:
            angles = program.free * n
            low_x[:angles], high_x[:angles] = (
                np.tile(side, program.free) for side in self._limits.position.T
            )
        if self.reach.keep_attitude:
            low_x[-3:] = high_x[-3:] = 0.0
        parameters = self._parameters()
        result = program.solver(x0=begin, p=parameters, lbg=low, ubg=high, lbx=low_x, ubx=high_x)
        g, x = result["g"].full()[:, 0], result["x"].full()[:, 0]
        # Ipopt widens bounds in proportion to their size.
        size = np.minimum(np.abs(low), np.abs(high))
        passed = np.maximum(low - g, g - high) / np.where(np.isfinite(size), np.maximum(size, 1.0), 1.0)
        left = float(np.maximum(passed, 0.0).max())
        status = program.solver.stats()["return_status"]
        # A motion that fulfils the constraints is one, even if Ipopt would go on to improve it.
        if not left < LEFT or status == "Infeasible_Problem_Detected":
            return ReachUnsolved(status, left)
        return ReachSolution(float(result["f"]) / SCALE / self.reach.duration, x)

    def motion(self, solution: ReachSolution) -> ReachPlan:
        """The motion of a solution, not yet measured."""
        mesh, t = self._programs.mesh, self.reach.duration
        free = solution.variables[: -3 * INTERVALS].reshape(-1, self._robot.n_joints)
        coefficients = np.concatenate([self._given, free, free[-1:]])
        q, rate, acceleration = (mesh.basis(mesh.breaks, k) @ coefficients / t**k for k in range(3))
        return ReachPlan(METHOD, mesh.breaks * t, q, rate, acceleration, cost=solution.cost)

    def tightened(self, solution: ReachSolution, excess: dict[str, float]) -> ReachSolution | ReachUnsolved:
        """Solve again from a solution, asking for more of what was measured to be passed."""
        for name in ("torque", "coriolis"):
            if name in excess:
                limit = self._loads.get(name)
                # Between the nodes a load may be passed by more than it is.
                less = None if limit is None else max(limit - MORE * excess[name], LEAST * limit)
                self._loads[name] = getattr(self._limits, name) if less is None else less
        if "clearance" in excess:
            self._clear += MORE * excess["clearance"]
        return self.solve(solution.variables)

    def _parameters(self) -> Array:
        axes = to_matrix(self.reach.quaternion)
        return np.concatenate(
            [
                self._given.ravel(),
                self._com,
                self.reach.position,
                axes.T.ravel(),
                [self.reach.c**2],
                self._spheres.ravel(),
            ]
        )

    def _sides(self, program: ReachProgram) -> tuple[Array, Array]:
        """Bounds of the constraints."""
        t, n, limits = self.reach.duration, program.joints, self._limits
        rate = np.inf if limits.rate is None else limits.rate * t * (1.0 - ROOM)
        acceleration = np.inf if limits.acceleration is None else limits.acceleration * t**2 * (1.0 - ROOM)
        loads = [np.full(program.torques, load * t**2 * (1.0 - ROOM)) for load in self._loads.values()]
        equal = np.zeros(3 * INTERVALS + 6)
        rates, accelerations = program.linear
        even = np.concatenate(
            [
                equal,
                np.full(rates * n, rate),
                np.full(accelerations * n, acceleration),
                *loads,
            ]
        )
        least = self._spheres[:, 3] + SINGLE_ARM.link_radius + self._clear
        gaps = np.repeat(least**2, self.model.links * INTERVALS)
        return np.concatenate([-even, gaps]), np.concatenate([even, np.full(len(gaps), np.inf)])
