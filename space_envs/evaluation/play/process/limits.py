"""Time limits of a policy's calls."""

from dataclasses import dataclass

from space_envs.errors import ConfigurationError, PolicyError


@dataclass(frozen=True)
class TimeLimits:
    """Seconds that a call of a policy may take: the first one of an episode, which plans, and any other."""

    planning: float
    action: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0.0:
                raise ConfigurationError(f"the time limit of {name} must be positive, got {value}")


class TimeLimitError(PolicyError):
    """A policy took longer than it may."""
