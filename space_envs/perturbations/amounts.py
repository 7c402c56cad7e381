"""Amounts by which a simulated robot differs from its nominal model, and their presets."""

from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from space_envs.checks import count, non_negative
from space_envs.errors import ConfigurationError, positive, shown, unknown_name

NOMINAL = "nominal"
LARGEST_SCALE = 10.0  # of the satellite's mass, and its inverse the smallest
LARGEST_SHARE = 0.5  # of masses and moments
LARGEST_FRICTION = 0.1  # of the torque limit; the simulation's step is too long for more viscous friction
LARGEST_FACTOR = 100.0  # on the standard deviations of sensors
LONGEST_DELAY = 10  # control periods
_SHARES = ("mass", "inertia")
_FRICTION = ("viscous_friction", "dry_friction")
_SENSORS = ("noise", "bias")
_DELAYS = ("action_delay", "observation_delay")


@dataclass(frozen=True)
class Perturbation:
    """Amounts of perturbation; an episode's values are drawn from them by its goal and seed.

    Attributes:
        satellite_mass: factor on the satellite's mass and inertia, the same in every episode.
        mass: largest relative error of each body's mass; each is uniform within it.
        inertia: largest relative error of each body's three principal second moments of mass, for the mass it
            has; each is uniform within it.
        viscous_friction: largest viscous friction of each joint at its rate limit, as a share of its torque
            limit; each is uniform from 0.
        dry_friction: largest dry friction of each joint, as a share of its torque limit; likewise.
        noise: factor on the standard deviations of `SENSOR_ERRORS`, drawn at every step.
        bias: factor on the same standard deviations, drawn once an episode.
        action_delay: control periods from an action to its effect; the first actions are zero.
        observation_delay: age of the sensors in an observation, control periods; `time` is the present one.
        locked_joint: probability that a joint is locked at its start; any joint is equally likely.

    Raises:
        ConfigurationError: for a value out of range.
    """

    satellite_mass: float = 1.0
    mass: float = 0.0
    inertia: float = 0.0
    viscous_friction: float = 0.0
    dry_friction: float = 0.0
    noise: float = 0.0
    bias: float = 0.0
    action_delay: int = 0
    observation_delay: int = 0
    locked_joint: float = 0.0

    def __post_init__(self) -> None:
        scale = positive("perturbation: satellite_mass", self.satellite_mass, LARGEST_SCALE)
        if scale * LARGEST_SCALE < 1.0:
            raise ConfigurationError(
                f"perturbation: satellite_mass must lie in {1.0 / LARGEST_SCALE:g} to {LARGEST_SCALE:g}, "
                f"got {shown(self.satellite_mass)}"
            )
        object.__setattr__(self, "satellite_mass", scale)
        limits = dict.fromkeys(_SHARES, LARGEST_SHARE) | dict.fromkeys(_FRICTION, LARGEST_FRICTION)
        limits |= dict.fromkeys(_SENSORS, LARGEST_FACTOR) | {"locked_joint": 1.0}
        for name, largest in limits.items():
            value = non_negative(f"perturbation: {name}", getattr(self, name))
            if value > largest:
                raise ConfigurationError(f"perturbation: {name} must lie in 0 to {largest:g}, got {value:g}")
            object.__setattr__(self, name, value)
        for name in _DELAYS:
            steps = count(f"perturbation: {name}", getattr(self, name), LONGEST_DELAY)
            object.__setattr__(self, name, steps)

    @classmethod
    def of(cls, given: "Perturbation | str") -> "Perturbation":
        """Perturbation from its text: a preset or none, then NAME=VALUE, separated by spaces.

        Raises:
            ConfigurationError: for another type, an unknown name, with the nearest, or an invalid value.
        """
        if isinstance(given, Perturbation):
            return given
        if not isinstance(given, str) or not given.split():
            raise ConfigurationError(
                f"perturbation must be a Perturbation or words such as 'mass=0.1', got {shown(given)}"
            )
        made, *words = _first(given.split())
        for word in words:
            name, equals, value = word.partition("=")
            if not equals:
                raise unknown_name("perturbation after the first word", word, [f"{n}=" for n in _names()])
            made = replace(made, **{_known(name): _number(name, value)})
        return made

    @property
    def text(self) -> str:
        """Shortest text that `of` reads: the name of a preset, or every amount that differs from nominal."""
        for name, preset in PRESETS.items():
            if self == preset:
                return name
        usual, own = asdict(Perturbation()), asdict(self)
        return " ".join(f"{name}={value!r}" for name, value in own.items() if value != usual[name])

    @property
    def nominal(self) -> bool:
        """Whether nothing differs from the nominal model."""
        return self == PRESETS[NOMINAL]

    def __str__(self) -> str:
        return self.text


PRESETS = {
    NOMINAL: Perturbation(),
    "mild": Perturbation(
        mass=0.05,
        inertia=0.05,
        viscous_friction=0.002,
        dry_friction=0.002,
        noise=1.0,
        bias=1.0,
        action_delay=1,
    ),
    "severe": Perturbation(
        mass=0.2,
        inertia=0.2,
        viscous_friction=0.01,
        dry_friction=0.01,
        noise=3.0,
        bias=3.0,
        action_delay=1,
        observation_delay=1,
        locked_joint=0.1,
    ),
}


def _names() -> list[str]:
    return [field.name for field in fields(Perturbation)]


def _first(words: list[str]) -> tuple[Any, ...]:
    """Preset of the first word, or the nominal one, and the words that change it."""
    if "=" in words[0]:
        return (PRESETS[NOMINAL], *words)
    if words[0] not in PRESETS:
        valid = [*PRESETS, *(f"{name}=" for name in _names())]
        raise unknown_name("perturbation", words[0], valid)
    return (PRESETS[words[0]], *words[1:])


def _known(name: str) -> str:
    if name not in _names():
        raise unknown_name("perturbation", name, _names())
    return name


def _number(name: str, text: str) -> float | int:
    try:
        return int(text) if name in _DELAYS else float(text)
    except ValueError:
        kind = "a whole number" if name in _DELAYS else "a number"
        raise ConfigurationError(f"perturbation: {name} must be {kind}, got {text!r}") from None
