"""The path of docs/first_policy.md, as a new user walks it: every command and the file, with fewer steps."""

import re
import shlex
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from files_of_the_docs import write_files

from space_envs.evaluation.harness import policy_times
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.replay import videos

PAGE = Path(__file__).resolve().parent.parent / "docs" / "first_policy.md"
EPISODES = ["--jobs", "1", "--no-pictures"]
# What makes each command of the page short, by its first words.
SHORT = {
    "train.py --algo planner": ["--steps", "2048", "--goals", "512", "--validation-episodes", "8"],
    "train.py --algo ppo": [
        "--init",
        "none",
        "--steps",
        "512",
        "--num-envs",
        "4",
        "--validation-episodes",
        "4",
    ],
    "evaluate.py --policy": EPISODES,
    "evaluate.py replay": [],
    "my_ppo.py": [],
}


def commands() -> list[list[str]]:
    """Words of every Python command in the page's shell blocks, without `python`."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith("python ")]


def shortened(words: list[str]) -> list[str]:
    """A command of the page with fewer steps or episodes."""
    key = next(key for key in SHORT if " ".join(words).startswith(key))
    fewer = {"50": "2", "100": "2"}  # episodes, updates
    return [*(fewer.get(word, word) for word in words[1:]), *SHORT[key]]


def run(words: list[str]) -> None:
    """Run a command of the page."""
    if words[0] == "my_ppo.py":
        import_module("my_ppo").train(int(shortened(words)[0]))
    else:
        program = import_module(f"agents.commands.{words[0].removesuffix('.py')}")
        assert program.main(shortened(words)) == 0, words


def test_the_commands_of_the_page_run_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_files(PAGE, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    for name, value in (("WIDTH", 160), ("HEIGHT", 120)):
        monkeypatch.setattr(videos, name, value)
    monkeypatch.setattr(policy_times, "ROUNDS", 1)
    try:
        for words in commands():
            run(words)
    finally:
        sys.modules.pop("my_ppo", None)
    assert (tmp_path / "planned.mp4").stat().st_size > 0
    assert "update 2: reward" in capsys.readouterr().out
    learned = np.load(tmp_path / "my_ppo.npz")
    assert all(np.isfinite(value).all() for value in learned.values())
    for result, policies in (("planner", 2), ("ppo", 2), ("my_ppo", 2)):
        records = read_records(tmp_path / "results" / result / "records.jsonl")
        assert len({record.policy for record in records}) == policies and len(records) == 2 * policies
        assert not any(record.outcome == "policy_error" for record in records)
