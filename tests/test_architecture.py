"""Rules about the code itself: who may import whom, what nobody does, how long a file may be."""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from statistics import median

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
# Rooms and what stands alone, from the lowest: each imports itself and those before it, and none behind it.
ROOMS = (
    *("space_envs.errors", "space_envs.checks", "space_envs.system", "space_envs.codegen"),
    *("space_envs.dynamics", "space_envs.scenery", "space_envs.robots"),
    *(
        "space_envs.simulation",
        "space_envs.drives",
        "space_envs.control",
        "space_envs.perturbations",
        "space_envs.step_limits",
        "space_envs.metric",
        "space_envs.tasks",
    ),
    *("space_envs.foreign_code", "space_envs.registration", "space_envs.rendering"),
    *("space_envs.envs", "space_envs.wrappers", "space_envs.policy"),
    *(f"space_envs.evaluation.{room}" for room in ("play", "records", "statistics", "leaderboard", "replay")),
    *(f"space_envs.evaluation.{room}" for room in ("harness", "results", "datasets", "report")),
    *("space_envs.robots.check", "space_envs.robots.__main__"),  # a robot in every task, with its report
    "promp",
    *("agents.planners.common", "agents.planners.single_arm", "agents.planners.dual_arm", "agents.motions"),
    *("agents.policies", "agents.demonstrations", "agents.learning", "agents.commands"),
    *("reproduce", "benchmarks", "docs"),
)
MOST_FILES = 12  # of a room
FULLER = {
    "benchmarks": "one file a benchmark, and none imports another but what several share",
    "tests": "one file a subject, flat as pytest's plain import mode wants it",
}
# Third-party packages that promp may use.
PROMP_NEEDS = {"numpy"}

LONGEST, MEDIAN = 400, 130  # lines of a file
LONGER = {
    "tests/test_dynamics.py": "one check after another of the same functions, on the same robots",
    "tests/test_envs.py": "one suite through which every id and control mode goes",
    "tests/test_experts.py": "one suite through which every planner goes",
    "tests/test_reactionless_free.py": "one planner, looked at from all sides",
    "tests/test_report.py": "one report, made once and looked at from all sides",
}
# Tests that ask where a cache would be for users who do not exist.
MADE_UP_PATHS = {"tests/test_libraries.py", "tests/test_architecture.py"}
# Messages of the harness to a process that it started itself, and back; as multiprocessing does it.
BETWEEN_OWN_PROCESSES = {"space_envs/evaluation/play/process/server.py"}
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


def modules() -> dict[str, str]:
    """Files of the packages by dotted name."""
    names = [name for name in outside_tests() if "/" in name]
    return {name[:-3].replace("/", ".").removesuffix(".__init__"): name for name in names}


def graph() -> dict[str, set[str]]:
    """Which module imports which, those inside functions and under TYPE_CHECKING included."""
    found = modules()
    edges: dict[str, set[str]] = {module: set() for module in found}
    for module, name in found.items():
        for node in ast.walk(tree(name)):
            if isinstance(node, ast.Import):
                edges[module] |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                edges[module] |= (inner & {*found}) | ({str(node.module)} if inner - {*found} else set())
    return {module: (others & {*found}) - {module} for module, others in edges.items()}


def room_of(module: str) -> str:
    """The room that a module stands in, or the module itself."""
    rooms = [room for room in ROOMS if f"{module}.".startswith(f"{room}.")]
    return max(rooms, key=len, default=module)


def test_there_is_no_circle_of_imports():
    """Modules that import each other hold something that belongs into a third."""
    try:
        TopologicalSorter(graph()).prepare()
    except CycleError as error:
        raise AssertionError(f"circle: {' -> '.join(error.args[1])}") from None


def test_arrows_between_rooms_point_down():
    order = {room: number for number, room in enumerate(ROOMS)}
    assert_none(
        f"{module} imports {other}"
        for module, others in graph().items()
        for other in others
        if (here := room_of(module)) in order and order.get(room_of(other), -1) > order[here]
    )


def test_every_module_is_in_a_room():
    packages = {module for module, name in modules().items() if name.endswith("__init__.py")}
    assert_none(
        f"{module} is in no room" for module in modules() if room_of(module) not in (*ROOMS, *packages)
    )


def test_rooms_are_small():
    count = Counter(name.rpartition("/")[0] for name in NAMES)
    assert_none(
        f"{room} has {number} files, at most {MOST_FILES}, or say why in FULLER"
        for room, number in count.items()
        if number > MOST_FILES and room not in FULLER
    )


def test_no_two_files_of_a_room_differ_by_an_ending():
    """`record` and `records`, `merge` and `merging`: nobody knows which holds what."""
    stems: dict[tuple[str, str], list[str]] = {}
    for name in outside_tests():
        room, _, file = name.rpartition("/")
        stems.setdefault((room, re.sub(r"(e|s|ing)$", "", file[:-3])), []).append(name)
    assert_none(" and ".join(names) for names in stems.values() if len(names) > 1)


def test_names_of_classes_are_unique():
    places: dict[str, list[str]] = {}
    for name in outside_tests():
        for node in tree(name).body:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(name)
    several = {cls: names for cls, names in places.items() if len(names) > 1}
    assert_none(f"{cls}: {', '.join(names)}" for cls, names in several.items())


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


def docstrings(name: str) -> Iterator[tuple[str, str]]:
    """Place and docstring of a module, its classes and its functions."""
    for node in ast.walk(tree(name)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            if text := ast.get_docstring(node):
                yield f"{name}:{node.body[0].lineno}", text


def test_docstrings_begin_with_what_a_thing_is_or_does():
    """A noun phrase or an imperative; a question about it leaves the reader to find the answer."""
    questions = re.compile(r"(What|Which|Whose|Who|Where|How|It) ")
    assert_none(
        f"{place}: {text.splitlines()[0]}"
        for name in outside_tests()
        for place, text in docstrings(name)
        if questions.match(text)
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
    """A pickle is a program: files of others are read as arrays and JSON."""

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


def test_the_median_file_is_short():
    lengths = [len(source(name).splitlines()) for name in outside_tests() if not name.endswith("__init__.py")]
    assert median(lengths) <= MEDIAN


def test_files_are_short():
    """A longer file is divided by idea, or says in LONGER why not."""
    assert_none(
        f"{name} has {length} lines"
        for name in NAMES
        if (length := len(source(name).splitlines())) > LONGEST and name not in LONGER
    )
