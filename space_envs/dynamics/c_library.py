"""C sources compiled once by the system's compiler and kept in a per-user cache.

A cached library is named after a hash of all that it was made from and a digest of its own bytes, so that a
damaged or half-copied file is noticed before it is loaded, and built again.
"""

import contextlib
import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from space_envs.errors import SpaceEnvsError

CACHE_VARIABLE = "SPACE_ENVS_CACHE"
# Without contraction into fused multiply-add a result is the same on every machine with IEEE arithmetic.
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
_TIMEOUT = 120.0  # s


class LibraryError(SpaceEnvsError, RuntimeError):
    """A C library could not be built, kept or loaded; the message says what is missing."""


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


def load_library(source: str) -> ctypes.CDLL:
    """The shared library of a C source, from the cache or built into it.

    Raises:
        LibraryError: if there is no compiler, it fails, or the cache cannot be written or loaded from.
    """
    command = _compiler()
    key = _key(source, command)
    try:
        folder = cache_folder()
        for path in _intact(folder, key):
            with contextlib.suppress(OSError):  # whole, yet of another system that shares the folder
                return ctypes.CDLL(str(path))
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
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
    """Libraries of this key whose bytes are what their name says."""
    for path in sorted(folder.glob(f"{key}-*{_suffix()}")):
        try:
            if path.stem == f"{key}-{_digest(path)}":
                yield path
        except OSError:
            continue  # unreadable, or another process is replacing it


def _build(source: str, command: list[str], folder: Path, key: str) -> Path:
    """Compile beside the cache entry and rename, so that processes that do it at once cannot meet halfway."""
    with tempfile.TemporaryDirectory(prefix=".build-", dir=folder) as workplace:
        built = Path(workplace) / f"kernel{_suffix()}"
        _run([*command, *FLAGS, "-x", "c", "-", "-o", str(built), "-lm"], source)
        path = folder / f"{key}-{_digest(built)}{_suffix()}"
        os.replace(built, path)
    return path
