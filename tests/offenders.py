"""Rules over many cases as one test, whose failure lists every case that breaks the rule."""

import re
from collections.abc import Callable, Iterable
from typing import Any

import pytest


def assert_none(offenders: Iterable[str]) -> None:
    """Fail with the list of all offenders, if there are any."""
    found = list(offenders)
    assert not found, "\n" + "\n".join(found)


def accepted(call: Callable[[], Any], error: type[Exception], message: str) -> str | None:
    """What came of a call that is not this error with a message that matches; None if it was refused so."""
    try:
        call()
    except error as caught:
        said = str(caught)
        return None if re.search(message, said) else f"said {said[:200]!r} where {message!r} was expected"
    return f"was accepted where {message!r} was expected"


def assert_refused(
    program: Callable[[list[str]], int],
    cases: Iterable[tuple[list[str], str]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Fail unless every command line ends with status 2 and one line of error, which holds its text."""
    offenders = []
    for words, message in cases:
        status, said = program(words), capsys.readouterr().err
        if status != 2 or message not in said or said.count("\n") != 1:
            offenders.append(f"{words}: status {status}, said {said!r} where {message!r} was expected")
    assert_none(offenders)
