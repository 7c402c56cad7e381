"""An evaluation from its first chunk to the printed table."""

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from rich.console import Console

from agents.commands.choice import expert_names
from agents.commands.evaluation.defects import defects
from agents.commands.show import show
from agents.policies.registry import POLICIES
from space_envs.codegen.libraries import warned_once
from space_envs.evaluation.harness.evaluation import Evaluated, Evaluation
from space_envs.evaluation.harness.policy_times import policy_times
from space_envs.evaluation.harness.rates import REPORT, Seconds, playing, recorded, remember, timing
from space_envs.evaluation.harness.runner import EVALUATION, collect, finish, play_missing, prepare
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.configuration import config_hash, configuration
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.replay.replay import Replay, make_replays
from space_envs.evaluation.replay.stills import capture_pictures
from space_envs.evaluation.report.folder import BOOTSTRAP_SEED, ReportPaths, write_report
from space_envs.evaluation.report.tables.terminal import to_terminal
from space_envs.evaluation.results.folders import read_folder
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.registration import make_task
from space_envs.system.output import held
from space_envs.system.provenance import provenance


@dataclass(frozen=True)
class RunOptions:
    """Options of the run of an evaluation, which do not affect the records.

    Attributes:
        output: folder of the results. resume, overwrite: whether to continue or replace results in it.
        jobs, backend, address: of the processes. pictures, videos: whether to draw captures.
        arguments: of the command line, for the provenance.
    """

    output: Path
    resume: bool = False
    overwrite: bool = False
    jobs: int = 1
    backend: str = "loky"
    address: str | None = None
    pictures: bool = True
    videos: bool = False
    arguments: tuple[str, ...] = ()


def run(evaluation: Evaluation, options: RunOptions) -> int:
    """Evaluate the chunks that have no result yet, write every file of the results, and print the table.

    Returns:
        The exit status: 1 if a built-in policy raised or returned no actions, a defect of the project.

    Raises:
        SpaceEnvsError: if the folder cannot be used or read, or a policy ends its process.
    """
    with held(options.output, EVALUATION):
        return _run_alone(evaluation, options)


def _run_alone(evaluation: Evaluation, options: RunOptions) -> int:
    started = perf_counter()
    folder = options.output
    if not prepare(evaluation, folder, options.resume, options.overwrite):
        done = read_folder(folder)
        show(done.records, folder, done.described, notes=(f"{folder} is complete; nothing was evaluated",))
        return _status(evaluation, done.records)
    chunks = evaluation.chunks()
    with warned_once():
        play_missing(chunks, folder, options.jobs, options.backend, options.address)
        times, spent = policy_times(chunks, folder)
    evaluated = list(collect(chunks, times, folder))
    before = perf_counter()
    result = _result(evaluation, chunks, evaluated, options, started)
    paths = write_report(result, folder, videos=options.videos)
    finish(folder)
    _remember(evaluated, spent, (perf_counter() - before) / len(evaluated))
    _show(result, paths)
    return _status(evaluation, result.records)


def _remember(evaluated: Sequence[Evaluated], spent: Mapping[LeaderboardEntry, float], report: float) -> None:
    """Store the measured times for dry runs of later evaluations."""
    rates = {playing(one.episodes.entry): Seconds.of(one.pace) for one in evaluated}
    rates |= {timing(entry): Seconds.of([seconds]) for entry, seconds in spent.items()}
    before = recorded(REPORT)
    known = [report] if before is None else [report, before.least, before.most]
    remember(rates | {REPORT: Seconds(min(known), report, max(known))})


def _status(evaluation: Evaluation, records: Sequence[EpisodeRecord]) -> int:
    """Print the defects of built-in policies; returns the exit status."""
    built_in = [
        policy.name for _, policy in evaluation.entries if getattr(policy, "source", None) in POLICIES
    ]
    found = defects(records, built_in)
    for line in found:
        print(f"evaluate.py: {line}", file=sys.stderr)
    if found:
        print("evaluate.py: that is a fault of this project, and no score of the policy", file=sys.stderr)
    return 1 if found else 0


def _result(
    evaluation: Evaluation,
    chunks: list[Chunk],
    evaluated: list[Evaluated],
    options: RunOptions,
    started: float,
) -> EvaluationResult:
    """Results from which the report is made."""
    records: list[EpisodeRecord] = []
    episodes: dict[LeaderboardEntry, EpisodeBatch] = {}
    replays: dict[LeaderboardEntry, tuple[Replay, ...]] = {}
    pictures: dict[LeaderboardEntry, Any] = {}
    notes: set[str] = set()
    for one in evaluated:
        entry, task = one.episodes.entry, one.episodes.task()
        records += one.records
        episodes[entry] = one.episodes
        replays[entry] = make_replays(task, one.episodes, one.records)
        if options.pictures:
            frames, note = capture_pictures(task, {entry: one.episodes})
            pictures |= frames
            notes |= {note} if note else set()
    note = "Pictures were switched off with --no-pictures."
    if options.pictures:
        note = "" if pictures else " ".join(sorted(notes))
    about = _about(evaluation, chunks, options, started)
    return EvaluationResult(records, episodes, about, pictures, note, replays, expert_names())


def _about(
    evaluation: Evaluation, chunks: list[Chunk], options: RunOptions, started: float
) -> dict[str, Any]:
    """Provenance: what is needed to repeat the evaluation and to check whether another is comparable."""
    command = shlex.join(["evaluate.py", *options.arguments])
    configurations = {}
    for chunk in {chunk.entry: chunk for chunk in chunks}.values():
        task, mode = make_task(chunk.task.env_id, chunk.keywords), chunk.policy.control_mode
        configurations[config_hash(chunk.task.env_id, mode, task)] = configuration(
            chunk.task.env_id, mode, task
        )
    return {
        **provenance(command, evaluation.seeds),
        "configurations": configurations,
        "timing": {
            "finished": datetime.now(UTC).isoformat(timespec="seconds"),
            "seconds": round(perf_counter() - started, 1),
            "jobs": options.jobs,
            "backend": options.backend,
        },
    }


def _show(result: EvaluationResult, paths: ReportPaths) -> None:
    console = Console()
    to_terminal(build_rows(result.records, np.random.default_rng(BOOTSTRAP_SEED)), console)
    console.print()
    for label, path in (
        ("Report", paths.html),
        ("Leaderboard", paths.markdown),
        ("Table", paths.csv),
        ("Records", paths.records),
        ("Summary", paths.summary),
    ):
        console.print(f"{label + ':':13}{path}", highlight=False, soft_wrap=True, markup=False)
    if paths.videos_note:
        print(paths.videos_note, file=sys.stderr)
