"""Blocks of a paper's page: text, tables, claims, figures, and the page that holds them in sections."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from reproduce.claims import Claim
from reproduce.page.animation import Movie
from reproduce.page.figures import Figure
from reproduce.page.text import PageText


@dataclass(frozen=True)
class Prose:
    """Paragraphs, and points below them."""

    paragraphs: tuple[str, ...]
    points: tuple[str, ...] = ()

    kind = "text"


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column names the row, the others are figures unless `words`."""

    title: str
    heads: Sequence[str]
    rows: Sequence[tuple[str, ...]]
    caption: str = ""
    words: bool = False
    colors: tuple[str, ...] = ()  # of the dots before the rows' names

    kind = "table"


@dataclass(frozen=True)
class ClaimTable:
    """Claims with what was measured; `own` and `random` name the cases that it was measured on."""

    claims: tuple[Claim, ...]
    own: str
    random: str

    kind = "claims"


@dataclass(frozen=True)
class Picture:
    """A rendered picture: `jpeg` is the file's content."""

    key: str
    title: str
    caption: str
    alt: str
    jpeg: bytes

    kind = "picture"

    @property
    def source(self) -> str:
        """Data URL for an img element."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


Block = Prose | Table | ClaimTable | Figure | Movie | Picture


@dataclass(frozen=True)
class Section:
    """A heading with the blocks below it."""

    title: str
    blocks: tuple[Block, ...]

    @property
    def anchor(self) -> str:
        """Anchor of the heading, for the list of contents."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower())


@dataclass(frozen=True)
class Page:
    """Content of the page of a paper.

    Attributes:
        name: of the paper, and of the files. lead: paragraphs at the top. notice: a warning above them,
            such as that of a run with few cases. chips: (figure, its meaning). tiles: (label, value, unit,
            remark).
        command: that made it. provenance: versions, machine, seeds; plain JSON values.
        files: (title, text) of the files next to the page, by name.
    """

    name: str
    title: str
    lead: tuple[str, ...]
    notice: str
    chips: tuple[tuple[str, str], ...]
    tiles: tuple[tuple[str, str, str, str], ...]
    sections: tuple[Section, ...]
    command: str
    provenance: Mapping[str, Any]
    files: Mapping[str, tuple[str, str]]


def sections(text: PageText, blocks: Mapping[str, Sequence[Block | None]]) -> tuple[Section, ...]:
    """Sections in the order of the text's headings, with their blocks by key; None is left out."""
    headings: dict[str, str] = text.fill("sections")
    return tuple(
        Section(heading, tuple(block for block in blocks[key] if block is not None))
        for key, heading in headings.items()
    )


def tiles(text: PageText, figures: Mapping[str, str]) -> tuple[tuple[str, str, str, str], ...]:
    """Tiles of the text that have a figure, by their key: (label, figure, unit, remark)."""
    return tuple(
        (tile["label"], figures[tile["key"]], tile["unit"], tile["who"])
        for tile in text.fill("tiles")
        if tile["key"] in figures
    )
