"""Random values of an episode's perturbation; its goal and seed decide them, and nothing else."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.perturbations.amounts import Perturbation

NOISE_BLOCK = 64  # observations whose noise is drawn together


class Stream(IntEnum):
    """Independent streams of random numbers, so that a factor is the same alone and with others."""

    MASS = 1
    INERTIA = 2
    VISCOUS_FRICTION = 3
    DRY_FRICTION = 4
    LOCKED_JOINT = 5
    BIAS = 6
    NOISE = 7


@dataclass(frozen=True, eq=False)
class EpisodeDraws:
    """Values of k episodes of a robot with b bodies and n joints.

    Attributes:
        mass: (k, b) factors on the masses. inertia: (k, b, 3) relative errors of principal second moments.
        viscous_friction, dry_friction: (k, n) shares of the torque limits.
        locked: (k, n) bool, at most one joint of each episode.
    """

    mass: Array
    inertia: Array
    viscous_friction: Array
    dry_friction: Array
    locked: NDArray[np.bool_]


def generator(key: NDArray[np.int64], stream: Stream, block: int = 0) -> np.random.Generator:
    """Random numbers of an episode's stream; each block of it is independent of the others."""
    return np.random.default_rng([*key.tolist(), int(stream), block])


def episode_draws(amounts: Perturbation, keys: NDArray[np.int64], bodies: int, joints: int) -> EpisodeDraws:
    """Draw the values of episodes, each by its own key.

    Args:
        keys: (k, 2) number drawn from the episode's seed, and index of its goal plus 1, both at least 0.
        bodies, joints: numbers of the robot, the satellite being body 0.
    """
    mass = amounts.mass * _uniform(keys, Stream.MASS, bodies) + 1.0
    mass[:, 0] *= amounts.satellite_mass
    shares = [_uniform(keys, stream, joints) for stream in (Stream.VISCOUS_FRICTION, Stream.DRY_FRICTION)]
    lock = 0.5 * (_uniform(keys, Stream.LOCKED_JOINT, 2) + 1.0)  # in 0 to 1
    locked = np.arange(joints) == np.floor(joints * lock[:, :1])
    return EpisodeDraws(
        mass=mass,
        inertia=amounts.inertia * _uniform(keys, Stream.INERTIA, 3 * bodies).reshape(-1, bodies, 3),
        viscous_friction=amounts.viscous_friction * 0.5 * (shares[0] + 1.0),
        dry_friction=amounts.dry_friction * 0.5 * (shares[1] + 1.0),
        locked=locked & (lock[:, 1:] < amounts.locked_joint),
    )


def _uniform(keys: NDArray[np.int64], stream: Stream, size: int) -> Array:
    """Numbers (k, size), uniform from -1 to 1."""
    drawn = [generator(key, stream).uniform(-1.0, 1.0, size) for key in keys]
    return np.array(drawn).reshape(len(keys), size)
