"""Every number that learning depends on, in typed tables per task and algorithm."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from agents.policies.learned.features import (
    CLUTTERED_FEATURES,
    DUAL_PLANAR_FEATURES,
    DUAL_SPATIAL_FEATURES,
    SINGLE_ARM_FEATURES,
    Feature,
    feature_table,
)
from agents.policies.learned.network import ACTIVATIONS
from space_envs.errors import ConfigurationError, positive, positive_integer, unknown_name

ALGORITHMS = ("ppo", "sac", "td3", "bc")
_LARGEST = {"num_envs": 2**16, "steps": 10**12, "batch_size": 2**24, "interval": 10**12}
LARGEST_WIDTH = 2**14


@dataclass(frozen=True)
class Hyperparameters:
    """What all algorithms share.

    Attributes:
        num_envs: episodes simulated together. steps: control steps of all of them together.
        learning_rate: of Adam. batch_size: samples in one of its steps.
        hidden: widths of the hidden layers, of actor and critic alike.
        activation: of the hidden layers, one of `agents.policies.learned.network.ACTIVATIONS`.
        gamma: discount per control step.
        interval: steps between validations, each followed by a checkpoint.
        minutes: limit on the wall time, all in all; None is no limit.
        features: what the networks see.
    """

    num_envs: int
    steps: int
    learning_rate: float
    batch_size: int
    hidden: tuple[int, ...]
    activation: str
    interval: int
    gamma: float = 0.99
    minutes: float | None = None
    features: tuple[Feature, ...] = SINGLE_ARM_FEATURES

    def __post_init__(self) -> None:
        if self.activation not in ACTIVATIONS:
            raise unknown_name("activation", self.activation, ACTIVATIONS)
        for name, largest in _LARGEST.items():
            positive_integer(name, getattr(self, name), largest)
        positive("learning_rate", self.learning_rate)
        if self.minutes is not None and not self.minutes > 0:  # infinity lifts a table's limit
            raise ConfigurationError(f"minutes must be positive, got {self.minutes!r}")
        if positive("gamma", self.gamma) > 1:
            raise ConfigurationError(f"gamma must lie in (0, 1], got {self.gamma!r}")
        if not self.hidden:
            raise ConfigurationError("hidden must be layer widths, got none")
        for width in self.hidden:
            positive_integer("a layer width of hidden", width, LARGEST_WIDTH)

    @property
    def round(self) -> int:
        """Steps of all environments together between two updates; a run takes whole rounds."""
        raise NotImplementedError


@dataclass(frozen=True)
class PPO(Hyperparameters):
    """Proximal policy optimisation (Schulman et al. 2017), names as in stable-baselines3.

    Attributes:
        expert: cloned first, unless a run to start from is named; None starts from random weights.
        deviation: initial standard deviation of an action, in units of the action.
        critic_warm_up: steps in which only the critic learns, where the actor is warm started.
        final_rate: share of the learning rate left at the end of the linear decay.
    """

    n_steps: int = 128
    n_epochs: int = 5
    gae_lambda: float = 0.95
    clip_range: float = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    target_kl: float | None = None
    expert: str | None = "gjm"
    deviation: float = 0.1
    critic_warm_up: int = 0
    final_rate: float = 0.1

    @property
    def round(self) -> int:
        """Steps of a rollout."""
        return self.num_envs * self.n_steps


@dataclass(frozen=True)
class OffPolicy(Hyperparameters):
    """What SAC and TD3 share, names as in stable-baselines3.

    Attributes:
        train_freq: steps of the vector environment between updates. gradient_steps: of one update.
    """

    buffer_size: int = 200_000
    learning_starts: int = 5_000
    tau: float = 0.005
    train_freq: int = 1
    gradient_steps: int = 8

    @property
    def round(self) -> int:
        """Steps between two updates."""
        return self.num_envs * self.train_freq


@dataclass(frozen=True)
class SAC(OffPolicy):
    """Soft actor-critic (Haarnoja et al. 2018) with its entropy coefficient learned.

    Attributes:
        ent_coef: auto_ and the coefficient to begin with. With stable-baselines3's 1 the entropy outweighs
            the reward of a step, which is some hundredths.
        target_entropy: of an action, nat.
    """

    ent_coef: str = "auto_0.005"
    target_entropy: float = -14.0


@dataclass(frozen=True)
class TD3(OffPolicy):
    """Twin delayed deterministic policy gradient (Fujimoto et al. 2018).

    Attributes:
        exploration: standard deviation of the noise on actions while collecting.
    """

    exploration: float = 0.1
    policy_delay: int = 2
    target_policy_noise: float = 0.1
    target_noise_clip: float = 0.3


@dataclass(frozen=True)
class BC(Hyperparameters):
    """Behaviour cloning by DAgger (Ross et al. 2011): the expert labels what the learner visits.

    An expert that plans ahead (one with a state) drives itself in every round, since it cannot label the
    states of another.

    Attributes:
        expert: name in the registry of policies.
        episode: steps in an episode; a capture does not end it, so that resting at the goal is learned too.
        epochs: passes over all data so far, after each round. last_epochs: after the last one.
        weight: errors count relative to the expert's mean absolute action plus this, in units of the action.
        noise: standard deviation of what disturbs the expert's own actions, in half of the steps.
        final_rate: share of the learning rate left at the end of a round.
        deviation: standard deviation written into the policy.
    """

    expert: str = "gjm"
    episode: int = 120
    epochs: int = 4
    last_epochs: int = 12
    weight: float = 0.05
    noise: float = 0.1
    final_rate: float = 0.1
    deviation: float = 0.1

    @property
    def round(self) -> int:
        """Steps of the episodes that are collected together."""
        return self.num_envs * self.episode


AnyHyperparameters = PPO | SAC | TD3 | BC
_CLASSES: dict[str, type[PPO] | type[SAC] | type[TD3] | type[BC]] = {
    "ppo": PPO,
    "sac": SAC,
    "td3": TD3,
    "bc": BC,
}


def _off_policy(hidden: tuple[int, ...], features: tuple[Feature, ...]) -> dict[str, AnyHyperparameters]:
    """Tables of SAC and TD3, which have the same numbers in every task."""
    return {
        name: kind(
            num_envs=16,
            steps=200_000,
            learning_rate=5e-4,
            batch_size=256,
            hidden=hidden,
            activation="relu",
            interval=20_000,
            features=features,
        )
        for name, kind in (("sac", SAC), ("td3", TD3))
    }


def _dual_arm(features: tuple[Feature, ...], rounds: int) -> dict[str, AnyHyperparameters]:
    """Tables of a dual-arm task, whose expert is the reactionless resolved rate."""
    bc = BC(
        num_envs=128,
        steps=rounds * 200 * 128,
        learning_rate=2e-3,
        batch_size=1024,
        hidden=(256, 256),
        activation="tanh",
        interval=4 * 200 * 128,
        features=features,
        expert="reactionless_rate",
        episode=200,
        weight=0.02,
        noise=0.05,
    )
    # Gentle: the clone captures nearly everything already, and must not be unlearned while the critic is bad.
    ppo = PPO(
        num_envs=128,
        steps=1_000_000,
        learning_rate=5e-5,
        batch_size=2048,
        hidden=bc.hidden,
        activation=bc.activation,
        interval=100_000,
        features=features,
        n_steps=64,
        n_epochs=4,
        clip_range=0.1,
        target_kl=0.01,
        critic_warm_up=150_000,
        deviation=0.03,
        minutes=7.0,
        expert=bc.expert,
    )
    return {"ppo": ppo, **_off_policy(bc.hidden, features), "bc": bc}


SINGLE_ARM: dict[str, AnyHyperparameters] = {
    "ppo": PPO(
        num_envs=128,
        steps=1_500_000,
        learning_rate=3e-4,
        batch_size=1024,
        hidden=(128, 128),
        activation="tanh",
        interval=150_000,
        n_steps=64,
        n_epochs=8,
        critic_warm_up=100_000,
        minutes=9.0,
    ),
    **_off_policy((128, 128), SINGLE_ARM_FEATURES),
    "bc": BC(
        num_envs=128,
        steps=12 * 120 * 128,
        learning_rate=2e-3,
        batch_size=1024,
        hidden=(128, 128),
        activation="tanh",
        interval=3 * 120 * 128,
    ),
}

TABLES: dict[str, dict[str, AnyHyperparameters]] = {
    "SpaceCapture/SingleArm-v0": SINGLE_ARM,
    "SpaceCapture/SingleArmCluttered-v0": {
        name: replace(table, features=CLUTTERED_FEATURES) for name, table in SINGLE_ARM.items()
    },
    "SpaceCapture/DualArmPlanar-v0": _dual_arm(DUAL_PLANAR_FEATURES, 8),
    "SpaceCapture/DualArmSpatial-v0": _dual_arm(DUAL_SPATIAL_FEATURES, 10),
}


def hyperparameters(env_id: str, algorithm: str) -> AnyHyperparameters:
    """The table for a task and an algorithm.

    Raises:
        ConfigurationError: for an algorithm or id that has none.
    """
    if env_id not in TABLES:
        raise unknown_name("environment id", env_id, TABLES)
    if algorithm not in TABLES[env_id]:
        raise unknown_name("algorithm", algorithm, TABLES[env_id])
    return TABLES[env_id][algorithm]


def to_json(parameters: AnyHyperparameters) -> dict[str, Any]:
    """As plain JSON values."""
    return asdict(parameters) | {"features": [list(feature) for feature in parameters.features]}


def from_json(algorithm: str, values: Mapping[str, Any]) -> AnyHyperparameters:
    """Hyperparameters from what `to_json` gave.

    Raises:
        ConfigurationError: for an unknown algorithm, or names or values that do not fit it.
    """
    if algorithm not in _CLASSES:
        raise unknown_name("algorithm", algorithm, _CLASSES)
    kind = _CLASSES[algorithm]
    names = [field.name for field in fields(kind)]
    if unknown := [name for name in values if name not in names]:
        raise unknown_name(f"hyperparameter of {algorithm}", unknown[0], names)
    given = dict(values)
    try:
        given["hidden"] = tuple(given["hidden"])
        given["features"] = feature_table(given["features"])
        return kind(**given)
    except (TypeError, KeyError) as error:
        raise ConfigurationError(f"hyperparameters of {algorithm} do not fit: {error}") from None
