"""Variations of demonstrations: the paper's three kinds, and the random draws behind them (sec. IV)."""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.policies.single_arm.mpc import CONTROL_WEIGHT, POSITION_WEIGHT
from space_envs.checks import non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive, positive_integer, unknown_name
from space_envs.tasks.common import DIFFICULTIES

KINDS = ("cost_matrices", "elastic_band", "noise")
BANDS = ("joint", "task")
OFF_REDUNDANCY = 0.3  # share of an arbitrary direction in the direction of an obstacle


@dataclass(frozen=True)
class DemonstratorConfig:
    """Settings of the variations.

    Attributes:
        difficulty: of the task, whose train split gives the goals.
        per_goal: demonstrations of one goal, cycling through the kinds.
        weight_decades: kind cost_matrices: half-width of the log-uniform factors on the joints' position
            weights, powers of ten; the control weights vary by half as many.
        ramp: least and largest exponent with which the position weights grow, in all kinds.
        scale_decades: half-width of the log-uniform factor on all position weights, powers of ten, likewise.
        redundancy: standard deviation of the configuration that the redundancy is drawn to, rad a joint.
        bands: kind elastic_band: the space of its artificial obstacle. `task` is the paper's, a sphere
            between the end-effector's points at start and goal; the shipped prior has `joint`, a sphere of
            joint angles.
        radius, offset: bands `joint`: least and largest radius, distance of the centre from the motion, rad.
        sphere_radius, sphere_offset: bands `task`: the same in m, from the end-effector's path.
        noise: kind noise: standard deviation of the acceleration that disturbs every control period, rad/s^2.
        noise_free: s at the end without noise, so that the arm comes to rest.
        rest: largest joint rate at the end, rad/s.
    """

    difficulty: str = "medium"
    dt: float = 0.1
    per_goal: int = 3
    weight_decades: float = 1.0
    ramp: tuple[float, float] = (2.0, 12.0)
    scale_decades: float = 1.5
    redundancy: float = 0.2
    radius: tuple[float, float] = (0.4, 0.7)
    offset: float = 0.1
    bands: str = "joint"
    sphere_radius: tuple[float, float] = (0.3, 0.6)
    sphere_offset: float = 0.1
    noise: float = 0.015
    noise_free: float = 2.5
    rest: float = 2e-3

    def __post_init__(self) -> None:
        if self.difficulty not in DIFFICULTIES:
            raise unknown_name("difficulty", self.difficulty, DIFFICULTIES)
        if self.bands not in BANDS:
            raise unknown_name("space of elastic bands", self.bands, BANDS)
        for name, value in vars(self).items():
            numbers = value if isinstance(value, tuple) else (value,)
            for one in () if name in ("difficulty", "bands") else numbers:
                non_negative(f"demonstrations: {name}", one)
        positive("dt", self.dt)
        positive_integer("per_goal", self.per_goal, 1000)
        for name in ("ramp", "radius", "sphere_radius"):
            value = getattr(self, name)
            if not isinstance(value, tuple) or len(value) != 2 or value[0] > value[1]:
                raise ConfigurationError(f"{name} must be a least and a largest value, got {value!r}")

    def as_dict(self) -> dict[str, Any]:
        """All settings as JSON values."""
        return {
            key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()
        }


class VariationDraws(NamedTuple):
    """Random quantities of one demonstration, or of D; shapes as in the problem they enter."""

    q: Array
    r: Array
    ramp: Array
    preferred: Array
    obstacle_phase: Array
    obstacle_side: Array
    obstacle_radius: Array
    disturbance: Array
    sphere_side: Array
    sphere_radius: Array


def draw(
    config: DemonstratorConfig,
    seed: int,
    number: NDArray[np.int64],
    attempt: int,
    kind: NDArray[np.int64],
    time: Array,
    home: Array,
) -> VariationDraws:
    """Every demonstration draws everything from a generator of its own, and uses what is of its kind."""
    n, samples = len(home), len(time)
    drawn: list[VariationDraws] = []
    for i, k in zip(number.tolist(), kind.tolist(), strict=True):
        rng = np.random.default_rng([seed, i, attempt])
        preferred = home + rng.normal(0.0, config.redundancy, n)
        position = _random_spd(rng, n, config.weight_decades)
        control = _random_spd(rng, n, config.weight_decades / 2)
        ramp = rng.uniform(*config.ramp)
        scale = 10.0 ** rng.uniform(-config.scale_decades, config.scale_decades)
        phase, radius, side = rng.uniform(0.3, 0.7), rng.uniform(*config.radius), rng.standard_normal(n)
        noise = rng.normal(0.0, config.noise, (samples, n)) * (time < time[-1] - config.noise_free)[:, None]
        sphere, aside = rng.uniform(*config.sphere_radius), rng.standard_normal(3)
        varied, pushed, noisy = (k == KINDS.index(name) for name in KINDS)
        q = np.zeros((2 * n, 2 * n))
        q[:n, :n] = scale * POSITION_WEIGHT * (position if varied else np.eye(n))
        drawn.append(
            VariationDraws(
                q=q,
                r=CONTROL_WEIGHT * (control if varied else np.eye(n)),
                ramp=np.array(ramp),
                preferred=preferred,
                obstacle_phase=np.array(phase),
                obstacle_side=side,
                # An obstacle of size zero has no effect.
                obstacle_radius=np.array(radius if pushed else 0.0),
                disturbance=noise * noisy,
                sphere_side=aside,
                sphere_radius=np.array(sphere if pushed else 0.0),
            )
        )
    stacked = VariationDraws(*(np.stack(column) for column in zip(*drawn, strict=True)))
    return stacked._replace(disturbance=np.ascontiguousarray(stacked.disturbance.swapaxes(0, 1)))


def _random_spd(rng: np.random.Generator, n: int, decades: float) -> Array:
    """A random positive definite matrix (n, n): correlated directions, diagonal log-uniform around 1."""
    factor = rng.standard_normal((n, 3 * n))
    product = factor @ factor.T
    scale = np.sqrt(10.0 ** rng.uniform(-decades, decades, n) / np.diag(product))
    return product * scale[:, None] * scale


def sideways_direction(arm: FloatingRobot, q: Array, side: Array) -> Array:
    """Unit directions (D, n) of joints, mostly along the arm's redundancy at q, from normal draws `side`."""
    jacobian = arm.generalized_jacobian(q)
    rest = side - (np.linalg.pinv(jacobian) @ jacobian @ side[..., None])[..., 0]
    direction = rest + OFF_REDUNDANCY * side
    return direction / np.sqrt((direction * direction).sum(axis=1, keepdims=True))
