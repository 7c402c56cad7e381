"""The commands of docs/own_robot.md, as a reader with example-robot-data would run them."""

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from pathlib import Path

import pytest
from files_of_the_docs import file_blocks, write_files

from space_envs.evaluation.harness import policy_times
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.replay import videos
from space_envs.registration import make_task

SINGLE_ARM = "SpaceCapture/SingleArm-v0"
PAGE = Path(__file__).resolve().parent.parent / "docs" / "own_robot.md"
# What makes each command of the page short, by its first words.
SHORT = {
    "evaluate.py --robot": ["--episodes", "2", "--jobs", "1"],
    "-m space_envs.robots check": ["--goals", "1", "--planners", "gjm"],
    "-m agents.demonstrations --robot": ["--count", "6"],
    "-m agents.demonstrations.optimal": [
        "--goals",
        "4",
        "--attitude",
        "unconstrained",
        "--limits",
        "limited",
    ],
    "train.py": ["--steps", "512", "--num-envs", "4", "--validation-episodes", "4"],
}


def commands() -> list[list[str]]:
    """Words of every Python command in the page's shell blocks, without `python`."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith("python ")]


def program(words: Sequence[str]) -> tuple[Callable[[list[str]], int], list[str]]:
    """Main function of a command, and its arguments."""
    if words[0] == "-m":
        name = words[1]
        module = import_module(f"{name}.__main__")
        return module.main, [*words[2:]]
    return import_module(f"agents.commands.{words[0].removesuffix('.py')}").main, [*words[1:]]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which the commands of the page were run, one after the other."""
    folder = tmp_path_factory.mktemp("own_robot")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setenv("SPACE_ENVS_ROBOTS", str(folder / "made"))
        patch.setattr(policy_times, "ROUNDS", 1)
        patch.setattr(videos, "WIDTH", 160)
        patch.setattr(videos, "HEIGHT", 120)
        write_files(PAGE, folder)
        for words in commands():
            main, given = program(words)
            more = next((more for start, more in SHORT.items() if " ".join(words).startswith(start)), [])
            assert main([*given, *more]) == 0, words
        yield folder


def test_the_panda_takes_ten_lines() -> None:
    text = dict(file_blocks(PAGE))["my_panda.toml"]
    assert len([line for line in text.splitlines() if line.strip()]) == 10


def test_both_robots_are_evaluated(ran: Path) -> None:
    for folder, file in (("panda", "my_panda"), ("servicer", "my_servicer")):
        robot = make_task(SINGLE_ARM, {"robot": str(ran / f"{file}.toml")}).robot
        records = read_records(ran / "results" / folder / "records.jsonl")
        assert {(record.robot, record.robot_digest) for record in records} == {(file, robot.digest[:12])}
        assert all(record.captured for record in records)
        assert "<canvas" in (ran / "results" / folder / "report.html").read_text(encoding="utf-8")


def test_what_commands_make_is_found_again(ran: Path) -> None:
    (folder,) = (ran / "made").iterdir()
    assert make_task(SINGLE_ARM, {"robot": str(ran / "my_servicer.toml")}).robot.digest.startswith(
        folder.name
    )
    made = {path.name for path in folder.iterdir()}
    assert {"my_servicer_check.html"} <= {path.name for path in ran.iterdir()} and len(made) > 2


def test_a_run_knows_its_robot(ran: Path, capsys: pytest.CaptureFixture[str]) -> None:
    evaluate = import_module("agents.commands.evaluate").main
    words = ["--robot", "my_panda.toml", "--policy", "runs/servicer", "--episodes", "2", "--output", "no"]
    assert evaluate(words) == 2
    assert "my_servicer" in capsys.readouterr().err
