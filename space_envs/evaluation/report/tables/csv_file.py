"""The leaderboard as a CSV file with every figure and its interval."""

import csv
import io
import math
from collections.abc import Sequence
from itertools import chain

from space_envs.evaluation.leaderboard.figures import FIGURES, TIMINGS
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.causes import CAUSES, OUTCOMES
from space_envs.evaluation.records.names import csv_name
from space_envs.evaluation.statistics.intervals import MISSING


def to_csv(rows: Sequence[Row]) -> str:
    """Every figure with its interval in the units of the records; rates in 0..1, empty where none exists."""
    head = [
        "rank",
        "env_id",
        "robot",
        "difficulty",
        "split",
        "goal",
        "perturbation",
        "policy",
        "control_mode",
    ]
    head += ["knowledge", "config_hash", "task_version", "episodes", "captures", "seeds"]
    figures = dict.fromkeys(chain(FIGURES, *(row.figures for row in rows)))
    largest = dict.fromkeys(chain.from_iterable(row.largest for row in rows))
    for key in figures:
        head += [key, f"{key}_low", f"{key}_high"]
    head += [*(f"{key}_max" for key in largest), *OUTCOMES, *(f"cause_{cause}" for cause in CAUSES)]
    head += [f"timing_{key}" for key in TIMINGS]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        numbers = [end for key in figures for end in vars(row.figures.get(key, MISSING)).values()]
        numbers += [row.largest.get(key, math.nan) for key in largest]
        task = row.task
        names = (task.env_id, task.robot, task.difficulty, task.split, task.goal)
        names = (*names, task.perturbation, row.policy)
        names = (*names, row.control_mode, row.knowledge)
        cells: list[object] = ["" if row.rank is None else row.rank, *map(csv_name, names)]
        cells += [csv_name(row.config_hash), row.task_version, row.episodes, row.captures, len(row.seeds)]
        cells += [repr(number) if math.isfinite(number) else "" for number in numbers]
        cells += [row.outcomes[outcome] for outcome in OUTCOMES]
        causes = {each.cause: each.count for each in row.failures}
        cells += [causes.get(cause, 0) for cause in CAUSES]
        cells += [repr(row.timing[key]) if math.isfinite(row.timing[key]) else "" for key in TIMINGS]
        writer.writerow(cells)
    return text.getvalue()
