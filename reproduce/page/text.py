"""Text of a paper's page: the entries of a TOML file whose strings are Jinja templates."""

import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import reduce
from math import degrees
from typing import Any, Self

import jinja2

from space_envs.evaluation.report.templating import read_template


class PageText:
    """Entries of a page's text, filled with values where they are read.

    Args:
        entries: strings, and lists and tables of them. constants: values that every entry may show.
    """

    def __init__(self, entries: Mapping[str, Any], constants: Mapping[str, Any]) -> None:
        self._entries = entries
        self._environment = jinja2.Environment(undefined=jinja2.StrictUndefined)
        self._environment.globals |= constants
        self._environment.filters |= {"fmt": format, "each": _each, "deg": degrees}

    @classmethod
    def of(cls, paper: str, constants: Mapping[str, Any]) -> Self:
        """The text of a paper's page, from `templates/PAPER.toml`."""
        return cls(tomllib.loads(read_template(f"{paper}.toml", "reproduce")), constants)

    def raw(self, name: str) -> Any:
        """The entry of a dotted name as it is in the file."""
        return reduce(lambda table, key: table[key], name.split("."), self._entries)

    def fill(self, name: str, /, **values: Any) -> Any:
        """The entry of a dotted name, filled: a string, or a list or dictionary of them."""
        return self.filled(self.raw(name), values)

    def filled(self, entry: Any, values: Mapping[str, Any]) -> Any:
        """An entry with all its strings filled, and their white space made single spaces."""
        if isinstance(entry, Mapping):
            return {name: self.filled(value, values) for name, value in entry.items()}
        if isinstance(entry, list):
            return [self.filled(value, values) for value in entry]
        return _single_spaced(self._rendered(entry, values))

    def paragraphs(self, name: str, /, **values: Any) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The entry of a dotted name, filled, as paragraphs and as points."""
        rendered = self._rendered(self.raw(name), values)
        parts = [_single_spaced(part) for part in re.split(r"\n\s*\n|\n\s*(?=- )", rendered)]
        return (
            tuple(part for part in parts if part and not part.startswith("- ")),
            tuple(part.removeprefix("- ") for part in parts if part.startswith("- ")),
        )

    def _rendered(self, text: str, values: Mapping[str, Any]) -> str:
        return self._environment.from_string(text).render(values)


def _each(values: Iterable[float], form: str) -> str:
    """Numbers formatted alike, with commas between them."""
    return ", ".join(format(value, form) for value in values)


def _single_spaced(text: str) -> str:
    return re.sub(r"[ \n]+", " ", text).strip()
