"""Rows, their counts and their failures in words, the same in every table."""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby

from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.tasks.outcome import Outcome

# Words for causes in a count, of one and of several.
_CALLED = {outcome.value: (outcome.label, outcome.plural) for outcome in Outcome}


def by_task(rows: Sequence[Row]) -> list[tuple[EvaluatedTask, list[Row]]]:
    """Rows of each task together, in the order of `build_rows`."""
    return [(task, list(group)) for task, group in groupby(rows, key=lambda row: row.task)]


def row_name(row: Row, rows: Sequence[Row]) -> str:
    """The policy's name, with its control mode where that is not the one of most rows shown together."""
    usual = usual_mode(rows)
    return row.policy if row.control_mode == usual else f"{row.policy} ({row.control_mode})"


def usual_mode(rows: Sequence[Row]) -> str:
    """The control mode of most rows; of several, the first in the alphabet."""
    count = Counter(row.control_mode for row in rows)
    return min(count, key=lambda mode: (-count[mode], mode))


def modes_summary(rows: Sequence[Row]) -> str:
    """The control mode of the rows, in words."""
    several = len({row.control_mode for row in rows}) > 1
    return usual_mode(rows) + (" where no other is named" if several else "")


def failure_summaries(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Each policy that failed, and all its failed episodes by their cause, such as "18 of 100: 10 infeasible,
    6 timeouts, 2 singular"; the same words wherever a table stands."""
    summaries = []
    for row in rows:
        if row.failures:
            failed = sum(each.count for each in row.failures)
            causes = ", ".join(f"{e.count} {cause_label(e.cause, e.count)}" for e in row.failures)
            summaries.append((row_name(row, rows), f"{failed} of {row.episodes}: {causes}"))
    return summaries


def cause_label(cause: str, count: int) -> str:
    """A cause of failure in words, after a number."""
    one, several = _CALLED.get(cause, (cause.replace("_", " "),) * 2)
    return one if count == 1 else several


def counts_summary(rows: Sequence[Row]) -> str:
    """Number of episodes and seeds of the rows of a task, in words."""
    episodes = sorted({row.episodes for row in rows})
    seeds = len({seed for row in rows for seed in row.seeds})
    ends = " to ".join(map(str, dict.fromkeys((episodes[0], episodes[-1]))))
    return f"{ends} episodes a policy, {seeds} seed{'s' if seeds > 1 else ''}"
