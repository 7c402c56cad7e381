"""Episodes written by hand, for the tests that compare policies."""

from collections.abc import Sequence

import numpy as np
from synthetic_results import make_record

from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.episode import EpisodeRecord


def played(
    policy: str, attitudes: Sequence[float | None], seed: int = 0, start: int = 0, **changes: object
) -> list[EpisodeRecord]:
    """An episode for each attitude, at the end and at most; None is a failure that turned by 8 deg."""
    records = []
    for number, attitude in enumerate(attitudes):
        end: dict[str, object] = {"final_attitude": attitude, "peak_attitude": attitude}
        if attitude is None:
            end = {
                "final_attitude": 8.0,
                "peak_attitude": 8.0,
                "captured": False,
                "outcome": "timeout",
                "time_to_capture": None,
            }
            end |= {"steps": 200}
        records.append(
            make_record(policy=policy, seed=seed, episode=number, index=start + number, **(end | changes))
        )
    return records


def rows_of(records: Sequence[EpisodeRecord]) -> list[Row]:
    return build_rows(records, np.random.default_rng(0), resamples=50)
