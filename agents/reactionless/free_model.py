"""A robot whose base keeps its attitude, as compiled functions with first and second derivatives.

On reactionless motion the base only translates. Places with respect to the system's centre of mass are then
functions of the joint angles, and thetadot' M* thetadot (eq. 12 of shah2013) is twice the kinetic energy about
the centre of mass of a robot with that base: expressions far smaller than those of a base that turns.
"""

import threading
import warnings
from dataclasses import dataclass

import casadi as ca

from space_envs.dynamics import FloatingRobot, NoCompiledCodeWarning
from space_envs.dynamics.c_library import LibraryError, load_library
from space_envs.dynamics.symbolic import SymbolicRobot

# Second derivatives are long straight-line code: more optimisation takes minutes and wins nothing.
_PRAGMA = '#ifdef __GNUC__\n#pragma GCC optimize("O1")\n#endif\n'

_lock = threading.Lock()
_models: dict[str, "HeldAttitude"] = {}


@dataclass(frozen=True, eq=False)
class Smooth:
    """A function f(q, qdot, *parameters) of k outputs with its derivatives by y = [q; qdot].

    Attributes:
        value: -> f (k). slope: -> df/dy (k, 2 n). bend: (q, qdot, *parameters, weight (k)) -> second
            derivative (2 n, 2 n) of weight' f.
    """

    value: ca.Function
    slope: ca.Function
    bend: ca.Function


@dataclass(frozen=True, eq=False)
class HeldAttitude:
    """The functions of one robot. Vectors are in the axes of the base; d is 2 for a planar robot, else 3.

    Attributes:
        dimensions: d. turns: number r of momentum components that the joints can cause, 1 or 3.
        energy: thetadot' M* thetadot, J, on reactionless motion.
        turning: (r,) angular momentum about the centre of mass with the base at rest, N m s: Ibm~ thetadot
            of eq. 4 of shah2013.
        tilts: number of products that say how an approach axis is tilted, 4; none in the plane.
        ending: (4 d + r + tilts,) with parameter across (3, 4): end-effectors from the system's centre of
            mass (2 d) m, their velocities (2 d) m/s, `turning` (r) and the products of the approach axes with
            two columns of `across` each.
        projected: (q, u) -> rate (n), the part of u that is reactionless.
        still: (q, u, udot) -> that rate and its time derivative along the motion with it.
        places: q -> tips (6) from the system's centre of mass, axes (6) and centre of mass (3), base axes, m.
    """

    dimensions: int
    turns: int
    tilts: int
    energy: Smooth
    turning: Smooth
    ending: Smooth
    projected: ca.Function
    still: ca.Function
    places: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "HeldAttitude":
        """The functions of a robot, made at first use and kept.

        Warns:
            NoCompiledCodeWarning: if they have to run in CasADi's virtual machine, twenty times slower.
        """
        with _lock:
            if robot.fingerprint not in _models:
                _models[robot.fingerprint] = _build(robot)
            return _models[robot.fingerprint]


def compiled(functions: dict[str, ca.Function]) -> dict[str, ca.Function]:
    """The functions as compiled code, or as they are where nothing can be compiled (with a warning)."""
    generator = ca.CodeGenerator("kernel")
    for function in functions.values():
        generator.add(function)
    try:
        path = load_library(_PRAGMA + generator.dump())._name
    except LibraryError as error:
        message = f"planning runs in CasADi's virtual machine, twenty times slower: {error}"
        warnings.warn(message, NoCompiledCodeWarning, stacklevel=4)
        return functions
    return {key: ca.external(function.name(), path) for key, function in functions.items()}


def _build(robot: FloatingRobot) -> HeldAttitude:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot, u, udot = (ca.SX.sym(name, n) for name in ("q", "qdot", "u", "udot"))
    rest = ca.SX(6, 1)
    total = symbolic.momentum(q, qdot, rest)
    mass = float(robot.mass.sum())
    links = symbolic.kinematics(q)[3]
    centre = (float(robot.mass[0]) * ca.DM(robot.com[0]) + links @ ca.DM(robot.mass[1:])) / mass
    linear, angular = total[:3], total[3:] - ca.cross(centre, total[:3])
    planar = bool(angular[0].is_zero() and angular[1].is_zero())
    turning = angular[2] if planar else angular
    energy = 2.0 * symbolic.kinetic_energy(q, qdot, rest) - ca.dot(linear, linear) / mass
    poses = [symbolic.end_effector_pose(tip)(q) for tip in range(len(robot.tip_link))]
    tips = ca.vertcat(*[position - centre for position, _ in poses])
    axes = ca.vertcat(*[rotation[:, 2] for _, rotation in poses])
    d = 2 if planar else 3
    seen = ca.vertcat(tips[:d], tips[3 : 3 + d])
    across = ca.SX.sym("across", 3, 4)
    tilt = ca.vertcat(across[:, :2].T @ axes[:3], across[:, 2:].T @ axes[3:])
    ending = ca.vertcat(seen, ca.jtimes(seen, q, qdot), turning, *([] if planar else [tilt]))
    matrix = ca.jacobian(turning, qdot)
    reactionless = u - matrix.T @ _solve(matrix @ matrix.T, matrix @ u)
    change = ca.jtimes(reactionless, q, reactionless) + ca.jtimes(reactionless, u, udot)
    functions = {
        "projected": ca.Function("projected", [q, u], ca.cse([reactionless])),
        "still": ca.Function("still", [q, u, udot], ca.cse([reactionless, change])),
        "places": ca.Function("places", [q], ca.cse([tips, axes, centre])),
    }
    for name, f, parameters in (
        ("energy", energy, []),
        ("turning", turning, []),
        ("ending", ending, [across]),
    ):
        functions |= smooth_parts(name, f, [q, qdot], parameters)
    ready = compiled(functions)

    def smooth(name: str) -> Smooth:
        return Smooth(*(ready[f"{name}_{part}"] for part in ("value", "slope", "bend")))

    return HeldAttitude(
        dimensions=d,
        turns=turning.numel(),
        tilts=0 if planar else 4,
        energy=smooth("energy"),
        turning=smooth("turning"),
        ending=smooth("ending"),
        projected=ready["projected"],
        still=ready["still"],
        places=ready["places"],
    )


def smooth_parts(name: str, f: ca.SX, of: list[ca.SX], parameters: list[ca.SX]) -> dict[str, ca.Function]:
    """The three functions of a `Smooth`, by name."""
    y, weight = ca.vertcat(*of), ca.SX.sym("weight", f.numel())
    bend = ca.hessian(ca.dot(weight, f), y)[0]
    outputs = {"value": f, "slope": ca.jacobian(f, y), "bend": bend}
    extra = {"value": [], "slope": [], "bend": [weight]}
    return {
        f"{name}_{part}": ca.Function(
            f"{name}_{part}", [*of, *parameters, *extra[part]], ca.cse([ca.densify(value)])
        )
        for part, value in outputs.items()
    }


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a symmetric system of one or three rows, by its adjugate."""
    if matrix.numel() == 1:
        return right / matrix
    a, b, c = ca.horzsplit(matrix)
    adjugate = ca.horzcat(ca.cross(b, c), ca.cross(c, a), ca.cross(a, b)).T
    return (adjugate @ right) / ca.dot(a, ca.cross(b, c))
