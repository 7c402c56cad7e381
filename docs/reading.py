"""Documentation in the code, read as text: comments of values and sections of docstrings; Markdown tables."""

import ast
import inspect
import re
from collections.abc import Iterable, Sequence
from dataclasses import fields
from types import ModuleType
from typing import Any

from benchmarks.machine import markdown_table

_SECTION = re.compile(r"^(Args|Attributes|Returns|Raises):$")
_PADDED = 40  # characters of a last column that is padded
UNITS = ("m", "rad", "s", "deg", "m/s", "rad/s", "deg/s", "unit")


def comments(thing: ModuleType | type) -> dict[str, str]:
    """Comment of each value assigned in a module's or a class's body: at the line's end, or above it."""
    source = inspect.cleandoc("\n" + inspect.getsource(thing))
    tree: Any = ast.parse(source)
    body = tree.body if isinstance(thing, ModuleType) else tree.body[0].body
    lines = source.splitlines()
    found = {}
    for node in body:
        if not isinstance(node, ast.Assign | ast.AnnAssign):
            continue
        target = node.targets[0] if isinstance(node, ast.Assign) else node.target
        comment = lines[(node.end_lineno or 1) - 1].encode()[node.end_col_offset :].decode().strip()
        above, line = [], node.lineno - 2
        while not comment and line >= 0 and lines[line].lstrip().startswith("#"):
            above.insert(0, lines[line].strip().lstrip("# "))
            line -= 1
        if isinstance(target, ast.Name) and (comment or above):
            found[target.id] = comment.lstrip("# ") or " ".join(above)
    return found


def field_comments(kind: type) -> dict[str, str]:
    """Comments of a dataclass's fields, those of its bases included."""
    found = {}
    for base in reversed(kind.__mro__[:-1]):
        found |= comments(base)
    return found


def section(docstring: str | None, name: str) -> str:
    """One section of a docstring (Args, Attributes, ...), or the text before the first one for name ''."""
    parts: dict[str, list[str]] = {"": []}
    current = ""
    for line in inspect.cleandoc(docstring or "").splitlines():
        if match := _SECTION.match(line):
            current = match[1]
        else:
            parts.setdefault(current, []).append(line)
    return inspect.cleandoc("\n".join(parts.get(name, [])))


def described(text: str, names: Iterable[str]) -> dict[str, str]:
    """Descriptions by name in a docstring's section, from entries `name: ...` or `name, name: ...`."""
    either = "|".join(map(re.escape, names))
    parts = re.split(rf"(?<![\w*`])((?:{either})(?:, (?:{either}))*): ", " ".join(text.split()))
    found = {}
    for group, meaning in zip(parts[1::2], parts[2::2], strict=True):
        found |= dict.fromkeys(group.split(", "), meaning.strip())
    return found


def attributes(kind: type) -> dict[str, str]:
    """Descriptions of a dataclass's fields in its docstring and those of its bases, by name."""
    names = [field.name for field in fields(kind)]
    found = {}
    for base in reversed(kind.__mro__):
        found |= described(section(base.__doc__, "Attributes"), names)
    return found


def summary(thing: Any) -> str:
    """First sentence of a docstring, on one line."""
    paragraph = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return re.split(r"(?<=\.) (?=[A-Z])", paragraph)[0]


def flowed(text: str) -> str:
    """A docstring's paragraphs, each on one line."""
    return "\n\n".join(" ".join(part.split()) for part in text.split("\n\n"))


def split_unit(meaning: str) -> tuple[str, str]:
    """The unit at the end of a description, after a comma, and the rest; an empty text without a unit."""
    rest, _, unit = meaning.rpartition(", ")
    if unit in UNITS and rest:
        return unit, rest
    return ("", meaning) if meaning not in UNITS else (meaning, "")


def number(value: Any) -> str:
    """Text of a number, or of several with commas, to five digits; of other values as Python writes them."""
    if isinstance(value, float):
        return f"{value:.5g}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        parts = [number(each) for each in value]
        if value and isinstance(value[0], Sequence) and not isinstance(value[0], str):
            parts = [f"({part})" for part in parts]
        return ", ".join(parts)
    return str(value)


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table; bars inside cells are escaped. A wide last column is not padded."""
    cells = [[cell.replace("|", r"\|") for cell in row] for row in rows]
    text = markdown_table(list(header), cells)
    if max(len(row[-1]) for row in cells) <= _PADDED:
        return text
    head, rule, *body = (re.sub(r" +\|$", " |", line) for line in text.splitlines())
    return "\n".join([head, re.sub(r"-+\|$", "---|", rule), *body])
