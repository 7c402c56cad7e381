"""Files that pages of the documentation consist of: fenced blocks below a comment with their name."""

import re
from pathlib import Path

_FILE = re.compile(r"^<!-- file: (\S+) -->\n```\w+\n(.*?)^```$", re.M | re.S)


def file_blocks(page: Path) -> list[tuple[str, str]]:
    """Names and texts of the files of a page."""
    return _FILE.findall(page.read_text(encoding="utf-8"))


def write_files(page: Path, folder: Path) -> None:
    """Write the files of a page to a folder."""
    for name, text in file_blocks(page):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, encoding="utf-8")
