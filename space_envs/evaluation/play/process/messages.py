"""Messages between the harness and the process of a policy: JSON values, and arrays as raw bytes."""

import json
import math
import os
import select
import struct
import time
from typing import Any

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.system.reading import parse_json

_LENGTH = struct.Struct("<Q")


def pack(values: dict[str, Any], array: Array | None = None) -> bytes:
    """Message of plain values and an array."""
    head = json.dumps(values).encode()
    return _LENGTH.pack(len(head)) + head + (b"" if array is None else np.ascontiguousarray(array).tobytes())


def unpack(message: bytes) -> tuple[dict[str, Any], bytes]:
    """Values of a message, and the bytes of its array.

    Raises:
        ValueError, struct.error: for anything that `pack` does not make.
    """
    (size,) = _LENGTH.unpack(message[: _LENGTH.size])
    values = parse_json(message[_LENGTH.size :][:size])
    if not isinstance(values, dict):
        raise ValueError("expected an object")
    return values, message[_LENGTH.size + size :]


def send(pipe: int, message: bytes, deadline: float = math.inf) -> None:
    """Write a message with its length to a pipe.

    Raises:
        TimeoutError: if it is not read before the deadline of `time.monotonic`. OSError: if nobody reads it.
    """
    os.set_blocking(pipe, False)
    rest = memoryview(_LENGTH.pack(len(message)) + message)
    while rest:
        _wait(deadline, writing=pipe)
        rest = rest[os.write(pipe, rest) :]


def receive(pipe: int, deadline: float = math.inf, largest: int | None = None) -> bytes:
    """Read a message from a pipe.

    Raises:
        TimeoutError: if it is not there before the deadline of `time.monotonic`. EOFError: if nobody writes.
        ValueError: if it claims more than `largest` bytes.
    """
    (size,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size, deadline))
    if largest is not None and size > largest:
        raise ValueError(f"expected at most {largest} bytes, got {size}")
    return _exactly(pipe, size, deadline)


def _exactly(pipe: int, size: int, deadline: float) -> bytes:
    found = bytearray()
    while len(found) < size:
        _wait(deadline, reading=pipe)
        part = os.read(pipe, min(size - len(found), 2**20))
        if not part:
            raise EOFError
        found += part
    return bytes(found)


def _wait(deadline: float, reading: int | None = None, writing: int | None = None) -> None:
    left = None if math.isinf(deadline) else max(deadline - time.monotonic(), 0.0)
    to_read, to_write = ([] if pipe is None else [pipe] for pipe in (reading, writing))
    if not any(select.select(to_read, to_write, [], left)):
        raise TimeoutError
