"""What a user says about a run, checked and turned into settings and hyperparameters."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from types import NoneType
from typing import Any, get_args, get_type_hints

from agents.learning.hyperparameters import ALGORITHMS, BC, PPO, TABLES, AnyHyperparameters, hyperparameters
from agents.learning.runs import Settings
from agents.policies.registry import control_modes, missing
from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.tasks.common import DIFFICULTIES

VALIDATIONS = 10  # at least so many in a run
DEFAULT_ENV = "SpaceCapture/SingleArm-v0"
DEFAULT_ALGORITHM = "ppo"


@dataclass(frozen=True)
class Options:
    """The options of a run, named as those of train.py; None is what train.py does without the option.

    Attributes:
        hyperparameters: of the algorithm, by name, in place of its table's; lists stand for tuples.
    """

    algo: str | None = None
    env: str | None = None
    init: str | None = None
    expert: str | None = None
    steps: int | None = None
    minutes: float | None = None
    seed: int | None = None
    num_envs: int | None = None
    difficulty: str | None = None
    control_mode: str | None = None
    device: str | None = None
    hyperparameters: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def named(cls, values: Mapping[str, Any]) -> "Options":
        """From options and hyperparameters by name, of whatever type.

        Raises:
            ConfigurationError: for a name that is neither an option nor a hyperparameter of the algorithm,
                or a value of another type.
        """
        hints = {name: hint for name, hint in get_type_hints(cls).items() if name != "hyperparameters"}
        given = {name: value for name, value in values.items() if name in hints}
        for name, value in given.items():
            _check_type(name, value, hints[name])
        options = cls(**given)
        own = get_type_hints(type(options.table))
        valid = [*hints, *(name for name in own if name not in hints and name != "features")]
        others = {name: value for name, value in values.items() if name not in hints}
        for name, value in others.items():
            if name not in valid:
                raise unknown_name(f"option or hyperparameter of {options.algorithm}", name, valid)
            _check_type(name, value, own[name])
        return replace(options, hyperparameters=others)

    @property
    def algorithm(self) -> str:
        """The algorithm's name; ConfigurationError if there is none of that name."""
        name = DEFAULT_ALGORITHM if self.algo is None else self.algo
        if name not in ALGORITHMS:
            raise unknown_name("algorithm", name, ALGORITHMS)
        return name

    @property
    def table(self) -> AnyHyperparameters:
        """The hyperparameters of the id and the algorithm; ConfigurationError if there are none."""
        env_id = DEFAULT_ENV if self.env is None else self.env
        if env_id not in TABLES:
            raise unknown_name("environment id", env_id, TABLES)
        return hyperparameters(env_id, self.algorithm)

    def settle(self) -> tuple[Settings, AnyHyperparameters]:
        """Settings and hyperparameters of the run.

        Raises:
            ConfigurationError, PolicyError: for whatever would fail later.
        """
        table = self.table
        settings = Settings(
            algorithm=self.algorithm,
            env_id=DEFAULT_ENV if self.env is None else self.env,
            control_mode=self.control_mode or "joint_velocity",
            difficulty=self.difficulty or "medium",
            seed=0 if self.seed is None else self.seed,
            device=self.device or "cpu",
            init=None if self.init in (None, "none") else self.init,
        )
        changes = {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in self.hyperparameters.items()
        }
        parameters = replace(self._chosen(table), **changes)
        parameters = limited(parameters, self.steps, self.minutes, sooner="interval" not in changes)
        warm = settings.init is not None or isinstance(parameters, PPO) and parameters.expert is not None
        if isinstance(parameters, PPO) and warm and "critic_warm_up" not in changes:
            # Of a short run too the larger part improves the actor.
            warm_up = min(parameters.critic_warm_up, parameters.steps // 3)
            parameters = replace(parameters, critic_warm_up=warm_up)
        _check(settings, parameters)
        return settings, parameters

    def _chosen(self, parameters: AnyHyperparameters) -> AnyHyperparameters:
        """The table's hyperparameters with what the options say about the algorithm."""
        if self.num_envs is not None:
            parameters = replace(parameters, num_envs=self.num_envs)
        if self.init is not None:
            if not isinstance(parameters, PPO):
                raise ConfigurationError("--init is for ppo alone; the others start from random weights")
            if self.expert is not None:
                raise ConfigurationError("give either --init or --expert")
            return replace(parameters, expert=None)
        if self.expert is None:
            return parameters
        if not isinstance(parameters, PPO | BC):
            raise ConfigurationError("--expert is for bc and ppo alone")
        return replace(parameters, expert=self.expert)


OPTIONS = tuple(each.name for each in fields(Options) if each.name != "hyperparameters")


def limited(
    parameters: AnyHyperparameters, steps: int | None, minutes: float | None, sooner: bool = True
) -> AnyHyperparameters:
    """Hyperparameters with other steps and minutes.

    Steps are rounded up to whole rounds, as they are taken. A shorter run is validated `sooner`.
    """
    if steps is not None:
        parameters = replace(parameters, steps=steps)  # checked before it is computed with
        steps = -(-steps // parameters.round) * parameters.round
        interval = parameters.interval
        if sooner:
            interval = max(1, min(interval, steps // VALIDATIONS))
        parameters = replace(parameters, steps=steps, interval=interval)
    return parameters if minutes is None else replace(parameters, minutes=minutes)


def rounding(parameters: AnyHyperparameters, asked: int | None) -> str | None:
    """What to tell of steps that were asked for and rounded up; None if they were not."""
    if asked is None or asked == parameters.steps:
        return None
    return f"{parameters.steps:,} steps, not {asked:,}: whole rounds of {parameters.round:,} are taken"


def _check(settings: Settings, parameters: AnyHyperparameters) -> None:
    """Refuse what would fail later."""
    if settings.control_mode not in CONTROL_MODES:
        raise unknown_name("control mode", settings.control_mode, CONTROL_MODES)
    if settings.difficulty not in DIFFICULTIES:
        raise unknown_name("difficulty", settings.difficulty, DIFFICULTIES)
    if not 0 <= settings.seed < 2**32:
        raise ConfigurationError(f"seed must lie in 0..2^32 - 1, got {settings.seed}")
    check_device(settings.device)
    if isinstance(parameters, PPO | BC) and parameters.expert is not None:
        modes = control_modes(parameters.expert)
        if settings.control_mode not in modes:
            raise ConfigurationError(
                f"expert {parameters.expert!r} acts in control mode {' or '.join(map(repr, modes))}, not "
                f"{settings.control_mode!r}; "
                "name another --expert, or for ppo --init none"
            )
        if reasons := missing(parameters.expert, settings.env_id, settings.control_mode):
            raise ConfigurationError(
                f"expert {parameters.expert!r} does not fit {settings.env_id}: {'; '.join(reasons)}"
            )
    if isinstance(parameters, PPO) and settings.init is not None:
        from agents.learning.training import starting_policy  # torch takes seconds to import

        starting_policy(settings, parameters)


def check_device(device: str) -> None:
    """Refuse a device that torch cannot use.

    Raises:
        ConfigurationError: naming it and why.
    """
    if device == "cpu":
        return
    import torch as th

    try:
        th.ones(1, device=device).item()  # the device `meta` makes tensors, but computes nothing
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ConfigurationError(f"device {device!r} cannot be used: {str(error).splitlines()[0]}") from None


def _check_type(name: str, value: Any, hint: Any) -> None:
    """Refuse a value of a file that is not of the type that a field has."""
    several = get_args(hint) if NoneType in get_args(hint) else (hint,)
    kinds = [kind for kind in several if kind is not NoneType]
    if not any(_fits(value, kind) for kind in kinds):
        names = {float: "a number", int: "a whole number", str: "text"}
        said = " or ".join(names.get(kind, "a list of whole numbers") for kind in kinds)
        raise ConfigurationError(f"{name} must be {said}, got {value!r}")


def _fits(value: Any, kind: Any) -> bool:
    if kind is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if kind is int:
        return isinstance(value, int) and not isinstance(value, bool)
    if kind is str:
        return isinstance(value, str)
    return isinstance(value, list) and all(_fits(each, int) for each in value)
