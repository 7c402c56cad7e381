"""Scores on a scale from `random` (0) to the best expert (1).

A policy's score s is the mean of its episodes' scores in 0..1, more being better. An episode's kept-attitude
score is captured / (1 + peak attitude / 1 deg). For `success`, `capture@N deg` and `kept@N deg` it scores 1
where it captured (and ended, or stayed, within that attitude), else 0. For a cost it scores
max(0, 1 - cost / worst), and 0 where it did not capture, so that nothing is worse than a failure. The worst
final attitude and the worst base disturbance are the interquartile means of random's episodes as they ended;
the worst time to capture is the length of the longest episode of random and the experts.

The normalised score is (s - s_random) / (s_expert - s_random): below 0 the policy is worse than random, above
1 better than every expert. The best expert is found for each score by itself.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from space_envs.evaluation.leaderboard.comparison import COSTS, by_entry, episode_costs, seeds_of, words
from space_envs.evaluation.leaderboard.figures import HEADLINE, capture_key, kept_key, metric_values
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.statistics.averages import interquartile_mean
from space_envs.evaluation.statistics.intervals import Estimate, share_bootstrap, stratified_bootstrap
from space_envs.evaluation.statistics.resampling import named_generator
from space_envs.evaluation.statistics.scores import ATTITUDE_LIMITS
from space_envs.tasks.outcome import kept_attitude

# Name of a rate -> the record's field and the limit on it, deg.
RATES: Mapping[str, tuple[str, float]] = {
    "success": ("final_attitude", math.inf),
    **{capture_key(limit): ("final_attitude", limit) for limit in ATTITUDE_LIMITS},
    **{kept_key(limit): ("peak_attitude", limit) for limit in ATTITUDE_LIMITS},
}
SCORES = (HEADLINE, *RATES, *COSTS)
REFERENCE = "random"


@dataclass(frozen=True)
class NormalisedScore:
    """One score of a policy, or the reason why there is none.

    The interval is that of the policy's own episodes; the two reference scores are taken as they are.
    """

    estimate: Estimate | None
    expert: str | None  # the policy that has 1
    reason: str | None


Scores = Mapping[LeaderboardEntry, Mapping[str, NormalisedScore]]
"""Of each entry, by the names in SCORES."""


@dataclass(frozen=True)
class _Scale:
    merits: Mapping[LeaderboardEntry, np.ndarray]  # score of each episode
    zero: float
    one: float
    expert: str


def normalised_scores(
    records: Sequence[EpisodeRecord],
    experts: Collection[str],
    generator: np.random.Generator,
    resamples: int = 5000,
) -> dict[LeaderboardEntry, dict[str, NormalisedScore]]:
    """Each of SCORES of each policy of one task; the first is the one for a single number.

    `experts` are names of policies; those without records do not count. Where several entries are called
    `random` (in several control modes), the best of them has 0. Raises ConfigurationError for records of
    several tasks.
    """
    entropy = int(generator.integers(2**63))
    players = by_entry(records)
    scores: dict[LeaderboardEntry, dict[str, NormalisedScore]] = {entry: {} for entry in players}
    for name in SCORES:
        scale = _scale(name, players, experts)
        for entry, played in players.items():
            if isinstance(scale, str):
                scores[entry][name] = NormalisedScore(None, None, scale)
                continue
            stream = named_generator(entropy, name, *words(entry))
            raw = _mean(scale.merits[entry], seeds_of(played), stream, resamples, name in RATES)
            ends = ((end - scale.zero) / (scale.one - scale.zero) for end in (raw.value, raw.low, raw.high))
            scores[entry][name] = NormalisedScore(Estimate(*ends), scale.expert, None)
    return scores


def _scale(
    name: str, players: Mapping[LeaderboardEntry, list[EpisodeRecord]], experts: Collection[str]
) -> _Scale | str:
    """The scores of all episodes and the two references, or the reason why there is no such scale."""
    bottom = [entry for entry in players if entry.policy == REFERENCE]
    top = [entry for entry in players if entry.policy in experts and entry.policy != REFERENCE]
    if not bottom:
        return f"there are no episodes of {REFERENCE!r}, which has the score 0"
    if not top:
        return "there are no episodes of an expert, the best of which has the score 1"
    worst = None
    if name in COSTS:
        worst = _worst(name, *([r for entry in side for r in players[entry]] for side in (bottom, top)))
        if isinstance(worst, str):
            return worst
    merits = {entry: _merit(played, name, worst) for entry, played in players.items()}
    zero = max(float(merits[entry].mean()) for entry in bottom)
    best = max(top, key=lambda entry: merits[entry].mean())
    one = float(merits[best].mean())
    if one <= zero:
        return f"no expert is better than {REFERENCE!r} in {name}"
    return _Scale(merits, zero, one, best.policy)


def _worst(name: str, bottom: list[EpisodeRecord], top: list[EpisodeRecord]) -> float | str:
    """The cost from which on an episode scores 0, or the reason why there is none."""
    if name == "time_to_capture":
        times, steps = metric_values(top, name), metric_values(top, "steps")
        captured = np.isfinite(times) & (times > 0)
        if not captured.any():
            return "no expert captured"
        longest = metric_values(bottom + top, "steps").max()
        return float((times[captured] / steps[captured]).max() * longest)
    worst = float(interquartile_mean(metric_values(bottom, name)))
    if 0 < worst < math.inf:
        return worst
    return f"{name} of {REFERENCE!r} is {'zero' if worst == 0 else 'missing in too many episodes'}"


def _merit(records: Sequence[EpisodeRecord], name: str, worst: float | None) -> np.ndarray:
    """The score of each episode (n,) in 0..1."""
    if worst is not None:
        return np.clip(1 - episode_costs(records, name) / worst, 0, 1)
    captured = np.array([record.captured for record in records])
    attitude = metric_values(records, RATES.get(name, ("peak_attitude", 0.0))[0])
    if name == HEADLINE:
        return kept_attitude(captured, attitude)
    return (captured & (attitude <= RATES[name][1])).astype(np.float64)


def _mean(
    values: np.ndarray, strata: np.ndarray, generator: np.random.Generator, resamples: int, shares: bool
) -> Estimate:
    if not shares:
        return stratified_bootstrap(values, strata, generator, lambda drawn: drawn.mean(axis=-1), resamples)
    found = share_bootstrap(values[:, None], strata, generator, resamples)
    return Estimate(float(found.value[0]), float(found.low[0]), float(found.high[0]))
