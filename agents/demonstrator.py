"""The demonstrator of shyam2020, sec. IV: the linear-quadratic controller with the paper's three variations."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.elastic_bands import Detour, Obstacles, detour
from agents.inverse_kinematics import JointGoals, JointMotion, Rows, floating_inverse_kinematics
from agents.linear_quadratic import RAMP, closed_loop, receding_gains
from agents.mpc import CONTROL_WEIGHT, POSITION_WEIGHT
from agents.tracking import DURATION
from space_envs.control import STOP_MARGIN
from space_envs.dynamics import FloatingRobot, trajectory_cost
from space_envs.dynamics.rotations import Array
from space_envs.errors import PlanningError, unknown_name
from space_envs.models.parameters import SINGLE_ARM, VARIANTS
from space_envs.tasks.common import DIFFICULTIES
from space_envs.tasks.single_arm import SPLIT_SIZE, SingleArmTask

KINDS = ("cost_matrices", "obstacle", "noise")
ATTEMPTS = 40  # drawings of one demonstration before it is given up
STRIDE = 1597  # between the goals of successive groups; odd, so that the split's 4096 are met in turn
OFF_REDUNDANCY = 0.3  # share of any direction in the side on which an obstacle lies


@dataclass(frozen=True)
class DemonstratorConfig:
    """What demonstrations vary, and by how much.

    Attributes:
        difficulty, variant: of the task, whose train split gives the goals.
        per_goal: demonstrations of one goal, of all kinds in turn.
        weight_decades: half-width of the log-uniform factors on the position weights, powers of ten; the
            control weights vary by half as many. ramp: least and largest exponent of the growing weights.
        redundancy: standard deviation of the configuration that the redundancy is drawn to, rad a joint.
        radius: least and largest radius of an obstacle, rad. miss: distance of its centre from the way, rad.
        noise: standard deviation of the acceleration that disturbs every control period, rad/s^2.
        quiet: s before the end from which there is no noise, so that the arm comes to rest.
        rest: rad/s, the most that a joint may still turn at the end.
    """

    difficulty: str = "medium"
    variant: str = "paper"
    dt: float = 0.1
    per_goal: int = 3
    weight_decades: float = 1.0
    ramp: tuple[float, float] = (2.0, 12.0)
    scale_decades: float = 1.5
    redundancy: float = 0.2
    radius: tuple[float, float] = (0.4, 0.7)
    miss: float = 0.1
    noise: float = 0.015
    quiet: float = 2.5
    rest: float = 2e-3

    def __post_init__(self) -> None:
        if self.difficulty not in DIFFICULTIES:
            raise unknown_name("difficulty", self.difficulty, DIFFICULTIES)
        if self.variant not in VARIANTS:
            raise unknown_name("model variant", self.variant, VARIANTS)

    def as_dict(self) -> dict[str, Any]:
        """All settings as JSON values."""
        return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """D motions of T samples, from home to goals of the train split.

    Attributes:
        time: (T,) s. position, velocity: (D, T, n) rad and rad/s.
        goal_index: (D,) in the train split. kind: (D,) index into KINDS. attempt: (D,) drawings that failed.
        position_residual, orientation_residual: (D,) m and rad, of the end-effector at the end, inertial frame.
        cost: (D,) eq. 20 times dt with c = 1 m/rad, m^2/s.
    """

    time: Array
    position: Array
    velocity: Array
    goal_index: NDArray[np.int64]
    kind: NDArray[np.int64]
    attempt: NDArray[np.int64]
    position_residual: Array
    orientation_residual: Array
    cost: Array


@dataclass(frozen=True, eq=False)
class _Draws:
    """What chance decides about D demonstrations; shapes as in the problem they enter."""

    q: Array
    r: Array
    ramp: Array
    preferred: Array
    obstacle_phase: Array
    obstacle_side: Array
    obstacle_radius: Array
    disturbance: Array


def demonstrate(config: DemonstratorConfig, seed: int, first: int, count: int) -> Demonstrations:
    """Demonstrations first ... first + count - 1 of the seed; each is the same whoever asks for it.

    Raises:
        PlanningError: if one cannot be drawn in `ATTEMPTS` attempts.
    """
    number = np.arange(first, first + count)
    parts: dict[int, tuple[Demonstrations, int]] = {}
    left = number
    for attempt in range(ATTEMPTS):
        tried, good = _attempt(config, seed, left, attempt)
        for row in np.flatnonzero(good):
            parts[int(left[row])] = tried, int(row)
        left = left[~good]
        if left.size == 0:
            break
    else:
        raise PlanningError(f"demonstrations {left.tolist()} of seed {seed} failed {ATTEMPTS} times; vary them less")

    def column(name: str) -> Array:
        return np.stack([getattr(part, name)[row] for part, row in (parts[int(i)] for i in number)])

    time = next(iter(parts.values()))[0].time
    names = [name for name in vars(next(iter(parts.values()))[0]) if name != "time"]
    return Demonstrations(time, *[column(name) for name in names])


def _attempt(
    config: DemonstratorConfig, seed: int, number: NDArray[np.int64], attempt: int
) -> tuple[Demonstrations, NDArray[np.bool_]]:
    """Demonstrations by number, drawn for the attempt-th time, and whether each is one to learn from."""
    task = SingleArmTask(difficulty=config.difficulty, variant=config.variant)
    arm = task.robot
    time = np.arange(round(DURATION / config.dt) + 1) * config.dt
    kind = number % len(KINDS)
    index = (number // config.per_goal * STRIDE) % SPLIT_SIZE["train"]
    goals = task.goals("train", index)
    draws = _draw(config, seed, number, attempt, kind, time, arm.home)
    start = np.tile(arm.home, (len(number), 1))
    limits = arm.range + STOP_MARGIN * np.array([1.0, -1.0])

    gains, _ = receding_gains(draws.q, draws.r, time, draws.ramp)
    transition, response = closed_loop(gains, config.dt, draws.disturbance)
    # From rest: only the columns of the position count. (D, T, 2 n, n) and (D, T, 2 n).
    transition, response = transition.swapaxes(0, 1)[..., : arm.n_joints], response.swapaxes(0, 1)

    def motion_with(off: Detour | None, goal: Array, rows: Rows) -> JointMotion:
        way = (start[rows] - goal)[:, None, :, None]
        x = (transition[rows] @ way)[..., 0] + response[rows]
        q, qdot = x[..., : arm.n_joints] + goal[:, None, :], x[..., arm.n_joints :]
        if off is not None:
            q, qdot = q + off.position[rows], qdot + off.velocity[rows]
        return JointMotion(q, qdot, config.dt)

    def solve(off: Detour | None, begin: Array) -> JointGoals:
        base = np.zeros((len(number), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(number), 1))
        return floating_inverse_kinematics(
            arm,
            goals.position,
            goals.quaternion,
            lambda goal, rows: motion_with(off, goal, rows),
            *base,
            begin,
            limits,
            draws.preferred,
        )

    # First where the undisturbed way leads, then the detour from that way, then the goal with the detour.
    straight = solve(None, start).position
    middle = start + draws.obstacle_phase[:, None] * (straight - start)
    obstacles = Obstacles(middle + config.miss * _beside(arm, middle, draws.obstacle_side), draws.obstacle_radius)
    off = detour(start, straight, obstacles, _progress(time), config.dt)
    found = solve(off, straight)
    motion = motion_with(off, found.position, np.arange(len(number)))
    made = Demonstrations(
        time=time,
        position=motion.position,
        velocity=motion.velocity,
        goal_index=index,
        kind=kind,
        attempt=np.full(len(number), attempt),
        position_residual=found.position_residual,
        orientation_residual=found.orientation_residual,
        cost=trajectory_cost(arm, motion.position, motion.velocity, config.dt),
    )
    return made, found.converged & _usable(made, found.position, limits, config)


def _usable(made: Demonstrations, goal: Array, limits: Array, config: DemonstratorConfig) -> NDArray[np.bool_]:
    """Inside the limits of angle, rate and acceleration all the way, at rest on the goal at the end."""
    acceleration = np.diff(made.velocity, axis=1) / config.dt
    inside = ((made.position >= limits[:, 0]) & (made.position <= limits[:, 1])).all(axis=(1, 2))
    slow = np.abs(made.velocity).max(axis=(1, 2)) < SINGLE_ARM.rate_limit
    gentle = np.abs(acceleration).max(axis=(1, 2)) < SINGLE_ARM.acceleration_limit
    resting = np.abs(made.velocity[:, -1]).max(axis=1) < config.rest
    return inside & slow & gentle & resting


def _beside(arm: FloatingRobot, q: Array, side: Array) -> Array:
    """Unit directions (D, n) in joint space, mostly along the arm's redundancy at q, from normal draws `side`."""
    jacobian = arm.generalized_jacobian(q)
    rest = side - (np.linalg.pinv(jacobian) @ jacobian @ side[..., None])[..., 0]
    direction = rest + OFF_REDUNDANCY * side
    return direction / np.sqrt((direction * direction).sum(axis=1, keepdims=True))


def _progress(time: Array) -> Array:
    """Share (T,) of the way that the controller of policy `mpc` has made."""
    gains, _ = receding_gains(np.diag([POSITION_WEIGHT, 0.0]), np.array([[CONTROL_WEIGHT]]), time)
    transition, _ = closed_loop(gains, float(time[1]))
    return np.clip(1.0 - transition[:, 0, 0], 0.0, 1.0)


def _draw(
    config: DemonstratorConfig,
    seed: int,
    number: NDArray[np.int64],
    attempt: int,
    kind: NDArray[np.int64],
    time: Array,
    home: Array,
) -> _Draws:
    """Every demonstration draws from a generator of its own, all that there is, and uses what is of its kind."""
    n, samples = len(home), len(time)
    rows: list[tuple[Array, ...]] = []
    for i, k in zip(number.tolist(), kind.tolist(), strict=True):
        rng = np.random.default_rng([seed, i, attempt])
        preferred = home + rng.normal(0.0, config.redundancy, n)
        position, control = _random_spd(rng, n, config.weight_decades), _random_spd(rng, n, config.weight_decades / 2)
        ramp = rng.uniform(*config.ramp)
        scale = 10.0 ** rng.uniform(-config.scale_decades, config.scale_decades)
        phase, radius, side = rng.uniform(0.3, 0.7), rng.uniform(*config.radius), rng.standard_normal(n)
        noise = rng.normal(0.0, config.noise, (samples, n)) * (time < time[-1] - config.quiet)[:, None]
        varied, pushed, noisy = (k == KINDS.index(name) for name in KINDS)
        q = np.zeros((2 * n, 2 * n))
        q[:n, :n] = scale * POSITION_WEIGHT * (position if varied else np.eye(n))
        r = CONTROL_WEIGHT * (control if varied else np.eye(n))
        # An obstacle of no size pushes nothing.
        size = np.array(radius if pushed else 0.0)
        ramp = np.array(ramp)
        rows.append((q, r, ramp, preferred, np.array(phase), side, size, noise * noisy))
    q, r, ramp, preferred, phase, side, size, noise = (np.stack(column) for column in zip(*rows, strict=True))
    return _Draws(q, r, ramp, preferred, phase, side, size, np.ascontiguousarray(noise.swapaxes(0, 1)))


def _random_spd(rng: np.random.Generator, n: int, decades: float) -> Array:
    """A random positive definite matrix (n, n): correlated directions, diagonal log-uniform around 1."""
    factor = rng.standard_normal((n, 3 * n))
    product = factor @ factor.T
    scale = np.sqrt(10.0 ** rng.uniform(-decades, decades, n) / np.diag(product))
    return product * scale[:, None] * scale
