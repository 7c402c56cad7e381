"""Several runs of one command: the same bytes as single ones, failures contained, resumed, refused."""

import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from offenders import assert_refused
from package_of_the_docs import installed
from training_runs import ENV_ID, QUICK, defaults

from agents.commands.train import main
from agents.learning.runs.folder import RunFolder
from agents.learning.runs.settings import Settings, settle
from agents.learning.sweeps.plan import SweepPlan, make_runs, read_plan
from agents.learning.training import learn
from agents.policies.learned.policy_file import load_policy_file
from space_envs.errors import ConfigurationError
from space_envs.system.command_line import parse_seeds

# A bc run of two rounds, in about a second.
CLONING = """
[fixed]
algo = "bc"
expert = "{expert}"
num_envs = 8
episode_steps = 20
steps = 320
validation_interval = 160
hidden = [16, 16]
batch_size = 64
epochs = 1
last_epochs = 1
"""
BROKEN: dict[str, bool] = {}  # what is broken in this process


class Drifts:
    """An expert that always does the same; those below get a seed that they do not bear."""

    def __init__(self, context: Any, seed: int = 0) -> None:
        self.size, self.seed, self.calls = len(context.action_scale), seed, 0

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Any, Any]:
        self.calls += 1
        return np.full((len(observation), self.size), 0.1 + 0.01 * self.seed), None


class Fails(Drifts):
    """Raises with seed 1."""

    def predict(self, *arguments: Any, **keywords: Any) -> tuple[Any, Any]:
        if self.seed == 1:
            raise RuntimeError("out of ideas\nsecond line")
        return super().predict(*arguments, **keywords)


class Dies(Drifts):
    """Takes its process along with seed 1."""

    def predict(self, *arguments: Any, **keywords: Any) -> tuple[Any, Any]:
        if self.seed == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().predict(*arguments, **keywords)


class Interrupted(Drifts):
    """Ctrl-C in the second round of seed 1."""

    def predict(self, *arguments: Any, **keywords: Any) -> tuple[Any, Any]:
        if BROKEN and self.seed == 1 and self.calls >= 30:
            raise KeyboardInterrupt
        return super().predict(*arguments, **keywords)


@pytest.fixture
def broken() -> Iterator[None]:
    BROKEN["yes"] = True
    yield
    BROKEN.clear()


def cloning(path: Path, expert: type) -> list[str]:
    """Arguments of a sweep with an expert of this module."""
    file = path / f"{expert.__name__}.toml"
    file.write_text(CLONING.format(expert=f"{__name__}:{expert.__name__}"))
    return ["--sweep", str(file), "--output", str(path / "out"), *QUICK]


def rows(path: Path) -> dict[str, dict[str, Any]]:
    content = json.loads((path / "out" / "sweep.json").read_text())
    assert content["format"] == 1
    return {row["run"]: row for row in content["runs"]}


def test_runs_are_the_same_singly_and_together(tmp_path: Path) -> None:
    """One after the other, in two processes, and without a sweep; the task is one of another package."""
    common = {"env": "my_capture:MyCapture/Sprint-v0", "init": "none", "num_envs": 8, "n_steps": 16}
    common |= {"batch_size": 64, "steps": 256, "hidden": [16, 16], "minutes": "none"}
    file = tmp_path / "rates.toml"
    fixed = "".join(f"{name} = {json.dumps(value)}\n" for name, value in common.items())
    file.write_text(f"seeds = [3, 4]\n[fixed]\n{fixed}[values]\nenv_kwargs = [{{reward = 'sparse'}}]\n")
    with installed(tmp_path / "site"):
        for jobs in ("1", "2"):
            arguments = ["--sweep", str(file), "--jobs", jobs, "--output", str(tmp_path / jobs), *QUICK]
            assert main(arguments) == 0
        policies = []
        for seed in (3, 4):
            settings, parameters, _ = settle(common | {"seed": seed, "env_kwargs": {"reward": "sparse"}})
            folder = RunFolder(tmp_path / f"single-{seed}")
            folder.create(settings, parameters)
            assert learn(folder, episodes=2, quiet=True)["validation"]["seconds"] <= 10.0
            policies.append(folder.policy.read_bytes())
            for jobs in ("1", "2"):
                together = RunFolder(tmp_path / jobs / f"env_kwargs-reward-sparse_seed-{seed}")
                assert together.policy.read_bytes() == policies[-1]
                assert together.restore() == folder.restore() == (settings, parameters)
        assert policies[0] != policies[1]
        assert settings.task().reward == "sparse" and settings.env_id == common["env"]
        assert load_policy_file(folder.policy).env_id == "MyCapture/Sprint-v0"


def test_seeds_of_the_command_line_are_single_runs(tmp_path: Path) -> None:
    common = ["--init", "none", "--num-envs", "4", "--steps", "256", "--minutes", "inf", *QUICK]
    assert main([*common, "--seeds", "0,2", "--output", str(tmp_path / "many")]) == 0
    assert main([*common, "--seed", "2", "--output", str(tmp_path / "one")]) == 0
    many, one = RunFolder(tmp_path / "many" / "seed-2"), RunFolder(tmp_path / "one")
    assert many.policy.read_bytes() == one.policy.read_bytes()
    assert many.restore() == one.restore()
    assert sorted(path.name for path in (tmp_path / "many").iterdir()) == ["seed-0", "seed-2", "sweep.json"]


def test_a_failing_run_leaves_the_others_alone_and_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*cloning(tmp_path, Fails), "--seeds", "0-2"]
    arguments.remove("--quiet")
    assert main([*arguments, "--jobs", "2"]) == 1
    said = capsys.readouterr()
    found = rows(tmp_path)
    assert {name: row["status"] for name, row in found.items()} == {
        "seed-0": "finished",
        "seed-1": "failed",
        "seed-2": "finished",
    }
    assert (
        found["seed-1"]["error"] == "PolicyError: it raised RuntimeError: out of ideas second line (step 0)"
    )
    assert found["seed-2"]["summary"]["steps"] == 320
    assert (
        f"{tmp_path / 'out' / 'seed-1'} failed: PolicyError: it raised RuntimeError: out of ideas" in said.err
    )
    assert "over 2 seeds" in said.out
    trace = (tmp_path / "out" / "seed-1" / "error.txt").read_text()
    assert "in predict" in trace and "second line" in trace
    assert not (tmp_path / "out" / "seed-0" / "error.txt").exists()
    # Again: the failed one alone is tried.
    before = (tmp_path / "out" / "seed-0" / "summary.json").stat().st_mtime_ns
    commands = [len(RunFolder(tmp_path / "out" / name).config()["commands"]) for name in found]
    assert main(arguments) == 1
    assert (tmp_path / "out" / "seed-0" / "summary.json").stat().st_mtime_ns == before
    after = [len(RunFolder(tmp_path / "out" / name).config()["commands"]) for name in found]
    assert np.subtract(after, commands).tolist() == [0, 1, 0]


@pytest.mark.slow
def test_a_process_that_dies_is_one_lost_run(tmp_path: Path) -> None:
    assert main([*cloning(tmp_path, Dies), "--seeds", "0-3", "--jobs", "2"]) == 1
    found = rows(tmp_path)
    assert [row["status"] for row in found.values()] == ["finished", "failed", "finished", "finished"]
    assert "its process died" in found["seed-1"]["error"]
    assert not list((tmp_path / "out").glob("*/.running"))


def test_interrupted_and_gone_on_with(
    tmp_path: Path, broken: None, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*cloning(tmp_path, Interrupted), "--seeds", "0-1"]
    assert main(arguments) == 130
    assert "stopped with 1 of 2 runs finished; the same command continues" in capsys.readouterr().err
    assert [row["status"] for row in rows(tmp_path).values()] == ["finished", "unfinished"]
    halfway = RunFolder(tmp_path / "out" / "seed-1")
    checkpoint = halfway.checkpoint()
    assert checkpoint is not None and checkpoint["steps"] == 160
    before = (tmp_path / "out" / "seed-0" / "policy.npz").stat().st_mtime_ns
    BROKEN.clear()
    assert main(arguments) == 0
    assert (tmp_path / "out" / "seed-0" / "policy.npz").stat().st_mtime_ns == before
    assert [row["status"] for row in rows(tmp_path).values()] == ["finished", "finished"]
    undisturbed = tmp_path / "undisturbed"
    undisturbed.mkdir()
    assert main([*cloning(undisturbed, Interrupted), "--seeds", "1"]) == 0
    assert (undisturbed / "out" / "seed-1" / "policy.npz").read_bytes() == halfway.policy.read_bytes()
    # A sweep of other settings does not go on with these runs.
    assert main([*arguments, "--difficulty", "easy"]) == 2
    assert "with difficulty 'medium', not 'easy'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["ray", "dask"])
def test_clusters_give_the_same_runs(backend: str, tmp_path: Path) -> None:
    # Not an expert of this module, which a cluster's workers could not import.
    file = tmp_path / "gjm.toml"
    file.write_text(CLONING.format(expert="gjm"))
    arguments = ["--sweep", str(file), "--output", str(tmp_path / "out"), *QUICK]
    assert main([*arguments, "--seeds", "0-1"]) == 0
    spread = ["--jobs", "2", "--backend", backend, "--output", str(tmp_path / backend)]
    assert main([*arguments, "--seeds", "0-1", *spread]) == 0
    for name in ("seed-0", "seed-1"):
        policies = [(tmp_path / folder / name / "policy.npz").read_bytes() for folder in ("out", backend)]
        assert policies[0] == policies[1]


# What is trained --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "seeds"),
    [("0-9", tuple(range(10))), ("0,3,5-7", (0, 3, 5, 6, 7)), (" 4 , 2-2", (4, 2)), ("12", (12,))],
)
def test_seeds(text: str, seeds: tuple[int, ...]) -> None:
    assert parse_seeds(text) == seeds


@pytest.mark.parametrize("text", ["", "a", "3-1", "-1", "1,,2", "1-", "0-3,2", "0-99999", "1.5", "1" * 11])
def test_bad_seeds(text: str) -> None:
    with pytest.raises(ConfigurationError, match="seeds"):
        parse_seeds(text)


def test_the_product_is_trained_with_every_seed(tmp_path: Path) -> None:
    file = tmp_path / "plan.toml"
    file.write_text(
        'seeds = "1-2"\n[fixed]\ninit = "none"\n[values]\nhidden = [[64, 64], [32]]\ngamma = [0.9, 1]\n'
    )
    runs = make_runs(read_plan(file), {"steps": 50})
    assert [run.name for run in runs] == [
        f"hidden-{hidden}_gamma-{gamma}_seed-{seed}"
        for hidden in ("64x64", "32")
        for gamma in ("0.9", "1")
        for seed in (1, 2)
    ]
    last = runs[-1]
    assert last.values == {"hidden": [32], "gamma": 1, "seed": 2}
    assert last.settings == Settings("ppo", ENV_ID, seed=2)
    assert last.parameters == defaults(
        "ppo", hidden=(32,), gamma=1, expert=None, steps=8192, validation_interval=819
    )
    tasks = make_runs(SweepPlan((0,), {"algo": "bc"}, {"env": [ENV_ID], "expert": ["gjm", "mpc"]}), {})
    assert [run.name for run in tasks] == [
        f"env-SingleArm-v0_expert-{name}_seed-0" for name in ("gjm", "mpc")
    ]


def test_the_documented_sweep_file_is_one(tmp_path: Path) -> None:
    page = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
    match = re.search(r"<!-- file: rates.toml -->\n```toml\n(.*?)```", page, re.S)
    assert match
    file = tmp_path / "rates.toml"
    file.write_text(match[1])
    runs = make_runs(read_plan(file), {})
    assert len(runs) == 20 and runs[3].name == "learning_rate-0.0001_hidden-64x64_seed-3"
    assert all(run.parameters.minutes == float("inf") for run in runs)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[fixed]\nlerning_rate = 1.0", "hyperparameter of ppo 'lerning_rate'.*mean 'learning_rate'"),
        ('[fixed]\nalgo = "bc"\nn_steps = 4', "hyperparameter of bc 'n_steps'"),
        ("[fixed]\nfeatures = []", "features must not be empty"),
        ('[fixed]\nfeatures = [["joint_position", "plane", 1.0]]', "mean 'plain'"),
        ("[fixed]\nenv_kwargs = 3", "env_kwargs must be a table"),
        ("[values]\nenv_kwargs = [{horizon = 10}, {horizn = 10}]", "mean 'horizon'"),
        ("[fixed]\noutput = 'x'", "'output'"),
        ("[fixd]\n", "table 'fixd'.*mean 'fixed'"),
        ("fixed = 3", "must be a table"),
        ("[values]\ngamma = 0.9", "must be a list"),
        ("[values]\ngamma = []", "must be a list"),
        ("[values]\ngamma = [0.9, 0.8, 0.9]", "0.9 is there twice"),
        ("[fixed]\ngamma = 0.9\n[values]\ngamma = [0.8]", "gamma is fixed and has values"),
        ("[values]\ngamma = [0.9, 1.5]", "gamma must be above 0 and at most 1"),
        ('[values]\nlearning_rate = [1e-3, "fast"]', "learning_rate must be a number, got 'fast'"),
        ("[fixed]\nsteps = 1.5", "steps must be a whole number"),
        ("[fixed]\nhidden = 64", "hidden must be a list of whole numbers"),
        ('[fixed]\nhidden = [64, "a"]', "hidden must be a list of whole numbers"),
        ("[fixed]\nnum_envs = true", "num_envs must be a whole number"),
        ("[fixed]\nenv = [1]", "env must be text"),
        ('[values]\nalgo = ["ppo", "pqo"]', "Did you mean 'ppo'"),
        ('[values]\ndifficulty = ["easy", "hard", "meduim"]', "medium"),
        ('[values]\nactivation = ["tanh", "tan"]', "tanh"),
        ('[fixed]\nalgo = "bc"\n[values]\nexpert = ["gjm", "gmj"]', "gjm"),
        ('[values]\ninit = ["none", "nowhere"]', "nowhere"),
        ("[fixed]\nseed = 3", "seeds stand above"),
        ("seeds = [0, -1]", "seed must lie"),
        ("seeds = 0.5", "seeds must be"),
        ('seeds = "5-1"', "ranges like"),
        ("seeds = []", "seeds must be"),
        ('[values]\ninit = ["a/b", "a-b"]', "a/b"),
        ("gamma = [0.9", "not TOML"),
        (f"seeds = '0-99'\n[values]\ngamma = {[1 - i / 1000 for i in range(200)]}", "20,000 runs"),
    ],
)
def test_bad_files_are_refused_before_anything_begins(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "bad.toml"
    file.write_text(text)
    assert main(["--sweep", str(file), "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert re.search(message, error) and error.startswith("train.py: ") and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_bad_arguments(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fixed.toml").write_text('[fixed]\ndifficulty = "hard"\n')
    cases = [
        (["--seeds", "0-1", "--seed", "3"], "either --seed or"),
        (["--seeds", "x"], "ranges like"),
        (["--jobs", "2"], "--jobs is for several runs"),
        (["--backend", "ray"], "--backend is for several runs"),
        (["--seeds", "0-1", "--jobs", "0"], "jobs must be at least 1"),
        (["--seeds", "0-1", "--backend", "rya"], "Did you mean 'ray'"),
        (["--seeds", "0-1", "--address", "here:1"], "takes no address"),
        (["--seeds", "0-1", "--expert", "gmj"], "gjm"),
        (["--seeds", "0-1", "--validation-episodes", "0"], "validation-episodes"),
        (["--sweep", "nowhere.toml"], "nowhere.toml cannot be read"),
        (
            ["--sweep", "fixed.toml", "--difficulty", "easy"],
            "difficulty is given in the sweep file and as --",
        ),
        (["--resume", "nowhere", "--seeds", "0-1"], "omit --seeds"),
        (["--resume", "nowhere", "--jobs", "2"], "omit --jobs"),
    ]
    assert_refused(main, cases, capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["fixed.toml"]


def test_a_folder_of_one_run_is_not_one_of_several(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    RunFolder(tmp_path / "run").create(Settings("bc", ENV_ID), defaults("bc", expert="gjm"))
    assert main(["--algo", "bc", "--seeds", "0-1", "--output", str(tmp_path / "run")]) == 2
    assert "holds a single run" in capsys.readouterr().err
