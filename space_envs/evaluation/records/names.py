"""Escaping of names chosen by others, for each place where they are shown.

A policy's name may be any text. HTML is escaped by the template engine; this is for the other places.
"""

import json
import re
import unicodedata

from space_envs.system.digests import text_digest


def display_name(name: str, longest: int = 60) -> str:
    """The name on one line: control, format and unassigned characters replaced, cut at `longest`."""
    shown = "".join("\N{REPLACEMENT CHARACTER}" if unicodedata.category(c)[0] == "C" else c for c in name)
    shown = " ".join(shown.split()) or "(blank)"
    return shown if len(shown) <= longest else shown[: longest - 3] + "..."


def markdown_name(name: str, longest: int = 60) -> str:
    """The name inside a Markdown table cell: neither markup, HTML, a link nor the end of the cell."""
    shown = display_name(name, longest).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
    # Inside a word an underscore is no markup, and names like minimum_jerk stay readable in the source.
    return re.sub(r"[\\`*\[\]|~$]|(?<![A-Za-z0-9])_|_(?![A-Za-z0-9])", r"\\\g<0>", shown).replace(
        "://", "&#58;//"
    )


def csv_name(name: str) -> str:
    """The name inside a CSV cell; a spreadsheet does not take it for a formula."""
    shown = display_name(name)
    return "'" + shown if shown[0] in "=+-@" else shown


def latex_name(name: str) -> str:
    """The name as text of a LaTeX document: no character of it is a command."""
    special = {
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
        '"': r"\textquotedbl{}",
    }
    special |= {character: f"\\{character}" for character in "#$%&_{}"}
    shown = "".join(special.get(character, character) for character in display_name(name))
    # Two hyphens are a dash, and a bracket after a line's end is its argument.
    return shown.replace("--", "-{}-").replace("[", "{[}").replace("]", "{]}")


def figure_name(name: str) -> str:
    """The name as a matplotlib text: cut short, and dollar signs start no formula."""
    return display_name(name, 20).replace("$", r"\$")


def file_name(name: str) -> str:
    """A file's stem for the name: itself where it is plain, else its plain characters and a hash.

    Two different names never share a stem, also where the file system ignores case.
    """
    if re.fullmatch(r"[a-z0-9][a-z0-9_-]{0,40}", name):
        return name
    return f"{_plain(name, 40)}.{text_digest(name, 12)}"


def joined_file_name(*names: str) -> str:
    """A file's stem for several names together, which no other names share: plain characters and a hash."""
    return f"{_plain('-'.join(names), 80)}.{text_digest(json.dumps(names), 12)}"


def _plain(name: str, longest: int) -> str:
    return re.sub(r"[^a-z0-9_-]+", "-", name.lower()).strip("-")[:longest] or "policy"


def plural(count: int, noun: str) -> str:
    """A regular noun in the form that follows a number."""
    return noun if count == 1 else f"{noun}s"


def counted(count: int, noun: str) -> str:
    """A number and its regular noun: 1 episode, 2 episodes."""
    return f"{count} {plural(count, noun)}"
