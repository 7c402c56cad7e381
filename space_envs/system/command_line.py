"""What all command lines share: how they end, and what they say of a name that was mistyped."""

import argparse
import difflib
import errno
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

from space_envs.errors import ConfigurationError, SpaceEnvsError

FAILED, INVALID = 1, 2  # exit statuses
STOPPED, TERMINATED, NO_READER = 128 + signal.SIGINT, 128 + signal.SIGTERM, 128 + signal.SIGPIPE
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


class Terminated(KeyboardInterrupt):
    """SIGTERM came: the program ends as it does after Ctrl-C."""


class Parser(argparse.ArgumentParser):
    """A parser that names the option that is nearest to an unknown one."""

    _words: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As argparse's; the words are kept for `error`."""
        self._words = sys.argv[1:] if args is None else [*args]
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Say what is wrong on standard error and leave with status 2."""
        known = [name for action in self._actions for name in action.option_strings]
        hints = {}
        for word in self._words:
            name = word.partition("=")[0]
            if name[:2] == "--" and not any(option.startswith(name) for option in known):
                near = difflib.get_close_matches(name, known, n=1)
                hints |= {f"{name} is unknown, did you mean {near[0]}?": None} if near else {}
        super().error("; ".join([message, *hints]))


class Several(argparse.Action):
    """Values of an option that can be given several times: all of them count, and replace the default."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Append the values to those that were given before."""
        before = getattr(namespace, self.dest)
        setattr(namespace, self.dest, [*([] if before is self.default else before), *values])


def output_path(text: str) -> Path:
    """A path to write to, as argparse's type: an empty text would be the working directory."""
    if not text.strip():
        raise argparse.ArgumentTypeError("it must name a file or folder, got an empty text")
    return Path(text)


def may_replace(path: Path, overwrite: bool) -> None:
    """Refuse to replace a file unasked.

    Raises:
        ConfigurationError: if it is there, and `overwrite` is false, or if it is no regular file.
    """
    if path.exists() and not path.is_file():
        raise ConfigurationError(f"{path} is no file that can be replaced")
    if path.exists() and not overwrite:
        raise ConfigurationError(f"{path} is there already; --overwrite replaces it")


def ended(program: str, work: Callable[[], int | None], stopped: str = "stopped") -> int:
    """Do the work of a command line; returns the exit status.

    0 or what the work returns; 1 where the disk is full or fails; 2 for bad input; 130 after Ctrl-C; 143
    after SIGTERM. One line on standard error says what happened. 141, without a line, where nobody reads what
    is printed.

    Args:
        stopped: what is said after Ctrl-C, SIGTERM and a full disk, such as how to go on.
    """
    with _terminable():
        try:
            try:
                return work() or 0
            finally:
                sys.stdout.flush()
        except SpaceEnvsError as error:
            return _said(program, str(error), INVALID)
        except KeyboardInterrupt as error:
            return _said(program, stopped, TERMINATED if isinstance(error, Terminated) else STOPPED)
        except BrokenPipeError:
            return _unread()
        except SystemExit as error:
            if isinstance(error.__context__, BrokenPipeError):  # rich leaves so
                return _unread()
            raise
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            told = f"{where}{error.strerror or error}"
            if error.errno in _FULL:
                return _said(program, f"{told}; {stopped}", FAILED)
            return _said(program, told, INVALID)


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


def _said(program: str, text: str, status: int) -> int:
    print(f"{program}: {text}", file=sys.stderr)
    return status


def _unread() -> int:
    # What is still in the buffer would raise again when the interpreter ends.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return NO_READER
