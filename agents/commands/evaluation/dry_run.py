"""Dry runs: estimates of the time of an evaluation, from measurements on this machine."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text
from tqdm import tqdm

from space_envs.evaluation.harness.chunk_result import evaluate_chunk
from space_envs.evaluation.harness.evaluation import Evaluation
from space_envs.evaluation.harness.policy_times import ROUNDS, TIMED_EPISODES
from space_envs.evaluation.harness.rates import REPORT, Seconds, playing, recorded, remember, timing
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.names import counted, display_name

TRIAL = 2  # episodes measured of a policy without earlier measurements
_WIDE = (0.5, 3.0)  # factors of the interval of an estimate from these few
_STEPS = 0.1  # share of an episode's steps that is timed, in addition to its plan
_UNMEASURED_REPORT = Seconds(1.0, 3.0, 10.0)  # s per entry, before the first report was written


@dataclass(frozen=True)
class TimeEstimate:
    """Seconds of an evaluation: an episode of each entry on one core, and all steps together."""

    episode: dict[LeaderboardEntry, Seconds]
    playing: Seconds
    timing: Seconds
    report: Seconds

    @property
    def total(self) -> Seconds:
        """All together."""
        return self.playing + self.timing + self.report


def estimated_time(chunks: Sequence[Chunk], jobs: int) -> TimeEstimate:
    """Estimated time of an evaluation; a few episodes are evaluated of policies without measurements."""
    first = {chunk.entry: chunk for chunk in reversed(chunks)}
    unknown = [entry for entry in first if recorded(playing(entry)) is None]
    for entry in tqdm(unknown, unit="policy", desc="measuring", leave=False):
        remember({playing(entry): _measured(first[entry])})
    nothing = Seconds(0.0, 0.0, 0.0)
    episode = {entry: recorded(playing(entry)) or nothing for entry in first}
    work = [episode[chunk.entry] * len(chunk.indices) for chunk in chunks]
    share = sum(work, nothing) * (1.0 / min(jobs, len(chunks)))
    # The whole takes at least as long as its longest chunk.
    longest = Seconds(*(max(getattr(one, name) for one in work) for name in ("least", "usual", "most")))
    simulated = Seconds(
        *(max(getattr(one, n) for one in (share, longest)) for n in ("least", "usual", "most"))
    )
    timed = sum((_timing(entry, episode[entry]) for entry in first), nothing)
    return TimeEstimate(episode, simulated, timed, (recorded(REPORT) or _UNMEASURED_REPORT) * len(first))


def _measured(chunk: Chunk) -> Seconds:
    some = replace(chunk, indices=chunk.indices[:TRIAL])
    seconds = evaluate_chunk(some).seconds / len(some.indices)
    return Seconds(_WIDE[0] * seconds, seconds, _WIDE[1] * seconds)


def _timing(entry: LeaderboardEntry, episode: Seconds) -> Seconds:
    known = recorded(timing(entry))
    if known is not None:
        return known
    # Between an episode that only plans and one that only steps; one more episode warms up.
    count = ROUNDS * (TIMED_EPISODES + 1)
    return Seconds(_STEPS * count * episode.least, 0.5 * count * episode.usual, count * episode.most)


def dry_run(evaluation: Evaluation, jobs: int) -> None:
    """Print the policies and episodes of an evaluation, and its estimated time with `jobs` processes."""
    chunks, console = evaluation.chunks(), Console()
    estimate = estimated_time(chunks, jobs)
    for task in dict.fromkeys(chunk.task for chunk in chunks):
        table = Table("policy", box=box.SIMPLE_HEAD, title=str(task), title_justify="left")
        for title in ("episodes", "s an episode", "s on one core"):
            table.add_column(title, justify="right")
        for entry in dict.fromkeys(chunk.entry for chunk in chunks if chunk.task == task):
            episodes = sum(len(chunk.indices) for chunk in chunks if chunk.entry == entry)
            seconds = estimate.episode[entry].usual
            cells = (str(episodes), f"{seconds:.3g}", f"{seconds * episodes:.3g}")
            table.add_row(Text(display_name(entry.policy)), *cells)
        console.print(table)
    total = estimate.total
    console.print(
        f"{counted(len(chunks), 'chunk')} of episodes; about {total.usual:.0f} s, "
        f"between {total.least:.0f} and {total.most:.0f} s: {estimate.playing.usual:.0f} s of episodes with "
        f"{counted(jobs, 'job')}, "
        f"{estimate.timing.usual:.0f} s of timing, {estimate.report.usual:.0f} s for the report. "
        "No results were written.",
        soft_wrap=True,
    )
