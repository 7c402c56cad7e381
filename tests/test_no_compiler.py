"""Machines without a C compiler: every planner plans, with the numbers that compiled code gives."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from first_plans import first_actions

from agents.commands.choice import experts_for
from space_envs.registration import ENTRIES

TESTS = Path(__file__).parent
PLANNERS = [(env_id, name) for env_id in ENTRIES for name in experts_for(env_id)]
# Every planner of the single arm once.
ONCE = list({name: (env_id, name) for env_id, name in reversed(PLANNERS) if "SingleArm" in env_id}.values())


def without_compiler(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """A program that finds no compiler and no compiled code."""
    variables = {name: value for name, value in os.environ.items() if name != "CC"}
    (folder / "bin").mkdir()
    variables |= {"PATH": str(folder / "bin"), "SPACE_ENVS_CACHE": str(folder / "cache")}
    variables |= {"PYTHONPATH": str(TESTS.parent)}
    command = [sys.executable, *arguments]
    done = subprocess.run(command, env=variables, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    return done


def check(planners: list[tuple[str, str]], folder: Path) -> None:
    """Nearly equal actions with and without a compiler, and a warning that says which way it is."""
    done = without_compiler([str(TESTS / "first_plans.py"), json.dumps(planners)], folder)
    found = json.loads(done.stdout)
    assert not (folder / "cache").exists()
    assert len(found["warnings"]) == 1 and "no C compiler was found" in found["warnings"][0]
    compiled = first_actions(planners)
    for key, expected in compiled.items():
        assert found["plans"][key]["failure"] == expected["failure"]
        actions = found["plans"][key]["actions"], expected["actions"]
        np.testing.assert_allclose(*actions, atol=5e-3, err_msg=key)  # rounding decides where iterations end
    failed = [key for key, plan in compiled.items() if plan["failure"]]
    assert len(failed) <= len(planners) // 4, failed  # paths that are given may break a limit


def test_an_evaluation_warns_once_whatever_its_processes_do(tmp_path: Path) -> None:
    arguments = [str(TESTS.parent / "evaluate.py"), "--policy", "hold", "--split", "validation"]
    arguments += ["--episodes", "26", "--jobs", "2", "--no-pictures", "--output", str(tmp_path / "out")]
    assert without_compiler(arguments, tmp_path).stderr.count("no C compiler was found") == 1


def test_every_planner_plans_without_a_compiler(tmp_path: Path) -> None:
    check(ONCE, tmp_path)


@pytest.mark.slow
def test_planners_on_every_id_without_a_compiler(tmp_path: Path) -> None:
    check([planner for planner in PLANNERS if planner not in ONCE], tmp_path)
