"""Common parts of all command lines: a parser with hints and a version, and exit statuses."""

import argparse
import difflib
import errno
import itertools
import os
import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.system.provenance import package_version

FAILED, INVALID = 1, 2  # exit statuses
STOPPED, TERMINATED, NO_READER = 128 + signal.SIGINT, 128 + signal.SIGTERM, 128 + signal.SIGPIPE
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
MOST_SEEDS = 10_000  # of a list


class Terminated(KeyboardInterrupt):
    """SIGTERM was received: the program ends as it does after Ctrl-C."""


class Parser(argparse.ArgumentParser):
    """A parser with `--version`, whose errors name the option nearest to an unknown one."""

    _words: Sequence[str] = ()

    def __init__(self, *args: Any, **keywords: Any) -> None:
        super().__init__(*args, **keywords)
        self.add_argument("--version", action="version", version=f"space-capture {package_version()}")

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parsed arguments and those left over, as argparse's; the words are stored for `error`."""
        self._words = sys.argv[1:] if args is None else [*args]
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Print the message and the nearest options on standard error, and exit with status 2."""
        known = [name for action in self._actions for name in action.option_strings]
        hints = {}
        for word in self._words:
            name = word.partition("=")[0]
            if name[:2] == "--" and not any(option.startswith(name) for option in known):
                near = difflib.get_close_matches(name, known, n=1)
                hints |= {f"{name} is unknown, did you mean {near[0]}?": None} if near else {}
        super().error("; ".join([message, *hints]))


class AppendValues(argparse.Action):
    """Action of an option that can be given several times: its values add up and replace the default."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Append the values to those given before."""
        before = getattr(namespace, self.dest)
        setattr(namespace, self.dest, [*([] if before is self.default else before), *values])


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds from numbers and ranges like 0-9 or 0,3,5-7.

    Raises:
        ConfigurationError: for other text, a seed named twice, or more than `MOST_SEEDS`.
    """
    spans: list[range] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,10})(?:-(\d{1,10}))?\s*", part)
        first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
        if last < first:
            raise ConfigurationError(f"seeds are numbers and ranges like 0-9 or 0,3,5-7, got {text!r}")
        spans.append(range(first, last + 1))
    if sum(map(len, spans)) > MOST_SEEDS:
        raise ConfigurationError(
            f"{text!r} are {sum(map(len, spans)):,} seeds; at most {MOST_SEEDS:,} are possible"
        )
    seeds = tuple(itertools.chain(*spans))
    if len(set(seeds)) < len(seeds):
        twice = next(seed for seed in seeds if seeds.count(seed) > 1)
        raise ConfigurationError(f"seeds: {twice} is there twice")
    return seeds


def output_path(text: str) -> Path:
    """Path to write to, as an argparse type; an empty text, which names the working folder, is refused."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it must name a file or folder, got an empty text")
    return Path(text)


def check_replaceable(path: Path, overwrite: bool) -> None:
    """Refuse to replace a file without `overwrite`.

    Raises:
        ConfigurationError: if it exists and `overwrite` is false, or if it is not a regular file.
    """
    if path.exists() and not path.is_file():
        raise ConfigurationError(f"{path} is not a file that can be replaced")
    if path.exists() and not overwrite:
        raise ConfigurationError(f"{path} exists already; --overwrite replaces it")


def exit_status(program: str, work: Callable[[], int | None], stopped: str = "stopped") -> int:
    """Exit status of a command line's work: 0 or what the work returns.

    1 where the disk is full or fails; 2 for bad input; 130 after Ctrl-C; 143 after SIGTERM, each with one
    line on standard error. 141, without a line, where nobody reads the output.

    Args:
        stopped: message after Ctrl-C, SIGTERM and a full disk, such as how to continue.
    """
    with _terminable():
        try:
            try:
                return work() or 0
            finally:
                sys.stdout.flush()
        except SpaceEnvsError as error:
            return _report(program, str(error), INVALID)
        except KeyboardInterrupt as error:
            return _report(program, stopped, TERMINATED if isinstance(error, Terminated) else STOPPED)
        except BrokenPipeError:
            return _without_reader()
        except SystemExit as error:
            if isinstance(error.__context__, BrokenPipeError):  # rich exits this way
                return _without_reader()
            raise
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            message = f"{where}{error.strerror or error}"
            if error.errno in _FULL:
                return _report(program, f"{message}; {stopped}", FAILED)
            return _report(program, message, INVALID)


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM raises `Terminated` in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def terminate(number: int, frame: object) -> NoReturn:
        raise Terminated

    before = signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL if before is None else before)


def _report(program: str, message: str, status: int) -> int:
    print(f"{program}: {message}", file=sys.stderr)
    return status


def _without_reader() -> int:
    # The rest of the buffer would raise again when the interpreter ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return NO_READER
