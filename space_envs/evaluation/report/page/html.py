"""The report's page: one HTML file that asks for nothing outside itself and stays below ten megabytes.

Names are escaped by the template engine, data by `packing.json_text`, and a content security policy lets only
the page's own scripts run, known by their hashes.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, groupby
from types import MappingProxyType
from typing import Any

import numpy as np
from markupsafe import Markup

from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import counted, display_name, plural
from space_envs.evaluation.report import figures
from space_envs.evaluation.report.comparison_figures import comparison_plots
from space_envs.evaluation.report.drawing import prefixed
from space_envs.evaluation.report.page.pictures import page_pictures, why_no_pictures
from space_envs.evaluation.report.page.replays import page_replays
from space_envs.evaluation.report.page.scores import score_table
from space_envs.evaluation.report.tables import by_task, cause_called, failures_told, modes_told, row_name
from space_envs.evaluation.report.templating import make_environment, read_template, script_hash
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.evaluation.statistics.columns import (
    ABLE,
    NOTE,
    RULES,
    Column,
    column_named,
    columns_of,
    leaders,
)
from space_envs.evaluation.statistics.figures import HEADLINE
from space_envs.evaluation.statistics.normalised import Scores
from space_envs.evaluation.statistics.row import Row
from space_envs.registration import ENTRIES

SCRIPTS = ("pages.js", "table.js", "scrolling.js", "scene.js", "webgl.js", "painter.js", "player.js")
DRAWN = 30  # episodes of a policy whose course in time is drawn
PLOT_LETTERS = 4_200_000  # of a page of ten million


def make_plots(
    result: EvaluationResult, rows: Sequence[Row], scores: Scores, generator: np.random.Generator
) -> dict[EvaluatedTask, list[figures.Plot]]:
    """Every plot of each task, in the order of the page."""
    shade = _shade(rows)
    plots = {}
    for task, group in by_task(rows):
        named = {row_name(row, group): row for row in group}
        episodes = {
            name: result.episodes[row.entry].take(range(min(DRAWN, len(result.episodes[row.entry]))))
            for name, row in named.items()
            if row.entry in result.episodes
        }
        coloured = {name: shade[row.policy] for name, row in named.items()}
        records = [record for record in result.records if record.entry.task == task]
        made = [
            figures.intervals_plot(group, shade),
            figures.scores_plot(group, scores, shade),
            *comparison_plots(group, records, shade, generator),
            figures.cost_plot(group, shade),
            figures.outcomes_plot(group),
            figures.attitude_plot(episodes, coloured),
            figures.motion_plot(episodes),
        ]
        plots[task] = [plot for plot in made if plot]
    return plots


def to_html(
    result: EvaluationResult,
    rows: Sequence[Row],
    plots: Mapping[EvaluatedTask, Sequence[figures.Plot]],
    scores: Scores = MappingProxyType({}),
) -> str:
    """The page, self-contained.

    Raises:
        ConfigurationError: for pictures that are none.
    """
    scripts = [read_template(name) for name in SCRIPTS]
    env_ids = list(dict.fromkeys(row.task.env_id for row in rows))
    command = result.provenance.get("command")
    return (
        make_environment()
        .from_string(read_template("report.html.j2"))
        .render(
            title=display_name(", ".join(env_ids), 200),
            pages=_pages(result, rows, plots, scores),
            note=NOTE,
            rules=RULES,
            command=None if command is None else display_name(str(command), 20_000),
            provenance=_provenance(result),
            style=Markup(read_template("report.css")),
            scripts=[Markup(script) for script in scripts],
            hashes=[script_hash(script) for script in scripts],
        )
    )


def highlights(rows: Sequence[Row]) -> list[dict[str, str]]:
    """The first things to know: who leads, who captures most, and of the able the gentlest and fastest."""
    tiles = [
        _tile("Highest kept-attitude score", HEADLINE, rows),
        _tile("Most captures", "success", rows),
        _tile("Lowest final attitude error", "final_attitude", rows),
        _tile("Least base disturbance", "attitude_cost", rows),
        _tile("Fastest capture", "time_to_capture", rows),
    ]
    nothing = {"label": "Most captures", "value": "0", "unit": "%", "names": "nobody"}
    return [tile for tile in tiles if tile] or [nothing]


def _pages(
    result: EvaluationResult,
    rows: Sequence[Row],
    plots: Mapping[EvaluatedTask, Sequence[figures.Plot]],
    scores: Scores,
) -> list[dict[str, Any]]:
    """One page for each id, with a section for each of its tasks."""
    shade = _shade(rows)
    tasks = by_task(rows)
    replays = page_replays(tasks, result.replays, shade)
    pictures = page_pictures(tasks, result.pictures)
    fitting = _fitting(plots)
    pages = []
    numbered = [(number, task, group) for number, (task, group) in enumerate(tasks)]
    for page, (env_id, group) in enumerate(groupby(numbered, key=lambda item: item[1].env_id)):
        sections = []
        for number, task, mine in group:
            watched = replays[task]
            replayed = watched["entries"] if watched else []
            section = _section(task, mine, shade, number, replayed) | {
                "plots": [
                    replace(plot, panels=tuple(prefixed(panel, f"task{number}") for panel in plot.panels))
                    for plot in fitting[task]
                ],
                "left_out": [plot.title for plot in plots[task] if plot not in fitting[task]],
                "replays": watched,
                "pictures": pictures[task],
                "no_pictures": why_no_pictures(mine, result.pictures, result.pictures_note),
                "scores": score_table(mine, scores),
            }
            sections.append(section)
        pages.append(
            {
                "key": f"page-{page}",
                "name": display_name(env_id),
                "short": display_name(env_id.removeprefix("SpaceCapture/")),
                "summary": ENTRIES[env_id].summary if env_id in ENTRIES else "",
                "sections": sections,
                "choices": _choices(sections),
            }
        )
    return pages


def _fitting(
    plots: Mapping[EvaluatedTask, Sequence[figures.Plot]],
) -> dict[EvaluatedTask, list[figures.Plot]]:
    """The plots for which the page has room, each kind for all tasks or for none.

    Kinds in which all policies stand together come before those in which each stands alone.
    """
    sizes: dict[str, int] = {}
    for plot in chain.from_iterable(plots.values()):
        sizes[plot.key] = sizes.get(plot.key, 0) + sum(len(panel.svg) for panel in plot.panels)
    room, kinds = PLOT_LETTERS, set()
    for key in sorted(sizes, key=lambda key: key in ("attitude", "motion")):
        if sizes[key] <= room:
            room -= sizes[key]
            kinds.add(key)
    return {task: [plot for plot in group if plot.key in kinds] for task, group in plots.items()}


def _choices(sections: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
    """What a page can be filtered by: difficulty and split, where they differ."""
    found = {
        key: list(dict.fromkeys(section["task"][key] for section in sections))
        for key in ("difficulty", "split")
    }
    return {key: values for key, values in found.items() if len(values) > 1}


def _section(
    task: EvaluatedTask,
    rows: list[Row],
    shade: Mapping[str, figures.Look],
    number: int,
    replayed: Sequence[LeaderboardEntry],
) -> dict[str, Any]:
    """What the template shows for one task, apart from plots, replays and pictures.

    `replayed` are the entries with replays, in the order of the player.
    """
    episodes = sorted({row.episodes for row in rows})
    columns = columns_of(rows[0].metrics)
    best = {column.key: leaders(column, rows) for column in columns}
    ranges = {column.key: _range(column, rows) for column in columns}
    return {
        "number": number,
        "columns": columns,
        "task": {name: display_name(value) for name, value in vars(task).items()},
        "modes": display_name(modes_told(rows), 200),
        "episodes": " to ".join(str(end) for end in dict.fromkeys((episodes[0], episodes[-1]))),
        "episodes_noun": plural(episodes[-1], "episode"),
        "seeds": len({seed for row in rows for seed in row.seeds}),
        "highlights": highlights(rows),
        "able": f"{100 * ABLE:.0f} %",
        "rows": [
            {
                "name": display_name(row_name(row, rows)),
                "look": shade[row.policy],
                "replay": replayed.index(row.entry) if row.entry in replayed else None,
                "cells": [
                    _cell(column, row, row in best[column.key], ranges[column.key]) for column in columns
                ],
            }
            for row in rows
        ],
        "failures": [(display_name(name), told) for name, told in failures_told(rows)],
        "examples": [
            (display_name(row_name(row, rows)), cause_called(each.cause, 1), display_name(each.reason, 300))
            for row in rows
            for each in row.failures
            if each.reason
        ],
    }


def _tile(label: str, key: str, rows: Sequence[Row]) -> dict[str, str] | None:
    """The best figure and all who reach it; nothing where nobody competes for it."""
    column = column_named(key)
    best = leaders(column, rows)
    if not best:
        return None
    names = [display_name(row_name(row, rows)) for row in best]
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return {"label": label, "value": column.value(best[0]), "unit": column.unit, "names": shown}


def _range(column: Column, rows: Sequence[Row]) -> tuple[float, float, bool] | None:
    """Both ends of what a column's intervals are drawn on, and whether it is logarithmic."""
    if column.unit == "%":
        return 0.0, 100.0, False
    estimates = [column.estimate(row) for row in rows]
    if all(math.isnan(estimate.low) for estimate in estimates):
        return None
    values = [end for e in estimates for end in (e.value, e.low, e.high) if math.isfinite(end)]
    if not values or max(values) <= 0:
        return None
    positive = [value for value in values if value > 0]
    if max(positive) > 30 * min(positive):
        return 0.8 * min(positive), 1.05 * max(positive), True
    return 0.0, 1.05 * max(values), False


def _cell(column: Column, row: Row, best: bool, drawn: tuple[float, float, bool] | None) -> dict[str, Any]:
    """A figure, its interval, and where both are drawn in percent of the cell's width."""
    estimate = column.estimate(row)
    marks = None
    if drawn and math.isfinite(estimate.value):
        value, low, high = (_place(end, *drawn) for end in (estimate.value, estimate.low, estimate.high))
        marks = {"value": f"{value:.1f}", "low": f"{low:.1f}", "width": f"{max(high - low, 0):.1f}"}
    return {
        "value": column.value(row),
        "interval": column.interval(row),
        "best": best,
        # What does not exist sorts behind everything, whichever way the column is turned.
        "sort": repr(estimate.value) if math.isfinite(estimate.value) else "",
        "bar": marks if column.unit == "%" else None,
        "marks": None if column.unit == "%" else marks,
    }


def _place(value: float, start: float, end: float, logarithmic: bool) -> float:
    """Percent of the way from start to end; what is beyond them, or does not exist, is put at the ends."""
    if math.isnan(value):
        return 0.0
    value = min(max(value, start), end)
    if logarithmic:
        value, start, end = (math.log(each) for each in (value, start, end))
    return 100 * (value - start) / (end - start)


def _provenance(result: EvaluationResult) -> dict[str, list[tuple[str, str]]]:
    """Rows of lists under their headings; the command stands by itself."""
    plain = {
        key: value for key, value in result.provenance.items() if key not in ("command", "configurations")
    }
    groups = {"Run": _flat({key: value for key, value in plain.items() if key != "versions"})}
    groups["Run"] += _timing(result.records)
    groups["Versions"] = _flat(plain.get("versions", {}))
    groups["Configurations"] = _flat(result.provenance.get("configurations", {}))
    return {title: rows for title, rows in groups.items() if rows}


def _timing(records: Sequence[EpisodeRecord]) -> list[tuple[str, str]]:
    """On what planning time and time per action were measured."""
    timed = {(record.timing["processor"], record.timing["threads"]) for record in records}
    told = [
        f"{processor}, {counted(threads, 'thread')}"
        for processor, threads in sorted(timed, key=str)
        if processor is not None and threads is not None
    ]
    return [("planning and action timed on", display_name("; ".join(told), 1000))] if told else []


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested provenance as rows of a list: `machine: processor` -> an x86-64."""
    flat: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{display_name(str(key)).replace('_', ' ')}"
        if isinstance(value, Mapping):
            flat += _flat(value, f"{name}: ")
        elif isinstance(value, (list, tuple)):
            flat.append((name, display_name(", ".join(map(str, value)), 1000)))
        else:
            flat.append((name, "-" if value is None else display_name(str(value), 1000)))
    return flat


def _shade(rows: Sequence[Row]) -> dict[str, figures.Look]:
    """A look for each policy, the same on every task."""
    return figures.looks(list(dict.fromkeys(row.policy for row in rows)))
