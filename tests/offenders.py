"""Rules over many cases as one test, whose failure lists every case that breaks the rule."""

from collections.abc import Iterable


def assert_none(offenders: Iterable[str]) -> None:
    """Fail with the list of all offenders, if there are any."""
    found = list(offenders)
    assert not found, "\n" + "\n".join(found)
