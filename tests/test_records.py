"""Records: what is written is read back, equal input gives equal bytes, bad input says where."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_results import FAILED, make_record, make_result

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.storage import read_records, write_records
from space_envs.evaluation.records.timing import UNTIMED

FIELDS = (
    "schema env_id robot robot_digest policy control_mode knowledge difficulty split index episode seed "
    "config_hash task_version captured outcome cause reason time_to_capture time_to_envelope steps "
    "episode_return position_error orientation_error peak_attitude final_attitude attitude_cost "
    "base_angular_impulse kinetic_energy_integral mechanical_work peak_power collisions clipped_actions "
    "linear_momentum_drift angular_momentum_drift timing checksum"
).split()


def timing(**changes: object) -> dict[str, object]:
    return {"planning_ms": None, "action_ms": 1.0, "processor": "made up", "threads": 1} | changes


def test_keys_stand_in_the_order_of_the_schema() -> None:
    assert list(json.loads(make_record().to_json())) == FIELDS
    assert list(json.loads(make_record().to_json())["timing"]) == list(timing())


def test_round_trip_and_equal_bytes(tmp_path: Path) -> None:
    records = list(make_result(episodes=6).records)
    write_records(tmp_path / "a.jsonl", records)
    assert read_records(tmp_path / "a.jsonl") == records
    write_records(tmp_path / "b.jsonl", read_records(tmp_path / "a.jsonl"))
    assert (tmp_path / "a.jsonl").read_bytes() == (tmp_path / "b.jsonl").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.jsonl", "b.jsonl"]


@given(st.text(min_size=1), st.floats(min_value=0, allow_infinity=False))
def test_any_name_and_number_survives(name: str, value: float) -> None:
    record = make_record(policy=name, attitude_cost=value)
    assert "\n" not in record.to_json()
    assert EpisodeRecord.from_json(record.to_json()) == record


def test_names_with_unusual_line_ends_stay_on_one_line(tmp_path: Path) -> None:
    records = [make_record(policy="a\u2028b\x85c\nd")]
    write_records(tmp_path / "records.jsonl", records)
    assert read_records(tmp_path / "records.jsonl") == records


def test_numpy_scalars_and_integers_become_plain_numbers() -> None:
    plain = make_record(steps=7, position_error=2.0, captured=True)
    numpy = make_record(steps=np.int64(7), position_error=np.float64(2.0), captured=np.bool_(True))
    assert numpy.to_json() == plain.to_json() == make_record(steps=7, position_error=2).to_json()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"schema": 1}, "schema"),
        ({"outcome": "captred", "captured": False, "time_to_capture": None}, "Did you mean 'captured'"),
        ({"outcome": "timeout"}, "captured is True"),
        ({"cause": "timeout"}, "cause is 'timeout' but the episode captured"),
        (FAILED | {"cause": "infeasable"}, "unknown cause .*Did you mean 'infeasible'"),
        (FAILED | {"cause": None}, "unknown cause of outcome 'timeout': None"),
        (FAILED | {"cause": "collision"}, "unknown cause of outcome 'timeout': 'collision'"),
        (FAILED | {"outcome": "policy_error", "cause": "solver"}, "valid are 'policy_error'"),
        ({"task_version": -1}, "task_version must not be negative"),
        ({"captured": False, "outcome": "timeout"}, "time_to_capture"),
        ({"time_to_capture": None}, "time_to_capture"),
        ({"time_to_envelope": None}, "time_to_envelope is None"),
        ({"final_attitude": None}, "final_attitude"),
        ({"final_attitude": math.nan}, "final_attitude must be finite"),
        ({"attitude_cost": math.inf}, "attitude_cost must be finite"),
        ({"peak_attitude": -0.1}, "peak_attitude must not be negative"),
        ({"steps": -1}, "steps"),
        ({"steps": 1.5}, "steps must be int"),
        ({"steps": True}, "steps must be int"),
        ({"captured": 1}, "captured must be bool"),
        ({"policy": ""}, "policy must not be empty"),
        ({"policy": 3}, "policy must be str"),
        ({"timing": {"planning_ms": 1.0}}, "timing"),
        ({"timing": timing(action_ms=-1.0)}, "timing.action_ms"),
        ({"timing": timing(action_ms=math.nan)}, "timing.action_ms"),
        ({"timing": timing(threads=1.5)}, "timing.threads must be int"),
        ({"checksum": "0123456789abcdef"}, "the record was edited"),
    ],
)
def test_bad_records_name_their_field(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigurationError, match=said):
        make_record(**changes)


def test_an_episode_that_diverged_may_lack_values() -> None:
    record = make_record(
        captured=False,
        outcome="diverged",
        reason="simulation reset itself",
        time_to_capture=None,
        final_attitude=None,
        position_error=None,
        timing=UNTIMED,
    )
    assert EpisodeRecord.from_json(record.to_json()) == record
    assert '"final_attitude": null' in record.to_json()


GOOD = make_record().to_json()


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{", "not a JSON object"),
        ("[1]", "expected an object"),
        ("", "not a JSON object"),
        ("[" * 100_000, "not a JSON object"),
        (GOOD.replace('"steps": 125', '"steps": NaN'), "NaN is not a JSON number"),
        (GOOD.replace('"position_error": 0.003', '"position_error": 1e999'), "position_error must be finite"),
        (GOOD.replace('"steps": 125', '"steps": 125, "steps": 1'), "twice"),
        (GOOD.replace('"steps"', '"step"'), "Did you mean 'steps'"),
        (GOOD.replace('"steps": 125, ', ""), "missing field steps"),
        (GOOD.replace('"steps": 125', '"steps": 124'), "the record was edited"),
        (GOOD.replace(make_record().checksum, ""), "checksum must not be empty"),
    ],
)
def test_bad_lines_name_file_and_line(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "records.jsonl"
    path.write_text(f"{GOOD}\n{line}\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=rf"records\.jsonl:2: .*{said}"):
        read_records(path)


def test_cut_binary_and_missing_files(tmp_path: Path) -> None:
    path = tmp_path / "records.jsonl"
    path.write_text(GOOD[:-5], encoding="utf-8")
    with pytest.raises(ConfigurationError, match="cut short"):
        read_records(path)
    path.write_bytes(b"\xff\xfe\n")
    with pytest.raises(ConfigurationError, match=r"records\.jsonl:1"):
        read_records(path)
    with pytest.raises(ConfigurationError, match="cannot be read"):
        read_records(tmp_path / "none.jsonl")
    path.write_bytes(b"")
    assert read_records(path) == []
