"""Folder of compiled libraries, of which only the user can change the content."""

import os
import stat
import sys
import tempfile
import warnings
from pathlib import Path

from space_envs.errors import SpaceEnvsError

CACHE_VARIABLE = "SPACE_ENVS_CACHE"


class LibraryError(SpaceEnvsError, RuntimeError):
    """A C library could not be built, cached or loaded; the message says what is missing."""


class UnsafeCacheError(LibraryError):
    """Other users can write to the cache; the message says what to change."""


class UnsafeCacheWarning(RuntimeWarning):
    """The cache of compiled code is replaced by another one, since other users can write to it."""


def cache_folder() -> Path:
    """Path of the cache: SPACE_ENVS_CACHE, or the platform's folder for caches of a user.

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
    """Create a folder, if need be, whose content only the user can change, and return it with links resolved.

    Nothing is checked on systems whose files have no owners, such as Windows.

    Raises:
        UnsafeCacheError: if somebody else owns it, its group or others can write to it, or everybody can
            rename it. OSError: if it cannot be made.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder = folder.resolve(strict=True)
    problem = ownership_problem(folder.stat())
    if problem:
        raise UnsafeCacheError(f"{folder} {problem}")
    for above in folder.parents if _has_owners() else ():
        mode = above.stat().st_mode
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            raise UnsafeCacheError(f"{folder} can be replaced: everybody can write to {above} (chmod o-w)")
    return folder


def usable_folder() -> Path:
    """The cache, or a private folder among the temporary files where other users can write to the cache.

    Raises:
        UnsafeCacheError: if other users can write to both. OSError: if neither can be created.

    Warns:
        UnsafeCacheWarning: if the temporary folder is used.
    """
    try:
        return private_folder(cache_folder())
    except UnsafeCacheError as error:
        other = Path(tempfile.gettempdir()) / f"space_envs-{os.geteuid()}"
        message = f"compiled code is stored in {other}: {error}, or set {CACHE_VARIABLE}"
        warnings.warn(message, UnsafeCacheWarning, stacklevel=4)
        return private_folder(other)


def _has_owners() -> bool:
    return hasattr(os, "geteuid")


def ownership_problem(status: os.stat_result) -> str:
    """Problem with the owner or the mode of a file or folder, in words; empty if there is none."""
    if not _has_owners():
        return ""
    if status.st_uid != os.geteuid():
        return f"belongs to user {status.st_uid}, not to {os.geteuid()}"
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return f"can be written to by others (mode {stat.S_IMODE(status.st_mode):o}; chmod go-w)"
    return ""
