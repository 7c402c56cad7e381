"""Rules about the code itself: who may import whom, what nobody does, how long a file may be."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

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
    "tests/test_learning.py": "runs are trained once and looked at from all sides",
    "tests/test_reactionless_free.py": "one planner, looked at from all sides",
    "tests/test_report.py": "one report, made once and looked at from all sides",
}
# Tests that ask where a cache would be for users who do not exist.
MADE_UP_PATHS = {"tests/test_compiled.py", "tests/test_architecture.py"}
# Messages of the harness to a process that it started itself, and back; as multiprocessing does it.
BETWEEN_OWN_PROCESSES = {"space_envs/evaluation/play/policy_process.py"}
# Running code from text is what these tests are about.
MAY_EXECUTE = {"tests/test_docs.py"}
MACHINE_PATH = re.compile(r"(?<![\w.])/(?:home|root|Users|work|mnt|tmp|data|opt)/\w|(?<!\w)[A-Z]:\\")


def tree(name: str) -> ast.Module:
    return ast.parse((ROOT / name).read_text(encoding="utf-8"), name)


def imported(module: ast.Module, package: str) -> Iterator[str]:
    """Dotted names that a module imports, wherever in it, relative ones resolved to its top package."""
    for node in ast.walk(module):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield package if node.level else str(node.module)


def calls(module: ast.Module) -> Iterator[tuple[str, ast.Call]]:
    for node in ast.walk(module):
        if isinstance(node, ast.Call):
            yield ast.unparse(node.func), node


def test_sources_are_found():
    assert len(SOURCES) > 80
    assert {name.split("/")[0] for name in NAMES} >= set(FOLDERS)


@pytest.mark.parametrize("package", FORBIDDEN)
def test_imports_run_one_way(package):
    for name in (each for each in NAMES if each.startswith(f"{package}/")):
        found = {other.split(".")[0] for other in imported(tree(name), package)}
        assert not found & set(FORBIDDEN[package]), f"{name} imports {found & set(FORBIDDEN[package])}"


def test_promp_needs_numpy_only():
    import sys

    for name in (each for each in NAMES if each.startswith("promp/")):
        found = {other.split(".")[0] for other in imported(tree(name), "promp")}
        foreign = found - set(sys.stdlib_module_names) - {"promp"}
        assert foreign <= PROMP_NEEDS, f"{name} imports {foreign}"


@pytest.mark.parametrize("name", NAMES)
def test_module_says_what_it_is(name):
    said = ast.get_docstring(tree(name))
    assert said, f"{name} has no docstring"
    assert said.strip(), f"{name} has no docstring"


@pytest.mark.parametrize("name", NAMES)
def test_no_text_or_file_is_executed(name):
    module = tree(name)
    if not name.startswith("tests/"):
        unpickles = {
            other for other in imported(module, "") if other.split(".")[0] in ("pickle", "dill", "shelve")
        }
        assert not unpickles or name in BETWEEN_OWN_PROCESSES, f"{name} imports {unpickles}"
    for function, call in calls(module):
        if name not in MAY_EXECUTE:
            assert function not in ("eval", "exec", "compile", "os.system"), (
                f"{name}:{call.lineno} calls {function}"
            )
        if not name.startswith("tests/"):
            unpickles = re.fullmatch(r"\w*pickle\.loads?|joblib\.load", function)
            assert not unpickles or name in BETWEEN_OWN_PROCESSES, f"{name}:{call.lineno} calls {function}"
            if re.fullmatch(r"torch\.load|th\.load", function):
                given = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
                assert given.get("weights_only") == "True", f"{name}:{call.lineno} may unpickle"
        for keyword in call.keywords:
            true = isinstance(keyword.value, ast.Constant) and keyword.value.value is True
            assert not (keyword.arg == "shell" and true), f"{name}:{call.lineno} runs a shell"
            allowed = keyword.arg == "allow_pickle" and not (
                isinstance(keyword.value, ast.Constant) and keyword.value.value is False
            )
            assert not allowed or name.startswith("tests/"), f"{name}:{call.lineno} may unpickle"


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith("tests/")])
def test_input_is_not_checked_by_assert(name):
    """`python -O` drops assertions; users' mistakes need errors of the project's own."""
    if name.startswith("benchmarks/"):
        return
    lines = [node.lineno for node in ast.walk(tree(name)) if isinstance(node, ast.Assert)]
    assert not lines, f"{name}: assert in lines {lines}"


@pytest.mark.parametrize("name", sorted(set(NAMES) - MADE_UP_PATHS))
def test_no_path_of_one_machine(name):
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            assert not MACHINE_PATH.search(node.value), f"{name}:{node.lineno} has a path of one machine"


@pytest.mark.parametrize("name", NAMES)
def test_files_are_short(name):
    length = len((ROOT / name).read_text(encoding="utf-8").splitlines())
    assert length <= LONGEST or name in LONGER, (
        f"{name} has {length} lines; divide it, or say why not in LONGER"
    )
