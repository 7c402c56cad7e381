"""Mean returns of all policies next to their kept-attitude scores, on stored episodes of every id.

The episodes of policies that the file lacks are played first, one policy after the other, so that the command
can be stopped and started again. What is stored is what a reward needs of every control period, not the
reward: the tables follow from the reward as it is now.
"""

import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kendalltau, spearmanr
from tqdm import tqdm

from agents.policies.registry import policies_for
from agents.policies.resolve import resolve_policy
from benchmarks.machine import markdown_table
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.rollout import Rollout
from space_envs.registration import ENTRIES, make_task
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.files import write_arrays
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import EPISODE_FIELDS, CaptureErrors, ObservationLayout
from space_envs.tasks.outcome import Outcome, kept_attitude
from space_envs.tasks.rewards import StepQuantities

FILE = Path(__file__).resolve().parents[1] / "tests" / "data" / "returns.npz"
SPLIT, EPISODES = "validation", 16
DISCOUNTS = (1.0, 0.9995)
DIGITS = 3  # of a mean score, as in leaderboards; policies that share them are tied
CAPTURED = [Outcome.CAPTURED.code]
FAILED = [
    outcome.code for outcome in Outcome if outcome.flag == "terminated" and outcome.code not in CAPTURED
]


class StoredEpisodes(NamedTuple):
    """Inputs of a reward from E episodes, one after the other, S states in all.

    Attributes:
        position, orientation, base_speed, attitude, peak_attitude: (S,) in m, rad and m/s, first the state at
            the start of an episode, then one after every control period.
        effort: (S,) mean squared action of the period that ends there.
        length: (E,) control periods. outcome: (E,) codes of `Outcome`.
    """

    position: NDArray
    orientation: NDArray
    base_speed: NDArray
    attitude: NDArray
    peak_attitude: NDArray
    effort: NDArray
    length: NDArray
    outcome: NDArray

    @classmethod
    def of(cls, rollout: Rollout, task: CaptureTask) -> "StoredEpisodes":
        """Those of recorded episodes, in half precision."""
        count, steps = rollout.reward.shape
        kept = np.arange(steps + 1) <= rollout.length[:, None]
        observation = rollout.observation[kept]
        errors = task.errors(observation)
        effort = np.zeros((count, steps + 1))
        effort[:, 1:] = (np.clip(rollout.action, -1.0, 1.0) ** 2).mean(axis=2)
        codes = [Outcome(outcome).code for outcome in rollout.outcome]
        return cls(
            position=errors.position.astype(np.float16),
            orientation=errors.orientation.astype(np.float16),
            base_speed=errors.base_speed.astype(np.float16),
            attitude=task.attitude(observation).astype(np.float16),
            peak_attitude=task.layout.read(observation, "peak_attitude")[:, 0].astype(np.float16),
            effort=effort[kept].astype(np.float16),
            length=rollout.length.astype(np.int16),
            outcome=np.array(codes, np.int8),
        )


def played(env_id: str, name: str) -> StoredEpisodes:
    """Episodes of a policy on the first goals of the split."""
    policy = resolve_policy(name)
    environment = {"env_id": env_id, "control_mode": policy.control_mode}
    rollout = roll_out(policy.factory(0), environment, SPLIT, np.arange(EPISODES), 0)
    return StoredEpisodes.of(rollout, make_task(env_id, {}))


def load(path: Path = FILE) -> dict[tuple[str, str], StoredEpisodes]:
    """Stored episodes by id and policy."""
    if not path.exists():
        return {}
    with np.load(path, allow_pickle=False) as archive:
        names = dict.fromkeys(tuple(key.split("|")[:2]) for key in archive.files)
        return {
            (env_id, policy): StoredEpisodes(
                *(archive[f"{env_id}|{policy}|{field}"] for field in StoredEpisodes._fields)
            )
            for env_id, policy in names
        }


def save(stored: dict[tuple[str, str], StoredEpisodes], path: Path = FILE) -> None:
    """Write episodes by id and policy."""
    arrays = {
        f"{env_id}|{policy}|{field}": value
        for (env_id, policy), episodes in stored.items()
        for field, value in episodes._asdict().items()
    }
    write_arrays(path, arrays, compressed=True)


def weighted_terms(stored: StoredEpisodes, task: CaptureTask) -> Array:
    """Weighted reward terms (P, k) of all control periods, episode after episode."""
    states = stored._replace(**{name: getattr(stored, name).astype(float) for name in stored._fields[:6]})
    last = np.cumsum(stored.length + 1) - 1  # state of each episode
    ends = np.setdiff1d(np.arange(len(states.effort)), last - stored.length)  # of the periods
    outcome = np.full(len(states.effort), Outcome.RUNNING.code)
    outcome[last] = stored.outcome

    def quantities(at: NDArray[np.int64], beginning: StepQuantities | None) -> StepQuantities:
        observation = np.stack([states.peak_attitude[at], np.zeros(len(at))], axis=1)
        still = np.zeros(len(at))
        place, angle, speed = states.position[at], states.orientation[at], states.base_speed[at]
        return StepQuantities(
            observation=observation,
            previous=observation,
            action=np.sqrt(states.effort[at, None]),
            errors=CaptureErrors(place, angle, still, still, speed),
            attitude=states.attitude[at],
            captured=np.isin(outcome[at], CAPTURED),
            failed=np.isin(outcome[at], FAILED),
            layout=ObservationLayout(EPISODE_FIELDS),
            limits=task.limits,
            beginning=beginning,
        )

    return task.weighted_terms(quantities(ends, quantities(ends - 1, None)))


def returns(stored: StoredEpisodes, task: CaptureTask, discount: float = 1.0) -> Array:
    """Discounted sums (E,) of the rewards of the episodes."""
    first = np.cumsum(stored.length) - stored.length
    number = np.arange(stored.length.sum()) - np.repeat(first, stored.length)
    return np.add.reduceat(weighted_terms(stored, task).sum(axis=1) * discount**number, first)


def scores(stored: StoredEpisodes) -> Array:
    """Kept-attitude scores (E,) of the episodes."""
    last = np.cumsum(stored.length + 1) - 1
    return kept_attitude(
        stored.outcome == Outcome.CAPTURED.code, np.rad2deg(stored.peak_attitude[last].astype(float))
    )


class Correlation(NamedTuple):
    """Rank correlations of two figures of the same policies; equal figures share their mean rank."""

    spearman: float
    kendall: float


@cache
def _stored() -> dict[tuple[str, str], StoredEpisodes]:
    return load()


def means(env_id: str, discount: float, task: CaptureTask | None = None) -> dict[str, tuple[float, float]]:
    """Mean score and mean return of every policy with stored episodes of an id, best score first.

    Args:
        task: whose reward is taken; None is the id's own.
    """
    task = make_task(env_id, {}) if task is None else task
    found = {
        policy: (float(scores(episodes).mean()), float(returns(episodes, task, discount).mean()))
        for (name, policy), episodes in _stored().items()
        if name == env_id
    }
    return dict(sorted(found.items(), key=lambda row: (-row[1][0], row[0])))


def rank_correlation(env_id: str, discount: float, task: CaptureTask | None = None) -> Correlation:
    """Rank correlations of mean return and rounded mean score over all policies; arguments as of `means`."""
    score, mean_return = zip(*means(env_id, discount, task).values(), strict=True)
    tied = np.round(score, DIGITS)
    spearman, kendall = (np.asarray(rank(tied, mean_return))[0] for rank in (spearmanr, kendalltau))
    return Correlation(float(spearman), float(kendall))


def missing() -> list[tuple[str, str]]:
    """Ids and policies that fit them, of which no episodes are stored."""
    own = [name for name in ENTRIES if name.startswith("SpaceCapture/")]
    stored = load()
    return [(name, policy) for name in own for policy in policies_for(name) if (name, policy) not in stored]


def section(env_id: str) -> str:
    """Table of all policies on an id, and the rank correlations."""
    columns = [means(env_id, discount) for discount in DISCOUNTS]
    rows = []
    for policy, (score, _) in columns[0].items():
        captured = (_stored()[env_id, policy].outcome == Outcome.CAPTURED.code).mean()
        figures = [f"{column[policy][1]:.2f}" for column in columns]
        rows.append([policy, f"{100.0 * captured:.0f}", f"{score:.4f}", *figures])
    header = ["policy", "captured [%]", "kept-attitude score"]
    header += [f"return, discount {discount:g}" for discount in DISCOUNTS]
    found = [(discount, rank_correlation(env_id, discount)) for discount in DISCOUNTS]
    lines = [f"with discount {d:g} Spearman {c.spearman:.3f} and Kendall {c.kendall:.3f}" for d, c in found]
    correlations = f"Rank correlation of score and return: {', '.join(lines)}."
    return f"**{env_id}**\n\n{markdown_table(header, rows)}\n\n{correlations}"


def main() -> None:
    """Play what is missing, and print the tables."""
    parser = Parser(prog="python -m benchmarks.returns", description=__doc__)
    parser.add_argument("--stored", action="store_true", help="print the tables of what is stored, and stop")
    options = parser.parse_args()
    for env_id, policy in tqdm([] if options.stored else missing(), unit="policy"):
        save(load() | {(env_id, policy): played(env_id, policy)})
    print(f"The first {EPISODES} goals of the split {SPLIT}, difficulty medium.\n")
    print("\n\n".join(section(env_id) for env_id in dict.fromkeys(env_id for env_id, _ in load())))


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.returns", main))
