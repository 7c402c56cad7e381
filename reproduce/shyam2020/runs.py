"""Results of a goal: every planner's motion and its figures, and the algorithm's single steps."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import agents
import promp
import space_envs
from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import Failure
from agents.policies.single_arm.promp import SAMPLES
from reproduce.cases import CaseRecord, source_digest
from reproduce.shyam2020 import cases, measures, sampling, steps
from reproduce.shyam2020.cases import GoalCase, goal
from reproduce.shyam2020.measures import Course, course, figures
from reproduce.shyam2020.methods import METHODS, optimal_control
from reproduce.shyam2020.sampling import DrawnSamples, draw_samples, sample_figures
from reproduce.shyam2020.steps import (
    encoding_figures,
    literal_figures,
    locked_figures,
    sphere_figures,
    via_point_figures,
)


@dataclass(frozen=True, eq=False)
class PlannedGoal:
    """A goal with what figures need; courses are by method, of those that found a motion."""

    case: GoalCase
    courses: Mapping[str, Course]
    drawn: DrawnSamples | None
    record: CaseRecord


def work_out(case: GoalCase, seed: int) -> PlannedGoal:
    """Plan with every method, measure, and look at the algorithm's steps.

    The record is a plain JSON object: `index`; `goal`; `methods` with the figures of
    `reproduce.shyam2020.measures.figures`, or cause and reason of a failure; `once`, optimal control from a
    single start; `samples`, `via_point`, `literal`, `locked`, `encoding`, `sphere` as
    `sampling` and `steps` say, None where they cannot be asked; and `timing`, s, which alone depends
    on the clock.
    """
    _warm(seed)
    found: dict[str, Any] = {}
    timing: dict[str, float] = {}
    courses: dict[str, Course] = {}
    encoding = None
    for key, method in METHODS.items():
        started = perf_counter()
        motion = method.plan(case, seed)
        timing[key] = perf_counter() - started
        if isinstance(motion, Failure):
            found[key] = {"cause": str(motion.cause), "reason": motion.reason}
            continue
        courses[key] = course(motion)
        found[key] = dict(figures(courses[key], case))
        if key == "mpc" and isinstance(motion, JointMotion):
            encoding = encoding_figures(motion)
    started = perf_counter()
    once = optimal_control(case, starts=1)
    timing["once"] = perf_counter() - started
    drawn = draw_samples(case, seed, SAMPLES)
    record = {
        "index": case.index,
        "goal": {"position": case.position.tolist(), "quaternion": case.quaternion.tolist()},
        "methods": found,
        "once": {"cause": str(once.cause), "reason": once.reason}
        if isinstance(once, Failure)
        else {"cost": course(once).cost},
        "samples": sample_figures(drawn) if drawn else None,
        "via_point": via_point_figures(case, drawn.goal) if drawn else None,
        "literal": literal_figures(case),
        "locked": locked_figures(case),
        "encoding": encoding,
        "sphere": sphere_figures(case, drawn) if drawn else None,
        "timing": timing,
    }
    return PlannedGoal(case, courses, drawn, record)


@cache
def _warm(seed: int) -> None:
    """Call every planner once: compiling and loading do not count as planning."""
    for method in METHODS.values():
        method.plan(goal(-1), seed)


def case_record(index: int, seed: int) -> CaseRecord:
    """The record of a goal of the test split."""
    return work_out(goal(index), seed).record


def recipe(seed: int) -> dict[str, Any]:
    """Values that determine the records."""
    own, suite = Path(__file__).parent, Path(space_envs.__file__).parent
    sources = [
        Path(agents.__file__).parent / "planners" / "common",
        Path(agents.__file__).parent / "planners" / "single_arm",
        *(
            Path(agents.__file__).parent / "policies" / "single_arm" / name
            for name in ("minimum_jerk.py", "mpc.py", "promp.py", "reaching.py", "reactionless")
        ),
        Path(promp.__file__).parent,
        suite / "dynamics",
        suite / "codegen",
        suite / "robots",
        suite / "tasks" / "single_arm.py",
        *(Path(str(module.__file__)) for module in (cases, measures, sampling, steps)),
        own / "methods.py",
        own / "runs.py",
    ]
    return {
        "study": "shyam2020",
        "seed": seed,
        "sources": source_digest(sources),
        "versions": {name: version(name) for name in ("numpy", "scipy", "casadi", "mujoco")},
    }
