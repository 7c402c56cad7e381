"""Rows of the leaderboard: hand-worked figures, ranking, what failures count, digits, and what is told."""

import dataclasses
import io
import math
import re

import pytest
from rich.console import Console
from synthetic_results import failed, make_record, make_result, rows_of, timed

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.columns import COLUMNS, NOTE, RULES, column_named, leaders
from space_envs.evaluation.leaderboard.figures import FIGURES, SHARES
from space_envs.evaluation.leaderboard.rounding import interval, rounded
from space_envs.evaluation.leaderboard.rounding import supported_decimals as decimals
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.report.folder import write_report
from space_envs.evaluation.report.tables.latex import to_latex
from space_envs.evaluation.report.tables.markdown import to_markdown
from space_envs.evaluation.report.tables.terminal import to_terminal
from space_envs.evaluation.report.tables.wording import failure_summaries
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.evaluation.statistics.intervals import Estimate


def printed(rows: list[Row]) -> str:
    """What a pipe gets."""
    file = io.StringIO()
    to_terminal(rows, Console(file=file))
    return file.getvalue()


# Rows


def test_a_row_by_hand() -> None:
    attitudes = [0.05, 0.5, 4.0, 9.0, 1.0]
    times = [8.0, 10.0, 12.0, None, None]
    records = [
        make_record(
            episode=number,
            captured=seconds is not None,
            outcome="captured" if seconds is not None else "timeout",
            time_to_capture=seconds,
            final_attitude=attitude,
            peak_attitude=3.0 * attitude,
            timing=timed(10.0 * number if number else None, 1.0),
        )
        for number, (attitude, seconds) in enumerate(zip(attitudes, times, strict=True))
    ]
    (row,) = rows_of(records)
    figures = row.figures
    assert figures["success"].value == 0.6
    assert [figures[f"capture@{limit}deg"].value for limit in ("5", "1", "0.1")] == [0.6, 0.4, 0.2]
    assert [figures[f"kept@{limit}deg"].value for limit in ("5", "1", "0.1")] == [0.4, 0.2, 0.0]
    # Three captures with peaks of 0.15, 1.5 and 12 deg, and two failures that count nothing.
    score = (1 / 1.15 + 1 / 2.5 + 1 / 13) / 5
    assert figures["kept_attitude_score"].value == pytest.approx(score)
    # Of the three captures alone; of three values none is cut.
    assert figures["final_attitude"].value == pytest.approx(4.55 / 3)
    assert figures["time_to_capture"].value == 10.0
    assert figures["cost_times_duration"].value == pytest.approx(0.006 * 9.0)
    assert row.timing == {"planning_ms": 25.0, "action_ms": 1.0}
    assert (row.rank, row.episodes, row.captures, row.seeds) == (1, 5, 3, (0,))
    assert row.outcomes["timeout"] == 2
    assert set(figures) == set(FIGURES)


def test_figures_of_motion_and_cost_do_not_exist_without_a_capture() -> None:
    (row,) = rows_of([failed(final_attitude=0.0), failed(episode=1, final_attitude=0.0)])
    plain = row.to_dict()["figures"]
    without = {key for key, figure in plain.items() if figure["value"] is None}
    assert without == set(FIGURES) - {"kept_attitude_score", *SHARES}
    assert plain["final_attitude"] == {"value": None, "low": None, "high": None}
    assert (row.captures, row.rank, plain["kept_attitude_score"]["value"]) == (0, None, 0.0)
    for column in COLUMNS:
        if column.key in without:
            assert (column.value(row), column.interval(row)) == ("-", "")


def test_failures_do_not_change_figures_of_motion_and_cost() -> None:
    captures = [make_record(episode=k, attitude_cost=0.01 * k, peak_attitude=1.0 + k) for k in range(8)]
    still = [
        failed(episode=k, attitude_cost=0.0, peak_attitude=0.0, final_attitude=0.0) for k in range(8, 16)
    ]
    (alone,), (both,) = rows_of(captures), rows_of(captures + still)
    for key in set(FIGURES) - {"kept_attitude_score", *SHARES}:
        assert both.figures[key] == alone.figures[key], key
    assert both.figures["kept_attitude_score"].value == alone.figures["kept_attitude_score"].value / 2


def test_rows_are_ranked_by_the_score_then_success_then_cost_then_name() -> None:
    records = [
        failed(policy="still", peak_attitude=0.0),
        make_record(policy="turning", peak_attitude=9.0),
        make_record(policy="costly", peak_attitude=1.0, attitude_cost=0.2),
        make_record(policy="b", peak_attitude=1.0, attitude_cost=0.1),
        make_record(policy="a", peak_attitude=1.0, attitude_cost=0.1),
        # Half of the goals at twice the score are as good as all of them, and stand behind.
        make_record(policy="half", peak_attitude=0.0),
        failed(policy="half", episode=1),
    ]
    rows = rows_of(records)
    assert [row.policy for row in rows] == ["a", "b", "costly", "half", "turning", "still"]
    assert [row.rank for row in rows] == [1, 2, 3, 4, 5, None]
    assert rows_of(records[::-1]) == rows


def test_baselines_and_what_captured_nothing_are_never_best() -> None:
    best = {"peak_attitude": 0.0, "final_attitude": 0.0, "attitude_cost": 0.0, "time_to_capture": 1.0}
    quick = timed(0.1, 0.001)
    records = [make_record(policy=p, timing=quick, **best) for p in ("hold", "random", "hold (Ann)")]
    records += [failed(policy="nothing", timing=quick, **best | {"time_to_capture": None})]
    rows = rows_of([*records, make_record(policy="mine")])
    assert [(row.policy, row.rank) for row in rows][0] == ("mine", 1)
    assert {row.rank for row in rows[1:]} == {None}
    for column in COLUMNS:
        assert {row.policy for row in leaders(column, rows)} <= {"mine"}, column.key
    assert leaders(column_named("kept-attitude score"), rows_of(records)) == []


def test_who_captures_easy_goals_alone_is_not_marked_gentle() -> None:
    records = [make_record(policy="every", episode=k, attitude_cost=0.02) for k in range(10)]
    records += [make_record(policy="easy", episode=k, attitude_cost=0.001) for k in range(5)]
    records += [failed(policy="easy", episode=k) for k in range(5, 10)]
    rows = rows_of(records)
    assert [row.policy for row in leaders(column_named("attitude_cost"), rows)] == ["every"]


def test_tasks_and_control_modes_never_share_a_row() -> None:
    records = [
        make_record(difficulty="hard"),
        make_record(difficulty="easy"),
        make_record(split="ood"),
        make_record(control_mode="reactionless"),
        make_record(env_id="SpaceCapture/Other-v0"),
        make_record(env_id="SpaceCapture/DualArmPlanar-v0"),
    ]
    rows = rows_of(records)
    assert [(r.task.env_id[13:18], r.task.difficulty, r.task.split, r.rank) for r in rows] == [
        ("Singl", "easy", "test", 1),
        ("Singl", "medium", "test", 1),
        ("Singl", "medium", "ood", 1),
        ("Singl", "hard", "test", 1),
        ("DualA", "medium", "test", 1),
        ("Other", "medium", "test", 1),
    ]


def test_a_row_depends_on_its_own_records_only() -> None:
    records = list(make_result(episodes=10).records)
    every = {row.policy: row for row in rows_of(records)}
    mine = [record for record in records if record.policy == "promp"]
    (alone,) = rows_of(mine[::-1])
    assert alone == dataclasses.replace(every["promp"], rank=1)
    assert every["promp"].figures["final_attitude"].low < every["promp"].figures["final_attitude"].high


def test_what_does_not_belong_together_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="episode 0 of seed 0 of 'mpc'.*2 times"):
        rows_of([make_record(), make_record()])
    with pytest.raises(ConfigurationError, match="mix the configurations"):
        rows_of([make_record(), make_record(episode=1, config_hash="f" * 12)])
    with pytest.raises(ConfigurationError, match="mix the versions 1 and 3 of the task"):
        rows_of([make_record(), make_record(policy="gjm", task_version=1)])


# What is told


@pytest.mark.usefixtures("brief_reports")
def test_every_failed_episode_is_counted_under_its_cause(tmp_path) -> None:
    causes = ["infeasible"] * 10 + ["singular"] * 4 + ["joint_limit"] * 2 + ["timeout"] * 2
    records = [
        failed(
            policy="reactionless",
            episode=k,
            cause=cause,
            # Each of another joint at another time: sentences are no causes.
            reason=None if cause == "timeout" else f"joint {k % 3 + 1} would need 0.{k}83 rad/s <b>\x1b[3m",
        )
        for k, cause in enumerate(causes)
    ]
    records += [make_record(policy="reactionless", episode=k) for k in (18, 19)]
    records += [failed(policy="bc", outcome="collision"), failed(policy="bc", episode=1, outcome="diverged")]
    records += [failed(policy="gjm", outcome="policy_error", reason="late")]
    records += [make_record(policy="perfect")]
    rows = rows_of(records)
    told = dict(failure_summaries(rows))
    assert told == {
        "reactionless": "18 of 20: 10 infeasible, 4 singular, 2 joint limit, 2 timeouts",
        "bc": "2 of 2: 1 diverged, 1 collision",
        "gjm": "1 of 1: 1 policy error",
    }
    for row in rows:
        assert sum(each.count for each in row.failures) == row.episodes - row.captures
    text, markdown = printed(rows), to_markdown(rows)
    page = write_report(EvaluationResult(records), tmp_path).html.read_text(encoding="utf-8")
    for name, line in told.items():
        assert f"Failed: {name}, {line}\n" in text
        assert f"\n- {name}, {line}\n" in markdown
        assert f"<dt>{name}</dt><dd>{line}</dd>" in page
    assert "\x1b" not in text and "Failed: perfect" not in text


def test_the_rules_stand_under_every_table() -> None:
    rows = rows_of([make_record(), make_record(difficulty="hard")])
    text = " ".join(printed(rows).split())
    for rule in RULES:
        assert text.count(rule) == to_markdown(rows).count(rule) == to_latex(rows).count(rule) == 2
        assert not re.search(r"[\\#$%&_{}~^<>|\"]", rule)  # LaTeX would read them
    assert text.count(NOTE) == 1
    assert "the mean over all episodes of captured / (1 + peak attitude / 1 deg)" in RULES[0]
    assert any("falls with slowness" in rule for rule in RULES)


# Digits


@pytest.mark.parametrize(
    ("estimate", "value", "ends"),
    [
        ((0.000344, 0.000260, 0.000474), "0.00034", "[0.00026, 0.00047]"),  # half the width is 1.07e-4
        ((34.1, 26.1, 43.6), "34", "[26, 44]"),
        ((0.744, 0.629, 0.912), "0.74", "[0.63, 0.91]"),
        ((5.03, 4.56, 5.53), "5.0", "[4.6, 5.5]"),
        ((104.0, 23.2, 251.0), "100", "[20, 250]"),
        ((25.6, 25.58, 25.62), "25.6", "[25.6, 25.6]"),  # never more than three
        ((4.12e-06, 2.44e-06, 6.61e-06), "4.1e-06", "[2.4e-06, 6.6e-06]"),
        ((0.04, 0.001, 3.0), "0.04", "[0, 3.00]"),  # never less than one
        ((0.0, 0.0, 0.0370), "0", "[0, 0.037]"),
        ((1234567.0, 1100000.0, 1400000.0), "1.23e+06", "[1.10e+06, 1.40e+06]"),
        ((7.0, 7.0, 7.0), "7.00", "[7.00, 7.00]"),
        ((12.345, math.nan, math.nan), "12", ""),
        ((12.345, -math.inf, math.inf), "12", ""),
        ((math.nan, math.nan, math.nan), "-", ""),
        ((math.inf, 3.0, math.inf), "-", ""),
    ],
)
def test_figures_have_the_digits_that_their_interval_supports(
    estimate: tuple[float, float, float], value: str, ends: str
) -> None:
    found = Estimate(*estimate)
    assert rounded(found.value, decimals(found)) == value
    assert interval(found) == ends


def test_every_table_shows_the_same_digits() -> None:
    records = [make_record(episode=k, peak_attitude=1.0 + 0.1 * k) for k in range(12)]
    (row,) = rows_of(records)
    shown = column_named("peak_attitude").value(row)
    assert shown == "1.55" or re.fullmatch(r"1\.[56]\d?", shown)
    cell = f"{shown} {column_named('peak_attitude').interval(row)}"
    assert f"| {cell} |" in to_markdown([row]) and f" {shown} " in printed([row])
    assert shown in to_latex([row])
