"""Results of a case: all plans, their figures, and their simulation at torque level."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import space_envs
from agents.planners.common.plans import Failure
from agents.planners.dual_arm import problem
from agents.planners.dual_arm.problem import CapturePlan
from agents.planners.dual_arm.tracking import FINE, Tracked, Tracking, track
from reproduce.cases import CaseRecord, source_digest
from reproduce.shah2013.cases import ROBOT, CaptureCase, Sampler
from reproduce.shah2013.measures import SAMPLES, Curves, curves, record
from reproduce.shah2013.methods import ACCELERATION, METHODS

COARSE = Tracking()  # the suite's own step
BEFORE = 2.0  # s before the fastest change of zeta, at which (a) and (b) are compared


@dataclass(frozen=True, eq=False)
class PlannedCase:
    """A case with all that figures need; dictionaries are by method, of those that found a plan."""

    case: CaptureCase
    plans: Mapping[str, CapturePlan]
    curves: Mapping[str, Curves]
    coarse: Mapping[str, Tracked]
    fine: Mapping[str, Tracked]
    record: CaseRecord


def work_out(case: CaptureCase, fine: bool = False) -> PlannedCase:
    """Plan with every method, measure, and simulate at torque level; `fine`: with small steps too.

    The record is a plain JSON object: `index`, `case`, `methods` with the figures of
    `reproduce.shah2013.measures.record` and the peak base rates at torque level, or cause and reason of a
    failure, and `timing`, s, which alone depends on the clock.
    """
    plans: dict[str, CapturePlan] = {}
    figures: dict[str, Any] = {}
    timing: dict[str, float] = {}
    courses: dict[str, Curves] = {}
    coarse: dict[str, Tracked] = {}
    finer: dict[str, Tracked] = {}
    for key, method in METHODS.items():
        started = perf_counter()
        wider = figures[method.within] if method.within else {}
        if "cause" in wider:
            figures[key] = {
                "cause": wider["cause"],
                "reason": f"no plan with the wider bounds of {method.within}",
            }
            timing[key] = 0.0
            continue
        found = method.plan(case)
        timing[key] = perf_counter() - started
        if isinstance(found, Failure):
            figures[key] = {"cause": str(found.cause), "reason": found.reason}
            continue
        plans[key], courses[key] = found, curves(found)
        coarse[key] = track(found, ROBOT, COARSE)
        figures[key] = record(found, courses[key], case) | {
            "tracked_base_rate": coarse[key].peak_base_rate,
            "tracked_momentum": float(coarse[key].momentum.max()),
        }
        if fine:
            finer[key] = track(found, ROBOT, FINE)
            figures[key] |= {
                "tracked_base_rate_fine": finer[key].peak_base_rate,
                "tracked_momentum_fine": float(finer[key].momentum.max()),
            }
    if "zeta_zero" in courses and "local" in courses:
        figures["local"]["lead"] = _lead(courses["local"], courses["zeta_zero"], figures["local"])
    return PlannedCase(
        case,
        plans,
        courses,
        coarse,
        finer,
        {"index": case.index, "case": asdict(case), "methods": figures, "timing": timing},
    )


def settings(how: Tracking) -> str:
    """Settings of a simulation, in words."""
    fed_back = ", attitude fed back" if how.attitude_gain else ""
    return f"step {1000 * how.timestep:g} ms, torques held for {1000 * how.control_period:g} ms{fed_back}"


def case_record(index: int, seed: int, sampler: Sampler) -> CaseRecord:
    """The record of a random case."""
    return work_out(sampler.draw(seed, index)).record


def recipe(seed: int, sampler: Sampler) -> dict[str, Any]:
    """Values that determine the records of random cases."""
    suite, own = Path(space_envs.__file__).parent, Path(__file__).parent
    sources = [
        Path(problem.__file__).parent,
        Path(problem.__file__).parents[1] / "common",
        suite / "dynamics",
        suite / "codegen",
        suite / "robots",
        *(own / f"{name}.py" for name in ("cases", "measures", "methods", "runs")),
    ]
    return {
        "study": "shah2013",
        "seed": seed,
        "sampler": asdict(sampler),
        "samples": SAMPLES,
        "acceleration": ACCELERATION,
        "coarse": asdict(COARSE),
        "fine": asdict(FINE),
        "sources": source_digest(sources),
        "versions": {name: version(name) for name in ("numpy", "scipy", "casadi", "mujoco")},
    }


def _lead(local: Curves, zero: Curves, figures: Mapping[str, float]) -> float:
    """Energy of (b) minus that of (a), J s, shortly before zeta of (b) changes fastest."""
    then = max(0.0, figures["zeta_jolt_time"] - BEFORE)
    return float(np.interp(then, local.time, local.energy) - np.interp(then, zero.time, zero.energy))
