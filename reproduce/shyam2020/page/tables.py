"""Tables of the page of shyam2020: the planners over the goals, their demands, failures, and times."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from statistics import median
from typing import Any

import numpy as np

from reproduce.claims import CaseRecord
from reproduce.compare import figures_of, ratios, short
from reproduce.page.blocks import Table
from reproduce.shyam2020.cases import DIFFICULTY, limits
from reproduce.shyam2020.methods import METHODS, SingleArmMethod
from reproduce.shyam2020.page.text import TEXT
from reproduce.shyam2020.timing import DEMONSTRATIONS, REPEATS, StepTimes

COLORS = tuple(method.color for method in METHODS.values())


def _by_method(
    records: Sequence[CaseRecord],
) -> Iterator[tuple[SingleArmMethod, list[Mapping[str, Any]]]]:
    """Every method with its figures in the records in which it has a plan."""
    for key, method in METHODS.items():
        yield method, [found for record in records if (found := figures_of(record, key))]


def comparison(records: Sequence[CaseRecord]) -> Table:
    """Cost, attitude, goal error and planning time of every planner over the goals."""
    rows = []
    for method, found in _by_method(records):
        if not found:
            rows.append((method.name, "0", *["-"] * 8))
            continue
        over = ratios(records, "cost", method.key, "ocp")
        quantiles = np.quantile(over, [0.5, 0.9]) if over.size else [np.nan] * 2
        rows.append(
            (
                method.name,
                str(len(found)),
                short(1e4 * _median(found, "cost")),
                *(f"{quantile:.2f}" for quantile in quantiles),
                short(degrees(1.0) * _median(found, "end_attitude")),
                short(degrees(1.0) * _median(found, "peak_attitude")),
                f"{1000 * max(each['position_error'] for each in found):.2g}",
                f"{degrees(max(each['rotation_error'] for each in found)):.2g}",
                short(1000 * float(np.median([record["timing"][method.key] for record in records]))),
            )
        )
    text = TEXT.fill("tables.comparison", count=len(records), difficulty=DIFFICULTY)
    return Table(**text, rows=rows, colors=COLORS)


def _median(found: Sequence[Mapping[str, float]], name: str) -> float:
    return float(np.median([each[name] for each in found]))


def drives(records: Sequence[CaseRecord]) -> Table:
    """Largest rates, accelerations and torques of every planner, and its cost over that of `ocp_kept`."""
    rows = []
    for method, found in _by_method(records):
        if not found:
            rows.append((method.name, *["-"] * 6))
            continue
        over = ratios(records, "cost", method.key, "ocp_kept")
        peaks = ("peak_rate", "peak_acceleration", "peak_torque", "end_rate")
        rows.append(
            (
                method.name,
                *(f"{max(each[name] for each in found):.3g}" for name in peaks),
                f"{100 * max(each['shift'] for each in found):.3g}",
                f"{np.median(over):.2f}" if over.size else "-",
            )
        )
    return Table(**TEXT.fill("tables.drives", limits=limits()), rows=rows, colors=COLORS)


def failures(records: Sequence[CaseRecord]) -> Table:
    """Numbers of failures of every planner by cause, with an example."""
    rows = []
    for key, method in METHODS.items():
        each = [(record["index"], record["methods"][key]) for record in records]
        counts = Counter(found["cause"] for _, found in each if "cause" in found)
        for cause, number in sorted(counts.items()):
            index, reason = next((i, f["reason"]) for i, f in each if f.get("cause") == cause)
            rows.append((method.name, cause.replace("_", " "), str(number), str(index), reason))
    return Table(**TEXT.fill("tables.failures", rows=rows), rows=rows, words=True)


def step_times(steps: StepTimes) -> Table:
    """Times of the algorithm's steps."""
    text = TEXT.fill(
        "tables.steps",
        repeats=REPEATS,
        demonstrations=DEMONSTRATIONS,
        samples=steps.samples,
        times=steps.sample_times,
    )
    labels = text.pop("labels")
    rows = [(labels[key], short(1000 * median(values))) for key, values in steps.seconds.items()]
    return Table(**text, rows=rows)


def planning_times(records: Sequence[CaseRecord]) -> Table:
    """Times of planning by every method over the goals."""
    rows = []
    for key, method in METHODS.items():
        found = 1000 * np.array([record["timing"][key] for record in records])
        low, middle, high = np.quantile(found, [0.1, 0.5, 0.9])
        rows.append((method.name, *map(short, (middle, low, high, found.max()))))
    return Table(**TEXT.fill("tables.planning", count=len(records)), rows=rows, colors=COLORS)
