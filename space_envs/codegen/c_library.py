"""C sources compiled once by the system's compiler and kept in a per-user cache.

A cached library is named after a hash of all that it was made from and a digest of its own bytes, so that a
damaged or half-copied file is noticed before it is loaded, and built again. A library is code: what others
than the user could have written is neither loaded nor built upon.
"""

import contextlib
import ctypes
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

from space_envs.errors import SpaceEnvsError

CACHE_VARIABLE = "SPACE_ENVS_CACHE"
# Without contraction into fused multiply-add a result is the same on every machine with IEEE arithmetic.
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
_TIMEOUT = 120.0  # s


class LibraryError(SpaceEnvsError, RuntimeError):
    """A C library could not be built, kept or loaded; the message says what is missing."""


class UnsafeCacheError(LibraryError):
    """Others than the user can write to the cache; the message says what to change."""


class UnsafeCacheWarning(RuntimeWarning):
    """The cache of compiled code is left alone, since others can write to it; another is used."""


def cache_folder() -> Path:
    """Folder of compiled libraries: SPACE_ENVS_CACHE, or the platform's place for caches of a user.

    Raises:
        LibraryError: if the user has no home folder.
    """
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).absolute()
    try:
        home = Path.home()
    except RuntimeError:
        raise LibraryError(f"there is no home folder for a cache; set {CACHE_VARIABLE}") from None
    if sys.platform == "win32":
        place = os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local"
    elif sys.platform == "darwin":
        place = home / "Library" / "Caches"
    else:
        given = os.environ.get("XDG_CACHE_HOME", "")
        place = given if os.path.isabs(given) else home / ".cache"
    return Path(place) / "space_envs"


def private_folder(folder: Path) -> Path:
    """The folder, made if it is not there, of which only the user can change the content; links resolved.

    On systems without owners of files, such as Windows, nothing is checked.

    Raises:
        UnsafeCacheError: if somebody else owns it, its group or others can write to it, or everybody can
            rename it. OSError: if it cannot be made.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = folder.resolve(strict=True)
    problem = _unsafe(folder.stat())
    if problem:
        raise UnsafeCacheError(f"{folder} {problem}")
    for above in folder.parents if _has_owners() else ():
        mode = above.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise UnsafeCacheError(f"{folder} can be replaced: everybody can write to {above} (chmod o-w)")
    return folder


def load_library(source: str) -> ctypes.CDLL:
    """The shared library of a C source, from the cache or built into it.

    Where others can write to the cache, a private folder among the temporary files takes its place.

    Raises:
        LibraryError: if there is no compiler, it fails, or no cache can be written or loaded from.

    Warns:
        UnsafeCacheWarning: if others can write to the cache.
    """
    command = _compiler()
    key = _key(source, command)
    try:
        folder = _usable_folder()
        for path in _intact(folder, key):
            with contextlib.suppress(OSError):  # whole, yet of another system that shares the folder
                return ctypes.CDLL(str(path))
        return ctypes.CDLL(str(_build(source, command, folder, key)))
    except OSError as error:
        raise LibraryError(
            f"the cache of compiled code cannot be used ({error}); set {CACHE_VARIABLE}"
        ) from error


def _usable_folder() -> Path:
    """The cache, or the private folder that takes its place."""
    try:
        return private_folder(cache_folder())
    except UnsafeCacheError as error:
        other = Path(tempfile.gettempdir()) / f"space_envs-{os.geteuid()}"
        message = f"compiled code is kept in {other}: {error}, or set {CACHE_VARIABLE}"
        warnings.warn(message, UnsafeCacheWarning, stacklevel=3)
        return private_folder(other)


def _has_owners() -> bool:
    return hasattr(os, "geteuid")


def _unsafe(status: os.stat_result) -> str:
    """What is wrong with the owner and the mode of a file or folder; empty if nothing is."""
    if not _has_owners():
        return ""
    if status.st_uid != os.geteuid():
        return f"belongs to user {status.st_uid}, not to {os.geteuid()}"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"can be written to by others (mode {stat.S_IMODE(status.st_mode):o}; chmod go-w)"
    return ""


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
            timeout=_TIMEOUT,
            errors="replace",
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise LibraryError(f"the C compiler did not run: {error}") from error
    if done.returncode != 0:
        last = done.stderr.strip().splitlines()[-1:] or ["no message"]
        raise LibraryError(f"the C compiler failed ({shlex.join(command)}): {last[0]}")
    return done.stdout


def _key(source: str, command: list[str]) -> str:
    digest = hashlib.sha256()
    for part in (source, *command, *FLAGS, _run([*command, "--version"]), sys.platform, platform.machine()):
        digest.update(part.encode() + b"\0")
    return digest.hexdigest()[:32]


def _suffix() -> str:
    return {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


def _intact(folder: Path, key: str) -> Iterator[Path]:
    """Libraries of this key that only the user can have written and whose bytes are what their name says."""
    for path in sorted(folder.glob(f"{key}-*{_suffix()}")):
        try:
            status = path.lstat()
            safe = stat.S_ISREG(status.st_mode) and not _unsafe(status)
            if safe and path.stem == f"{key}-{_digest(path)}":
                yield path
        except OSError:
            continue  # unreadable, or another process is replacing it


def _build(source: str, command: list[str], folder: Path, key: str) -> Path:
    """Compile beside the cache entry and rename, so that processes that do it at once cannot meet halfway."""
    with tempfile.TemporaryDirectory(prefix=".build-", dir=folder) as workplace:
        built = Path(workplace) / f"kernel{_suffix()}"
        _run([*command, *FLAGS, "-x", "c", "-", "-o", str(built), "-lm"], source)
        built.chmod(0o700)  # whatever the umask
        path = folder / f"{key}-{_digest(built)}{_suffix()}"
        os.replace(built, path)
    return path
