"""The folder that an evaluation leaves: records, traces, summary, tables and one HTML page for people.

`report.html` is a single file that asks for nothing outside itself. Names are escaped by the template engine,
and a content security policy lets only the page's own script run, known by its hash.
"""

import base64
import hashlib
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image

from space_envs.errors import ConfigurationError
from space_envs.evaluation import figures
from space_envs.evaluation.drawing import prefixed
from space_envs.evaluation.leaderboard import Row, Task, build_rows
from space_envs.evaluation.names import display_name, file_name
from space_envs.evaluation.records import SCHEMA_VERSION, EvaluationResult, write_records
from space_envs.evaluation.tables import COLUMNS, NOTE, Column, by_task, row_name, to_csv, to_markdown
from space_envs.files import atomic_write_text

BOOTSTRAP_SEED = 0
ABLE = 0.9  # success from which a policy competes for the gentlest and the fastest capture
NO_PICTURES = (
    "There are no pictures: none came with these results. They need a machine that can draw (OpenGL through "
    "EGL or OSMesa); the figures above do not."
)


@dataclass(frozen=True)
class ReportPaths:
    """Where `write_report` put what."""

    folder: Path
    records: Path
    summary: Path
    markdown: Path
    csv: Path
    html: Path
    traces: Mapping[str, Path]  # by policy


def write_report(
    result: EvaluationResult, folder: str | Path, generator: np.random.Generator | None = None
) -> ReportPaths:
    """Write every file of the report, each whole or not at all, and return their paths.

    The same result gives the same bytes, apart from what a clock decided. The bootstrap draws from
    `generator`, by default a fresh one of seed 0. Raises ConfigurationError where records do not
    fit together.
    """
    if not result.records:
        raise ConfigurationError("a report needs at least one record")
    generator = np.random.default_rng(BOOTSTRAP_SEED) if generator is None else generator
    rows = build_rows(result.records, generator)
    folder = Path(folder)
    traces = {policy: folder / "traces" / f"{file_name(policy)}.npz" for policy in result.traces}
    paths = ReportPaths(
        folder=folder,
        records=folder / "records.jsonl",
        summary=folder / "summary.json",
        markdown=folder / "leaderboard.md",
        csv=folder / "leaderboard.csv",
        html=folder / "report.html",
        traces=traces,
    )
    # All text is made first, so that a result that cannot be reported leaves the folder as it was.
    summary, markdown, table, page = (
        summary_json(result, rows),
        to_markdown(rows),
        to_csv(rows),
        to_html(result, rows),
    )
    for policy, path in traces.items():
        result.traces[policy].save(path)
    write_records(paths.records, result.records)
    atomic_write_text(paths.summary, summary)
    atomic_write_text(paths.markdown, markdown)
    atomic_write_text(paths.csv, table)
    atomic_write_text(paths.html, page)
    return paths


def summary_json(result: EvaluationResult, rows: Sequence[Row]) -> str:
    """Schema version, provenance, rows and the trace file of each policy, as indented JSON."""
    summary = {
        "schema": SCHEMA_VERSION,
        "provenance": result.provenance,
        "rows": [row.to_dict() for row in rows],
        "traces": {policy: f"traces/{file_name(policy)}.npz" for policy in result.traces},
    }
    try:
        return json.dumps(summary, indent=2, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"provenance must hold plain JSON values: {error}") from error


def to_html(result: EvaluationResult, rows: Sequence[Row]) -> str:
    """The page, self-contained."""
    texts = {name: _template(name) for name in ("report.html.j2", "report.css", "report.js")}
    # Line ends as the browser will see them when it checks the hash.
    script = texts["report.js"].replace("\r\n", "\n")
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    tasks = by_task(rows)
    shade = figures.colours(list(dict.fromkeys(row.policy for row in rows)))
    return environment.from_string(texts["report.html.j2"]).render(
        title=display_name(", ".join(dict.fromkeys(task.env_id for task, _ in tasks)), 200),
        sections=[_section(task, group, result, shade, number) for number, (task, group) in enumerate(tasks)],
        columns=COLUMNS,
        note=NOTE,
        motion=_plots(result, shade),
        pictures=[
            (display_name(policy), [_jpeg(policy, frame) for frame in frames])
            for policy, frames in result.pictures.items()
            if len(frames)
        ],
        no_pictures=result.pictures_note or NO_PICTURES,
        command=result.provenance.get("command"),
        provenance=_flat({key: value for key, value in result.provenance.items() if key != "command"}),
        style=Markup(texts["report.css"]),
        script=Markup(script),
        script_hash=digest,
    )


def _section(
    task: Task, rows: list[Row], result: EvaluationResult, shade: Mapping[str, str], number: int
) -> dict[str, Any]:
    """What the template shows for one task."""
    plots = [figures.intervals_plot(rows, shade), figures.cost_plot(rows, shade), figures.outcomes_plot(rows)]
    episodes = sorted({row.episodes for row in rows})
    return {
        "task": {name: display_name(value) for name, value in vars(task).items()},
        "modes": [display_name(mode) for mode in sorted({row.control_mode for row in rows})],
        "episodes": " to ".join(str(end) for end in dict.fromkeys((episodes[0], episodes[-1]))),
        "seeds": len({seed for row in rows for seed in row.seeds}),
        "highlights": highlights(rows),
        "able": f"{100 * ABLE:.0f} %",
        "rows": [
            {
                "name": display_name(row_name(row, rows)),
                "colour": shade[row.policy],
                "cells": [_cell(column, row) for column in COLUMNS],
            }
            for row in rows
        ],
        "plots": [
            replace(plot, panels=tuple(prefixed(panel, f"task{number}") for panel in plot.panels))
            for plot in plots
            if plot
        ],
        "reasons": [
            (display_name(row_name(row, rows)), count, display_name(reason, 300))
            for row in rows
            for reason, count in row.reasons[:3]
        ],
    }


def highlights(rows: Sequence[Row]) -> list[dict[str, str]]:
    """The first things to know: who captures most; of the able ones, who is gentlest and fastest."""
    tiles = [_tile("Most captures", "success", rows)]
    able = [row for row in rows if row.figures["success"].value >= ABLE]
    if able:
        tiles.append(_tile("Least attitude left", "final_attitude", able))
        tiles.append(_tile("Lowest eq. 20 cost", "attitude_cost", able))
        tiles.append(_tile("Fastest capture", "time_to_capture", able))
    return tiles


def _tile(label: str, key: str, rows: Sequence[Row]) -> dict[str, str]:
    """The best figure and all who reach it, as far as the digits shown tell them apart."""
    column = next(column for column in COLUMNS if column.key == key)
    sign = -1 if column.better == "higher" else 1
    best = min((column.estimate(row).value for row in rows), key=lambda value: sign * value)
    names = [display_name(row_name(row, rows)) for row in rows if column.value(row) == column.number(best)]
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    return {"label": label, "value": column.number(best), "unit": column.unit, "names": shown}


def _cell(column: Column, row: Row) -> dict[str, Any]:
    estimate = column.estimate(row)
    # Rates are drawn as a bar with their interval; percent of the cell's width.
    drawn = column.unit == "%"
    return {
        "value": column.value(row),
        "interval": column.interval(row),
        # What does not exist sorts behind everything, whichever way the column is turned.
        "sort": repr(estimate.value) if math.isfinite(estimate.value) else "",
        "bar": [f"{end:.1f}" for end in (estimate.value, estimate.low, estimate.high - estimate.low)]
        if drawn
        else None,
    }


def _plots(result: EvaluationResult, shade: Mapping[str, str]) -> list[figures.Plot]:
    """The figures made from traces, policies in the order of the table."""
    traces = {policy: result.traces[policy] for policy in shade if policy in result.traces}
    plots = (figures.attitude_plot(traces, shade), figures.motion_plot(traces))
    return [plot for plot in plots if plot]


def _flat(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested provenance as rows of a list: `versions: numpy` -> 2.4.6."""
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


def _jpeg(policy: str, frame: np.ndarray) -> str:
    """A picture as a data URL."""
    frame = np.asarray(frame)
    if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[-1] != 3:
        raise ConfigurationError(
            f"pictures of {policy!r} must be uint8 (height, width, 3), got {frame.dtype} {frame.shape}"
        )
    buffer = io.BytesIO()
    Image.fromarray(frame).save(buffer, format="JPEG", quality=88)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")


def _template(name: str) -> str:
    return files("space_envs.evaluation").joinpath("templates", name).read_text(encoding="utf-8")
