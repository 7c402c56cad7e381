"""Options of `train.py`: those of a run, and those of hyperparameters, made from their dataclasses."""

import argparse
import json
from collections.abc import Sequence
from typing import Any, get_args

from agents.commands.choice import add_perturb
from agents.commands.robots import add_robot, robot_keywords, with_absolute_path
from agents.learning.runs.hyperparameters import ALGORITHMS, AnyHyperparameters, described, to_json
from agents.learning.runs.settings import DEFAULT_ALGORITHM, DEFAULT_ENV, OPTIONS, Settings
from agents.learning.runs.warm_start import DEFAULT_EXPERTS
from agents.learning.sweeps.plan import read_toml
from agents.learning.validation import EPISODES
from space_envs.control import CONTROL_MODES
from space_envs.errors import ConfigurationError, shown
from space_envs.system.command_line import output_path
from space_envs.tasks.common import DIFFICULTIES

_WORDS = {"true": True, "false": False, "none": None}  # also as Python spells them
_TEXT = {"expert": f"the first of {', '.join(DEFAULT_EXPERTS)} that fits", "features": "those of the id"}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of one run except hyperparameters; the value of an option that is not given is None."""
    add = parser.add_argument
    add("--algo", metavar="NAME", help=f"{', '.join(ALGORITHMS)}; default {DEFAULT_ALGORITHM}")
    add("--env", metavar="ID", help=f"environment id, or module:id; default {DEFAULT_ENV}")
    add("--init", metavar="RUN", help="run folder or policy file to start from, or none; not for bc")
    add("--seed", type=int, metavar="S", help="of everything random; default 0")
    add("--difficulty", metavar="NAME", help=f"{', '.join(DIFFICULTIES)}; default {Settings.difficulty}")
    add("--control-mode", metavar="NAME", help=f"{', '.join(CONTROL_MODES)}; default {Settings.control_mode}")
    add_robot(add)
    add_perturb(parser)
    what = "other keywords of the environment, as KEY=VALUE or one JSON object"
    add("--env-kwargs", nargs="+", metavar="KEY=VALUE", help=what)
    add("--device", metavar="NAME", help="of torch; default cpu, which is the fastest for these networks")
    what = "TOML file of options and hyperparameters; those of the command line take precedence"
    add("--config", metavar="FILE", help=what)
    what = (
        "run folder, default runs/ALGO-ID-TIME; for several runs the folder that holds theirs, default "
        "runs/ALGO-ID or runs/ and the sweep file's name"
    )
    add("--output", type=output_path, metavar="FOLDER", help=what)
    what = "continue this run; only --steps and --minutes may be changed"
    add("--resume", metavar="RUN", help=what)
    what = f"goals of a validation; default {EPISODES}, or all of the split if there are fewer"
    add("--validation-episodes", type=int, metavar="N", help=what)
    add("--dry-run", action="store_true", help="check, print the run as a --config file, and stop")
    add("--quiet", action="store_true", help="print neither a progress bar nor messages")


def add_hyperparameters(parser: argparse.ArgumentParser) -> None:
    """One option for each hyperparameter of any algorithm, as its dataclass describes it."""
    group = parser.add_argument_group(
        "hyperparameters", "Defaults of some ids differ; --dry-run prints them."
    )
    for name in hyperparameter_names():
        rows = {kind: described(each)[name] for kind, each in ALGORITHMS.items() if name in described(each)}
        hints = [hint for hint, _ in rows.values()]
        several = any(get_args(hint)[1:] == (...,) for hint in hints)
        metavar = "FIELD:KIND:SCALE" if name == "features" else "NAME" if str in hints else "X"
        group.add_argument(
            f"--{name.replace('_', '-')}",
            type=_word,
            nargs="+" if several else None,
            metavar=metavar,
            help=f"{next(iter(rows.values()))[1].meaning}; default {_defaults(name, list(rows))}",
        )


def hyperparameter_names() -> list[str]:
    """Names of the hyperparameters of all algorithms."""
    return list(dict.fromkeys(name for each in ALGORITHMS.values() for name in described(each)))


def _defaults(name: str, algorithms: Sequence[str]) -> str:
    """Default of a hyperparameter, with the algorithms to which it applies."""
    by_value: dict[str, list[str]] = {}
    for each in algorithms:
        value = _TEXT.get(name) or getattr(ALGORITHMS[each], name)
        text = " ".join(map(str, value)) if isinstance(value, tuple) else str(value).lower()
        by_value.setdefault(text, []).append(each)
    if len(by_value) == 1 and len(algorithms) == len(ALGORITHMS):
        return next(iter(by_value))
    return ", ".join(f"{text} ({', '.join(names)})" for text, names in by_value.items())


def _word(text: str) -> int | float | str:
    """A number if the text is one."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def given_options(parsed: argparse.Namespace) -> dict[str, Any]:
    """Options and hyperparameters that a file or the command line gives, by name.

    Raises:
        ConfigurationError: for an invalid file or malformed keywords.
    """
    given = {} if parsed.config is None else read_toml(parsed.config, "configuration file")
    names = [*OPTIONS, *hyperparameter_names()]
    given |= {name: value for name in names if (value := getattr(parsed, name)) is not None}
    if parsed.env_kwargs is not None:
        given["env_kwargs"] = environment_keywords(parsed.env_kwargs)
    keywords = given.get("env_kwargs", {})
    perturbation = {} if parsed.perturb is None else {"perturbation": " ".join(parsed.perturb)}
    if isinstance(keywords, dict) and (
        given_keywords := {**keywords, **robot_keywords(parsed), **perturbation}
    ):
        given["env_kwargs"] = with_absolute_path(given_keywords)
    return given


def environment_keywords(words: Sequence[str]) -> dict[str, Any]:
    """Keywords from KEY=VALUE, where a value is JSON or else text, and from objects of JSON.

    Raises:
        ConfigurationError: for a word that is neither, and a key that is given twice.
    """
    pairs: list[tuple[str, Any]] = []
    for word in words:
        key, equals, text = word.partition("=")
        if word.lstrip().startswith("{"):
            try:
                pairs += json.loads(word).items()
            except ValueError as error:
                raise ConfigurationError(f"--env-kwargs: {shown(word)} is not JSON: {error}") from None
        elif equals and key.isidentifier():
            pairs.append((key, _value(text)))
        else:
            raise ConfigurationError(f"--env-kwargs must be KEY=VALUE or a JSON object, got {shown(word)}")
    keys = [key for key, _ in pairs]
    if twice := [key for key in keys if keys.count(key) > 1]:
        raise ConfigurationError(f"--env-kwargs: {twice[0]} is given twice")
    return dict(pairs)


def _value(text: str) -> Any:
    if text.lower() in _WORDS:
        return _WORDS[text.lower()]
    try:
        return json.loads(text)
    except ValueError:
        return text


def to_toml(settings: Settings, parameters: AnyHyperparameters) -> str:
    """Options and hyperparameters of a run as a file that --config takes."""
    values = {option: getattr(settings, name) for option, name in OPTIONS.items()} | to_json(parameters)
    del values["init" if settings.init is None else "expert"]  # only one of them is given
    return "".join(f"{name} = {_toml(value)}\n" for name, value in values.items())


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return '"none"' if value is None else repr(value) if isinstance(value, float) else json.dumps(value)
