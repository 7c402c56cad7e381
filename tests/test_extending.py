"""The package of docs/extending.md is somebody else's: its task and policy work wherever ours do."""

import json
import os
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import pytest
from package_of_the_docs import commands, forget, installed
from synthetic_results import untimed

from agents.commands.evaluate import main as evaluate
from space_envs.evaluation.harness import policy_times
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.replay import videos

ENV_ID = "MyCapture/Sprint-v0"
POLICY = "my_capture.policies:Straight"
# What makes each command of the page short, by its first words.
SHORT = {
    "evaluate.py --env": ["--episodes", "2", "--jobs", "2", "--no-pictures"],
    "evaluate.py dataset": ["--episodes", "2", "--jobs", "1"],
    "train.py --env": ["--steps", "512", "--num-envs", "4", "--validation-episodes", "4"],
    "train.py --resume": ["--steps", "1024", "--validation-episodes", "4"],
}


def run(words: list[str], *more: str) -> int:
    """Exit status of a command, in a process that does not know the package before."""
    forget()
    key = next((key for key in SHORT if " ".join(words).startswith(key)), "")
    program = import_module(f"agents.commands.{words[0].removesuffix('.py')}")
    return program.main([*words[1:], *SHORT.get(key, []), *more])


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which the commands of the page were run, one after the other."""
    folder = tmp_path_factory.mktemp("extending")
    with installed(folder), pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(policy_times, "ROUNDS", 1)
        patch.setattr(videos, "WIDTH", 160)
        patch.setattr(videos, "HEIGHT", 120)
        for words in commands():
            assert run(words) == 0, words
        yield folder


def test_every_command_of_the_suite_is_on_the_page() -> None:
    first = [" ".join(words[:2]) for words in commands()]
    assert {"evaluate.py compare", "evaluate.py replay", "evaluate.py dataset"} <= set(first)
    assert {"evaluate.py --env", "train.py --env", "train.py --resume"} <= set(first)


def test_records_have_the_plain_id(ran: Path) -> None:
    records = read_records(ran / "results/sprint/records.jsonl")
    assert {record.env_id for record in records} == {ENV_ID}
    captured = {name: [r.captured for r in records if r.policy == name] for name in ("gjm", POLICY)}
    assert captured[POLICY] == [True] * 2 and len(captured["gjm"]) == 2
    for record in records:
        steps, closest, last = (record.metrics[name] for name in ("steps", "closest", "position_error"))
        assert steps is not None and steps <= 100  # its horizon
        assert closest is not None and last is not None and 0.0 < closest <= last


def test_the_reward_has_the_term_and_the_tables_the_metric(ran: Path) -> None:
    env = gym.make("my_capture:MyCapture/Sprint-v0")
    env.reset(seed=0)
    _, reward, _, _, info = env.step(env.action_space.sample())
    terms = info["reward_terms"]
    assert terms["rate_change"] < 0.0 and reward == pytest.approx(sum(terms.values()))
    assert "closest" in (ran / "results/sprint/leaderboard.csv").read_text().splitlines()[0]
    assert "closest" in (ran / "results/both/leaderboard.md").read_text()


def test_results_compare_and_replay(ran: Path) -> None:
    rows = json.loads((ran / "results/both/summary.json").read_text())["rows"]
    assert {row["policy"] for row in rows} == {"gjm", POLICY, "sprint"}
    assert ENV_ID in (ran / "results/both/report.html").read_text()
    assert (ran / "sprint.gif").stat().st_size > 0


def test_datasets_and_trained_runs(ran: Path) -> None:
    (card,) = ran.glob("results/datasets/space-capture/MyCapture-Sprint-v0/*/dataset.json")
    assert json.loads(card.read_text())["episodes"]["written"] == 2
    assert (ran / "runs/sprint/policy.npz").is_file()
    (trained,) = {record.policy for record in read_records(ran / "results/trained/records.jsonl")}
    assert trained == "sprint"


@pytest.mark.usefixtures("brief_reports")
def test_a_ray_cluster_imports_the_package_too(ran: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ray")
    monkeypatch.chdir(ran)
    words = next(words for words in commands() if words[0] == "evaluate.py" and "results/sprint" in words)
    assert run(words, "--backend", "ray", "--output", "results/ray") == 0
    usual, on_ray = (read_records(ran / f"results/{name}/records.jsonl") for name in ("sprint", "ray"))
    assert untimed(on_ray) == untimed(usual)


def test_tables_of_results_need_no_package(ran: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sprint, merged = str(ran / "results/sprint"), ran / "results/merged"
    for command in (["show", sprint, "--sort", "closest"], ["compare", sprint, "--output", str(merged)]):
        forget()
        assert evaluate(command) == 0
        printed = capsys.readouterr()
        assert re.search(r"closest.*\n.*\bmm\b", printed.out)
    assert "my_capture" not in sys.modules and "no replays of MyCapture/Sprint-v0" in printed.err
    assert evaluate(["show", str(merged)]) == 0 and " mm " in capsys.readouterr().out
    first, again = ((ran / "results" / name / "leaderboard.tex").read_text() for name in ("sprint", "merged"))
    assert first == again
    page = (merged / "report.html").read_text()
    assert "smallest distance of the end-effector from the grapple; lower is better" in page


def test_what_is_not_known_says_how_to_name_it(ran: Path, capsys: pytest.CaptureFixture[str]) -> None:
    forget()
    sprint = str(ran / "results/sprint")
    assert (
        evaluate(["replay", sprint, "--policy", "gjm", "--episode", "0", "--video", str(ran / "a.gif")]) == 2
    )
    assert "named as module:id" in capsys.readouterr().err
    assert evaluate(["--env", f"my_captur:{ENV_ID}", "--output", str(ran / "no")]) == 2
    assert "module 'my_captur' of environment id" in capsys.readouterr().err
    assert not os.path.exists(ran / "no")
