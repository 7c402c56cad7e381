"""Motion of least eq. 20 to an inertial pose as a sparse nonlinear program, by direct collocation.

Joint angles are cubic splines on a mesh; the base attitude is a variable at every break of it, and its change
between two breaks has to agree with the twists at the Gauss points (a defect that is a constraint). Time is
scaled to s = t / T: rates are multiplied by T, accelerations and torques by T squared.
"""

from dataclasses import dataclass

import casadi as ca

from agents.planners.single_arm.collocation.assembly import Assembly, OptionalConstraints
from agents.planners.single_arm.collocation.layout import Layout
from agents.planners.single_arm.collocation.mesh import MESH, sample_times
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot

# The barrier parameter starts low and decreases monotonically: adapted, motions that are nearly feasible are
# lost.
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": 150, "mu_init": 1e-2}


@dataclass(frozen=True, eq=False)
class ReachProgram:
    """Nonlinear program of one robot.

    Its variables are those of `Layout`; its parameters [first two coefficients (2 n), difference of the last
    two (n), com (3), position (3) of the goal m, its axes (9) column by column, c^2, spheres (4 K)]; its
    constraints, in this order: defects (3 N), end (6, 5 or 3, by the kind of the goal), rates and
    accelerations (rows of `linear`, n each),
    torques and clearances.

    Attributes:
        joints: n. free: number of free coefficients. linear: numbers of rows for rates and for accelerations.
        torques: number of constraints for each bound on them. clearances: number of constraints.
    """

    solver: ca.Function
    joints: int
    free: int
    linear: tuple[int, int]
    torques: int
    clearances: int

    @classmethod
    def of(cls, robot: FloatingRobot, constraints: OptionalConstraints) -> "ReachProgram":
        """Return the program of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if its functions are interpreted, up to twenty times slower.
        """
        return _build(robot, constraints)


@built_once
def _build(robot: FloatingRobot, constraints: OptionalConstraints) -> ReachProgram:
    assembly, n = Assembly(robot, constraints), robot.n_joints
    solver = assembly.program().solver({"print_time": False, "ipopt": IPOPT})
    torques = n * len(sample_times())
    return ReachProgram(solver, n, Layout(MESH, n).free, assembly.linear, torques, assembly.clearances)
