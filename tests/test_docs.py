"""The documentation is true: pages are those of the code, examples run, commands, links and names exist."""

import importlib
import importlib.util
import re
import runpy
import shlex
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from files_of_the_docs import file_blocks, write_files
from offenders import assert_none
from package_of_the_docs import installed
from PIL import Image
from result_folders import write_folder
from synthetic_results import make_record, make_result

from agents.commands.evaluate import COMMANDS
from docs import generate, pictures
from docs.blocks import BLOCKS
from docs.goals import goals
from docs.leaderboard import MARKER as LEADERBOARDS
from docs.leaderboard import with_leaderboards
from docs.reading import attributes, comments, described, field_comments, number, section, split_unit
from space_envs.envs import CaptureEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.columns import COLUMNS, RULES
from space_envs.rendering import missing_gl
from space_envs.system.provenance import package_version
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import CaptureEnvelope
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.dual_arm_spatial import ApproachEnvelope
from space_envs.tasks.single_arm import SingleArmTask

ROOT = generate.DOCS.parent
PAGES = [ROOT / "README.md", *sorted(generate.DOCS.rglob("*.md"))]
NAMES = [path.relative_to(ROOT).as_posix() for path in PAGES]
FILES = {name for path in PAGES for name, _ in file_blocks(path)}  # that pages consist of
FENCE = re.compile(
    r"^(?:<!-- (?P<mark>no-run|file: \S+) -->\n)?```(?P<kind>\w*)\n(?P<code>.*?)^```$", re.M | re.S
)
INNER = {"evaluate.py": COMMANDS, "space_envs.robots": ("check",)}  # commands with commands of their own
OWN_MODULES = ("agents", "benchmarks", "docs", "promp", "reproduce", "space_envs")


def blocks(path: Path, *kinds: str) -> Iterator[tuple[str | None, str, int]]:
    """Mark, code and line number of each fenced block of these kinds."""
    text = path.read_text(encoding="utf-8")
    for match in FENCE.finditer(text):
        if match["kind"] in kinds:
            yield match["mark"], match["code"], text[: match.start("code")].count("\n")


def commands() -> list[tuple[str, str]]:
    """Page and command, for every command line in a shell block or between backticks."""
    found = []
    for path, name in zip(PAGES, NAMES, strict=True):
        text = path.read_text(encoding="utf-8")
        lines = [line for _, code, _ in blocks(path, "sh", "bash") for line in code.splitlines()]
        lines += re.findall(r"`((?:python|make|train\.py|evaluate\.py)(?: [^`]*)?)`", FENCE.sub("", text))
        found += [(name, line.split(" #")[0].strip()) for line in lines]
    return [pair for pair in dict.fromkeys(found) if pair[1]]


def test_pages_are_those_of_the_code():
    assert generate.stale() == [], "run: python -m docs.generate"


def test_check_names_a_stale_page(monkeypatch, capsys):
    monkeypatch.setitem(BLOCKS, "policies", lambda: "another table")
    assert generate.main(["--check"]) == 1
    said = capsys.readouterr().out
    assert "docs/reproduce.md is stale" in said
    assert "docs/physics.md" not in said


def test_measurements_go_between_their_markers(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("before\n<!-- measured: python -c 'print(6 * 7)' -->\nold\n<!-- end -->\nafter\n")
    generate.measure(page, "")
    marker = "<!-- measured: python -c 'print(6 * 7)' -->"
    assert page.read_text() == f"before\n{marker}\n\n42\n\n<!-- end -->\nafter\n"


def test_leaderboards_of_the_readme_are_those_of_a_folder(tmp_path, monkeypatch, capsys):
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- leaderboard: SpaceCapture/SingleArm-v0 -->\nstale\n<!-- /leaderboard -->\nb\n")
    monkeypatch.setattr(generate, "README", page)
    monkeypatch.setattr(generate, "pages", dict)
    records = list(make_result(episodes=4).records)
    write_folder(tmp_path / "results", records)
    assert generate.main(["--leaderboard", str(tmp_path / "results")]) == 0
    text = page.read_text()
    assert text.startswith("a\n<!-- leaderboard: ") and text.endswith("\n<!-- /leaderboard -->\nb\n")
    assert (
        "Medium goals, test split, 4 episodes a policy, 4 seeds; the control mode is joint_velocity. " in text
    )
    assert "stale" not in text and "| 1 | " in text and all(rule in text for rule in RULES)
    # A few columns, and intervals where the README has room for them.
    (line,) = (line for line in text.splitlines() if "| mpc |" in line)
    assert line.count("|") < len(COLUMNS) and line.count("[") == 2
    with pytest.raises(ConfigurationError, match="unknown id in the records 'SpaceCapture/SingleArm-v1'"):
        with_leaderboards(text.replace("-v0", "-v1"), records)
    other = make_record(difficulty="hard")
    with pytest.raises(ConfigurationError, match="2 tables of SpaceCapture/SingleArm-v0"):
        with_leaderboards(text, [*records, other])


def test_the_readme_has_the_tables_of_both_ids():
    found = LEADERBOARDS.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    assert [env_id for _, env_id, _ in found] == [
        "SpaceCapture/SingleArm-v0",
        "SpaceCapture/DualArmPlanar-v0",
    ]


@pytest.mark.parametrize("name", [name for name in NAMES if any(blocks(ROOT / name, "python"))])
def test_examples_run(name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {}
    write_files(ROOT / name, tmp_path)
    with installed(tmp_path):
        for mark, code, line in blocks(ROOT / name, "python"):
            if mark is None:
                exec(compile("\n" * line + code, name, "exec"), namespace)


def test_the_ten_lines_of_the_readme_do_what_they_say(monkeypatch, capsys):
    """The arm moves at random, by another action at each step, and the satellite keeps its attitude."""
    ((_, code, _),) = [b for b in blocks(ROOT / "README.md", "python") if "gym.make(" in b[1]]
    taken = []
    step = CaptureEnv.step
    monkeypatch.setattr(CaptureEnv, "step", lambda env, action: taken.append(action) or step(env, action))
    namespace: dict = {}
    exec(compile(code, "README.md", "exec"), namespace)
    assert len(taken) > 50 and len({tuple(action) for action in taken}) == len(taken)
    assert 0.0 < namespace["info"]["attitude"] <= 0.05
    assert f"{namespace['info']['attitude']:.4f} deg" in capsys.readouterr().out


def test_few_examples_are_not_run():
    assert sum(mark == "no-run" for path in PAGES for mark, *_ in blocks(path, "python")) <= 2


def output_of(target: str, words: list[str], capsys, monkeypatch) -> str:
    """Output of a script or module with options that end it at once."""
    monkeypatch.setattr(sys, "argv", [target, *words])
    run = runpy.run_path if target.endswith(".py") else runpy.run_module
    with pytest.raises(SystemExit) as ended:
        run(str(ROOT / target) if target.endswith(".py") else target, run_name="__main__")
    assert ended.value.code in (0, None)
    return capsys.readouterr().out


def command_offenders(command: str, usage: Callable[[str, str], str]) -> Iterator[str]:
    """Make targets, modules and options of a command line that do not exist."""
    program, *words = shlex.split(command)
    if Path(program).name == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
        yield from (f"no target {word}" for word in words if word not in targets)
        return
    if Path(program).name in ("python", "python3"):
        if words[0] in FILES:
            return
        if words[0] == "-m":
            words = words[1:]
            if not importlib.util.find_spec(words[0]):
                yield f"no module {words[0]}"
                return
            if words[0].split(".")[0] not in OWN_MODULES:
                return
            # A command without options would do its work when it is asked for help.
            main = f"{words[0]}.__main__" if _is_module(f"{words[0]}.__main__") else words[0]
            spec = importlib.util.find_spec(main)
            assert spec and spec.origin
            if "Parser(" not in Path(spec.origin).read_text(encoding="utf-8"):
                yield f"{words[0]} takes no options"
                return
        program, *words = words
    elif program not in ("train.py", "evaluate.py"):
        return
    inner = words[0] if set(words[:1]) & set(INNER.get(program, ())) else ""
    known = usage(program, inner)
    for option in (word for word in words if word.startswith("-")):
        if not re.search(rf"(?<![\w-]){option}(?![\w-])", known):
            yield f"{program} {inner} has no option {option}"


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_commands_exist_with_their_options(capsys, monkeypatch):
    usage = cache(lambda target, inner: output_of(target, [*inner.split(), "--help"], capsys, monkeypatch))
    assert len(commands()) > 50
    assert_none(
        f"{page}: {command}: {offence}"
        for page, command in commands()
        for offence in command_offenders(command, usage)
    )


def command_modules() -> list[str]:
    """Scripts and modules of the project that can be run."""
    sources = {path.relative_to(ROOT).as_posix(): path for path in sorted(ROOT.glob("*.py"))}
    for package in OWN_MODULES:
        for path in sorted((ROOT / package).rglob("*.py")):
            sources[path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")] = path
    run = re.compile(r'^if __name__ == "__main__":\n    .*\bmain\b', re.M)
    return [name for name, path in sources.items() if run.search(path.read_text(encoding="utf-8"))]


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
def test_every_command_states_its_version(capsys, monkeypatch):
    assert len(command_modules()) > 15
    expected = f"space-capture {package_version()}\n"
    assert_none(
        name for name in command_modules() if output_of(name, ["--version"], capsys, monkeypatch) != expected
    )


def anchors(path: Path) -> set[str]:
    """Anchors that GitHub gives the headings of a page."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def link_offenders(page: Path) -> Iterator[str]:
    """Links of a page within the project that lead nowhere or out of it."""
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"\w+:", target):
            continue
        file, _, anchor = target.partition("#")
        linked = (page.parent / file).resolve() if file else page
        if not linked.exists() or not linked.is_relative_to(ROOT):
            yield target
        elif anchor and anchor not in anchors(linked):
            yield f"{target}, which has no such heading"


def test_links_lead_somewhere():
    assert_none(f"{name} links to {target}" for name in NAMES for target in link_offenders(ROOT / name))


def resolve(path: str) -> None:
    """Import a dotted path; fields of dataclasses count as attributes. Raises AssertionError."""
    parts = path.split(".")
    at = len(parts)
    while at and not _is_module(".".join(parts[:at])):
        at -= 1
    assert at, f"{path}: no such module"
    found: object = importlib.import_module(".".join(parts[:at]))
    for part in parts[at:]:
        if is_dataclass(found) and part in {field.name for field in fields(found)}:
            return
        assert hasattr(found, part), f"{path}: no {part}"
        found = getattr(found, part)


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # its parent is no package
        return False


def code_exists(code: str) -> bool:
    """Whether a dotted name, path or test of this project exists; true for any other text."""
    packages = "|".join(OWN_MODULES)
    if re.fullmatch(rf"(?:{packages})(?:\.\w+)+", code):
        try:
            resolve(code)
        except AssertionError:
            return False
    elif match := re.fullmatch(r"(tests/\w+\.py)::(\w+)", code):
        file = ROOT / match[1]
        return file.exists() and f"def {match[2]}(" in file.read_text(encoding="utf-8")
    elif re.fullmatch(rf"(?:{packages}|tests)/[\w./-]+", code):
        return (ROOT / code).exists()
    return True


def test_code_named_in_the_text_exists():
    """Dotted names of the project's packages, paths of its files, and tests, wherever a page has them."""
    assert_none(
        f"{name} names {code}"
        for name in NAMES
        for code in re.findall(r"`([^`\n]+)`", FENCE.sub("", (ROOT / name).read_text(encoding="utf-8")))
        if not code_exists(code)
    )


def test_every_symbol_has_a_place_in_the_code():
    text = (ROOT / "docs/physics.md").read_text(encoding="utf-8").split("\n## Symbols\n")[1]
    rows = [line for line in text.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 25
    for row in rows:
        names = re.findall(r"`([\w.]+)`", row.split(" | ")[2])
        assert names, f"no code for {row}"
        resolve(names[0])
        if names[0].endswith("pose_layout"):
            assert set(names[1:]) <= set(SingleArmTask().layout.slices)


def test_reading_of_comments_and_docstrings():
    assert comments(CaptureEnvelope)["linear_velocity"] == "m/s"
    text = section(
        "Title.\n\nArgs:\n    one: first. two, three: the\n        others.\n\nRaises:\n    Error: no.", "Args"
    )
    assert described(text, ["one", "two", "three"]) == {
        "one": "first.",
        "two": "the\nothers.".replace("\n", " "),
    } | {"three": "the others."}
    assert split_unit("joint angles, rad") == ("rad", "joint angles")
    assert split_unit("w x y z, either sign") == ("", "w x y z, either sign")


def test_what_is_said_of_inherited_fields_counts():
    assert field_comments(ApproachEnvelope) == field_comments(CaptureEnvelope) | {"approach": "deg"}
    about = attributes(DualArmPlanarTask)
    assert {"difficulty", "horizon", "mounts"} <= set(about)
    assert about["horizon"] == attributes(CaptureTask)["horizon"]


def test_numbers_as_a_reader_writes_them():
    assert number(0.1 + 0.2) == "0.3"
    assert number([1, 2.5]) == "1, 2.5"
    assert number(((0.5, 0.0), (-0.5, 0.0))) == "(0.5, 0), (-0.5, 0)"


def test_a_task_of_another_kind_has_to_be_described():
    with pytest.raises(TypeError, match="describes no task like CaptureTask"):
        goals(CaptureTask.__new__(CaptureTask))


def test_blocks_that_do_not_end_or_exist_are_errors():
    open_block = "<!-- generated: policies -->\n<!-- generated: links -->\n<!-- end -->\n"
    with pytest.raises(ValueError, match="no <!-- end -->"):
        generate.filled(open_block, "generated", str)
    with pytest.raises(ValueError, match="no block 'policy'; there are environments, policies"):
        generate.block("policy")


def test_pages_named_in_the_code_exist():
    assert_none(
        f"{path.relative_to(ROOT)} names {page}"
        for package in ("space_envs", "agents", "promp", "reproduce", "benchmarks")
        for path in (ROOT / package).rglob("*.py")
        for page in re.findall(r"docs/[\w/]+\.md", path.read_text(encoding="utf-8"))
        if not (ROOT / page).exists()
    )


def test_pictures_of_the_readme_are_those_of_their_command(tmp_path, monkeypatch, capsys):
    assert {f"{shot.name}.jpg" for shot in pictures.SHOTS} <= {
        path.name for path in pictures.IMAGES.iterdir()
    }
    for shot in pictures.SHOTS:
        assert f"docs/images/{shot.name}.jpg" in (ROOT / "README.md").read_text(encoding="utf-8")
        assert Image.open(pictures.IMAGES / f"{shot.name}.jpg").size == (pictures.WIDTH, pictures.HEIGHT)
    assert "docs/images/robots.jpg" in (ROOT / "README.md").read_text(encoding="utf-8")
    assert {path.stem for path in (pictures.IMAGES / "robots").iterdir()} == set(pictures.zoo())
    monkeypatch.setattr(pictures, "SHOTS", [replace(pictures.SHOTS[0], seconds=0.4)])
    monkeypatch.setattr(pictures, "zoo", lambda: ["shyam2020"])
    status = pictures.main(["--output", str(tmp_path)])
    if missing_gl() is not None:
        assert status == 2 and "libegl1" in capsys.readouterr().err
        return
    drawn = np.asarray(Image.open(tmp_path / "capture.jpg"))
    assert status == 0 and drawn.shape == (pictures.HEIGHT, pictures.WIDTH, 3) and drawn.std() > 20
