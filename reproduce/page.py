"""The page of a paper: what stands on it, as one HTML file that asks for nothing outside itself, as Markdown,
and the files beside it.

All text is plain and is escaped where it is written. A content security policy lets only the page's own
script run, known by its hash.
"""

import base64
import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from reproduce.animation import Movie
from reproduce.claims import SHARE_NOTE, Claim, Record
from reproduce.figures import Figure, standalone
from space_envs.evaluation.records.names import csv_name, display_name, markdown_name
from space_envs.evaluation.report.templating import make_environment, read_template, script_hash
from space_envs.system.files import atomic_write, atomic_write_text

_LONGEST = 10_000  # letters of a paragraph or cell


@dataclass(frozen=True)
class Text:
    """Paragraphs, and points below them."""

    paragraphs: tuple[str, ...]
    points: tuple[str, ...] = ()

    kind = "text"


@dataclass(frozen=True)
class Table:
    """Cells as text; the first column names the row, the others are figures unless `words`."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: bool = False
    colours: tuple[str, ...] = ()  # of the dots before the rows' names

    kind = "table"


@dataclass(frozen=True)
class Claims:
    """The table of claims; `own` and `random` say what its figures are about."""

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
        """For an img element that needs no file."""
        return "data:image/jpeg;base64," + base64.b64encode(self.jpeg).decode("ascii")


Block = Text | Table | Claims | Figure | Movie | Picture


@dataclass(frozen=True)
class Section:
    """A heading with what stands below it; `docs`: also in the documentation, which holds only what lasts."""

    title: str
    blocks: tuple[Block, ...]
    docs: bool = True

    @property
    def anchor(self) -> str:
        """Of the heading, for the list of contents."""
        return "".join(c if c.isalnum() else "-" for c in self.title.lower())


@dataclass(frozen=True)
class Page:
    """Everything that is written about one paper.

    Attributes:
        name: of the paper, and of the files. lead: paragraphs at the top. notice: what a reader must not
            overlook, such as a run with few cases. chips: (figure, what of). tiles: (label, value, unit,
            who).
        command: that made it. provenance: versions, machine, seeds; plain JSON values.
        files: text of the files beside the page, by name, with what each is.
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


def write_page(page: Page, folder: Path) -> dict[str, Path]:
    """Write the page, its Markdown, its figures and its files, each whole or not at all; paths by what."""
    texts = {f"{page.name}.html": to_html(page), f"{page.name}.md": to_markdown(page, "figures")}
    texts |= {name: text for name, (_, text) in page.files.items()}
    for name, text in texts.items():
        atomic_write_text(folder / name, text)
    _write_drawings(page.sections, folder / "figures")
    return {"Page": folder / f"{page.name}.html", "Markdown": folder / f"{page.name}.md"} | {
        what: folder / name for name, (what, _) in page.files.items()
    }


def write_docs(page: Page, folder: Path) -> Path:
    """Write the lasting part of the page as `folder`/<name>.md with its figures in `folder`/images."""
    lasting = replace(page, sections=tuple(section for section in page.sections if section.docs))
    _write_drawings(lasting.sections, folder / "images", f"{page.name}_")
    path = folder / f"{page.name}.md"
    atomic_write_text(path, to_markdown(lasting, "images", f"{page.name}_"))
    return path


def _write_drawings(sections: Iterable[Section], folder: Path, prefix: str = "") -> None:
    """Write what is drawn in the sections as files of their own, their names after `prefix`."""
    for section in sections:
        for block in section.blocks:
            if isinstance(block, Figure | Movie):
                text = block.file if isinstance(block, Figure) else standalone(block.svg)
                atomic_write_text(folder / f"{prefix}{_file(block)}", text)
            elif isinstance(block, Picture):
                with atomic_write(folder / f"{prefix}{_file(block)}") as path:
                    path.write_bytes(block.jpeg)


def _file(block: Figure | Movie | Picture) -> str:
    return f"{block.key}.{'jpg' if isinstance(block, Picture) else 'svg'}"


def to_html(page: Page) -> str:
    """The page, self-contained."""
    script = read_template("scrolling.js") + read_template("page.js", "reproduce")
    environment = make_environment()
    environment.filters["kind"] = _kind
    return environment.from_string(read_template("page.html.j2", "reproduce")).render(
        page=page,
        share_note=SHARE_NOTE,
        provenance=flat(page.provenance),
        style=Markup(read_template("report.css") + read_template("page.css", "reproduce")),
        script=Markup(script),
        script_hash=script_hash(script),
    )


def to_markdown(page: Page, images: str, prefix: str = "") -> str:
    """The page as Markdown; figures are files in the folder `images`, their names after `prefix`."""
    parts = [f"# {_md(page.title)}"]
    parts += [f"**{_md(page.notice)}**"] if page.notice else []
    parts += [_md(paragraph) for paragraph in page.lead]
    for section in page.sections:
        parts.append(f"## {_md(section.title)}")
        for block in section.blocks:
            parts += _markdown(block, images, prefix)
    parts += ["## Where this comes from", f"```sh\n{page.command}\n```"]
    rows = [f"- {_md(name)}: {_md(value)}" for name, value in flat(page.provenance)]
    parts += ["\n".join(rows)] if rows else []
    return "\n\n".join(parts) + "\n"


def _markdown(block: Block, images: str, prefix: str) -> list[str]:
    if isinstance(block, Text):
        points = "\n".join(f"- {_md(point)}" for point in block.points)
        return [*(_md(paragraph) for paragraph in block.paragraphs), *([points] if points else [])]
    if isinstance(block, Table):
        align = "---" if block.words else "---:"
        table = _markdown_table(block.heads, block.rows, align)
        return [f"### {_md(block.title)}", table, *([_md(block.caption)] if block.caption else [])]
    if isinstance(block, Claims):
        heads = ("where", "the paper says", f"measured, {block.own}", "there", block.random, "counted as so")
        rows = [
            (
                claim.rule.where,
                claim.rule.says,
                claim.measured + (f" {claim.rule.remark}" if claim.rule.remark else ""),
                claim.verdict,
                "-" if claim.share is None else str(claim.share),
                claim.rule.counted,
            )
            for claim in block.claims
        ]
        return [_markdown_table(heads, rows, "---"), SHARE_NOTE]
    picture = f"![{_md(block.alt)}]({images}/{prefix}{_file(block)})"
    return [f"### {_md(block.title)}", picture, _md(block.caption)]


def _markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]], align: str) -> str:
    lines = [heads, ["---", *[align] * (len(heads) - 1)]]
    text = [
        "| " + " | ".join(_md(cell) if number != 1 else cell for cell in line) + " |"
        for number, line in enumerate([*lines, *rows])
    ]
    return "\n".join(text)


def cases_csv(case: str, records: Iterable[Record]) -> str:
    """Every figure of every method in every record, as CSV; the first column is called `case`."""
    records = list(records)
    methods = [(record, key, found) for record in records for key, found in record["methods"].items()]
    names = list(
        dict.fromkeys(name for *_, found in methods for name in found if name not in ("cause", "reason"))
    )
    rows = [
        (record["index"], key, found.get("cause"), *map(found.get, names), record["timing"][key])
        for record, key, found in methods
    ]
    return table_csv((case, "method", "cause", *names, "planning_s"), rows)


def claims_csv(case: str, claims: Iterable[Claim]) -> str:
    """What came of every claim, as CSV; `case` is the paper's own."""
    rows = [
        (
            claim.rule.key,
            claim.rule.where,
            claim.rule.says,
            claim.verdict,
            *(vars(claim.share).values() if claim.share else [None] * 3),
        )
        for claim in claims
    ]
    return table_csv(("claim", "where", "says", case, "holds", "of", "left_out"), rows)


def table_csv(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table as CSV; numbers with all digits, text harmless to spreadsheets, nothing for None."""

    def cell(value: object) -> object:
        if value is None:
            return ""
        if isinstance(value, float):
            return repr(value)
        return value if isinstance(value, int) else csv_name(str(value))

    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        writer.writerow([cell(value) for value in row])
    return text.getvalue()


def flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested provenance as rows: `versions: numpy` -> 2.4.6."""
    rows: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{display_name(str(key)).replace('_', ' ')}"
        if isinstance(value, Mapping):
            rows += flat(value, f"{name}: ")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)
            rows.append((name, display_name(text, 1000)))
    return rows


def _md(text: str) -> str:
    return markdown_name(text, _LONGEST)


def _kind(block: Block) -> str:
    return {Figure: "figure", Movie: "movie"}.get(type(block)) or str(getattr(block, "kind", ""))
