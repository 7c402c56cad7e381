"""Keywords of every environment: types, defaults and validation."""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, ParamSpec, TypedDict

from space_envs.errors import ConfigurationError, positive_integer, shown, unknown_name
from space_envs.perturbations.amounts import Perturbation
from space_envs.robots.robot import Robot

P = ParamSpec("P")
RENDER_MODES = ("human", "rgb_array")
CAMERA = "overview"  # exists in every model for rendering
MAX_THREADS = 256
MAX_SIDE = 4096  # of an image, pixels


class EnvKeywords(TypedDict, total=False):
    """Keywords of an environment besides its id and control mode; omitted ones have the task's defaults."""

    # Of the environment.
    threads: int | None
    render_mode: str | None
    width: int
    height: int
    camera: str
    max_episode_steps: int | None
    # Of the task.
    difficulty: str
    split: str
    reward: str
    control_period: float
    timestep: float | None
    horizon: int
    attitude_limit: float
    c: float
    collisions: bool
    perturbation: str | Perturbation
    robot: str | Path | Robot | None
    variant: str | None
    # Of its capture envelope.
    position_tolerance: float
    linear_velocity_tolerance: float
    hold_time: float
    # Of some tasks only.
    goal: str
    mounts: Sequence[Sequence[float]] | None
    orientation_tolerance: float
    angular_velocity_tolerance: float
    approach_tolerance: float


@dataclass(frozen=True)
class EnvOptions:
    """Keywords of an environment that do not belong to its task, validated.

    Attributes:
        threads, render_mode, width, height, camera, max_episode_steps: as in `CaptureVectorEnv`.

    Raises:
        ConfigurationError: for a value that is not valid.
    """

    threads: int | None = None
    render_mode: str | None = None
    width: int = 480
    height: int = 480
    camera: str = CAMERA
    max_episode_steps: int | None = None

    def __post_init__(self) -> None:
        if self.threads is not None:
            object.__setattr__(self, "threads", positive_integer("threads", self.threads, MAX_THREADS))
        mode = self.render_mode
        if mode is not None and (not isinstance(mode, str) or mode not in RENDER_MODES):
            raise unknown_name("render mode", mode, RENDER_MODES)
        for name in ("width", "height"):
            object.__setattr__(self, name, positive_integer(name, getattr(self, name), MAX_SIDE))

    @classmethod
    def separated(cls, keywords: Mapping[str, Any]) -> "tuple[EnvOptions, dict[str, Any]]":
        """The options among the keywords, and the keywords of the task."""
        own = {f.name for f in fields(cls)}
        options = cls(**{name: value for name, value in keywords.items() if name in own})
        task = {name: value for name, value in keywords.items() if name not in own}
        return options, options.with_horizon(task)

    def with_horizon(self, keywords: dict[str, Any]) -> dict[str, Any]:
        """Keywords of the task, with the horizon set by `max_episode_steps`.

        Raises:
            ConfigurationError: where both are given and differ.
        """
        steps = self.max_episode_steps
        if steps is None or isinstance(steps, int) and steps == -1:
            return keywords
        limit = positive_integer("max_episode_steps", steps)
        horizon = keywords.get("horizon", limit)
        if positive_integer("horizon", horizon) != limit:
            raise ConfigurationError(
                f"horizon and max_episode_steps are the same and must agree, got {shown(horizon)} and "
                f"{limit}; give one of them"
            )
        return {**keywords, "horizon": limit}


class _TaskDefault:
    def __repr__(self) -> str:
        return "<default of the task>"


def explicit_keywords(init: Callable[P, None]) -> Callable[P, None]:
    """Decorator of an `__init__` that takes `**keywords` of `EnvKeywords`: `help` shows each by name."""
    defaults = {f.name: f.default for f in fields(EnvOptions)}
    signature = inspect.signature(init)
    *named, others = signature.parameters.values()
    keywords = [
        inspect.Parameter(
            name, inspect.Parameter.KEYWORD_ONLY, default=defaults.get(name, _TaskDefault()), annotation=kind
        )
        for name, kind in inspect.get_annotations(EnvKeywords).items()
    ]
    others = others.replace(annotation=Any)
    init.__signature__ = signature.replace(parameters=[*named, *keywords, others])  # type: ignore[attr-defined]
    return init
