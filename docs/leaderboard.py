"""The leaderboards of README.md, from the records of an evaluation."""

import re
from collections.abc import Sequence

import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.report.folder import BOOTSTRAP_SEED
from space_envs.evaluation.report.tables.markdown import markdown_table
from space_envs.evaluation.report.tables.wording import by_task, counts_summary, modes_summary

MARKER = re.compile(r"(<!-- leaderboard: (\S+) -->\n).*?(<!-- /leaderboard -->)", re.DOTALL)


def with_leaderboards(text: str, records: Sequence[EpisodeRecord]) -> str:
    """Text of a page with the tables of the ids that its markers name.

    Raises:
        ConfigurationError: if there is no table of an id in the records, or several.
    """
    tables = by_task(build_rows(records, np.random.default_rng(BOOTSTRAP_SEED)))

    def filled(match: re.Match[str]) -> str:
        found = [rows for task, rows in tables if task.env_id == match[2]]
        if not found:
            raise unknown_name("id in the records", match[2], [task.env_id for task, _ in tables])
        if len(found) > 1:
            raise ConfigurationError(f"the records have {len(found)} tables of {match[2]}, expected one")
        return f"{match[1]}{_table(found[0], records)}\n{match[3]}"

    return MARKER.sub(filled, text)


def _table(rows: Sequence[Row], records: Sequence[EpisodeRecord]) -> str:
    """Goals, episodes, control modes and processor of the evaluation, and the table."""
    task = rows[0].task
    timed = {r.timing["processor"] for r in records if r.entry.task == task} - {None}
    on = f"Timed on {' and '.join(sorted(map(str, timed)))}. " if timed else ""
    return (
        f"{task.difficulty.capitalize()} goals, {task.split} split, {counts_summary(rows)}; "
        f"the control mode is {modes_summary(rows)}. {on}Brackets are 95 % intervals.\n\n"
        f"{markdown_table(rows, brief=True)}"
    )
