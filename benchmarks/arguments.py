"""Arguments that benchmarks share, refused before anything runs."""

import argparse

from space_envs.errors import positive_integer, unknown_name
from space_envs.registration import ENTRIES
from space_envs.tasks.common import SPLITS

MOST = 10_000


def whole(text: str) -> int:
    """Type of an argument that is a whole number from 1 to `MOST`."""
    try:
        return positive_integer("it", int(text), MOST)
    except ValueError:
        message = f"must be a whole number from 1 to {MOST:,}, got {text!r}"
        raise argparse.ArgumentTypeError(message) from None


def seed(text: str) -> int:
    """Type of an argument that is a seed."""
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 2^32 - 1, got {text!r}")
    return int(text)


def split(text: str) -> str:
    """Type of an argument that names a split."""
    return _named("split", text, SPLITS)


def env_id(text: str) -> str:
    """Type of an argument that names an environment."""
    return _named("environment id", text, tuple(ENTRIES))


def _named(kind: str, text: str, valid: tuple[str, ...]) -> str:
    if text not in valid:
        raise argparse.ArgumentTypeError(str(unknown_name(kind, text, valid)))
    return text
