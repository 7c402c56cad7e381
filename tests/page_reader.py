"""Reads an HTML page of ours: what it could load or run, and what it says."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from page_layout import CHROMIUM, layout_faults


class Reader(HTMLParser):
    """Everything of a page that could lead outside it or run."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.links: list[str] = []
        self.scripts: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.inside = ""
        self.policy = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.inside = tag
        self.links += [
            str(values[name]) for name in ("src", "href", "xlink:href", "action") if values.get(name)
        ]
        self.ids += [str(values["id"])] if values.get("id") else []
        if tag == "script":
            self.scripts.append("")
        if values.get("http-equiv") == "Content-Security-Policy":
            self.policy = str(values["content"])
        assert not [name for name in values if name.startswith("on")]

    def handle_endtag(self, tag: str) -> None:
        self.inside = ""

    def handle_data(self, data: str) -> None:
        if self.inside == "script":
            self.scripts[-1] += data
        elif self.inside != "style":
            self.text.append(data)


def check_study(name: str, tmp_path: Path, request: pytest.FixtureRequest) -> tuple[str, dict[str, Any], str]:
    """The page, summary and docs page of a paper's run into `out` and `docs`; all their links lead somewhere.

    Chromium, where there is one, finds no fault in the page's layout.
    """
    out, docs = tmp_path / "out", tmp_path / "docs"
    text = (out / f"{name}.html").read_text(encoding="utf-8")
    for link in check_self_contained(text).links:
        assert link.startswith(("#", "data:")) or (out / link).exists()
    if CHROMIUM:
        assert layout_faults(request.getfixturevalue("browser"), (out / f"{name}.html").as_uri()) == []
    for figure in (out / "figures").glob("*.svg"):
        ElementTree.parse(figure)
    written = (docs / f"{name}.md").read_text(encoding="utf-8")
    for link in re.findall(r"\]\((images/\S+)\)", written):
        assert (docs / link).exists()
    assert [path.name for path in tmp_path.rglob(".*")] == [".space-capture"]
    return text, json.loads((out / "summary.json").read_text(encoding="utf-8")), written


def check_self_contained(text: str) -> Reader:
    reader = Reader(text)
    assert [link for link in reader.links if not re.match(r"#|data:,?|[\w.]+\.(csv|json|md)$", link)] == []
    assert not re.search(r"@import|url\((?!#|\"?#)", text)
    assert len(reader.ids) == len(set(reader.ids))
    (script,) = reader.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in reader.policy and "default-src 'none'" in reader.policy
    return reader
