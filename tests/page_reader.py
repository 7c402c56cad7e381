"""Reads an HTML page of ours: what it could load or run, and what it says."""

import base64
import hashlib
import re
from html.parser import HTMLParser


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


def check_self_contained(text: str) -> Reader:
    reader = Reader(text)
    assert [link for link in reader.links if not re.match(r"#|data:,?|[\w.]+\.(csv|json|md)$", link)] == []
    assert not re.search(r"@import|url\((?!#|\"?#)", text)
    assert len(reader.ids) == len(set(reader.ids))
    (script,) = reader.scripts
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in reader.policy and "default-src 'none'" in reader.policy
    return reader
