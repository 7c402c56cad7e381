"""The leaderboard in Markdown."""

from collections.abc import Sequence

from space_envs.evaluation.leaderboard.columns import KNOWLEDGE, NOTE, RULES, columns_of
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import markdown_name
from space_envs.evaluation.report.tables.wording import (
    by_task,
    counts_summary,
    failure_summaries,
    modes_summary,
    row_name,
)

WITH_INTERVALS = (HEADLINE, "success")  # where there is no room for all


def to_markdown(rows: Sequence[Row]) -> str:
    """One table for each task, with intervals, failures and rules; names are escaped."""
    parts = ["# Leaderboard\n"]
    for task, group in by_task(rows):
        summary = markdown_name(f"{counts_summary(group)}. Control mode: {modes_summary(group)}.", 200)
        parts.append(f"\n## {markdown_name(str(task), 200)}\n\n{summary}\n\n{markdown_table(group)}")
    parts.append(f"\n{NOTE}\n")
    return "".join(parts)


def markdown_table(rows: Sequence[Row], brief: bool = False) -> str:
    """The table of one task, its failures and the rules under it; all columns and intervals, or a few."""
    every = columns_of(rows[0].metrics)
    rank, *others = [column for column in every if not brief or column.display.room != "full"]
    heads = [rank.heading, "policy", KNOWLEDGE, *(column.heading for column in others)]
    parts = [f"| {' | '.join(heads)} |\n", "| ---: | --- | --- |" + " ---: |" * len(others) + "\n"]
    for row in rows:
        bare = {column.key for column in others if brief and column.key not in WITH_INTERVALS}
        cells = [f"{c.value(row)} {'' if c.key in bare else c.interval(row)}".strip() for c in others]
        cells = [rank.value(row), markdown_name(row_name(row, rows)), row.knowledge, *cells]
        parts.append(f"| {' | '.join(cells)} |\n")
    failed = failure_summaries(rows)
    parts.append("\nFailed:\n\n" if failed else "")
    parts += [f"- {markdown_name(name)}, {failures}\n" for name, failures in failed]
    return "".join(parts) + f"\n{' '.join(RULES)}\n"
