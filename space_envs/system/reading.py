"""Untrusted files, read as data: they are read, or rejected with a reason.

Nothing is unpickled or executed. A file that is not regular, too large, nested too deeply or claims more than
it contains is rejected before memory is allocated. Errors give the reason; the caller adds the file name.
"""

import io
import json
import os
import stat
import zipfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError

LARGEST = 4 * 2**30  # bytes of a file, and of what it holds once it is unpacked
LARGEST_JSON = 256 * 2**20  # bytes
_RATIO = 1100  # by which deflate can shrink anything at most, with a margin
_NPY, _LONGEST_HEADER = ".npy", 10_000


def read_bytes(path: str | Path, largest: int = LARGEST) -> bytes:
    """The content of a regular file.

    Raises:
        OSError: if it is not there or cannot be read. ConfigurationError: if it is no regular file, or larger
            than `largest` bytes.
    """
    # Without O_NONBLOCK, opening a named pipe would wait for a writer.
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | os.O_NONBLOCK)) as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode):
            raise ConfigurationError("not a regular file")
        if found.st_size > largest:
            raise ConfigurationError(f"it has {found.st_size:,} bytes; at most {largest:,} are read")
        return file.read(largest)


def parse_json(text: bytes | str) -> Any:
    """The value of a JSON text.

    Raises:
        ConfigurationError: if it is none, is no UTF-8, or is nested too deeply to be one of ours.
    """
    try:
        return json.loads(text.decode("utf-8") if isinstance(text, bytes) else text)
    except RecursionError:
        raise ConfigurationError("not JSON: nested too deeply") from None
    except ValueError as error:
        raise ConfigurationError(f"not JSON: {error}") from None


def read_object(path: str | Path) -> dict[str, Any]:
    """The JSON object in a file.

    Raises:
        OSError: if it is not there or cannot be read. ConfigurationError: if it holds none.
    """
    value = parse_json(read_bytes(path, LARGEST_JSON))
    if not isinstance(value, dict):
        raise ConfigurationError(f"expected a JSON object, got {type(value).__name__}")
    return value


def read_arrays(path: str | Path) -> dict[str, NDArray[Any]]:
    """All arrays of an npz file, by name.

    Raises:
        OSError: if it is not there or cannot be read. ConfigurationError: if it is no npz, is damaged,
            holds objects, or claims more than it holds.
    """
    return parse_arrays(read_bytes(path))


def parse_arrays(content: bytes) -> dict[str, NDArray[Any]]:
    """All arrays of the bytes of an npz file, by name; ConfigurationError as in `read_arrays`."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            _check_sizes(archive, len(content))
            return {info.filename.removesuffix(_NPY): _array(archive, info) for info in archive.infolist()}
    except ConfigurationError:
        raise
    # Broken bytes make zipfile and numpy raise a dozen unrelated types; all of them mean the same here.
    except Exception as error:
        if not zipfile.is_zipfile(io.BytesIO(content)):
            raise ConfigurationError("not an npz archive") from None
        # numpy's own words advise to unpickle.
        reason = str(error) if isinstance(error, zipfile.BadZipFile) else type(error).__name__
        raise ConfigurationError(f"a damaged npz archive: {reason}") from None


def _check_sizes(archive: zipfile.ZipFile, size: int) -> None:
    total = 0
    for info in archive.infolist():
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            raise ConfigurationError(f"{info.filename!r} is compressed in a way that npz files are not")
        if info.compress_size > size or info.file_size > _RATIO * (info.compress_size + 1):
            raise ConfigurationError(f"{info.filename!r} claims {info.file_size:,} bytes, more than it holds")
        total += info.file_size
    if total > LARGEST:
        raise ConfigurationError(f"its arrays have {total:,} bytes; at most {LARGEST:,} are read")
    if len(set(archive.namelist())) < len(archive.namelist()):
        raise ConfigurationError("an array stands twice")


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    if not info.filename.endswith(_NPY):
        raise ConfigurationError(f"{info.filename!r} is no array")
    with archive.open(info) as file:
        return _read_npy(file, info)


def _read_npy(file: BinaryIO | Any, info: zipfile.ZipInfo) -> NDArray[Any]:
    """An array whose header was compared with the bytes that there are."""
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }.get(version)
    if read is None:
        raise ConfigurationError(f"{info.filename!r} has the unknown format {version}")
    shape, fortran_order, dtype = read(file, max_header_size=_LONGEST_HEADER)
    if dtype.hasobject:
        raise ConfigurationError(f"{info.filename!r} holds objects of Python, which are never read")
    if not all(isinstance(axis, int) and axis >= 0 for axis in shape):
        raise ConfigurationError(f"{info.filename!r} has the impossible shape {shape}")
    needed = dtype.itemsize
    for axis in shape:
        needed *= axis
    data = file.read(info.file_size)
    if len(data) != needed:
        raise ConfigurationError(
            f"{info.filename!r} claims {needed:,} bytes of {dtype} {shape}, it holds {len(data):,}"
        )
    array = np.frombuffer(bytearray(data), dtype=dtype) if needed else np.empty(0, dtype)
    return array.reshape(shape, order="F" if fortran_order else "C")
