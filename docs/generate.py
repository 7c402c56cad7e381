"""Write the parts of the documentation that come from the code or from measurements.

python -m docs.generate             write the pages of all ids and the generated blocks of the others
python -m docs.generate --check     change nothing; name the pages that are stale, and exit with 1
python -m docs.generate --leaderboard results/leaderboard
                                    insert the tables of an evaluation of `make leaderboard` into README.md
python -m docs.generate --measure momentum speed attitude_cost
                                    run the benchmarks that these pages name, and insert their output
"""

import argparse
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from docs.blocks import BLOCKS
from docs.id_page.page import environment_page
from docs.leaderboard import with_leaderboards
from space_envs.evaluation.records.episode import SCHEMA_VERSION
from space_envs.evaluation.records.schema import schema_text
from space_envs.evaluation.results.folders import read_folder
from space_envs.registration import ENTRIES
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.files import atomic_write_text

DOCS = Path(__file__).resolve().parent
README = DOCS.parent / "README.md"
# A block begins with its name or command and ends with the next end marker; blocks do not nest.
BEGIN = re.compile(r"<!-- (?:generated|measured): ")
MARKER = re.compile(
    rf"(<!-- (generated|measured): ([^\n]+?) -->\n)(?:(?!{BEGIN.pattern}).)*?(<!-- end -->)", re.DOTALL
)
REFERENCE = "fetch/bin/python"  # as benchmarks/speed.py and docs/speed.md name it


def pages() -> dict[Path, str]:
    """Expected text of every page that depends on the code.

    Raises:
        ValueError: if a page has a block without an end, or with an unknown name.
    """
    wanted = {
        DOCS / "environments" / f"{env_id.split('/')[-1]}.md": environment_page(env_id) for env_id in ENTRIES
    }
    wanted[DOCS / "schema" / f"record-v{SCHEMA_VERSION}.json"] = schema_text()
    for path in sorted(DOCS.glob("*.md")):
        wanted[path] = filled(path.read_text(encoding="utf-8"), "generated", block)
    return wanted


def stale() -> list[Path]:
    """Pages that differ from their expected text, belong to no id, or have an empty measurement."""
    wanted = pages()
    found = [p for p, text in wanted.items() if not p.is_file() or p.read_text(encoding="utf-8") != text]
    found += [path for path in sorted((DOCS / "environments").glob("*.md")) if path not in wanted]
    for path, text in wanted.items():
        if any(m[2] == "measured" and "|" not in m[0].split("-->\n", 1)[1] for m in MARKER.finditer(text)):
            found.append(path)
    return found


def measure(page: Path, reference: str) -> None:
    """Run the commands of a page's measured blocks and insert their output.

    Raises:
        subprocess.CalledProcessError: if one fails; the page is then unchanged.
    """

    def output(command: str) -> str:
        _, *words = [reference if word == REFERENCE else word for word in shlex.split(command)]
        done = subprocess.run(
            [sys.executable, *words], cwd=DOCS.parent, stdout=subprocess.PIPE, text=True, check=True
        )
        return done.stdout.strip()

    atomic_write_text(page, filled(page.read_text(encoding="utf-8"), "measured", output))


def block(name: str) -> str:
    """Content of a generated block.

    Raises:
        ValueError: for a name that no block has.
    """
    if name not in BLOCKS:
        raise ValueError(f"there is no block {name!r}; there are {', '.join(BLOCKS)}")
    return BLOCKS[name]()


def filled(text: str, kind: str, content: Callable[[str], str]) -> str:
    """Page text with the content of each block of a kind, generated or measured, from what its marker names.

    Raises:
        ValueError: if a block has no end.
    """
    if len(BEGIN.findall(text)) != len(MARKER.findall(text)):
        raise ValueError("a generated or measured block has no <!-- end -->")

    def fill(match: re.Match[str]) -> str:
        return f"{match[1]}\n{content(match[3])}\n\n{match[4]}" if match[2] == kind else match[0]

    return MARKER.sub(fill, text)


def measured_pages() -> dict[str, Path]:
    """Pages with measurements, by name."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(DOCS.glob("*.md"))}
    return {
        path.stem: path
        for path, text in texts.items()
        if any(match[2] == "measured" for match in MARKER.finditer(text))
    }


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = Parser(
        prog="python -m docs.generate",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--check", action="store_true", help="name stale pages and exit with 1 if there are any"
    )
    parser.add_argument(
        "--measure",
        nargs="+",
        choices=sorted(measured_pages()),
        metavar="PAGE",
        help="measure for these pages",
    )
    parser.add_argument(
        "--leaderboard",
        type=Path,
        metavar="RESULTS",
        help="insert the tables of this folder of results into README.md",
    )
    parser.add_argument(
        "--reference",
        default=REFERENCE,
        help="python with gymnasium-robotics for page speed (default %(default)s)",
    )
    options = parser.parse_args(arguments)
    if options.check:
        found = [path.relative_to(DOCS.parent) for path in stale()]
        for path in found:
            print(f"{path} is stale; run: python -m docs.generate")
        return 1 if found else 0
    names = options.measure or []
    if "speed" in names and not Path(options.reference).is_file():
        print(f"there is no {options.reference}; docs/speed.md says how to make it", file=sys.stderr)
        return 2
    if options.leaderboard is not None:
        records = read_folder(options.leaderboard).records
        atomic_write_text(README, with_leaderboards(README.read_text(encoding="utf-8"), records))
    for name in names:
        print(f"measuring for docs/{name}.md")
        measure(measured_pages()[name], options.reference)
    for path, text in pages().items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            atomic_write_text(path, text)
            print(path.relative_to(DOCS.parent))
    return 0


if __name__ == "__main__":
    sys.exit(exit_status("python -m docs.generate", main))
