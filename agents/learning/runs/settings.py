"""Settings and hyperparameters of a run from a user's options, checked before the run starts."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.util import find_spec
from typing import Any, NamedTuple, get_type_hints

from agents.learning.runs.defaults import default_hyperparameters
from agents.learning.runs.hyperparameters import (
    ALGORITHMS,
    BC,
    CONTRIB,
    CONTRIB_MISSING,
    AnyHyperparameters,
    OffPolicy,
    Planner,
    described,
    typed,
)
from agents.learning.runs.warm_start import default_expert, experts_for, starting_policy
from agents.policies.learned.features import FeatureView
from agents.policies.learned.planner_network import PlanningNetwork
from agents.policies.registry import check_needs
from space_envs.envs import CaptureVectorEnv
from space_envs.envs.limits import checked_num_envs
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.policy import DEFAULT_CONTROL_MODE, PolicyContext
from space_envs.registration import find
from space_envs.tasks.base import CaptureTask

DEFAULT_ALGORITHM, DEFAULT_ENV = "ppo", "SpaceCapture/SingleArm-v0"
VALIDATIONS = 10  # at least so many in a run
# Names of the options that are no hyperparameters, and the field of Settings that each one sets.
OPTIONS = {
    "algo": "algorithm",
    "env": "env_id",
    "control_mode": "control_mode",
    "difficulty": "difficulty",
    "env_kwargs": "env_kwargs",
    "seed": "seed",
    "device": "device",
    "init": "init",
}
# Keywords of the environments that are not for env_kwargs, and what sets them.
_SET_BY = {
    **dict.fromkeys(("env_id", "env"), "the option --env"),
    **dict.fromkeys(("control_mode", "difficulty", "num_envs"), "an option of its own"),
    "split": "training, which takes the splits train and validation",
    "autoreset_mode": "training",
    "max_episode_steps": "the keyword horizon, which is the same",
    **dict.fromkeys(("render_mode", "width", "height", "camera"), "nothing: training draws no pictures"),
}


@dataclass(frozen=True)
class Settings:
    """Settings of a run that are no hyperparameters.

    Attributes:
        algorithm: one of `ALGORITHMS`. env_id: registered id, or module:id.
        control_mode, difficulty: of the environment. env_kwargs: its other keywords, plain values.
        seed: of everything random. device: of torch.
        init: folder of a run or policy file that learning starts from; None is none.
    """

    algorithm: str = DEFAULT_ALGORITHM
    env_id: str = DEFAULT_ENV
    control_mode: str = DEFAULT_CONTROL_MODE
    difficulty: str = "medium"
    env_kwargs: dict[str, Any] = field(default_factory=dict)
    seed: int = 0
    device: str = "cpu"
    init: str | None = None

    @property
    def environment(self) -> dict[str, Any]:
        """Keywords of the environment."""
        return {"control_mode": self.control_mode, "difficulty": self.difficulty, **self.env_kwargs}

    def context(self) -> PolicyContext:
        """Context of a policy of the environment; errors as in `task`."""
        return PolicyContext.from_env(self._env())

    def task(self) -> CaptureTask:
        """The environment's task.

        Raises:
            UnknownIdError, ConfigurationError: raised by the environment and its task.
        """
        return self._env().task

    def _env(self) -> CaptureVectorEnv:
        try:
            keywords = json.dumps(self.environment)
        except (TypeError, ValueError) as error:
            raise ConfigurationError(f"env_kwargs must be plain values: {error}") from None
        return _environment(self.env_id, keywords)


@lru_cache(maxsize=16)
def _environment(env_id: str, keywords: str) -> CaptureVectorEnv:
    """An environment that is only used for its task."""
    return CaptureVectorEnv(env_id, **json.loads(keywords))


class Settled(NamedTuple):
    """A run that passed all checks, and messages for the user."""

    settings: Settings
    parameters: AnyHyperparameters
    messages: tuple[str, ...]


def settle(given: Mapping[str, Any]) -> Settled:
    """The run that options and hyperparameters describe, by name, with defaults for omitted ones.

    Raises:
        SpaceEnvsError: for whatever would fail later: an unknown name, a value of another type or out of its
            range, what the task refuses, an expert that does not fit, a policy that cannot be started from.
    """
    settings = _settings(given)
    names = described(ALGORITHMS[settings.algorithm])
    own = {name: value for name, value in given.items() if name not in OPTIONS}
    for name in own:
        if name not in names:
            raise unknown_name(f"option or hyperparameter of {settings.algorithm}", name, [*OPTIONS, *names])
    context = settings.context()
    parameters = default_hyperparameters(context.env_id, settings.algorithm, context.layout, own)
    if isinstance(parameters, Planner) and (reasons := PlanningNetwork.needs.missing(context)):
        raise ConfigurationError(f"planner does not fit {context.env_id}: {'; '.join(reasons)}")
    FeatureView(parameters.features, context.layout, context.arm.home)
    checked_num_envs(parameters.num_envs, settings.task())
    parameters, message = _started(settings, parameters, context, given)
    whole = limited(parameters, own.get("steps"), sooner="validation_interval" not in own)
    if not isinstance(whole, BC | Planner) and (whole.expert or settings.init):
        # Of a short run too the larger part improves the actor.
        names = {"critic_warm_up", "demonstrations"} if isinstance(whole, OffPolicy) else {"critic_warm_up"}
        most = whole.steps // (2 * len(names) + 1)
        whole = replace(whole, **{name: min(getattr(whole, name), most) for name in names - own.keys()})
    if settings.init is not None and not isinstance(whole, BC | Planner):
        starting_policy(settings.init, context, whole)
    return Settled(settings, whole, tuple(filter(None, (message, rounding(whole, own.get("steps"))))))


def _settings(given: Mapping[str, Any]) -> Settings:
    hints = get_type_hints(Settings)
    values = {
        name: typed(option, given[option], hints[name]) for option, name in OPTIONS.items() if option in given
    }
    settings = Settings(**values)
    settings = replace(settings, env_id=find(settings.env_id).name)  # which other processes can make
    if settings.algorithm not in ALGORITHMS:
        raise unknown_name("algorithm", settings.algorithm, ALGORITHMS)
    if not 0 <= settings.seed < 2**32:
        raise ConfigurationError(f"seed must lie in 0..2^32 - 1, got {settings.seed}")
    for name in settings.env_kwargs:
        if name in _SET_BY:
            raise ConfigurationError(f"env_kwargs: {name} is set by {_SET_BY[name]}")
    if "init" in given and settings.algorithm in ("bc", "planner"):
        raise ConfigurationError(
            f"--init is for reinforcement; {settings.algorithm} starts from random weights"
        )
    check_device(settings.device)
    if settings.algorithm in CONTRIB and not find_spec("sb3_contrib"):
        raise ConfigurationError(f"{settings.algorithm} needs {CONTRIB_MISSING}")
    return settings


def _started(
    settings: Settings, parameters: AnyHyperparameters, context: PolicyContext, given: Mapping[str, Any]
) -> tuple[AnyHyperparameters, str | None]:
    """The hyperparameters with the expert that is cloned, and a message where there is none."""
    if isinstance(parameters, Planner):
        return parameters, None
    if "init" in given:
        if "expert" in given:
            raise ConfigurationError("give either --init or --expert")
        return replace(parameters, expert=None), None
    if "expert" not in given:
        parameters = replace(parameters, expert=default_expert(context))
    if parameters.expert is not None:
        check_needs(parameters.expert, context)
        return parameters, None
    where = f"{settings.env_id} in control mode {settings.control_mode!r}"
    if not isinstance(parameters, BC):
        return parameters, f"no expert is cloned for {where}: {settings.algorithm} starts from random weights"
    fitting = ", ".join(experts_for(context)) or "none of the registered ones"
    raise ConfigurationError(f"bc needs an --expert for {where}; policies that fit are {fitting}")


def limited(
    parameters: AnyHyperparameters, steps: int | None, minutes: float | None = None, sooner: bool = True
) -> AnyHyperparameters:
    """Hyperparameters with other steps and minutes.

    Steps are rounded up to whole rounds, as they are taken. A shorter run is validated `sooner`.
    """
    if steps is not None:
        parameters = replace(parameters, steps=steps)  # checked before it is computed with
        steps = -(-steps // parameters.round) * parameters.round
        interval = parameters.validation_interval
        if sooner:
            interval = max(1, min(interval, steps // VALIDATIONS))
        parameters = replace(parameters, steps=steps, validation_interval=interval)
    return parameters if minutes is None else replace(parameters, minutes=minutes)


def rounding(parameters: AnyHyperparameters, requested: int | None) -> str | None:
    """Message that more steps are taken than were requested; None if they are not."""
    if requested is None or requested == parameters.steps:
        return None
    return f"{parameters.steps:,} steps, not {requested:,}: whole rounds of {parameters.round:,} are taken"


def check_device(device: str) -> None:
    """Refuse a device that torch cannot use.

    Raises:
        ConfigurationError: naming it and why.
    """
    if device == "cpu":
        return
    import torch as th  # seconds to import

    try:
        th.ones(1, device=device).item()  # the device `meta` makes tensors, but computes nothing
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ConfigurationError(f"device {device!r} cannot be used: {str(error).splitlines()[0]}") from None
