"""Digests (SHA-256, in hexadecimal digits) by which files, texts and plain values are known."""

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

from space_envs.system.reading import read_bytes

DIGITS = 64  # of a whole digest


def file_digest(path: str | Path) -> str:
    """Digest of a regular file's bytes; errors as of `read_bytes`."""
    return sha256(read_bytes(path)).hexdigest()


def text_digest(text: str, digits: int = DIGITS) -> str:
    """First digits of the digest of a text, which may be any."""
    return sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:digits]


def json_digest(value: Any, digits: int = DIGITS) -> str:
    """First digits of the digest of plain JSON values, whatever the order of their keys."""
    return text_digest(json.dumps(value, sort_keys=True), digits)
