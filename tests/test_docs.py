"""The documentation is true: pages are those of the code, examples run, commands, links and names exist."""

import importlib
import importlib.util
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image
from result_folders import write_folder
from synthetic_results import make_record, make_result

from agents.commands.evaluate import COMMANDS
from agents.commands.evaluate import main as evaluate
from docs import generate, pictures
from docs.blocks import BLOCKS
from docs.goals import goals
from docs.leaderboard import MARKER as LEADERBOARDS
from docs.leaderboard import with_leaderboards
from docs.reading import attributes, comments, described, field_comments, number, section, split_unit
from space_envs.envs import CaptureEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.record import read_records
from space_envs.evaluation.statistics.columns import COLUMNS, RULES
from space_envs.registration import ENTRIES
from space_envs.rendering import missing_gl
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import CaptureEnvelope
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.dual_arm_spatial import ApproachEnvelope

ROOT = generate.DOCS.parent
PAGES = [ROOT / "README.md", *sorted(generate.DOCS.rglob("*.md"))]
NAMES = [path.relative_to(ROOT).as_posix() for path in PAGES]
FENCE = re.compile(
    r"^(?:<!-- (?P<mark>no-run|file: \S+) -->\n)?```(?P<kind>\w*)\n(?P<code>.*?)^```$", re.M | re.S
)
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


@pytest.mark.parametrize("name", NAMES)
def test_examples_run(name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    known = set(ENTRIES)
    namespace: dict[str, object] = {}
    try:
        for mark, code, line in blocks(ROOT / name, "python"):
            if mark != "no-run":
                exec(compile("\n" * line + code, name, "exec"), namespace)
    finally:
        for added in set(ENTRIES) - known:
            del ENTRIES[added], gym.registry[added]


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


def test_policy_of_ones_own_enters_the_leaderboard(monkeypatch, tmp_path, capsys):
    ((_, code, _),) = [
        b for b in blocks(ROOT / "docs/extending.md", "python") if b[0] == "file: my_policy.py"
    ]
    (tmp_path / "my_policy.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    try:
        output = ["--no-pictures", "--output", str(tmp_path / "out")]
        status = evaluate(["--policy", "my_policy:StraightToGoal", "--episodes", "4", *output])
    finally:
        sys.modules.pop("my_policy", None)
    assert status == 0
    records = read_records(tmp_path / "out" / "records.jsonl")
    assert [record.captured for record in records] == [True] * 4
    assert "StraightToGoal" in capsys.readouterr().out


@pytest.fixture(scope="module")
def helps() -> dict[str, str]:
    """What each command of the project says with --help, by module or script; filled as needed."""
    return {}


def help_of(target: str, kept: dict[str, str], capsys, monkeypatch, inner: str = "") -> str:
    """Of a script or module, or of a command inside it."""
    if (name := f"{target} {inner}") not in kept:
        monkeypatch.setattr(sys, "argv", [target, *inner.split(), "--help"])
        run = runpy.run_path if target.endswith(".py") else runpy.run_module
        with pytest.raises(SystemExit) as ended:
            run(str(ROOT / target) if target.endswith(".py") else target, run_name="__main__")
        assert ended.value.code in (0, None)
        kept[name] = capsys.readouterr().out
    return kept[name]


@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")
@pytest.mark.parametrize(("page", "command"), commands())
def test_commands_exist_with_their_options(page, command, helps, capsys, monkeypatch):
    words = shlex.split(command)
    if Path(words[0]).name == "make":
        targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
        assert set(words[1:]) <= set(targets)
        return
    if Path(words[0]).name in ("python", "python3"):
        words = words[1:]
        if words[0] == "-m":
            words = words[1:]
            assert importlib.util.find_spec(words[0]), f"{page}: there is no module {words[0]}"
            if words[0].split(".")[0] not in OWN_MODULES:
                return
            # A command without options would do its work when it is asked for help.
            main = f"{words[0]}.__main__" if _is_module(f"{words[0]}.__main__") else words[0]
            spec = importlib.util.find_spec(main)
            assert spec and spec.origin and "argparse" in Path(spec.origin).read_text(encoding="utf-8")
    elif words[0] not in ("train.py", "evaluate.py"):
        return
    inner = words[1] if words[0] == "evaluate.py" and set(words[1:2]) & set(COMMANDS) else ""
    usage = help_of(words[0], helps, capsys, monkeypatch, inner)
    for option in (word for word in words[1:] if word.startswith("-")):
        assert re.search(rf"(?<![\w-]){option}(?![\w-])", usage), f"{page}: {words[0]} has no option {option}"


def anchors(path: Path) -> set[str]:
    """Anchors that GitHub gives the headings of a page."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    titles = re.findall(r"^#+ (.+)$", text, re.M)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("name", NAMES)
def test_links_lead_somewhere(name):
    page = ROOT / name
    for target in re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"\w+:", target):
            continue
        file, _, anchor = target.partition("#")
        linked = (page.parent / file).resolve() if file else page
        assert linked.exists(), f"{name} links to {target}"
        assert linked.is_relative_to(ROOT), f"{name} links outside the project: {target}"
        assert not anchor or anchor in anchors(linked), f"{name} links to {target}, which has no such heading"


def resolve(path: str) -> None:
    """Import what a dotted path names; fields of dataclasses count as attributes. Raises AssertionError."""
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


@pytest.mark.parametrize("name", NAMES)
def test_code_named_in_the_text_exists(name):
    """Dotted names of the project's packages, paths of its files, and tests, wherever a page has them."""
    text = FENCE.sub("", (ROOT / name).read_text(encoding="utf-8"))
    for code in re.findall(r"`([^`\n]+)`", text):
        if re.fullmatch(rf"(?:{'|'.join(OWN_MODULES)})(?:\.\w+)+", code):
            resolve(code)
        elif match := re.fullmatch(r"(tests/\w+\.py)::(\w+)", code):
            source = (ROOT / match[1]).read_text(encoding="utf-8")
            assert f"def {match[2]}(" in source, f"{name}: there is no test {code}"
        elif re.fullmatch(rf"(?:{'|'.join(OWN_MODULES)}|tests)/[\w./-]+", code):
            assert (ROOT / code).exists(), f"{name}: there is no {code}"


def test_every_symbol_has_a_place_in_the_code():
    text = (ROOT / "docs/physics.md").read_text(encoding="utf-8").split("\n## Symbols\n")[1]
    rows = [line for line in text.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 25
    for row in rows:
        names = re.findall(r"`([\w.]+)`", row.split(" | ")[2])
        assert names, f"no code for {row}"
        resolve(names[0])
        if names[0].endswith("LAYOUT"):
            layout = importlib.import_module(names[0].rpartition(".")[0]).LAYOUT
            assert set(names[1:]) <= set(layout.slices)


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
        generate._filled(open_block, "generated", str)
    with pytest.raises(ValueError, match="no block 'policy'; there are environments, policies"):
        generate._block("policy")


def test_pages_named_in_the_code_exist():
    for path in sorted((ROOT / "space_envs").rglob("*.py")) + sorted((ROOT / "agents").rglob("*.py")):
        for page in re.findall(r"docs/[\w/]+\.md", path.read_text(encoding="utf-8")):
            assert (ROOT / page).exists(), f"{path.relative_to(ROOT)} names {page}"


def test_pictures_of_the_readme_are_those_of_their_command(tmp_path, monkeypatch, capsys):
    assert {f"{shot.name}.jpg" for shot in pictures.SHOTS} <= {
        path.name for path in pictures.IMAGES.iterdir()
    }
    for shot in pictures.SHOTS:
        assert f"docs/images/{shot.name}.jpg" in (ROOT / "README.md").read_text(encoding="utf-8")
        assert Image.open(pictures.IMAGES / f"{shot.name}.jpg").size == (pictures.WIDTH, pictures.HEIGHT)
    monkeypatch.setattr(pictures, "SHOTS", [replace(pictures.SHOTS[0], seconds=0.4)])
    status = pictures.main(["--output", str(tmp_path)])
    if missing_gl() is not None:
        assert status == 2 and "libegl1" in capsys.readouterr().err
        return
    drawn = np.asarray(Image.open(tmp_path / "capture.jpg"))
    assert status == 0 and drawn.shape == (pictures.HEIGHT, pictures.WIDTH, 3) and drawn.std() > 20
