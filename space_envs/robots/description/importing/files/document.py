"""XML of a robot file, read as untrusted data."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError, no_path
from space_envs.system.reading import read_bytes

_LARGEST = 64 * 2**20  # bytes
_DEEPEST = 200  # elements within each other
_ROOTS = {"robot": "urdf", "mujoco": "mjcf"}
_XACRO = "http://www.ros.org/wiki/xacro"


class _Builder(ET.TreeBuilder):
    """A builder that rejects document types, whose entities can expand without bounds, and deep nesting."""

    depth = 0

    def doctype(self, *_: Any) -> None:
        raise ConfigurationError("it has a DOCTYPE, which robot files do not need; remove it")

    def start(self, tag: Any, attrs: Any, /) -> Any:
        self.depth += 1
        if self.depth > _DEEPEST:
            raise ConfigurationError(f"its elements are nested more than {_DEEPEST} deep")
        return super().start(tag, attrs)

    def end(self, tag: Any, /) -> Any:
        self.depth -= 1
        return super().end(tag)


def read_document(path: Path) -> tuple[str, ET.Element]:
    """Format (`urdf` or `mjcf`) and root element of a robot file.

    Raises:
        ConfigurationError: if there is no such file, it is no XML, or of neither format.
    """
    try:
        root = parse_xml(path)
    except FileNotFoundError:
        names = [other.name for other in path.parent.glob("*")] if path.parent.is_dir() else []
        raise no_path("robot file", path, names) from None
    except OSError as error:
        raise ConfigurationError(f"cannot be read: {error}") from None
    return _format_of(path, root), root


def parse_xml(path: Path) -> ET.Element:
    """Root element of an XML file.

    Raises:
        ConfigurationError: if it is no XML, or has a document type. OSError: if it cannot be read.
    """
    try:
        return ET.fromstring(read_bytes(path, _LARGEST), ET.XMLParser(target=_Builder()))
    except (ET.ParseError, LookupError, ValueError) as error:
        if isinstance(error, ConfigurationError):
            raise
        raise ConfigurationError(f"not well-formed XML: {error}") from None


def _format_of(path: Path, root: ET.Element) -> str:
    if _is_xacro(path, root):
        stem = path.name.removesuffix(".xacro").removesuffix(".urdf")
        output = f"{stem}.urdf" if path.suffix == ".xacro" else f"{stem}_expanded.urdf"
        raise ConfigurationError(
            f"this is a xacro file, from which a URDF has to be made first: xacro {path.name} > {output}"
        )
    if root.tag not in _ROOTS:
        raise ConfigurationError(
            f"the root element is <{root.tag}>; expected <robot> (URDF) or <mujoco> (MJCF)"
        )
    return _ROOTS[root.tag]


def _is_xacro(path: Path, root: ET.Element) -> bool:
    """Whether macros are still to be expanded; a URDF made from them may keep their namespace."""
    if path.suffix == ".xacro":
        return True
    return any(
        str(element.tag).startswith(f"{{{_XACRO}}}")
        or any(re.search(r"\$[({]", value) for value in element.attrib.values())
        for element in root.iter()
    )
