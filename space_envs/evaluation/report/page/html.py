"""The report page: one self-contained HTML file of less than ten megabytes.

Names are escaped by the template engine, data by `packing.json_text`, and a content security policy lets only
the page's own scripts run, known by their hashes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, groupby
from types import MappingProxyType
from typing import Any

from markupsafe import Markup

from space_envs.evaluation.leaderboard.columns import (
    NOTE,
    RULES,
)
from space_envs.evaluation.leaderboard.normalised import Scores
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.drawing.panel import prefixed
from space_envs.evaluation.report.page.pictures import no_pictures_reason, page_pictures
from space_envs.evaluation.report.page.provenance import provenance_lists
from space_envs.evaluation.report.page.replays import page_replays
from space_envs.evaluation.report.page.scores import score_table
from space_envs.evaluation.report.page.section import make_section
from space_envs.evaluation.report.plots.all_plots import policy_looks
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.wording import by_task
from space_envs.evaluation.report.templating import make_environment, read_template, script_hash
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.registration import ENTRIES

SCRIPTS = ("pages.js", "table.js", "scrolling.js", "scene.js", "webgl.js", "painter.js", "player.js")
PLOT_CHARACTERS = 4_200_000  # of a page of ten million


def to_html(
    result: EvaluationResult,
    rows: Sequence[Row],
    plots: Mapping[EvaluatedTask, Sequence[Plot]],
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
            provenance=provenance_lists(result),
            style=Markup(read_template("report.css")),
            scripts=[Markup(script) for script in scripts],
            hashes=[script_hash(script) for script in scripts],
        )
    )


def _pages(
    result: EvaluationResult,
    rows: Sequence[Row],
    plots: Mapping[EvaluatedTask, Sequence[Plot]],
    scores: Scores,
) -> list[dict[str, Any]]:
    """One page for each id, with a section for each of its tasks."""
    looks = policy_looks(rows)
    tasks = by_task(rows)
    replays = page_replays(tasks, result.replays, looks)
    pictures = page_pictures(tasks, result.pictures)
    fitting = _fitting(plots)
    pages = []
    numbered = [(number, task, group) for number, (task, group) in enumerate(tasks)]
    for page, (env_id, group) in enumerate(groupby(numbered, key=lambda item: item[1].env_id)):
        sections = []
        for number, task, mine in group:
            watched = replays[task]
            replayed = watched["entries"] if watched else []
            section = make_section(task, mine, looks, number, replayed) | {
                "plots": [
                    replace(plot, panels=tuple(prefixed(panel, f"task{number}") for panel in plot.panels))
                    for plot in fitting[task]
                ],
                "left_out": [plot.title for plot in plots[task] if plot not in fitting[task]],
                "replays": watched,
                "pictures": pictures[task],
                "no_pictures": no_pictures_reason(mine, result.pictures, result.pictures_note),
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
    plots: Mapping[EvaluatedTask, Sequence[Plot]],
) -> dict[EvaluatedTask, list[Plot]]:
    """The plots for which the page has room, each kind for all tasks or for none.

    Kinds in which all policies stand together come before those in which each stands alone.
    """
    sizes: dict[str, int] = {}
    for plot in chain.from_iterable(plots.values()):
        sizes[plot.key] = sizes.get(plot.key, 0) + sum(len(panel.svg) for panel in plot.panels)
    room, kinds = PLOT_CHARACTERS, set()
    for key in sorted(sizes, key=lambda key: key in ("attitude", "motion")):
        if sizes[key] <= room:
            room -= sizes[key]
            kinds.add(key)
    return {task: [plot for plot in group if plot.key in kinds] for task, group in plots.items()}


def _choices(sections: Sequence[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Filters of a page: robot, difficulty, goal, split and perturbation, where they differ."""
    found = {
        key: list(dict.fromkeys(section["task"][key] for section in sections))
        for key in ("robot", "difficulty", "goal", "split", "perturbation")
    }
    return {key: values for key, values in found.items() if len(values) > 1}
