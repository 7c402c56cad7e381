"""All plots of a report."""

from collections.abc import Sequence

import numpy as np

from space_envs.evaluation.leaderboard.normalised import Scores
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.report.drawing.look import Look, make_looks
from space_envs.evaluation.report.plots.comparison import comparison_plots
from space_envs.evaluation.report.plots.disturbance import cost_plot
from space_envs.evaluation.report.plots.intervals import intervals_plot, scores_plot
from space_envs.evaluation.report.plots.motion import attitude_plot, motion_plot
from space_envs.evaluation.report.plots.outcomes import outcomes_plot
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.wording import by_task, row_name
from space_envs.evaluation.results.result import EvaluationResult

DRAWN = 30  # episodes of a policy whose course in time is drawn


def make_plots(
    result: EvaluationResult, rows: Sequence[Row], scores: Scores, generator: np.random.Generator
) -> dict[EvaluatedTask, list[Plot]]:
    """Every plot of each task, in the order of the page."""
    looks = policy_looks(rows)
    plots = {}
    for task, group in by_task(rows):
        named = {row_name(row, group): row for row in group}
        episodes = {
            name: result.episodes[row.entry].take(range(min(DRAWN, len(result.episodes[row.entry]))))
            for name, row in named.items()
            if row.entry in result.episodes
        }
        colored = {name: looks[row.policy] for name, row in named.items()}
        records = [record for record in result.records if record.entry.task == task]
        made = [
            intervals_plot(group, looks),
            scores_plot(group, scores, looks),
            *comparison_plots(group, records, looks, generator),
            cost_plot(group, looks),
            outcomes_plot(group),
            attitude_plot(episodes, colored),
            motion_plot(episodes),
        ]
        plots[task] = [plot for plot in made if plot]
    return plots


def policy_looks(rows: Sequence[Row]) -> dict[str, Look]:
    """A look for each policy, the same on every task."""
    return make_looks(list(dict.fromkeys(row.policy for row in rows)))
