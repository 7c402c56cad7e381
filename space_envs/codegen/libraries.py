"""C sources compiled once by the system's compiler and cached for the user.

A cached library is named after a hash of everything it was made from and a digest of its own bytes, so that a
damaged or half-copied file is noticed before it is loaded, and rebuilt. A library is code: files that other
users could have written are neither loaded nor built upon.
"""

import contextlib
import ctypes
import functools
import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

from space_envs.codegen.cache import CACHE_VARIABLE, LibraryError, ownership_problem, usable_folder
from space_envs.system.digests import file_digest

# Without contraction into fused multiply-add a result is the same on every machine with IEEE arithmetic.
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
TIMEOUT = 120.0  # s
_MODULE = "space_envs"  # module of the warnings


class NoCompiledCodeWarning(RuntimeWarning):
    """No C compiler is available: results are the same, computation is many times slower."""


@functools.cache
def warn_uncompiled(reason: str) -> None:
    """Warn that there is no compiled code: once per process and reason, in one line without the source.

    Warns:
        NoCompiledCodeWarning: with the reason.
    """
    message = f"functions run without compiled code, up to twenty times slower: {reason}"
    warnings.warn_explicit(message, NoCompiledCodeWarning, _MODULE, 1)


@contextlib.contextmanager
def warned_once() -> Iterator[None]:
    """Warn now if there is no compiler, and have the processes that are started inside not repeat it.

    Warns:
        NoCompiledCodeWarning: with the reason.
    """
    before = os.environ.get("PYTHONWARNINGS")
    try:
        _compiler()
    except LibraryError as error:
        warn_uncompiled(str(error))
        quiet = f"ignore::{RuntimeWarning.__name__}:{_MODULE}"
        os.environ["PYTHONWARNINGS"] = quiet if before is None else f"{before},{quiet}"
    try:
        yield
    finally:
        os.environ.pop("PYTHONWARNINGS", None)
        if before is not None:
            os.environ["PYTHONWARNINGS"] = before


def load_library(source: str, native: bool = False) -> ctypes.CDLL:
    """The shared library of a C source, from the cache or built into it.

    Args:
        native: whether it may use all instructions of this processor, such as those on wide vectors.

    Raises:
        LibraryError: if there is no compiler, it fails, or no cache can be written or loaded from.

    Warns:
        UnsafeCacheWarning: if other users can write to the cache; a temporary folder is used then.
    """
    command = _compiler()
    flags, processor = _native(tuple(command)) if native else ((), "")
    command, key = [*command, *flags], _key(source, command, processor)
    try:
        folder = usable_folder()
        for path in _intact(folder, key):
            with contextlib.suppress(OSError):  # intact, but of another system that shares the folder
                return ctypes.CDLL(str(path))
        return ctypes.CDLL(str(_build(source, command, folder, key)))
    except OSError as error:
        raise LibraryError(
            f"the cache of compiled code cannot be used ({error}); set {CACHE_VARIABLE}"
        ) from error


def _compiler() -> list[str]:
    """Command of the C compiler: CC if that is set, else the first of cc, gcc, clang."""
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in [chosen] if chosen else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(command[0])
        if path:
            return [path, *command[1:]]
    raise LibraryError(f"no C compiler was found ({f'CC={chosen[0]}' if chosen else 'cc, gcc, clang'})")


def _run(command: list[str], source: str = "") -> str:
    try:
        done = subprocess.run(
            command,
            input=source,
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
            errors="replace",
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise LibraryError(f"the C compiler did not run: {error}") from error
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise LibraryError(f"the C compiler failed ({shlex.join(command)}): {last[0]}")
    return done.stdout


@functools.cache
def _native(command: tuple[str, ...]) -> tuple[tuple[str, ...], str]:
    """Flags for all instructions of this processor, if the compiler has any, and what they stand for."""
    flags = ("-march=native",)
    try:
        return flags, _run([*command, *flags, "-dM", "-E", "-x", "c", "-"])
    except LibraryError:
        return (), ""


def _key(source: str, command: list[str], processor: str) -> str:
    digest = hashlib.sha256()
    for part in (
        source,
        processor,
        *command,
        *FLAGS,
        _run([*command, "--version"]),
        sys.platform,
        platform.machine(),
    ):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:32]


def _suffix() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def _intact(folder: Path, key: str) -> Iterator[Path]:
    """Libraries with this key that only the user can have written and whose bytes match their name."""
    for path in sorted(folder.glob(f"{key}-*{_suffix()}")):
        try:
            status = path.lstat()
            safe = stat.S_ISREG(status.st_mode) and not ownership_problem(status)
            if safe and path.stem == f"{key}-{file_digest(path)[:32]}":
                yield path
        except OSError:
            continue  # unreadable, or another process is replacing it


def _build(source: str, command: list[str], folder: Path, key: str) -> Path:
    """Compile in a temporary folder and rename, so that processes can build the same library at once."""
    with tempfile.TemporaryDirectory(prefix=".build-", dir=folder) as temporary:
        built = Path(temporary) / f"kernel{_suffix()}"
        _run([*command, *FLAGS, "-x", "c", "-", "-o", str(built), "-lm"], source)
        built.chmod(0o700)  # whatever the umask
        path = folder / f"{key}-{file_digest(built)[:32]}{_suffix()}"
        os.replace(built, path)
    return path
