"""Hyperparameters of each algorithm: type, default, range and meaning of every one, in one row.

The defaults are those of a task of which nothing is known; `agents.learning.runs.defaults` has the
differences of ids. The command line, its help and the checks of files follow from these rows.
"""

import math
import types
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from typing import Annotated, Any, NamedTuple, Union, get_args, get_origin, get_type_hints

from agents.policies.learned.features import Feature, feature_table
from agents.policies.learned.network import ACTIVATIONS
from agents.policies.learned.policy_file import PLAN_KINDS
from space_envs.errors import ConfigurationError, shown, unknown_name

STEPS, SIZE, WIDTH = 10**12, 2**24, 2**14  # largest counts that are accepted


class Range(NamedTuple):
    """Meaning of a hyperparameter, and the numbers that it may be.

    Attributes:
        meaning: in a few words, with the unit.
        least, most: bounds, included. above: bound, excluded.
    """

    meaning: str
    least: float = -math.inf
    most: float = math.inf
    above: float = -math.inf

    def check(self, name: str, value: float) -> None:
        """Refuse a number outside the range, NaN too; ConfigurationError names it."""
        if not (self.least <= value <= self.most and value > self.above):
            raise ConfigurationError(f"{name} must be {self}, got {shown(value)}")

    def __str__(self) -> str:
        bounds = [("above", self.above), ("at least", self.least), ("at most", self.most)]
        return " and ".join(f"{word} {bound:,.12g}" for word, bound in bounds if math.isfinite(bound))


Steps = Annotated[int, Range("control steps, of all episodes together", 1, STEPS)]
Interval = Annotated[int, Range("steps between two validations, each followed by a checkpoint", 1, STEPS)]
LearningRate = Annotated[float, Range("step size of Adam", above=0.0, most=1e3)]
BatchSize = Annotated[int, Range("samples in one step of Adam", 2, SIZE)]
Envs = Annotated[int, Range("episodes simulated together", 1, 2**16)]
FinalRatio = Annotated[float, Range("final learning rate divided by the first; it falls linearly", 0.0, 1.0)]
ActionDeviation = Annotated[
    float,
    Range("initial standard deviation of the policy's actions", above=0.0, most=10.0),
]
Expert = Annotated[str | None, Range("policy to clone first, or none")]
WarmUp = Annotated[
    int, Range("first steps in which the critic alone learns, after a start from a policy", 0, STEPS)
]
PolicyDelay = Annotated[int, Range("updates of the critic for one of the actor", 1, SIZE)]
Tau = Annotated[float, Range("share of the network in each update of its target", 0.0, 1.0)]


@dataclass(frozen=True)
class Hyperparameters:
    """Hyperparameters that all algorithms share.

    Raises:
        ConfigurationError: for a value out of its range, or an unknown activation.
    """

    features: Annotated[tuple[Feature, ...], Range("inputs of the networks, each as FIELD:KIND:SCALE")]
    num_envs: Envs = 128
    steps: Steps = 200_000
    minutes: Annotated[float | None, Range("limit on the wall time, min; none lifts it", above=0.0)] = None
    learning_rate: LearningRate = 3e-4
    batch_size: BatchSize = 1024
    hidden: Annotated[tuple[int, ...], Range("widths of the hidden layers, actor and critic", 1, WIDTH)] = (
        128,
        128,
    )
    activation: Annotated[str, Range(f"of the hidden layers: {', '.join(ACTIVATIONS)}")] = "tanh"
    validation_interval: Interval = 20_000

    def __post_init__(self) -> None:
        for name, (hint, allowed) in described(type(self)).items():
            value = typed(name, getattr(self, name), hint)
            object.__setattr__(self, name, value)
            for number in value if isinstance(value, tuple) else (value,):
                if isinstance(number, int | float):
                    allowed.check(name, number)
        if self.activation not in ACTIVATIONS:
            raise unknown_name("activation", self.activation, ACTIVATIONS)
        for name in ("hidden", "features"):
            if not getattr(self, name):
                raise ConfigurationError(f"{name} must not be empty")

    @property
    def round(self) -> int:
        """Steps of all episodes together between two updates; a run takes whole rounds."""
        raise NotImplementedError


@dataclass(frozen=True)
class Discounted(Hyperparameters):
    """Hyperparameters of algorithms that sum rewards."""

    gamma: Annotated[float, Range("discount of a control step", above=0.0, most=1.0)] = 0.9995


@dataclass(frozen=True)
class PPO(Discounted):
    """Proximal policy optimisation (Schulman et al. 2017), names as in stable-baselines3."""

    steps: Steps = 1_500_000
    validation_interval: Interval = 150_000
    n_steps: Annotated[int, Range("control steps of each episode between updates", 2, SIZE)] = 64
    n_epochs: Annotated[int, Range("passes over the data of an update", 1, 1000)] = 8
    gae_lambda: Annotated[float, Range("of generalised advantage estimation", 0.0, 1.0)] = 0.95
    clip_range: Annotated[float, Range("of the ratio of probabilities", above=0.0, most=10.0)] = 0.2
    ent_coef: Annotated[float, Range("weight of the entropy in the loss", 0.0, 1e3)] = 0.0
    vf_coef: Annotated[float, Range("weight of the critic in the loss", 0.0, 1e3)] = 0.5
    max_grad_norm: Annotated[float, Range("largest norm of a gradient", above=0.0)] = 0.5
    target_kl: Annotated[float | None, Range("divergence that ends an update early", above=0.0)] = None
    expert: Expert = None
    action_deviation: ActionDeviation = 0.1
    critic_warm_up: WarmUp = 100_000
    final_rate_ratio: FinalRatio = 0.1

    @property
    def round(self) -> int:
        """Steps of a rollout."""
        return self.num_envs * self.n_steps


@dataclass(frozen=True)
class OffPolicy(Discounted):
    """Hyperparameters that algorithms with a replay buffer share, names as in stable-baselines3.

    With an initial policy, the replay buffer begins with its steps, the actor learns from the critic only
    once that has learned from them, and it keeps a cloning term in its loss.
    """

    num_envs: Envs = 16
    learning_rate: LearningRate = 5e-4
    batch_size: BatchSize = 256
    activation: Annotated[str, Range(f"of the hidden layers: {', '.join(ACTIVATIONS)}")] = "relu"
    buffer_size: Annotated[int, Range("steps in the replay buffer", 1, 10**8)] = 200_000
    learning_starts: Annotated[int, Range("steps before the first update", 0, STEPS)] = 5_000
    train_freq: Annotated[int, Range("control steps of each episode between updates", 1, SIZE)] = 1
    gradient_steps: Annotated[int, Range("steps of Adam in an update", 1, SIZE)] = 8
    expert: Expert = None
    demonstrations: Annotated[int, Range("first steps, of the initial policy if there is one", 1, STEPS)] = (
        20_000
    )
    critic_warm_up: WarmUp = 20_000
    cloning_weight: Annotated[
        float, Range("of the mean squared difference from the initial policy's action", 0.0, 1e6)
    ] = 60.0
    action_deviation: ActionDeviation = 0.1

    @property
    def round(self) -> int:
        """Steps between two updates."""
        return self.num_envs * self.train_freq


@dataclass(frozen=True)
class MaximumEntropy(OffPolicy):
    """Hyperparameters of SAC and its successors, with the entropy coefficient learned.

    With stable-baselines3's first coefficient of 1 the entropy outweighs the reward of a step, which is some
    hundredths.
    """

    ent_coef: Annotated[float | str, Range("of the entropy: a number, or auto_ and the first", 0.0, 1e3)] = (
        "auto_0.005"
    )
    target_entropy: Annotated[float, Range("of an action, nat", -1e6, 1e6)] = -14.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.ent_coef, str):
            automatic, _, first = self.ent_coef.partition("_")
            if automatic != "auto" or first and not _positive(first):
                raise ConfigurationError(
                    f"ent_coef must be a number, or auto_ and a positive one, got {self.ent_coef!r}"
                )


@dataclass(frozen=True)
class SAC(MaximumEntropy):
    """Soft actor-critic (Haarnoja et al. 2018)."""

    tau: Tau = 0.005


@dataclass(frozen=True)
class TQC(SAC):
    """Truncated quantile critics (Kuznetsov et al. 2020), of sb3-contrib."""

    top_quantiles_to_drop_per_net: Annotated[
        int, Range("largest quantiles of each critic that a target leaves out", 0, 24)
    ] = 2


@dataclass(frozen=True)
class CrossQ(MaximumEntropy):
    """Batch normalisation in place of target networks (Bhatt et al. 2024), of sb3-contrib."""

    policy_delay: PolicyDelay = 3


@dataclass(frozen=True)
class TD3(OffPolicy):
    """Twin delayed deterministic policy gradient (Fujimoto et al. 2018)."""

    tau: Tau = 0.005
    exploration_noise: Annotated[
        float, Range("standard deviation of the noise on actions while collecting", 0.0, 10.0)
    ] = 0.1
    policy_delay: PolicyDelay = 2
    target_policy_noise: Annotated[
        float, Range("standard deviation of the noise on the target's actions", 0.0, 10.0)
    ] = 0.1
    target_noise_clip: Annotated[float, Range("largest noise on the target's actions", 0.0, 10.0)] = 0.3


@dataclass(frozen=True)
class BC(Discounted):
    """Behaviour cloning by DAgger (Ross et al. 2011): the expert labels what the learner visits.

    An expert that plans ahead (one with a state) drives itself in every round, since it cannot label the
    states of another. A capture does not end an episode, so that resting at the goal is learned too.
    """

    steps: Steps = 12 * 120 * 128
    validation_interval: Interval = 3 * 120 * 128
    learning_rate: LearningRate = 2e-3
    expert: Expert = None
    episode_steps: Annotated[int, Range("control steps of an episode", 1, 10**4)] = 120
    epochs: Annotated[int, Range("passes over all data so far, after each round", 1, 10**6)] = 4
    last_epochs: Annotated[int, Range("passes after the last round", 1, 10**6)] = 12
    error_offset: Annotated[
        float, Range("errors are relative to the expert's mean absolute action plus this", above=0.0)
    ] = 0.05
    expert_noise: Annotated[
        float, Range("standard deviation of what disturbs the expert in half of its steps", 0.0, 10.0)
    ] = 0.1
    final_rate_ratio: FinalRatio = 0.1
    action_deviation: ActionDeviation = 0.1

    @property
    def round(self) -> int:
        """Steps of the episodes that are collected together."""
        return self.num_envs * self.episode_steps


@dataclass(frozen=True)
class Planner(Hyperparameters):
    """Self-labelled planning: the network learns its own plans after a Gauss-Newton step, of the train split.

    Goals of all difficulties are trained on, whatever the one that the run is validated with.
    """

    num_envs: Annotated[int, Range("goals labelled together", 2, 2**16)] = 512
    steps: Annotated[int, Range("goals labelled, with repetitions", 1, STEPS)] = 2_300 * 512
    validation_interval: Annotated[int, Range("goals between two validations", 1, STEPS)] = 400 * 512
    learning_rate: Annotated[float, Range("largest step size of SOAP", above=0.0, most=1e3)] = 3e-3
    batch_size: BatchSize = 512
    hidden: Annotated[tuple[int, ...], Range("widths of the hidden layers", 1, WIDTH)] = (256, 256, 256)
    activation: Annotated[str, Range(f"of the hidden layers: {', '.join(ACTIVATIONS)}")] = "silu"
    kind: Annotated[str, Range(f"of plans: {', '.join(PLAN_KINDS)}")] = "kept"
    goals: Annotated[int, Range("of the train split of each difficulty", 1, 2**20)] = 4096
    reuse: Annotated[int, Range("steps of the optimiser after each labelling", 1, 1000)] = 8
    memory: Annotated[int, Range("labels that are kept at most", 2, 10**7)] = 16_384
    damping: Annotated[float, Range("of Gauss-Newton steps, m^2/s per squared coordinate", above=0.0)] = 3e-3
    position_weight: Annotated[float, Range("of the squared position error, 1/s", above=0.0)] = 10.0
    rotation_weight: Annotated[float, Range("of the squared rotation error, m^2/(s rad^2)", above=0.0)] = 5.0
    attitude_weight: Annotated[float, Range("of the squared attitude error, m^2/(s rad^2)", above=0.0)] = 1e3
    limit_weight: Annotated[float, Range("of squared violations of limits, m^2/s", 0.0)] = 10.0
    rate_share: Annotated[float, Range("of rate limits that plans are trained to keep", 0.0, 1.0)] = 0.92
    acceleration_share: Annotated[float, Range("the same of acceleration limits", 0.0, 1.0)] = 0.87
    averaging: Annotated[float, Range("decay of the parameters' average, of a step", 0.0, 1.0)] = 0.999

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kind not in PLAN_KINDS:
            raise unknown_name("kind of plans", self.kind, PLAN_KINDS)

    @property
    def round(self) -> int:
        """Goals labelled together."""
        return self.num_envs


CONTRIB = ("tqc", "crossq")  # algorithms of sb3-contrib
CONTRIB_MISSING = "sb3-contrib: pip install 'space-capture[contrib]'"
AnyHyperparameters = PPO | SAC | TD3 | TQC | CrossQ | BC | Planner
ALGORITHMS: dict[str, type[AnyHyperparameters]] = {
    "ppo": PPO,
    "sac": SAC,
    "td3": TD3,
    "tqc": TQC,
    "crossq": CrossQ,
    "bc": BC,
    "planner": Planner,
}


@cache
def described(algorithm: type[Hyperparameters]) -> dict[str, tuple[Any, Range]]:
    """Type, meaning and range of each hyperparameter, by name."""
    hints = get_type_hints(algorithm, include_extras=True)
    return {field.name: get_args(hints[field.name])[:2] for field in fields(algorithm)}


def typed(name: str, value: Any, hint: Any) -> Any:
    """A value of a file, or of the command line, as a field of that type holds it.

    Lists become tuples, rows and texts FIELD:KIND:SCALE become features, and the text none becomes None.

    Raises:
        ConfigurationError: for a value of another type.
    """
    several = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    kinds = [dict if get_origin(kind) is dict else kind for kind in several]
    if value == "none" and types.NoneType in kinds:
        return None
    if any(_is(value, kind) for kind in kinds):
        return value
    if isinstance(value, list | tuple):
        if tuple[Feature, ...] in kinds:
            return feature_table(value)
        if tuple[int, ...] in kinds and all(_is(each, int) for each in value):
            return tuple(value)
    words = " or ".join(_KINDS[kind] for kind in kinds)
    raise ConfigurationError(f"{name} must be {words}, got {shown(value)}")


_KINDS = {
    float: "a number",
    int: "a whole number",
    str: "text",
    dict: "a table",
    types.NoneType: "none",
    tuple[int, ...]: "a list of whole numbers",
    tuple[Feature, ...]: "a list of features",
}


def _is(value: Any, kind: Any) -> bool:
    if isinstance(value, bool) or not isinstance(kind, type):
        return False
    return isinstance(value, (int, float) if kind is float else kind)


def _positive(text: str) -> bool:
    try:
        return 0.0 < float(text) < math.inf
    except ValueError:
        return False


def to_json(parameters: AnyHyperparameters) -> dict[str, Any]:
    """As plain JSON values."""
    return asdict(parameters) | {"features": [list(feature) for feature in parameters.features]}


def from_json(algorithm: str, values: Mapping[str, Any]) -> AnyHyperparameters:
    """Hyperparameters from what `to_json` gave.

    Raises:
        ConfigurationError: for an unknown algorithm, and names or values that do not fit it.
    """
    if algorithm not in ALGORITHMS:
        raise unknown_name("algorithm", algorithm, ALGORITHMS)
    names = described(ALGORITHMS[algorithm])
    for name in values:
        if name not in names:
            raise unknown_name(f"hyperparameter of {algorithm}", name, names)
    if missing := [name for name in names if name not in values]:
        raise ConfigurationError(f"hyperparameters of {algorithm} lack {', '.join(missing)}")
    return ALGORITHMS[algorithm](**values)
