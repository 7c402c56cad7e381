"""The published schema accepts what the class accepts, and refuses what it refuses."""

import json
from collections.abc import Mapping
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_results import FAILED, make_record, make_result, record_of

from docs.generate import DOCS
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.causes import CAUSES, NO_PLAN_CAUSES, OUTCOMES
from space_envs.evaluation.records.episode import MAY_BE_ABSENT, SCHEMA_VERSION, EpisodeRecord
from space_envs.evaluation.records.metrics import METRICS
from space_envs.evaluation.records.schema import record_schema, schema_text
from space_envs.evaluation.records.timing import UNTIMED

VALIDATOR = jsonschema.Draft202012Validator(record_schema())
RECORDS = {
    "captured": make_record(),
    "untimed": make_record(timing=UNTIMED),
    "planless": make_record(**FAILED, cause="infeasible", reason="joint 3 is too slow"),
    "failed": make_record(**FAILED, reason="too late", attitude_cost=None, linear_momentum_drift=None),
}
COUNTS = "index episode seed task_version steps collisions clipped_actions".split()
POSITIVE = (
    "position_error orientation_error peak_attitude final_attitude attitude_cost base_angular_impulse "
    "kinetic_energy_integral peak_power linear_momentum_drift angular_momentum_drift"
).split()
PLAIN = [name for name in json.loads(make_record().to_json()) if name not in ("timing", "checksum")]
SIGNED = ("episode_return", "mechanical_work")
NAMES = "env_id robot robot_digest policy control_mode difficulty split config_hash".split()


def accepted_by_class(values: Mapping[str, Any]) -> bool:
    """Whether there is such a record, if its checksum is the right one: that is beyond a schema."""
    try:
        record_of({name: value for name, value in values.items() if name != "checksum"})
    except (ConfigurationError, TypeError):  # of unknown and of missing fields
        return False
    return "checksum" in values


def test_the_published_file_is_that_of_the_code() -> None:
    path = DOCS / "schema" / f"record-v{SCHEMA_VERSION}.json"
    assert path.read_text(encoding="utf-8") == schema_text(), "run: python -m docs.generate"
    schema = json.loads(schema_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$schema"].endswith("2020-12/schema")
    assert schema["$id"].endswith(f":{SCHEMA_VERSION}")


def test_every_field_is_described_and_metrics_with_their_units() -> None:
    properties = record_schema()["properties"]
    assert list(properties) == list(json.loads(make_record(goal="axis", perturbation="mild").to_json()))
    assert "goal" not in json.loads(make_record().to_json())
    timing = properties["timing"]["properties"]
    assert all(len(each["description"]) > 5 for each in {**properties, **timing}.values())
    for metric in METRICS:
        assert properties[metric.name]["description"].startswith(f"{metric.unit}, " if metric.unit else ""), (
            metric
        )


def test_metrics_of_a_task_of_its_own_are_numbers_after_the_others() -> None:
    own = make_record(env_id="Own/Task-v0", closeness=0.25, missing=None)
    values = json.loads(own.to_json())
    VALIDATOR.validate(values)
    assert list(values)[-4:] == ["closeness", "missing", "timing", "checksum"]
    assert EpisodeRecord.from_json(own.to_json()) == own
    for value in ("near", True, [], {}):
        assert not accepted_by_class(values | {"closeness": value})
        assert not VALIDATOR.is_valid(values | {"closeness": value})
    with pytest.raises(ConfigurationError, match="unknown field 'closeness'"):
        make_record(closeness=0.25)  # an id whose task is known and has no such metric


@pytest.mark.parametrize("name", RECORDS)
def test_records_are_accepted(name: str) -> None:
    VALIDATOR.validate(json.loads(RECORDS[name].to_json()))


def test_records_of_an_evaluation_and_all_outcomes_are_accepted() -> None:
    for record in make_result(episodes=4, seeds=2).records:
        VALIDATOR.validate(json.loads(record.to_json()))
    for outcome in OUTCOMES[1:]:
        VALIDATOR.validate(json.loads(make_record(**FAILED | {"outcome": outcome}).to_json()))


def mutations() -> list[tuple[str, str, Any]]:
    """Record, field and value that neither may accept; `None` in place of a value takes the field away."""
    wrong: list[tuple[str, Any]] = [(name, value) for name in NAMES for value in ("", 3, [], {})]
    wrong += [(name, value) for name in COUNTS for value in (-1, 1.5, "1", True, [])]
    wrong += [(name, value) for name in POSITIVE for value in (-0.1, "1", True, {})]
    wrong += [(name, value) for name in SIGNED for value in ("1", False, [])]
    wrong += [("schema", value) for value in (1, 2, 3, 5, "4", 4.5, True)]
    wrong += [("captured", value) for value in (0, 1, "true")]
    wrong += [("outcome", value) for value in ("captred", "", 3)]
    wrong += [("cause", value) for value in ("captured", "infeasable", "", 3, "collision")]
    wrong += [("knowledge", value) for value in ("models", "", None, 3)]
    wrong += [("reason", value) for value in (3, [])]
    for name in ("time_to_capture", "time_to_envelope"):
        wrong += [(name, value) for value in (-1.0, "1", True)]
    wrong += [("timing", value) for value in (3, [], {}, {**UNTIMED, "more": 1}, {"planning_ms": 1.0})]
    for name in ("planning_ms", "action_ms"):
        wrong += [("timing", {**UNTIMED, name: value}) for value in (-1.0, "1", True)]
    wrong += [("timing", {**UNTIMED, "processor": value}) for value in ("", 3)]
    wrong += [("timing", {**UNTIMED, "threads": value}) for value in (-1, 1.5, "1")]
    wrong += [("an_unknown_field", "1"), ("policy ", "x")]
    return [(record, name, value) for record in RECORDS for name, value in wrong]


@pytest.mark.parametrize("record", RECORDS)
def test_what_the_class_refuses_the_schema_refuses(record: str) -> None:
    whole = json.loads(RECORDS[record].to_json())
    assert accepted_by_class(whole)
    for _, name, value in (each for each in mutations() if each[0] == record):
        values = whole | {name: value}
        assert not accepted_by_class(values), (name, value)
        assert not VALIDATOR.is_valid(values), (name, value)
    for name in set(whole) - set(MAY_BE_ABSENT):
        missing = {each: value for each, value in whole.items() if each != name}
        assert not accepted_by_class(missing), name
        assert not VALIDATOR.is_valid(missing), name
    for other in ([], "text", 3, None, {}):
        assert not VALIDATOR.is_valid(other)


@pytest.mark.parametrize("record", RECORDS)
def test_null_is_accepted_by_both_or_by_neither(record: str) -> None:
    for name in (*PLAIN, "timing", "checksum"):
        values = json.loads(RECORDS[record].to_json()) | {name: None}
        assert VALIDATOR.is_valid(values) == (accepted_by_class(values) and name != "checksum"), name


def test_captured_outcome_and_time_agree() -> None:
    for captured in (True, False):
        for outcome in ("captured", "timeout"):
            for time in (None, 1.0):
                values = json.loads(make_record().to_json())
                values |= {"captured": captured, "outcome": outcome, "time_to_capture": time}
                values["time_to_envelope"] = time
                values["cause"] = None if outcome == "captured" else outcome
                assert VALIDATOR.is_valid(values) == accepted_by_class(values), values
                assert VALIDATOR.is_valid(values) == (captured == (outcome == "captured") == bool(time))


def test_causes_fit_how_the_episode_ended() -> None:
    allowed = 0
    for outcome in OUTCOMES:
        captured = outcome == "captured"
        for cause in (None, *CAUSES):
            values = json.loads(make_record().to_json()) | {"captured": captured, "outcome": outcome}
            values |= dict.fromkeys(("time_to_capture", "time_to_envelope"), 1.0 if captured else None)
            values["cause"] = cause
            assert VALIDATOR.is_valid(values) == accepted_by_class(values), values
            allowed += accepted_by_class(values)
            if accepted_by_class(values):
                assert (cause is None) == captured
                assert cause in (None, outcome) or outcome in ("timeout", "attitude_lost", "collision")
    assert allowed == len(OUTCOMES) + 3 * len(NO_PLAN_CAUSES)


@pytest.mark.parametrize("checksum", ["", "0123", "0123456789abcdeF", "0123456789abcdef0", 3])
def test_checksums_have_their_form(checksum: object) -> None:
    values = json.loads(make_record().to_json()) | {"checksum": checksum}
    assert not VALIDATOR.is_valid(values)
    with pytest.raises(ConfigurationError, match="checksum"):
        EpisodeRecord.from_dict(values)


@given(
    st.sampled_from(PLAIN),
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(),
        st.floats(allow_nan=False, allow_infinity=False).filter(lambda value: not value.is_integer()),
        st.text(),
    ),
    st.sampled_from(list(RECORDS)),
)
def test_both_judge_any_value_alike(name: str, value: object, record: str) -> None:
    values = json.loads(RECORDS[record].to_json()) | {name: value}
    assert VALIDATOR.is_valid(values) == accepted_by_class(values)
