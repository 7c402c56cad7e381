"""Normalised scores against hand-worked cases."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_results import entry, make_result, played

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.normalised import SCORES, normalised_scores
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.report.folder import write_report
from space_envs.evaluation.report.page.html import to_html
from space_envs.evaluation.report.page.scores import all_scores, plain_scores


def test_normalised_success_by_hand() -> None:
    records = (
        played("random", [None, None, None, 1.0])
        + played("expert", [1.0, 1.0, 1.0, 1.0])
        + played("lesser", [1.0, None, None, None])
        + played("mine", [1.0, 1.0, None, 3.0])
    )
    scores = normalised_scores(records, {"expert", "lesser", "absent"}, np.random.default_rng(0))
    assert SCORES[0] == "kept_attitude_score" and list(scores[entry("mine")]) == list(SCORES)
    mine = scores[entry("mine")]["success"]
    assert mine.estimate is not None and mine.expert == "expert"
    # (3/4 - 1/4) / (1 - 1/4)
    assert mine.estimate.value == pytest.approx(2 / 3)
    assert mine.estimate.low < mine.estimate.value < mine.estimate.high <= 1
    for policy, value in (("random", 0), ("lesser", 0), ("expert", 1)):
        found = scores[entry(policy)]["success"].estimate
        assert found is not None and found.value == pytest.approx(value, abs=1e-12)
    # Within 1 deg: random 1/4, the expert 4/4, mine 2/4.
    within = scores[entry("mine")]["capture@1deg"].estimate
    assert within is not None and within.value == pytest.approx(1 / 3)
    # Scores of 1/2 and 1/4: mine has (1/2 + 1/2 + 1/4) / 4, random 1/8, the expert 1/2.
    main = scores[entry("mine")][SCORES[0]].estimate
    assert main is not None and main.value == pytest.approx((5 / 16 - 1 / 8) / (1 / 2 - 1 / 8))


def test_captures_within_an_attitude_throughout_are_scored_by_the_peak() -> None:
    records = (
        played("random", [None] * 4)
        + played("expert", [0.5] * 4)
        + played("mine", [0.5, 0.5, 0.5, None], peak_attitude=2.0)
    )
    scores = normalised_scores(records, {"expert"}, np.random.default_rng(0))[entry("mine")]
    for name, value in (("capture@1deg", 0.75), ("kept@5deg", 0.75), ("kept@1deg", 0.0)):
        found = scores[name].estimate
        assert found is not None and found.value == pytest.approx(value), name


def test_normalised_cost_by_hand() -> None:
    # Random ends at 8 deg, so an episode scores 1 - attitude / 8: the expert's 3/4, mine 1/2, 1/2, 0 and 0.
    records = (
        played("random", [None] * 4)
        + played("hold", [None] * 4)
        + played("expert", [2.0] * 4)
        + played("mine", [4.0, 4.0, None, 10.0])
    )
    scores = normalised_scores(records, {"expert"}, np.random.default_rng(0))
    mine, hold, best = (scores[entry(p)]["final_attitude"].estimate for p in ("mine", "hold", "expert"))
    assert mine is not None and hold is not None and best is not None
    assert mine.value == pytest.approx((1 / 4) / (3 / 4))
    assert 0 <= mine.low < mine.value < mine.high
    assert (hold.value, best.value) == (0, 1)


def test_normalised_time_by_hand() -> None:
    # 0.1 s a step, 200 steps at most: an episode scores 1 - time / 20 s.
    records = (
        played("random", [None] * 3)
        + played("expert", [1.0] * 3, time_to_capture=10.0, steps=100)
        + played("slow", [1.0] * 3, time_to_capture=15.0, steps=150)
    )
    scores = normalised_scores(records, {"expert"}, np.random.default_rng(0))
    slow = scores[entry("slow")]["time_to_capture"].estimate
    assert slow is not None and slow.value == pytest.approx(0.25 / 0.5)


@pytest.mark.parametrize(
    ("records", "name", "reason"),
    [
        (played("expert", [1.0]), "success", "no episodes of 'random'"),
        (played("random", [1.0]) + played("a", [1.0]), "success", "no episodes of an expert"),
        (played("random", [1.0, None]) + played("expert", [1.0, None]), "success", "no expert is better"),
        (played("random", [0.0]) + played("expert", [0.0]), "final_attitude", "is zero"),
        (
            played("random", [None], final_attitude=None) + played("expert", [0.0]),
            "final_attitude",
            "is missing",
        ),
        (played("random", [None]) + played("expert", [None]), "time_to_capture", "no expert captured"),
    ],
)
def test_a_missing_reference_is_a_reason(records: list[EpisodeRecord], name: str, reason: str) -> None:
    for scores in normalised_scores(records, {"expert", "random"}, np.random.default_rng(0)).values():
        assert scores[name].estimate is None
        assert reason in str(scores[name].reason)


def test_scores_of_several_tasks_are_refused() -> None:
    records = played("a", [1.0]) + played("a", [1.0], split="train")
    with pytest.raises(ConfigurationError, match="train split"):
        normalised_scores(records, (), np.random.default_rng(0))


@pytest.mark.usefixtures("brief_reports")
def test_scores_stand_in_the_summary_and_on_the_page(tmp_path: Path) -> None:
    made = make_result(episodes=6, policies=("random", "mpc", "gjm"))
    paths = write_report(replace(made, experts=("mpc", "gjm")), tmp_path)
    rows = {row["policy"]: row["normalised"] for row in json.loads(paths.summary.read_text())["rows"]}
    assert rows["random"]["success"]["value"] == 0.0
    assert max(rows[name]["success"]["value"] for name in ("mpc", "gjm")) == 1.0
    page = paths.html.read_text()
    assert "Normalised scores" in page
    assert "1 is mpc" in page or "1 is gjm" in page
    without = all_scores(made.records, (), np.random.default_rng(0))
    table = build_rows(made.records, np.random.default_rng(0), resamples=200)
    reason = plain_scores(without[table[0].entry])["success"]["reason"]
    assert reason and reason in to_html(made, table, {table[0].task: []}, without)
