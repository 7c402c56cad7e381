"""The page's table of normalised scores, and the same for summary.json."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.leaderboard.normalised import SCORES, NormalisedScore, Scores, normalised_scores
from space_envs.evaluation.leaderboard.rounding import interval, rounded, supported_decimals
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.tables.wording import row_name


def all_scores(
    records: Sequence[EpisodeRecord], experts: Collection[str], generator: np.random.Generator
) -> Scores:
    """Normalised scores of every entry, within its own task."""
    by_task: dict[EvaluatedTask, list[EpisodeRecord]] = {}
    for record in records:
        by_task.setdefault(record.entry.task, []).append(record)
    return {
        entry: scores
        for group in by_task.values()
        for entry, scores in normalised_scores(group, experts, generator).items()
    }


def plain_scores(scores: Mapping[str, NormalisedScore]) -> dict[str, Any]:
    """An entry's scores as plain JSON values."""
    return {
        name: {"reason": score.reason}
        if score.estimate is None
        else {**vars(score.estimate), "expert": score.expert}
        for name, score in scores.items()
    }


def score_table(rows: Sequence[Row], scores: Scores) -> dict[str, Any] | None:
    """Headings and cells for the rows of one task, and why scores are missing; None if there are none."""
    found = [(row, scores[row.entry]) for row in rows if row.entry in scores]
    if not found:
        return None
    first = found[0][1]
    there = [name for name in SCORES if first[name].estimate is not None]
    return {
        "titles": [column_named(name).title for name in there],
        "experts": [display_name(first[name].expert or "") for name in there],
        "rows": [
            (display_name(row_name(row, rows)), [_cell(own[name]) for name in there]) for row, own in found
        ],
        "reasons": list(dict.fromkeys(first[name].reason for name in SCORES if name not in there)),
    }


def _cell(score: NormalisedScore) -> tuple[str, str]:
    if score.estimate is None:
        return "-", ""
    return rounded(score.estimate.value, supported_decimals(score.estimate)), interval(score.estimate)
