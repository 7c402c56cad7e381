"""The package that docs/extending.md is, as a user would have it installed."""

import re
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from files_of_the_docs import write_files
from joblib.externals.loky import get_reusable_executor

from space_envs.registration import ENTRIES, unregister

PAGE = Path(__file__).resolve().parent.parent / "docs" / "extending.md"
NAME = "my_capture"
_COMMAND = re.compile(
    r"^python ((?:evaluate|train)\.py .*my_capture:.*|train\.py --resume runs/sprint.*)$", re.M
)


def commands() -> list[list[str]]:
    """Words of every command of the page that names the package or what came of it, without `python`."""
    return [shlex.split(command) for command in _COMMAND.findall(PAGE.read_text(encoding="utf-8"))]


def forget(package: str = NAME) -> None:
    """Make this process one that has not imported a package."""
    for env_id in [name for name, entry in ENTRIES.items() if entry.module.partition(".")[0] == package]:
        unregister(env_id)
    for name in [each for each in sys.modules if each.partition(".")[0] == package]:
        del sys.modules[name]


@contextmanager
def installed(folder: Path) -> Iterator[None]:
    """The package in a folder that this process, and those that it starts, find modules in."""
    write_files(PAGE, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        patch.setenv("PYTHONPATH", str(folder), prepend=":")
        get_reusable_executor().shutdown()  # processes that were started before know another path
        try:
            yield
        finally:
            forget()
            get_reusable_executor().shutdown()
