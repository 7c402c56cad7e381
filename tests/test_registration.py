"""Registration: one call for everybody's tasks, names of ids with their module, and what is refused."""

import pickle
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from package_of_the_docs import forget, installed

import space_envs
from agents.commands.evaluate import main
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.errors import ConfigurationError, UnknownIdError, UnknownKeywordError
from space_envs.evaluation.records.storage import read_records
from space_envs.registration import ENTRIES, find, make_task, unregister
from space_envs.tasks.single_arm import SingleArmTask

OWN = "my_capture:MyCapture/Sprint-v0"


@dataclass(frozen=True)
class BriefTask(SingleArmTask):
    """A short one."""

    horizon: int = 5


@pytest.fixture
def brief() -> Iterator[str]:
    """An id that this module registers."""
    space_envs.register("Tests/Brief-v0", BriefTask, position_tolerance=0.02, c=2.0)
    yield "Tests/Brief-v0"
    unregister("Tests/Brief-v0")


@pytest.fixture(scope="module", autouse=True)
def package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with installed(tmp_path_factory.mktemp("site")):
        yield


def test_a_registered_task_is_an_environment_with_its_defaults(brief: str) -> None:
    env = gym.make(brief)
    task = env.unwrapped.task  # type: ignore[attr-defined]
    assert (task.horizon, task.c, task.envelope.position, task.envelope.hold) == (5, 2.0, 0.02, 1.0)
    assert make_task(brief, {"c": 1.0}).c == 1.0
    assert (find(brief).summary, find(brief).name) == ("A short one", f"{__name__}:{brief}")
    space_envs.register(
        brief, BriefTask, position_tolerance=0.02, c=2.0
    )  # again, as a module that is reloaded


@pytest.mark.parametrize(
    ("id", "task", "defaults", "message"),
    [
        ("Brief-v0", BriefTask, {}, "has the form 'Namespace/Name-v0', got 'Brief-v0'"),
        ("Tests/Brief", BriefTask, {}, "has the form"),
        ("a:Tests/Brief-v0", BriefTask, {}, "has the form"),
        (3, BriefTask, {}, "has the form 'Namespace/Name-v0', got 3"),
        ("Tests/New-v0", dict, {}, "subclass of space_envs.tasks.base.CaptureTask .*got <class 'dict'>"),
        ("Tests/New-v0", BriefTask(), {}, "subclass of .*got BriefTask"),
        ("Tests/New-v0", BriefTask, {"horizn": 3}, "'horizn'.*Did you mean 'horizon'"),
        ("Tests/New-v0", BriefTask, {"horizon": 0}, "horizon must be a positive integer.*got 0"),
        (
            "SpaceCapture/SingleArm-v0",
            BriefTask,
            {},
            "registered already, by space_envs for .*:SingleArmTask",
        ),
        ("Tests/Brief-v0", BriefTask, {"c": 3.0}, "registered already, by test_registration"),
    ],
)
def test_what_cannot_be_registered(id: Any, task: Any, defaults: dict, message: str, brief: str) -> None:
    known = dict(ENTRIES)
    with pytest.raises(ConfigurationError, match=message):
        space_envs.register(id, task, **defaults)
    assert known == ENTRIES


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("no colon", "must be a class or 'module:Class', got 'no colon'"),
        ("no_such_module:Task", "'no_such_module:Task' of Tests/Late-v0 cannot be imported: No module named"),
        (f"{__name__}:BriefTsk", "Did you mean 'BriefTask'"),
        ("builtins:dict", "must be a subclass"),
    ],
)
def test_a_task_that_is_named_is_looked_at_when_it_is_needed(source: str, message: str) -> None:
    space_envs.register("Tests/Late-v0", source)
    try:
        with pytest.raises(ConfigurationError, match=message):
            make_task("Tests/Late-v0", {})
    finally:
        unregister("Tests/Late-v0")


def test_names_that_nobody_registers() -> None:
    with pytest.raises(UnknownIdError, match="Did you mean 'SpaceCapture/SingleArm-v0'.*named as module:id"):
        find("SpaceCapture/SingleArms-v0")
    with pytest.raises(
        UnknownIdError, match="'no_such_module' of .* cannot be imported: ModuleNotFoundError"
    ):
        find("no_such_module:Tests/Brief-v0")
    with pytest.raises(UnknownIdError, match="unknown environment id 'MyCapture/Sprnt-v0'.*Did you mean"):
        find("my_capture:MyCapture/Sprnt-v0")
    with pytest.raises(UnknownKeywordError, match="horizn"):
        make_task("SpaceCapture/SingleArm-v0", {"horizn": 1})


def test_ids_of_another_package_by_gymnasiums_names() -> None:
    forget()
    single = gym.make(OWN)
    assert single.spec is not None and single.spec.id == "MyCapture/Sprint-v0"
    assert (
        isinstance(single.unwrapped, CaptureEnv) and single.unwrapped.vector.env_id == "MyCapture/Sprint-v0"
    )
    forget()
    vector = gym.make_vec(OWN, num_envs=2)
    first, _ = vector.reset(seed=3)
    np.testing.assert_array_equal(first[0], single.reset(seed=3)[0])
    forget()
    again = CaptureVectorEnv(OWN, 2)
    np.testing.assert_array_equal(again.reset(seed=3)[0], first)


def test_copies_of_an_environment_find_their_task_in_another_process() -> None:
    """As an AsyncVectorEnv, whose processes are started afresh, or a spec that was written down needs it."""
    env = gym.make(OWN)
    assert env.spec is not None
    text = env.spec.to_json()
    code = (
        "import sys, pickle, gymnasium as gym\n"
        "from gymnasium.envs.registration import EnvSpec\n"
        "data = sys.stdin.buffer.read()\n"
        "text, copy = pickle.loads(data)\n"
        "assert gym.make(EnvSpec.from_json(text)).unwrapped.task.horizon == 100\n"
        "assert pickle.loads(copy).task.horizon == 100\n"
    )
    given = pickle.dumps((text, pickle.dumps(env.unwrapped)))
    done = subprocess.run([sys.executable, "-c", code], input=given, capture_output=True)
    assert done.returncode == 0, done.stderr.decode()


@pytest.mark.usefixtures("brief_reports")
def test_a_task_that_no_table_of_ours_knows_is_evaluated(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its own difficulty and splits, no camera; policies that plan nothing and that do."""
    words = ["--env", "bare_task:Tests/Bare-v0", "--episodes", "2", "--jobs", "1"]
    words += ["--output", str(tmp_path / "out")]
    try:
        assert main([*words, "--policy", "hold", "random", "gjm", "minimum_jerk", "--videos"]) == 0
        records = read_records(tmp_path / "out" / "records.jsonl")
        assert {(r.env_id, r.difficulty, r.outcome) for r in records} == {
            ("Tests/Bare-v0", "near", "timeout")
        }
        assert all(record.timing["action_ms"] is not None for record in records)
        video = ["--policy", "gjm", "--episode", "0", "--video", str(tmp_path / "a.gif")]
        assert main(["replay", words[-1], "--env", words[1], *video]) == 0
        for option, what, valid in (("--difficulty", "hard", "near"), ("--split", "ood", "train', 'test")):
            assert main([*words, "--policy", "hold", option, what]) == 2
            message = f"unknown {option[2:]} {what!r}; valid are '{valid}'"
            assert message in capsys.readouterr().err
    finally:
        forget("bare_task")
