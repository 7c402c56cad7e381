"""Objects built once per process for each description."""

import functools
import threading
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

Options = ParamSpec("Options")
Built = TypeVar("Built")


class Described(Protocol):
    """Anything with a fingerprint of its content, such as a robot."""

    @property
    def fingerprint(self) -> str:
        """Text that is equal for equal content."""
        ...


Builder = Callable[Concatenate[Any, Options], Built]

_lock = threading.RLock()  # reentrant: builders call other builders
_built: dict[tuple[Any, ...], Any] = {}


def built_once(build: Builder[Options, Built]) -> Builder[Options, Built]:
    """Decorate a function to cache its results, by the fingerprint of its first argument and by all others.

    Concurrent calls share one result. The other arguments must be hashable.
    """

    @functools.wraps(build)
    def cached(description: Described, *args: Options.args, **kwargs: Options.kwargs) -> Built:
        key = (build, description.fingerprint, args, tuple(kwargs.items()))
        if key not in _built:
            with _lock:
                if key not in _built:
                    _built[key] = build(description, *args, **kwargs)
        return _built[key]

    return cached


def clear() -> None:
    """Clear the cache, for example after a change of the compiler."""
    with _lock:
        _built.clear()
