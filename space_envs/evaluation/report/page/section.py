"""Section of the page for one task: highlights, table, failures."""

from collections.abc import Mapping, Sequence
from typing import Any

from space_envs.evaluation.leaderboard.columns import (
    ABLE,
    column_named,
    columns_of,
    leaders,
)
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.names import display_name, plural
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.page.cells import column_scale, make_cell
from space_envs.evaluation.report.tables.wording import (
    cause_label,
    failure_summaries,
    modes_summary,
    row_name,
)


def highlights(rows: Sequence[Row]) -> list[dict[str, str]]:
    """Highlights: the best score and success, and the least error, disturbance and time of able policies."""
    tiles = [
        _tile("Highest kept-attitude score", HEADLINE, rows),
        _tile("Most captures", "success", rows),
        _tile("Lowest final attitude error", "final_attitude", rows),
        _tile("Least base disturbance", "attitude_cost", rows),
        _tile("Fastest capture", "time_to_capture", rows),
    ]
    nothing = {"label": "Most captures", "value": "0", "unit": "%", "names": "no policy"}
    return [tile for tile in tiles if tile] or [nothing]


def make_section(
    task: EvaluatedTask,
    rows: list[Row],
    looks: Mapping[str, Look],
    number: int,
    replayed: Sequence[LeaderboardEntry],
) -> dict[str, Any]:
    """Values of the template for one task, apart from plots, replays and pictures.

    `replayed` are the entries with replays, in the order of the player.
    """
    episodes = sorted({row.episodes for row in rows})
    columns = columns_of(rows[0].metrics)
    best = {column.key: leaders(column, rows) for column in columns}
    scales = {column.key: column_scale(column, rows) for column in columns}
    return {
        "number": number,
        "columns": columns,
        "task": {name: display_name(value) for name, value in vars(task).items()},
        "modes": display_name(modes_summary(rows), 200),
        "episodes": " to ".join(str(end) for end in dict.fromkeys((episodes[0], episodes[-1]))),
        "episodes_noun": plural(episodes[-1], "episode"),
        "seeds": len({seed for row in rows for seed in row.seeds}),
        "highlights": highlights(rows),
        "able": f"{100 * ABLE:.0f} %",
        "rows": [
            {
                "name": display_name(row_name(row, rows)),
                "knowledge": row.knowledge,
                "look": looks[row.policy],
                "replay": replayed.index(row.entry) if row.entry in replayed else None,
                "cells": [
                    make_cell(column, row, row in best[column.key], scales[column.key]) for column in columns
                ],
            }
            for row in rows
        ],
        "failures": [(display_name(name), summary) for name, summary in failure_summaries(rows)],
        "examples": [
            (display_name(row_name(row, rows)), cause_label(each.cause, 1), display_name(each.reason, 300))
            for row in rows
            for each in row.failures
            if each.reason
        ],
    }


def _tile(label: str, key: str, rows: Sequence[Row]) -> dict[str, str] | None:
    """Best figure and the policies that reach it; None where no policy competes for it."""
    column = column_named(key)
    best = leaders(column, rows)
    if not best:
        return None
    names = [display_name(row_name(row, rows)) for row in best]
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return {"label": label, "value": column.value(best[0]), "unit": column.unit, "names": shown}
