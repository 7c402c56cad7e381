"""Share of a robot's validation goals that each built-in planner reaches, as evaluate.py measures it.

The planners stand above this package, so they are not imported: the command evaluates them in a process of
its own, as a user would, and the shares are read from the records that it leaves.
"""

import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from space_envs.errors import SpaceEnvsError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.results.folders import read_folder
from space_envs.robots.check.figures.goals import SPLIT

EVALUATE = ("-m", "agents.commands.evaluate")


@dataclass(frozen=True)
class PlannerFigures:
    """A planner on a robot.

    Attributes:
        policy: its name. control_mode: that it acts in. goals: of the validation split. captured: of them.
        score: kept-attitude score. peak_attitude, final_attitude: of the captures, interquartile means, deg;
            NaN where there are none. failure: the most frequent one, in words; empty where it captured all.
    """

    policy: str
    control_mode: str
    goals: int
    captured: int
    score: float
    peak_attitude: float
    final_attitude: float
    failure: str


def planner_figures(
    source: str, env_id: str, goals: int, policies: Sequence[str] = ("experts",), variant: str | None = None
) -> list[PlannerFigures]:
    """Figures of planners on the validation goals of a task, the best first; progress is on standard error.

    Args:
        source: name or file of the robot. policies: planners, or `experts` for all of them that fit.
        variant: of the robot; None is the first.

    Raises:
        SpaceEnvsError: if the evaluation fails; the message is in its own words.
    """
    with TemporaryDirectory() as folder:
        output = Path(folder) / "evaluation"
        command = [
            *(sys.executable, *EVALUATE, "--env", env_id, "--robot", source, "--policy", *policies),
            *("--split", SPLIT, "--episodes", str(goals), "--no-pictures", "--output", str(output)),
        ]
        command += ["--variant", variant] if variant else []
        done = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
        if not (output / "summary.json").is_file():
            raise SpaceEnvsError(f"evaluate.py ended with status {done.returncode} and left no results")
        rows = build_rows(read_folder(output).records, np.random.default_rng(0), resamples=50)
        return [_figures(row) for row in rows]


def _figures(row: Row) -> PlannerFigures:
    failure = row.failures[0] if row.failures else None
    words = "" if failure is None else ": ".join(part for part in (failure.cause, failure.reason) if part)
    score, peak, final = (row.figures[key].value for key in (HEADLINE, "peak_attitude", "final_attitude"))
    return PlannerFigures(row.policy, row.control_mode, row.episodes, row.captures, score, peak, final, words)
