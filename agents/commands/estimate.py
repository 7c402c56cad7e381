"""How long an evaluation will take, from what was measured on this machine."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from tqdm import tqdm

from space_envs.evaluation.harness.chunk_result import evaluate_chunk
from space_envs.evaluation.harness.policy_times import ROUNDS, TIMED_EPISODES
from space_envs.evaluation.harness.rates import REPORT, Seconds, playing, recorded, remember, timing
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.entry import LeaderboardEntry

TRIAL = 2  # episodes that are played of a policy of which nothing was measured
_WIDE = (0.5, 3.0)  # of what so few say, the interval
_STEPS = 0.1  # share of an episode's steps that is timed, beside its plan
_UNMEASURED_REPORT = Seconds(1.0, 3.0, 10.0)  # s an entry, until one was written


@dataclass(frozen=True)
class TimeEstimate:
    """Seconds of an evaluation: an episode of each entry on one core, and of all that is done."""

    episode: dict[LeaderboardEntry, Seconds]
    playing: Seconds
    timing: Seconds
    report: Seconds

    @property
    def total(self) -> Seconds:
        """All together."""
        return self.playing + self.timing + self.report


def estimate(chunks: Sequence[Chunk], jobs: int) -> TimeEstimate:
    """What an evaluation will take; a few episodes are played of policies of which nothing was measured."""
    first = {chunk.entry: chunk for chunk in reversed(chunks)}
    unknown = [entry for entry in first if recorded(playing(entry)) is None]
    for entry in tqdm(unknown, unit="policy", desc="measuring", leave=False):
        remember({playing(entry): _measured(first[entry])})
    nothing = Seconds(0.0, 0.0, 0.0)
    episode = {entry: recorded(playing(entry)) or nothing for entry in first}
    work = [episode[chunk.entry] * len(chunk.indices) for chunk in chunks]
    share = sum(work, nothing) * (1.0 / min(jobs, len(chunks)))
    # Nothing is done before its longest part.
    longest = Seconds(*(max(getattr(one, name) for one in work) for name in ("least", "usual", "most")))
    played = Seconds(*(max(getattr(one, n) for one in (share, longest)) for n in ("least", "usual", "most")))
    timed = sum((_timing(entry, episode[entry]) for entry in first), nothing)
    return TimeEstimate(episode, played, timed, (recorded(REPORT) or _UNMEASURED_REPORT) * len(first))


def _measured(chunk: Chunk) -> Seconds:
    some = replace(chunk, indices=chunk.indices[:TRIAL])
    seconds = evaluate_chunk(some).seconds / len(some.indices)
    return Seconds(_WIDE[0] * seconds, seconds, _WIDE[1] * seconds)


def _timing(entry: LeaderboardEntry, episode: Seconds) -> Seconds:
    known = recorded(timing(entry))
    if known is not None:
        return known
    # Between an episode that is all plan, and one that is all steps; one more is played to warm up.
    count = ROUNDS * (TIMED_EPISODES + 1)
    return Seconds(_STEPS * count * episode.least, 0.5 * count * episode.usual, count * episode.most)
