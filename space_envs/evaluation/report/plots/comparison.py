"""Plots that compare the policies of one task with each other."""

from collections.abc import Mapping, Sequence

import numpy as np

from space_envs.evaluation.leaderboard.comparison import improvements
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.plots.improvement import improvement_plot
from space_envs.evaluation.report.plots.pareto import pareto_plot
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.plots.profiles import profiles_plot

IMPROVED = (
    HEADLINE,
    "attitude_cost",
)  # of COMPARED, those with a plot


def comparison_plots(
    rows: Sequence[Row],
    records: Sequence[EpisodeRecord],
    looks: Mapping[str, Look],
    generator: np.random.Generator,
    resamples: int = 2000,
) -> list[Plot]:
    """Performance profiles, probabilities of improvement and Pareto front of one task.

    `rows` and `records` are of the same policies, `looks` has the look of each. A plot for which there are no
    data is left out. Raises ConfigurationError where they are of several tasks.
    """
    plots = (
        profiles_plot(rows, records, looks, generator, resamples),
        *(improvement_plot(rows, m, improvements(records, m, generator, resamples)) for m in IMPROVED),
        pareto_plot(rows, looks),
    )
    return [plot for plot in plots if plot]
