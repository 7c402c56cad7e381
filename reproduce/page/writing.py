"""Write the page of a paper: one self-contained HTML file, the same as Markdown, and the files next to it.

All text is plain and is escaped where it is written. A content security policy lets only the page's own
script run, known by its hash.
"""

from collections.abc import Iterable, Sequence
from pathlib import Path

from markupsafe import Markup

from reproduce.claims import SHARE_NOTE
from reproduce.page.animation import Movie
from reproduce.page.blocks import Block, ClaimTable, Page, Picture, Prose, Section, Table
from reproduce.page.figures import Figure, standalone
from space_envs.evaluation.records.names import markdown_name
from space_envs.evaluation.report.page.provenance import flat_rows
from space_envs.evaluation.report.templating import make_environment, read_template, script_hash
from space_envs.system.files import atomic_write, atomic_write_text

_LONGEST = 10_000  # characters of a paragraph or cell


def write_page(page: Page, folder: Path) -> dict[str, Path]:
    """Write the page, its Markdown, its figures and its files, each whole or not at all; paths by title."""
    texts = {f"{page.name}.html": to_html(page), f"{page.name}.md": to_markdown(page, "figures")}
    texts |= {name: text for name, (_, text) in page.files.items()}
    for name, text in texts.items():
        atomic_write_text(folder / name, text)
    _write_drawings(page.sections, folder / "figures")
    return {"Page": folder / f"{page.name}.html", "Markdown": folder / f"{page.name}.md"} | {
        title: folder / name for name, (title, _) in page.files.items()
    }


def write_docs(page: Page, folder: Path) -> Path:
    """Write the page as `folder`/<name>.md with its figures in `folder`/images; returns the path."""
    _write_drawings(page.sections, folder / "images", f"{page.name}_")
    path = folder / f"{page.name}.md"
    atomic_write_text(path, to_markdown(page, "images", f"{page.name}_"))
    return path


def _write_drawings(sections: Iterable[Section], folder: Path, prefix: str = "") -> None:
    """Write figures, movies and pictures of the sections as files, their names after `prefix`."""
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
    return (
        make_environment()
        .from_string(read_template("page.html.j2", "reproduce"))
        .render(
            page=page,
            share_note=SHARE_NOTE,
            provenance=flat_rows(page.provenance),
            style=Markup(read_template("report.css") + read_template("page.css", "reproduce")),
            script=Markup(script),
            script_hash=script_hash(script),
        )
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
    parts += ["## Provenance", f"```sh\n{page.command}\n```"]
    rows = [f"- {_md(name)}: {_md(value)}" for name, value in flat_rows(page.provenance)]
    parts += ["\n".join(rows)] if rows else []
    return "\n\n".join(parts) + "\n"


def _markdown(block: Block, images: str, prefix: str) -> list[str]:
    if isinstance(block, Prose):
        points = "\n".join(f"- {_md(point)}" for point in block.points)
        return [*(_md(paragraph) for paragraph in block.paragraphs), *([points] if points else [])]
    if isinstance(block, Table):
        align = "---" if block.words else "---:"
        table = _markdown_table(block.heads, block.rows, align)
        return [f"### {_md(block.title)}", table, *([_md(block.caption)] if block.caption else [])]
    if isinstance(block, ClaimTable):
        return [_markdown_claims(block), SHARE_NOTE]
    picture = f"![{_md(block.alt)}]({images}/{prefix}{_file(block)})"
    return [f"### {_md(block.title)}", picture, _md(block.caption)]


def _markdown_claims(block: ClaimTable) -> str:
    heads = ("where", "the paper says", f"measured, {block.own}", "verdict", block.random, "criterion")
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
    return _markdown_table(heads, rows, "---")


def _markdown_table(heads: Sequence[str], rows: Iterable[Sequence[str]], align: str) -> str:
    lines = [heads, ["---", *[align] * (len(heads) - 1)]]
    text = [
        "| " + " | ".join(_md(cell) if number != 1 else cell for cell in line) + " |"
        for number, line in enumerate([*lines, *rows])
    ]
    return "\n".join(text)


def _md(text: str) -> str:
    return markdown_name(text, _LONGEST)
