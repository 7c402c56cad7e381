"""Template engine, shared files and hashes of scripts of the project's HTML pages."""

import base64
import hashlib
import re
from importlib.resources import files

import jinja2
from markupsafe import Markup


def make_environment() -> jinja2.Environment:
    """Template engine that escapes everything, with the filters `breakable` and `unit`."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {"breakable": breakable, "unit": display_unit}
    return environment


def breakable(name: str) -> Markup:
    """A name, escaped, that may break after its punctuation and nowhere else, not even within a number."""
    return Markup("<wbr>").join(re.split(r"(?<=[@_:/])(?=.)|(?<=\.)(?=\D)", name))


def display_unit(unit: str) -> str:
    """A unit with its exponents raised."""
    return unit.replace("^2", "²")


def read_template(name: str, package: str = "space_envs.evaluation.report") -> str:
    """A file of the folder templates of a package, with line ends as a browser sees them."""
    text = files(package).joinpath("templates", name).read_text(encoding="utf-8")
    return text.replace("\r\n", "\n")


def script_hash(script: str) -> str:
    """Hash of a script for a content security policy."""
    return base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
