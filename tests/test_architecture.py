"""Rules about the code itself: who may import whom, what nobody does, how long a file may be."""

import ast
import re
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from offenders import assert_none

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("space_envs", "agents", "promp", "reproduce", "benchmarks", "docs", "tests")
SOURCES = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py")) + sorted(
    ROOT.glob("*.py")
)
NAMES = [path.relative_to(ROOT).as_posix() for path in SOURCES]

# Package -> packages of this project that it must not import.
FORBIDDEN = {
    "space_envs": ("agents", "promp", "reproduce", "benchmarks", "docs", "tests", "train", "evaluate"),
    "promp": ("space_envs", "agents", "reproduce", "benchmarks", "docs", "tests", "train", "evaluate"),
    "agents": ("reproduce", "benchmarks", "docs", "tests", "train", "evaluate"),
    "reproduce": ("benchmarks", "docs", "tests", "train", "evaluate"),
    "benchmarks": ("reproduce", "docs", "tests", "train", "evaluate"),
    "docs": ("reproduce", "tests"),
}
# Third-party packages that promp may use.
PROMP_NEEDS = {"numpy"}

LONGEST = 400
LONGER = {
    "space_envs/envs/capture.py": "one class, whose parts share the bookkeeping of episodes",
    "tests/test_dynamics.py": "one check after another of the same functions, on the same robots",
    "tests/test_envs.py": "one suite through which every id and control mode goes",
    "tests/test_experts.py": "one suite through which every planner goes",
    "tests/test_reactionless_free.py": "one planner, looked at from all sides",
    "tests/test_report.py": "one report, made once and looked at from all sides",
}
# Tests that ask where a cache would be for users who do not exist.
MADE_UP_PATHS = {"tests/test_libraries.py", "tests/test_architecture.py"}
# Messages of the harness to a process that it started itself, and back; as multiprocessing does it.
BETWEEN_OWN_PROCESSES = {"space_envs/evaluation/play/policy_process.py"}
# Running code from text is what these tests are about.
MAY_EXECUTE = {"tests/test_docs.py"}
MACHINE_PATH = re.compile(r"(?<![\w.])/(?:home|root|Users|work|mnt|tmp|data|opt)/\w|(?<!\w)[A-Z]:\\")


@cache
def source(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@cache
def tree(name: str) -> ast.Module:
    return ast.parse(source(name), name)


def outside_tests() -> list[str]:
    return [name for name in NAMES if not name.startswith("tests/")]


def imported(module: ast.Module, package: str) -> Iterator[str]:
    """Dotted names that a module imports, wherever in it, relative ones resolved to its top package."""
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield package if node.level else str(node.module)


def calls(name: str) -> Iterator[tuple[str, ast.Call]]:
    """Place (file and line) and node of every call in a file."""
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Call):
            yield f"{name}:{node.lineno}", node


def keywords(call: ast.Call) -> dict[str | None, str]:
    """Keyword arguments of a call, as source text."""
    return {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}


def test_sources_are_found():
    assert len(SOURCES) > 80
    assert {name.split("/")[0] for name in NAMES} >= set(FOLDERS)


def test_imports_run_one_way():
    assert_none(
        f"{name} imports {other}"
        for name in NAMES
        for other in imported(tree(name), name.split("/")[0])
        if other.split(".")[0] in FORBIDDEN.get(name.split("/")[0], ())
    )


def test_promp_needs_numpy_only():
    allowed = {*sys.stdlib_module_names, *PROMP_NEEDS, "promp"}
    assert_none(
        f"{name} imports {other}"
        for name in NAMES
        if name.startswith("promp/")
        for other in imported(tree(name), "promp")
        if other.split(".")[0] not in allowed
    )


def test_every_module_has_a_docstring():
    assert_none(
        f"{name} has no docstring" for name in NAMES if not (ast.get_docstring(tree(name)) or "").strip()
    )


def test_no_text_is_executed():
    forbidden = ("eval", "exec", "compile", "os.system")
    assert_none(
        f"{place} calls {ast.unparse(call.func)}"
        for name in NAMES
        for place, call in calls(name)
        if (ast.unparse(call.func) in forbidden and name not in MAY_EXECUTE)
        or keywords(call).get("shell") == "True"
    )


def test_nothing_is_unpickled():
    """A pickle is a program: files of strangers are read as arrays and JSON."""

    def offenders(name: str) -> Iterator[str]:
        for other in imported(tree(name), ""):
            if other.split(".")[0] in ("pickle", "dill", "shelve"):
                yield f"{name} imports {other}"
        for place, call in calls(name):
            function, given = ast.unparse(call.func), keywords(call)
            if re.fullmatch(r"\w*pickle\.loads?|joblib\.load", function):
                yield f"{place} calls {function}"
            if re.fullmatch(r"(torch|th)\.load", function) and given.get("weights_only") != "True":
                yield f"{place} calls {function} without weights_only=True"
            if given.get("allow_pickle", "False") != "False":
                yield f"{place} allows pickles"

    assert_none(
        each for name in outside_tests() if name not in BETWEEN_OWN_PROCESSES for each in offenders(name)
    )


def test_input_is_not_checked_by_assert():
    """`python -O` drops assertions; users' mistakes need errors of the project's own."""
    assert_none(
        f"{name}:{node.lineno} asserts"
        for name in outside_tests()
        if not name.startswith("benchmarks/")
        for node in ast.walk(tree(name))
        if isinstance(node, ast.Assert)
    )


def test_no_path_of_one_machine():
    assert_none(
        f"{name}:{node.lineno}: {node.value!r}"
        for name in set(NAMES) - MADE_UP_PATHS
        for node in ast.walk(tree(name))
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and MACHINE_PATH.search(node.value)
    )


def test_files_are_short():
    """A longer file is divided by idea, or says in LONGER why not."""
    assert_none(
        f"{name} has {length} lines"
        for name in NAMES
        if (length := len(source(name).splitlines())) > LONGEST and name not in LONGER
    )
