"""Objects that are built once a process for each description that they are built from."""

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

_lock = threading.RLock()  # builders use what other builders have built
_built: dict[tuple[Any, ...], Any] = {}


def built_once(build: Builder[Options, Built]) -> Builder[Options, Built]:
    """The function with its results cached, by the fingerprint of its first argument and by all others.

    Threads that ask at the same time share one result. The other arguments must be hashable.
    """

    @functools.wraps(build)
    def kept(description: Described, *args: Options.args, **kwargs: Options.kwargs) -> Built:
        key = (build, description.fingerprint, args, tuple(kwargs.items()))
        if key not in _built:
            with _lock:
                if key not in _built:
                    _built[key] = build(description, *args, **kwargs)
        return _built[key]

    return kept


def clear() -> None:
    """Forget everything that was built, as after a change of the compiler."""
    with _lock:
        _built.clear()
