"""Metrics of a task's own: one function and one row, in its records and in all its tables."""

import csv
import io
import json
import re
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from rich.console import Console
from synthetic_results import make_record

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.columns import COLUMNS, column_named, columns_of
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.descriptions import described_metrics, description
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.metrics import METRICS, episode_metrics
from space_envs.evaluation.report.page.html import to_html
from space_envs.evaluation.report.tables.csv_file import to_csv
from space_envs.evaluation.report.tables.latex import to_latex
from space_envs.evaluation.report.tables.markdown import to_markdown
from space_envs.evaluation.report.tables.terminal import to_terminal
from space_envs.evaluation.results.result import EvaluationResult
from space_envs.metric import Display, Metric
from space_envs.registration import ENTRIES, RegisteredTask
from space_envs.tasks.single_arm import SingleArmTask

OWN = "Own/Watched-v0"


def jerkiness(episodes, task):
    """Largest torque times a length of the task's, N m^2."""
    return np.abs(episodes.torque).max(axis=(1, 2)) * task.control_period


@dataclass(frozen=True)
class WatchedTask(SingleArmTask):
    """The single arm, with metrics of its own."""

    metrics: ClassVar[tuple[Metric, ...]] = (
        Metric(
            "jerkiness",
            "N m^2",
            "a made-up number",
            jerkiness,
            Display("jerkiness", "lower", unit="N mm^2", scale=1e6, room="paper"),
        ),
        Metric(
            "doubt", "", "of no episode", jerkiness, Display(statistic="largest", over="all"), optional=True
        ),
    )


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(ENTRIES, OWN, RegisteredTask(OWN, WatchedTask, __name__))


def records(count: int = 4) -> list[EpisodeRecord]:
    usual = [make_record(episode=number) for number in range(count)]
    own = [make_record(env_id=OWN, episode=k, jerkiness=0.5 + k, doubt=float(k)) for k in range(count)]
    return usual + own


@pytest.fixture
def rows() -> list[Row]:
    return build_rows(records(), np.random.default_rng(0))


def test_values_are_computed_after_those_of_every_task() -> None:
    count = 2
    series = {name: np.ones((count, 3)) for name in ("position_error", "orientation_error", "attitude")}
    totals = (
        "peak_attitude base_angular_impulse kinetic_energy_integral mechanical_work peak_power "
        "linear_momentum_drift angular_momentum_drift episode_return"
    ).split()
    episodes: Any = SimpleNamespace(
        torque=np.array([[[1.0, -3.0]] * 2, [[2.0, 0.0]] * 2]),
        qvel=np.zeros((count, 3, 8)),
        index=np.arange(count),
        length=np.full(count, 2),
        clipped=np.zeros(count, dtype=np.int64),
        outcome=["timeout"] * count,
        **series,
        **{name: np.zeros(count) for name in totals},
    )
    values = episode_metrics(episodes, WatchedTask())
    assert list(values) == [*(metric.name for metric in METRICS), "jerkiness", "doubt"]
    np.testing.assert_allclose(values["jerkiness"], [0.3, 0.2])
    assert np.isnan(values["time_to_capture"]).all()


def test_records_have_the_keys_of_their_own_task_behind_the_others() -> None:
    usual, own = records(1)
    assert own.to_dict() | {"env_id": "", "checksum": ""} == (
        {**usual.to_dict(), "jerkiness": 0.5, "doubt": 0.0} | {"env_id": "", "checksum": ""}
    )
    assert list(own.metrics)[-2:] == ["jerkiness", "doubt"]
    assert EpisodeRecord.from_json(own.to_json()) == own
    with pytest.raises(ConfigurationError, match="missing field jerkiness, doubt"):
        make_record(env_id=OWN)
    with pytest.raises(ConfigurationError, match="jerkiness must not be negative"):
        make_record(env_id=OWN, jerkiness=-1.0, doubt=None)
    with pytest.raises(ConfigurationError, match="lacks jerkiness"):
        make_record(env_id=OWN, jerkiness=None, doubt=None)


def test_every_table_of_the_task_has_the_column_and_no_other(rows: list[Row]) -> None:
    usual, own = rows
    assert [row.task.env_id for row in rows] == ["SpaceCapture/SingleArm-v0", OWN]
    added = set(columns_of(own.metrics)) - set(COLUMNS)
    assert [column.heading for column in added] == ["jerkiness [N mm^2]"]
    column = column_named("jerkiness", columns_of(own.metrics))
    assert float(column.value(own)) == 2e6  # the mean of 0.5 to 3.5 N m^2
    assert column.value(usual) == "-"
    assert columns_of(usual.metrics) == COLUMNS
    for text in (to_markdown(rows), to_latex(rows)):
        first, second = re.split(r"(?=Own/)", text, maxsplit=1)
        assert "jerkiness" not in first and "jerkiness" in second
    file = io.StringIO()
    to_terminal(rows, Console(file=file))
    assert file.getvalue().count("jerkiness") == 1
    head, *lines = csv.DictReader(io.StringIO(to_csv(rows))).reader
    table = [dict(zip(head, line, strict=True)) for line in lines]
    assert [line["jerkiness"] for line in table] == ["", "2.0"]
    assert [line["doubt_max"] for line in table] == ["", "3.0"]
    assert json.dumps(own.to_dict()["figures"]["jerkiness"]).startswith('{"value": 2.0,')
    assert own.to_dict()["doubt"] == 3.0


def test_the_page_has_the_column_in_the_section_of_its_task(rows: list[Row]) -> None:
    page = to_html(EvaluationResult(records()), rows, {row.task: [] for row in rows})
    first, second = page.split('id="task-1"')
    assert "<button" in first and "jerkiness" not in first and ">jerkiness<small>N mm²" in second


def test_numbers_of_a_task_that_is_not_registered_are_shown_as_described(
    monkeypatch: pytest.MonkeyPatch, rows: list[Row]
) -> None:
    own = [record.to_json() for record in records() if record.env_id == OWN]
    descriptions = json.loads(json.dumps({OWN: [description(metric) for metric in WatchedTask.metrics]}))
    monkeypatch.delitem(ENTRIES, OWN)
    read = [EpisodeRecord.from_json(line) for line in own]
    described = described_metrics(descriptions)
    (row,) = build_rows(read, np.random.default_rng(0), described=described)
    assert columns_of(row.metrics) == columns_of(rows[1].metrics)
    assert row.to_dict() == rows[1].to_dict()
    (row,) = build_rows(read, np.random.default_rng(0))
    titles = [column.title for column in columns_of(row.metrics)]
    assert "jerkiness" in titles and "doubt" in titles  # by their names
    with pytest.raises(ConfigurationError, match="has no function"):
        described[OWN][0].of(None, None)
    for change in ({"unit": 3}, {"name": "Two words"}, {"display": {}}, {"unit": "<b>"}, {"more": 1}):
        with pytest.raises(ConfigurationError):
            described_metrics({OWN: [descriptions[OWN][0] | change]})
    with pytest.raises(ConfigurationError, match="an object of lists"):
        described_metrics({OWN: 3})


@pytest.mark.parametrize("metrics", [(METRICS[0],), (WatchedTask.metrics[0],) * 2])
def test_two_metrics_of_one_name_are_refused(metrics: tuple[Metric, ...]) -> None:
    episodes: Any = SimpleNamespace(index=[0], torque=np.ones((1, 1, 1)))
    task = SimpleNamespace(metrics=metrics, control_period=0.1)
    with pytest.raises(ConfigurationError, match="two metrics of the name"):
        episode_metrics(episodes, task)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda: Metric("Two words", "", "", jerkiness), "lower-case letters"),
        (lambda: Display(statistic="mode"), "unknown statistic of a display"),
        (lambda: Display(better="smaller"), "unknown better of a display"),  # type: ignore[arg-type]
    ],
)
def test_rows_that_make_no_sense_are_refused(made, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        made()
