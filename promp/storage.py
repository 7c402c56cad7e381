"""Arrays in a file: npz without pickles, with a format version and a checksum, whole or absent."""

import hashlib
import io
import os
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from promp.errors import StorageError

FORMAT = "space-capture-promp"
VERSION = 1


def checksum(arrays: Mapping[str, np.ndarray]) -> str:
    """sha256 over name, type, shape and bytes of every array, in the order of the names."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        array = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}|{array.dtype.str}|{array.shape}|".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def save_arrays(path: str | Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write `arrays` to `path`; equal arrays give equal bytes. A reader sees the old file or the new one."""
    path = Path(path)
    header = {"format": np.array(FORMAT), "version": np.array(VERSION), "sha256": np.array(checksum(arrays))}
    members: dict[str, Any] = {**header, **arrays}
    buffer = io.BytesIO()
    np.savez(buffer, **members)
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(buffer.getvalue())
            file.flush()
            os.fsync(file.fileno())
        # mkstemp makes private files; give this one the permissions that open() would have.
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(name, 0o666 & ~mask)
        os.replace(name, path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def load_arrays(path: str | Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """The arrays `names` of a file that save_arrays wrote, or StorageError naming the file and the defect.

    A file that does not exist or may not be read gives the usual OSError.
    """
    if Path(path).exists() and not Path(path).is_file():
        raise StorageError(f"{path}: not a regular file")
    content = Path(path).read_bytes()
    if not zipfile.is_zipfile(io.BytesIO(content)):
        raise StorageError(f"{path}: expected a ProMP file (npz), got one that is no archive")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as archive:
            stored = {name: archive[name] for name in archive.files}
    # Damaged bytes make zipfile and numpy raise a dozen unrelated types; all of them mean the same here.
    except Exception as error:
        raise StorageError(
            f"{path}: expected a ProMP file (npz), got a corrupt or truncated one: {type(error).__name__}"
        ) from error
    if str(stored.pop("format", None)) != FORMAT:
        raise StorageError(f"{path}: expected a file of format {FORMAT!r}")
    version, claimed = stored.pop("version", None), str(stored.pop("sha256", None))
    if str(version) != str(VERSION):
        raise StorageError(f"{path}: expected format version {VERSION}, got {version}")
    if set(stored) != set(names):
        raise StorageError(f"{path}: expected the arrays {sorted(names)}, got {sorted(stored)}")
    actual = checksum(stored)
    if actual != claimed:
        raise StorageError(
            f"{path}: its content does not match its checksum (sha256 {actual}, it states {claimed})"
        )
    return stored
