"""`train.py`: runs from the command line, killed and resumed, and bad input refused in one line."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from offenders import assert_refused
from training_runs import QUICK, begin

from agents.commands.train import main
from agents.learning.runs.folder import RunFolder
from agents.learning.runs.settings import settle
from agents.policies.learned.trained import load_trained
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext

ROOT = Path(__file__).parents[1]
CLONING = ["--algo", "bc", "--num-envs", "16", "--episode-steps", "20", "--hidden", "16", "16"]


def test_a_killed_run_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "run"
    command = [sys.executable, str(ROOT / "train.py"), *QUICK]
    options = ["--init", "none", "--num-envs", "8", "--seed", "5", "--steps", "40960", "--output", str(path)]
    process = subprocess.Popen([*command, *options, "--env-kwargs", "horizon=50"], cwd=ROOT)
    try:
        deadline = time.monotonic() + 60
        while not (path / "checkpoint.npz").exists():
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    folder = RunFolder(path)
    killed, config = folder.checkpoint(), folder.config()
    assert killed is not None and folder.summary() is None
    steps = killed["steps"] + 1024
    assert main([*QUICK, "--resume", str(path), "--steps", str(steps)]) == 0
    ended, after, summary = folder.checkpoint(), folder.config(), folder.summary()
    assert ended is not None and summary is not None and ended["steps"] == summary["steps"] == steps
    assert ended["history"][: len(killed["history"])] == killed["history"]
    assert summary["validation"]["seconds"] <= 5.0
    assert ended["times"]["wall"] > killed["times"]["wall"]
    assert after["settings"] == config["settings"] and after["settings"]["seed"] == 5
    assert len(after["commands"]) == 2 and after["versions"] == config["versions"]
    now, before = after["hyperparameters"], config["hyperparameters"]
    assert {name for name, value in now.items() if value != before[name]} <= {"steps", "validation_interval"}


def test_a_run_takes_the_steps_that_it_announced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "run"
    assert main([*CLONING, *QUICK[:2], "--steps", "400", "--output", str(folder)]) == 0
    assert "640 steps, not 400: whole rounds of 320" in capsys.readouterr().out
    summary = RunFolder(folder).summary()
    assert summary is not None and summary["steps"] == 640
    # It is not overwritten.
    assert main([*CLONING, "--output", str(folder)]) == 2
    assert "--resume" in capsys.readouterr().err


def test_training_around_obstacles(tmp_path: Path) -> None:
    env_id = "SpaceCapture/SingleArmCluttered-v0"
    folder = tmp_path / "run"
    assert main([*CLONING, *QUICK, "--steps", "320", "--env", env_id, "--output", str(folder)]) == 0
    env = CaptureVectorEnv(env_id, 2)
    policy = load_trained(folder, PolicyContext.from_env(env))
    observation, _ = env.reset(seed=0)
    moved = observation.copy()
    moved[:, env.task.layout.slices["obstacle_position"]] += 0.1
    assert not np.array_equal(policy.predict(observation)[0], policy.predict(moved)[0])


def test_bad_input_is_one_line_and_nothing_is_begun(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    cases = [
        (["--algo", "pp"], "Did you mean 'ppo'"),
        (["--env", "SpaceCapture/SingleArm-v1"], "SingleArm-v0"),
        (["--difficulty", "meduim"], "medium"),
        (["--control-mode", "torque"], "joint_torque"),
        (["--control-mode", "joint_torque", "--expert", "gjm"], "the environment is in 'joint_torque'"),
        (["--expert", "gmj"], "gjm"),
        (["--algo", "sac", "--clip-range", "0.2"], "hyperparameter of sac 'clip_range'"),
        (["--algo", "bc", "--init", "none"], "--init is for reinforcement"),
        (["--init", "none", "--expert", "gjm"], "either"),
        (["--init", "nowhere"], "no policy file nowhere"),
        (["--steps", "0"], "steps must be"),
        (["--steps", "many"], "steps must be a whole number, got 'many'"),
        (["--minutes", "nan"], "minutes must be"),
        (["--num-envs", "-1"], "num_envs must be"),
        (["--seed", "-1"], "seed must lie"),
        (["--device", "abacus"], "abacus"),
        (["--device", "meta"], "meta"),
        (["--num-envs", str(10**9)], "num_envs must be at least 1 and at most 65,536"),
        (["--steps", str(10**30)], "steps must be at least 1 and at most"),
        (["--seed", str(10**30)], "seed must lie"),
        (["--env-kwargs", "horizn=3"], "Did you mean 'horizon'"),
        (["--config", "nowhere.toml"], "nowhere.toml cannot be read"),
        (["--validation-episodes", "0"], "validation-episodes"),
        (["--resume", "nowhere"], "there is no run's folder 'nowhere'."),
        (["--resume", "."], ". holds no run: there is no config.json"),
        (["--resume", "nowhere", "--algo", "ppo", "--gamma", "1"], "omit --algo, --gamma"),
    ]
    assert_refused(main, cases, capsys)
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_not_there_is_answered_with_the_nearest_that_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin(tmp_path / "ppo-easy", "ppo")
    (tmp_path / "ppo-eass").mkdir()  # nearer, and no run
    assert main(["--resume", str(tmp_path / "ppo-esy")]) == 2
    error = capsys.readouterr().err
    assert error.endswith(
        f"there is no run's folder '{tmp_path}/ppo-esy'. Did you mean '{tmp_path}/ppo-easy'?\n"
    )


def test_steps_are_whole_rounds_and_the_user_is_told() -> None:
    for algorithm, steps, taken, whole in (
        ("bc", 8_000, 15_360, 15_360),
        ("bc", 20_000, 30_720, 15_360),
        ("bc", 15_360, 15_360, 15_360),
        ("ppo", 10_000, 16_384, 8_192),
        ("sac", 1_001, 1_008, 16),
    ):
        _, parameters, messages = settle({"algo": algorithm, "steps": steps})
        assert parameters.steps == taken and parameters.round == whole
        assert (messages == ()) if taken == steps else f"{taken:,} steps, not {steps:,}" in messages[0]


def test_bad_syntax_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, status in ((["--stepz", "3"], 2), (["--help"], 0)):
        with pytest.raises(SystemExit) as exit_:
            main(arguments)
        assert exit_.value.code == status
    captured = capsys.readouterr()
    assert "--resume RUN" in captured.out and "did you mean --steps?" in captured.err
