"""Output folders of commands: marked, locked by one process at a time, and protected from deletion by
mistake.

The mark of a folder has the kind of its content and the process that writes to it. It is locked during
writing; the system releases the lock when the process ends.
"""

import fcntl
import json
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError
from space_envs.system.reading import read_object

MARK = ".space-capture"


@contextmanager
def held(folder: Path, kind: str, known: bool = False) -> Iterator[None]:
    """Create a folder for one kind of content, and lock it against other processes.

    Args:
        known: whether its content is known to be of this kind, even without a mark.

    Raises:
        ConfigurationError: if it cannot be written, holds files that no command put there, is for another
            kind of thing, or another process writes to it.
    """
    if not known:
        check_free(folder, kind)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark = os.open(folder / MARK, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}") from None
    try:
        try:
            fcntl.flock(mark, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigurationError(f"{_writer(folder)} writes to {folder}; wait, or name another") from None
        except OSError as error:
            raise ConfigurationError(f"{folder} cannot be locked: {error.strerror}") from None
        try:
            _write(mark, {"kind": kind, "process": os.getpid(), "machine": socket.gethostname()})
            yield
        finally:
            _write(mark, {"kind": kind})  # what is shared with others does not name the machine
    finally:
        os.close(mark)


def check_free(folder: Path, kind: str) -> None:
    """Reject a folder with another kind of content, before any work.

    Raises:
        ConfigurationError: if it is no folder, holds files that no command put there, or is for another kind.
    """
    if not folder.exists():
        return
    if not folder.is_dir():
        raise ConfigurationError(f"{folder} is a file; expected a folder to write to")
    found = _mark(folder).get("kind")
    if found is None and any(path.name != MARK for path in folder.iterdir()):
        raise ConfigurationError(
            f"{folder} holds files, and no {MARK} that marks it as of {_a(kind)}; name an empty or new folder"
        )
    if found is not None and found != kind:
        raise ConfigurationError(f"{folder} is of {_a(str(found))}, not of {_a(kind)}; name another folder")


def holder(folder: Path) -> str | None:
    """Process that writes to a folder now, in words, or None."""
    try:
        mark = os.open(folder / MARK, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(mark, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _writer(folder)
    finally:
        os.close(mark)
    return None


def remove_files(folder: Path, *patterns: str) -> None:
    """Remove files of a folder by their names' patterns, and the folder if nothing else is in it."""
    for pattern in patterns:
        for path in folder.glob(pattern):
            if path.is_file() or path.is_symlink():
                path.unlink(missing_ok=True)
    if folder.is_dir() and not folder.is_symlink() and not any(folder.iterdir()):
        folder.rmdir()


def _write(mark: int, values: dict[str, Any]) -> None:
    os.ftruncate(mark, 0)
    os.pwrite(mark, (json.dumps(values) + "\n").encode(), 0)


def _mark(folder: Path) -> dict[str, Any]:
    try:
        return read_object(folder / MARK)
    except (OSError, ConfigurationError):
        return {}


def _writer(folder: Path) -> str:
    found = _mark(folder)
    return f"process {found.get('process', 'unknown')} on {found.get('machine', 'another machine')}"


def _a(kind: str) -> str:
    article = "an" if kind[:1] in "aeiou" else "a"
    return kind if kind.endswith("s") else f"{article} {kind}"
