"""What a user's editor and type checker see of the packages."""

import inspect
import json
import subprocess
import sys
from dataclasses import fields
from importlib.resources import files
from pathlib import Path

import space_envs
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.envs.keywords import EnvKeywords
from space_envs.registration import ENTRIES, ENVELOPE_KEYWORDS

USER = """
import numpy as np

from promp import ProMP
from space_envs import __version__
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.tasks.rewards import RewardTerm, StepQuantities


def speed(step: StepQuantities) -> Array:
    return np.square(step.read("joint_velocity")).sum(axis=1)


RewardTerm("speed", speed, -0.1)
envs = CaptureVectorEnv("SpaceCapture/SingleArm-v0", 4, difficulty="hard", horizon=50, hold_time=0.5)
observation, info = envs.reset(seed=0)
print(envs.task.errors(observation).position.max(), __version__, ProMP)
CaptureEnv(horizon="long")  # wrong
CaptureEnv(difficult="hard")  # wrong
RewardTerm("speed", 3.0, -0.1)  # wrong
"""


def test_a_type_checker_sees_the_types_from_a_users_file(tmp_path: Path) -> None:
    (tmp_path / "user.py").write_text(USER)
    command = [sys.executable, "-m", "pyright", "--pythonpath", sys.executable, "--outputjson", "user.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    found = json.loads(done.stdout)["generalDiagnostics"]
    hooked = [each["message"] for each in found if each.get("rule") == "reportMissingImports"]
    assert not hooked, "install as the Makefile does: --config-settings editable_mode=compat"
    lines = USER.splitlines()
    assert [lines[each["range"]["start"]["line"]].partition("  # ")[2] for each in found] == ["wrong"] * 3
    for package in ("space_envs", "agents", "promp"):
        assert (files(package) / "py.typed").is_file()


def test_keywords_stand_in_the_signatures() -> None:
    keywords = {*ENVELOPE_KEYWORDS, *EnvKeywords.__annotations__}
    for entry in ENTRIES.values():
        names = {field.name for field in fields(entry.task) if field.name != "envelope"}
        for kind in (CaptureEnv, CaptureVectorEnv):
            assert keywords | names <= inspect.signature(kind).parameters.keys()
    assert inspect.signature(CaptureEnv).parameters["width"].default == 480
    assert space_envs.__version__.count(".") == 2
