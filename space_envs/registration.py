"""Registration of tasks by id, of this package and of any other: the one table of tasks."""

import inspect
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib import import_module
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import make

from space_envs.errors import (
    ConfigurationError,
    UnfitRobotError,
    UnknownIdError,
    positive,
    shown,
    unknown_id,
    unknown_keyword,
    unknown_name,
)
from space_envs.foreign_code import described, undisturbed
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import LARGEST_TOLERANCE

PACKAGE = __name__.partition(".")[0]
_ID = re.compile(r"[A-Za-z0-9_-]+/[A-Za-z0-9_.-]+-v\d+")

# Keywords of gym.make that set the capture envelope, and the field of CaptureEnvelope each one sets.
ENVELOPE_KEYWORDS = {
    "position_tolerance": "position",
    "orientation_tolerance": "orientation",
    "approach_tolerance": "approach",
    "linear_velocity_tolerance": "linear_velocity",
    "angular_velocity_tolerance": "angular_velocity",
    "hold_time": "hold",
}


@dataclass(frozen=True)
class RegisteredTask:
    """A registered id.

    Attributes:
        id: as in `gym.make`, after registration.
        source: class of the task, or its name as "module:Class", imported at first use.
        module: module that registers the id on import.
        defaults: keywords of the task that differ from those of its class.
    """

    id: str
    source: type[CaptureTask] | str
    module: str
    defaults: Mapping[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Id that works in every process: `module:id`, or the id alone if this package registers it."""
        here = self.module.partition(".")[0] in (PACKAGE, "__main__")
        return self.id if here else f"{self.module}:{self.id}"

    @cached_property
    def task(self) -> type[CaptureTask]:
        """Class of the task.

        Raises:
            ConfigurationError: if it cannot be imported or is not a task.
        """
        return _imported(self.source, self.id) if isinstance(self.source, str) else self.source

    @property
    def summary(self) -> str:
        """The first paragraph of the task's docstring, as one line without a full stop."""
        return " ".join(inspect.getdoc(self.task).partition("\n\n")[0].split()).rstrip(".")  # type: ignore[union-attr]

    def make(self, keywords: Mapping[str, Any]) -> CaptureTask:
        """The task with keywords of `gym.make`; errors as in `make_task`."""
        keywords = {**self.defaults, **keywords}
        task = self.task()
        names = [f.name for f in fields(task) if f.name != "envelope"]
        within = {f.name for f in fields(task.envelope)}
        tolerances = [keyword for keyword, name in ENVELOPE_KEYWORDS.items() if name in within]
        own = {"control_mode", "render_mode", "width", "height", "camera", "threads", "max_episode_steps"}
        for name in keywords:
            if name not in names and name not in tolerances:
                raise unknown_keyword(name, [*names, *tolerances, *sorted(own)])
        given = {
            ENVELOPE_KEYWORDS[name]: positive(name, keywords[name], LARGEST_TOLERANCE)
            for name in tolerances
            if name in keywords
        }
        usual = {name: value for name, value in keywords.items() if name in names}
        try:
            return self.task(**usual, envelope=replace(task.envelope, **given))
        except UnfitRobotError as error:
            raise UnfitRobotError(self.id, error.args[1]) from None


ENTRIES: dict[str, RegisteredTask] = {}


def register(id: str, task: type[CaptureTask] | str, **defaults: Any) -> None:
    """Register a task under an id for `gym.make`, `gym.make_vec` and every command.

    Call it in a module that can be imported: other processes import it to find the task, and users name the
    id as `module:id`. The same registration again changes nothing.

    Args:
        id: of the form Namespace/Name-v0.
        task: subclass of `CaptureTask`, or its name as "module:Class", imported at first use.
        **defaults: keywords of the task that differ from the defaults of its class.

    Raises:
        ConfigurationError: for an invalid form of the id, an id of another task, an object that is not a
            task, or an invalid default.
        UnknownKeywordError: for a default that is not a keyword of the task.
    """
    if not isinstance(id, str) or not _ID.fullmatch(id):
        raise ConfigurationError(f"an environment id has the form 'Namespace/Name-v0', got {shown(id)}")
    if not isinstance(task, str):
        _check_class(task, id)
    frame = inspect.currentframe()
    module = frame.f_back.f_globals.get("__name__", "__main__") if frame and frame.f_back else "__main__"
    entry = RegisteredTask(id, task, module, defaults)
    if (known := ENTRIES.get(id)) is not None and _words(known) != _words(entry):
        raise ConfigurationError(
            f"environment id {id!r} is registered already, by {known.module} for {_words(known)[0]}; "
            f"got {_words(entry)[0]} from {module}"
        )
    if not isinstance(task, str):
        entry.make({})
    ENTRIES[id] = entry
    gym.registry.pop(id, None)  # Gymnasium warns of a known id
    gym.register(
        id=id,
        entry_point=f"{PACKAGE}.envs:CaptureEnv",
        vector_entry_point=f"{PACKAGE}.envs:CaptureVectorEnv",
        kwargs={"env_id": entry.name},
    )


def unregister(id: str) -> None:
    """Remove an id.

    Raises:
        UnknownIdError: if it is not registered.
    """
    del ENTRIES[find(id).id], gym.registry[id]


def find(name: str) -> RegisteredTask:
    """Entry of an id; for `module:id` its module is imported first, which runs that module's code.

    Raises:
        UnknownIdError: if the id is unknown or the module cannot be imported.
    """
    if not isinstance(name, str):
        raise unknown_id(name, ENTRIES)
    module, _, env_id = name.rpartition(":")
    if module and module not in sys.modules:
        try:
            with undisturbed():
                import_module(module)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a user's module may raise anything on import
            raise UnknownIdError(
                f"module {module!r} of environment id {name!r} cannot be imported: {described(error)}"
            ) from None
    if env_id not in ENTRIES:
        raise unknown_id(env_id, ENTRIES)
    return ENTRIES[env_id]


def make_task(name: str, keywords: Mapping[str, Any]) -> CaptureTask:
    """Build the task of an id, or of `module:id`, from the keywords of `gym.make`.

    Raises:
        UnknownIdError: for an unknown id. UnknownKeywordError: for an unknown keyword.
        UnfitRobotError: for a robot that does not fit the task. ConfigurationError: for an invalid value.
    """
    return find(name).make(keywords)


def _imported(source: str, env_id: str) -> type[CaptureTask]:
    module_name, _, class_name = source.partition(":")
    if not all(part.isidentifier() for part in [*module_name.split("."), class_name]):
        raise ConfigurationError(f"task of {env_id} must be a class or 'module:Class', got {source!r}")
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise ConfigurationError(f"task {source!r} of {env_id} cannot be imported: {error}") from None
    if not hasattr(module, class_name):
        names = [name for name, value in vars(module).items() if isinstance(value, type)]
        raise unknown_name(f"class of module {module_name!r}", class_name, names)
    return _check_class(getattr(module, class_name), env_id)


def _check_class(task: Any, env_id: str) -> type[CaptureTask]:
    if not isinstance(task, type) or not issubclass(task, CaptureTask):
        raise ConfigurationError(
            f"task of {env_id} must be a subclass of {CaptureTask.__module__}.CaptureTask or its name as "
            f"'module:Class', got {shown(task)}"
        )
    return task


def _words(entry: RegisteredTask) -> tuple[str, dict[str, Any]]:
    """Name of an entry's class as "module:Class", and its defaults."""
    kind = entry.source
    name = kind if isinstance(kind, str) else f"{kind.__module__}:{kind.__qualname__}"
    return name, dict(entry.defaults)


def max_steps_of_make(env: gym.Env) -> Any:
    """`max_episode_steps` of the `gym.make` call that constructs `env`, from its argument or spec, or None.

    `gym.make` adds a TimeLimit wrapper and does not pass the number on. The environment truncates its
    episodes itself and must know it, or there would be two limits; so it is read from the frame of the call.
    That frame is the first one outside the constructors of `env`; frames further out construct other objects
    that contain `env`.
    """
    frame = inspect.currentframe()
    frame = frame and frame.f_back
    while frame is not None and frame.f_locals.get("self") is env:
        frame = frame.f_back
    if frame is None or frame.f_code is not make.__code__:
        return None
    given, spec = (frame.f_locals.get(name) for name in ("max_episode_steps", "env_spec"))
    return getattr(spec, "max_episode_steps", None) if given is None else given
