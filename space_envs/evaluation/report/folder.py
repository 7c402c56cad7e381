"""Write the result folder of an evaluation: records, episodes, summary, tables, plots and the report page."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.normalised import Scores
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.episode_file import save_episodes
from space_envs.evaluation.records.descriptions import description
from space_envs.evaluation.records.episode import RECORDS, REPORT, SCHEMA_VERSION, SUMMARY
from space_envs.evaluation.records.metrics import own_metrics
from space_envs.evaluation.records.names import file_name
from space_envs.evaluation.records.storage import write_records
from space_envs.evaluation.replay.videos import write_videos
from space_envs.evaluation.report.page.html import to_html
from space_envs.evaluation.report.page.scores import all_scores, plain_scores
from space_envs.evaluation.report.plots.all_plots import make_plots
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.csv_file import to_csv
from space_envs.evaluation.report.tables.latex import to_latex
from space_envs.evaluation.report.tables.markdown import to_markdown
from space_envs.evaluation.results.result import EPISODES, EvaluationResult, entry_stem, task_stem
from space_envs.system.digests import file_digest
from space_envs.system.files import atomic_write, atomic_write_text

BOOTSTRAP_SEED = 0


@dataclass(frozen=True)
class ReportPaths:
    """Paths of the files of a report."""

    folder: Path
    records: Path
    summary: Path
    markdown: Path
    csv: Path
    latex: Path
    html: Path
    plots: Path  # a folder
    episodes: Mapping[LeaderboardEntry, Path]
    videos: Mapping[LeaderboardEntry, Path]
    videos_note: str  # why there are none, if videos were asked for


def write_report(
    result: EvaluationResult,
    folder: str | Path,
    generator: np.random.Generator | None = None,
    videos: bool = False,
) -> ReportPaths:
    """Write every file of the report, each whole or not at all, and return their paths.

    The same result gives the same bytes, apart from what a clock decided. The bootstrap draws from
    `generator`, by default a fresh one of seed 0. With `videos`, an mp4 of each entry's best episode is
    written too, where this machine can draw. Raises ConfigurationError where records do not fit together.
    """
    if not result.records:
        raise ConfigurationError("a report needs at least one record")
    generator = np.random.default_rng(BOOTSTRAP_SEED) if generator is None else generator
    rows = build_rows(result.records, generator, described=result.described)
    scores = all_scores(result.records, result.experts, generator)
    summary_json(result, rows, scores, {})  # refuses provenance that is not plain, before plots take time
    plots = make_plots(result, rows, scores, generator)
    folder = Path(folder)
    episodes = {entry: folder / EPISODES / f"{entry_stem(entry)}.npz" for entry in result.episodes}
    # All text is made first, so that a result that cannot be reported leaves the folder as it was.
    texts = {
        "leaderboard.md": to_markdown(rows),
        "leaderboard.csv": to_csv(rows),
        "leaderboard.tex": to_latex(rows),
        REPORT: to_html(result, rows, plots, scores),
    }
    for entry, path in episodes.items():
        save_episodes(path, result.episodes[entry])
    write_records(folder / RECORDS, result.records)
    for name, text in texts.items():
        atomic_write_text(folder / name, text)
    relied_on = [folder / RECORDS, *episodes.values()]
    checksums = {path.relative_to(folder).as_posix(): file_digest(path) for path in relied_on}
    atomic_write_text(folder / SUMMARY, summary_json(result, rows, scores, checksums))
    write_plots(plots, folder / "plots")
    written, note = {}, ""
    if videos:
        targets = {
            entry: (replays[0], folder / "videos" / f"{entry_stem(entry)}.mp4")
            for entry, replays in result.replays.items()
            if replays
        }
        written, note = write_videos(targets)
    _remove_others(folder / EPISODES, "*.npz", episodes.values())
    _remove_others(folder / "videos", "*.mp4", written.values())
    return ReportPaths(
        folder=folder,
        records=folder / RECORDS,
        summary=folder / SUMMARY,
        markdown=folder / "leaderboard.md",
        csv=folder / "leaderboard.csv",
        latex=folder / "leaderboard.tex",
        html=folder / REPORT,
        plots=folder / "plots",
        episodes=episodes,
        videos=written,
        videos_note=note,
    )


def summary_json(
    result: EvaluationResult, rows: Sequence[Row], scores: Scores, checksums: Mapping[str, str]
) -> str:
    """Content of summary.json: provenance, rows, the tasks' own metrics, and checksums of files."""
    summary = {
        "schema": SCHEMA_VERSION,
        "provenance": result.provenance,
        "rows": [
            row.to_dict()
            | {"normalised": plain_scores(scores[row.entry])}
            | {
                "episodes": f"{EPISODES}/{entry_stem(row.entry)}.npz"
                if row.entry in result.episodes
                else None
            }
            for row in rows
        ],
        "metrics": {
            env_id: [description(metric) for metric in own]
            for env_id in dict.fromkeys(row.task.env_id for row in rows)
            if (own := own_metrics(env_id, result.described))
        },
        "checksums": dict(checksums),
    }
    try:
        return json.dumps(summary, indent=2, allow_nan=False) + "\n"
    except (TypeError, ValueError) as error:
        raise ConfigurationError(f"provenance must hold plain JSON values: {error}") from error


def _remove_others(folder: Path, pattern: str, kept: Iterable[Path]) -> None:
    """Remove files that an earlier evaluation left in the folder."""
    for path in set(folder.glob(pattern)) - set(kept):
        path.unlink()


def write_plots(plots: Mapping[EvaluatedTask, Sequence[Plot]], folder: Path) -> list[Path]:
    """Write each panel as SVG and as PNG into a folder for each task; older plots there are removed."""
    panels = [
        (folder / task_stem(task), panel)
        for task, group in plots.items()
        for plot in group
        for panel in plot.panels
    ]
    written = []
    for place, panel in tqdm(panels, unit="plot", desc="plots", leave=False):
        path = place / f"{file_name(panel.key)}.svg"
        atomic_write_text(path, panel.standalone_svg())
        with atomic_write(path.with_suffix(".png")) as temporary:
            temporary.write_bytes(panel.png())
        written += [path, path.with_suffix(".png")]
    for path in {*folder.glob("*/*.svg"), *folder.glob("*/*.png")} - set(written):
        path.unlink()
    return written
