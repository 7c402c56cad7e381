"""Tables I and II of the paper beside what the compiled model has, and how long planning takes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from statistics import median
from time import perf_counter

import mujoco
import numpy as np

from agents.demonstrations.controller import demonstrate
from agents.demonstrations.prior import fit_prior
from agents.demonstrations.variations import DemonstratorConfig
from agents.policies.single_arm.promp import shipped_prior
from promp import ViaPoint
from reproduce.page import Table
from reproduce.shyam2020.cases import Case, context
from reproduce.shyam2020.methods import METHODS
from reproduce.shyam2020.sampling import SAMPLES, joint_goal, prior
from space_envs.dynamics import trajectory_cost
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.errors import PlanningError
from space_envs.robots.single_arm import END_EFFECTOR, SATELLITE, ModelOptions, single_arm_model

# As printed: alpha rad, a m, d m; then mass kg and Ix, Iy, Iz kg m^2, link 0 being the satellite.
TABLE_I = (
    (-pi / 2, 0.0, 0.5),
    (pi / 2, 0.0, 0.0),
    (pi / 2, 0.9, 0.0),
    (-pi / 2, 0.9, 0.0),
    (pi / 2, 0.8, 0.0),
    (-pi / 2, 0.8, 0.0),
    (pi / 2, 0.0, 0.8),
)
TABLE_II = (
    (200.0, 1400.0, 1400.0, 2040.0),
    (20.0, 0.10, 0.10, 0.10),
    (30.0, 0.25, 25.0, 25.0),
    (30.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
    (20.0, 0.25, 25.0, 25.0),
)
HOME = (0.0, 5 * pi / 4, 0.0, 0.0, pi / 2, -pi / 2, 0.0)  # rad, section VI
REPEATS = 20  # of what is timed
DEMONSTRATIONS = 30  # that are generated and fitted to see how long it takes


@dataclass(frozen=True)
class Compiled:
    """What the compiled model says of Tables I and II.

    Attributes:
        frames: (7, 3) alpha rad, a m, d m. bodies: (8, 4) mass kg and inertia kg m^2 in the axes of DH frame
            i. products: kg m^2, largest product of inertia in those axes. home: (7,) rad, of the keyframe.
        tip: (3,) m, end-effector at home in the base frame.
    """

    frames: Array
    bodies: Array
    products: float
    home: Array
    tip: Array


def compiled() -> Compiled:
    """Read the model of the paper's variant back."""
    model = single_arm_model(ModelOptions("paper"))
    names = [f"link{i}" for i in range(1, 8)]
    frames, bodies, products = [], [], 0.0
    satellite = model.body(SATELLITE)
    inertia = _inertia(satellite.inertia, satellite.iquat)
    bodies.append([satellite.mass[0], *np.diag(inertia)])
    products = _product(inertia)
    for i, name in enumerate(names):
        # Where joint i + 1 sits in the body of joint i: Tz(d) Tx(a) Rx(alpha).
        after = model.body(names[i + 1]) if i + 1 < len(names) else model.site(END_EFFECTOR)
        turn = to_matrix(after.quat)
        frames.append([np.arctan2(turn[2, 1], turn[1, 1]), after.pos[0], after.pos[2]])
        body = model.body(name)
        inertia = turn.T @ _inertia(body.inertia, body.iquat) @ turn
        bodies.append([body.mass[0], *np.diag(inertia)])
        products = max(products, _product(inertia))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    return Compiled(
        np.array(frames),
        np.array(bodies),
        products,
        data.qpos[7:].copy(),
        data.site(END_EFFECTOR).xpos.copy(),
    )


def _inertia(principal: Array, axes: Array) -> Array:
    turn = to_matrix(axes)
    return turn @ np.diag(principal) @ turn.T


def _product(inertia: Array) -> float:
    return float(np.abs(inertia - np.diag(np.diag(inertia))).max())


def model_tables() -> tuple[Table, Table]:
    """Tables I and II as compiled."""
    found = compiled()
    worst = [float(np.abs(found.frames - TABLE_I).max()), float(np.abs(found.bodies - TABLE_II).max())]
    frames = tuple(
        (str(i + 1), f"{alpha / pi:+.3g} π", f"{a:g}", f"{d:g}", f"θ{i + 1}", f"{found.home[i] / pi:.4g} π")
        for i, (alpha, a, d) in enumerate(found.frames.round(12).tolist())
    )
    bodies = tuple(
        (name, *(f"{value:g}" for value in row))
        for name, row in zip(
            ("satellite", *(f"link {i}" for i in range(1, 8))), found.bodies.round(12).tolist(), strict=True
        )
    )
    tip = ", ".join(f"{value:.5f}" for value in found.tip)
    return (
        Table(
            "Table I: Denavit-Hartenberg parameters",
            ("joint", "α [rad]", "a [m]", "d [m]", "θ", "θ at home [rad]"),
            frames,
            "Read back from the compiled MuJoCo model, standard convention; the largest difference from the "
            f"printed table is {worst[0]:.0e}, of the home angles from those of section VI "
            f"{float(np.abs(found.home - HOME).max()):.0e}. At home the end-effector is at ({tip}) m in the "
            "base frame.",
        ),
        Table(
            "Table II: masses and inertias",
            ("body", "mass [kg]", "Ix [kg m²]", "Iy [kg m²]", "Iz [kg m²]"),
            bodies,
            "Read back from the compiled MuJoCo model, about the centres of mass, axes of the DH frames; "
            f"largest difference from the printed table {worst[1]:.0e}, largest product of inertia "
            f"{found.products:.0e}. Centres of mass, which the paper does not give, are mid-link.",
        ),
    )


def step_times(case: Case, seed: int) -> Mapping[str, tuple[str, list[float]]]:
    """How long each step of V-D takes, s, one after the other in this process: label and repeats by step.

    Raises:
        PlanningError: for a goal without a joint goal.
    """
    config = DemonstratorConfig()
    started = perf_counter()
    demonstrations = demonstrate(config, seed, 0, DEMONSTRATIONS)
    making = (perf_counter() - started) / DEMONSTRATIONS
    at, bare, arm = prior(), shipped_prior(), context().arm
    goal = joint_goal(case)
    if goal is None:
        raise PlanningError(f"goal {case.index} has no joint goal to time the steps with")
    rest, duration = np.zeros_like(goal), float(at.times[-1])
    ends = [ViaPoint(0.0, case.start, rest, duration), ViaPoint(1.0, goal, rest, duration)]
    conditioned = bare.condition_on(ends)
    rng = np.random.default_rng(seed)
    motion = at.motion(conditioned.sample(rng, SAMPLES))
    return {
        "demonstration": ("one demonstration, offline (IV)", [making]),
        "fit": (
            f"fit of the ProMP to {DEMONSTRATIONS} demonstrations, offline (eq. 16, 17)",
            _times(lambda: fit_prior(demonstrations)),
        ),
        "goal": ("joint goal in the frame that the base will have", _times(lambda: joint_goal(case))),
        "condition": ("conditioning on start and goal (eq. 18, 19)", _times(lambda: bare.condition_on(ends))),
        "sample": (
            f"{SAMPLES} samples, as joint motions",
            _times(lambda: at.motion(conditioned.sample(rng, SAMPLES))),
        ),
        "cost": (
            f"their costs (eq. 20), {motion.position.shape[1]} times each",
            _times(lambda: trajectory_cost(arm, motion.position, motion.velocity, motion.dt)),
        ),
    }


def short(value: float) -> str:
    """Three digits, and no powers of ten for large numbers."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _times(call: Callable[[], object]) -> list[float]:
    call()
    found = []
    for _ in range(REPEATS):
        started = perf_counter()
        call()
        found.append(perf_counter() - started)
    return found


def time_tables(
    steps: Mapping[str, tuple[str, list[float]]], records: Sequence[Mapping[str, dict[str, float]]]
) -> tuple[Table, Table]:
    """Times of the algorithm's steps, and of planning by every method over the goals."""
    planning = []
    for key, method in METHODS.items():
        found = 1000 * np.array([record["timing"][key] for record in records])
        low, middle, high = np.quantile(found, [0.1, 0.5, 0.9])
        planning.append((method.name, *map(short, (middle, low, high, found.max()))))
    return (
        Table(
            "Steps of the algorithm",
            ("step", "median [ms]"),
            tuple((label, short(1000 * median(values))) for label, values in steps.values()),
            f"The page's own goal, one process, {REPEATS} repeats. The policy shares the gain of eq. 19 "
            "among all goals and costs its samples at every other time.",
        ),
        Table(
            "Planning times",
            ("planner", "median [ms]", "10 %", "90 %", "largest"),
            tuple(planning),
            f"From the goal pose to a motion, over {len(records)} goals, while as many processes ran as are "
            "named below. What is compiled at a first call is not counted.",
            colours=tuple(method.colour for method in METHODS.values()),
        ),
    )
