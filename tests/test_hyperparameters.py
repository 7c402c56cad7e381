"""Hyperparameters and options of train.py: defaults, ranges, files, the command line, tasks of others."""

import json
import tomllib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from training_runs import ENV_ID, defaults, installed_algorithms

from agents.commands.train import main
from agents.commands.training.options import environment_keywords
from agents.learning.runs.defaults import default_hyperparameters
from agents.learning.runs.feature_tables import usual_features
from agents.learning.runs.hyperparameters import ALGORITHMS, PPO, described, from_json, to_json
from agents.learning.runs.settings import Settings, settle
from agents.policies.learned.features import FeatureView
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.registration import ENTRIES, make_task
from space_envs.tasks.common import Field, ObservationLayout


def test_defaults_of_every_id_survive_json() -> None:
    for env_id in ENTRIES:
        for algorithm, kind in installed_algorithms().items():
            if algorithm == "planner" and env_id != ENV_ID:
                continue  # it is for static poses of one arm without obstacles
            settings, parameters, messages = settle({"algo": algorithm, "env": env_id})
            assert settings == Settings(algorithm, env_id) and not messages
            again = from_json(algorithm, json.loads(json.dumps(to_json(parameters))))
            assert again == parameters and type(again) is kind


@pytest.mark.parametrize(
    ("algorithm", "change", "message"),
    [
        ("ppo", {"num_envs": 0}, "num_envs must be at least 1 and at most 65,536, got 0"),
        ("ppo", {"steps": -1}, "steps must be at least 1"),
        ("ppo", {"batch_size": 1.5}, "batch_size must be a whole number, got 1.5"),
        ("ppo", {"n_steps": True}, "n_steps must be a whole number, got True"),
        ("ppo", {"learning_rate": float("nan")}, "learning_rate must be above 0"),
        ("ppo", {"gamma": 1.1}, "gamma must be above 0 and at most 1"),
        ("ppo", {"minutes": 0.0}, "minutes must be above 0"),
        ("ppo", {"hidden": ()}, "hidden must not be empty"),
        ("ppo", {"hidden": (16, 0)}, "hidden must be at least 1"),
        ("ppo", {"activation": "tan"}, "mean 'tanh'"),
        ("ppo", {"features": [["joint_position"]]}, "a feature must be"),
        ("sac", {"ent_coef": "automatic"}, "ent_coef must be a number, or auto_"),
        ("sac", {"tau": -0.1}, "tau must be at least 0"),
        ("td3", {"policy_delay": 0}, "policy_delay must be"),
        ("bc", {"expert_noise": -1.0}, "expert_noise must be"),
    ],
)
def test_bad_hyperparameters(algorithm: str, change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        defaults(algorithm, **change)


def test_json_with_foreign_names() -> None:
    values = to_json(defaults("ppo"))
    with pytest.raises(ConfigurationError, match="gama"):
        from_json("ppo", values | {"gama": 0.9})
    with pytest.raises(ConfigurationError, match="lack steps"):
        from_json("ppo", {name: value for name, value in values.items() if name != "steps"})


@pytest.mark.parametrize("algorithm", installed_algorithms())
def test_every_hyperparameter_is_an_option_and_a_dry_run_gives_a_file(
    algorithm: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Options change every value; the printed file gives the same run; the command line takes precedence."""
    changed, options = asdict(defaults(algorithm)), []
    for name in described(ALGORITHMS[algorithm]):
        given: Any = {"hidden": [8, 4], "activation": "elu", "expert": "mpc", "ent_coef": 0.01}.get(name)
        given = "reactionless" if name == "kind" else given
        if name == "features":
            given, words = [("joint_position", "plain", 2.0)], ["joint_position:plain:2"]
        else:
            given = given or (round(0.9 * float(changed[name]), 6) if isinstance(changed[name], float) else 7)
            words = list(map(str, given)) if isinstance(given, list) else [str(given)]
        changed[name] = given
        options += [f"--{name.replace('_', '-')}", *words]
    first = ["--algo", algorithm, "--steps", "7", "--dry-run"]
    assert main([*first, *options]) == 0
    text = capsys.readouterr().out
    printed = tomllib.loads(text)
    del changed["steps"]  # which are whole rounds
    for name, value in changed.items():
        assert json.dumps(printed[name]) == json.dumps(value), name
    assert printed["steps"] % 7 == 0
    file = tmp_path / "run.toml"
    file.write_text(text)
    assert main(["--config", str(file), "--dry-run"]) == 0
    assert capsys.readouterr().out == text
    assert main(["--config", str(file), "--learning-rate", "0.5", "--dry-run"]) == 0
    assert tomllib.loads(capsys.readouterr().out) == printed | {"learning_rate": 0.5}


def test_a_start_from_random_weights_is_said_and_an_expert_is_asked_for() -> None:
    _, parameters, messages = settle({"control_mode": "joint_torque"})
    assert isinstance(parameters, PPO) and parameters.expert is None
    assert "ppo starts from random weights" in messages[0]
    with pytest.raises(ConfigurationError, match="bc needs an --expert"):
        settle({"algo": "bc", "control_mode": "joint_torque"})
    assert settle({"init": "none"})[1:] == (defaults("ppo", expert=None), ())


def test_keywords_of_the_environment() -> None:
    words = ["horizon=100", "collisions=false", "reward=sparse", '{"c": 2.0}', "timestep=none"]
    assert environment_keywords(words) == {
        "horizon": 100,
        "collisions": False,
        "reward": "sparse",
        "c": 2.0,
        "timestep": None,
    }
    for bad in (["horizon"], ["=3"], ["{"], ["c=1", "c=2"]):
        with pytest.raises(ConfigurationError, match="--env-kwargs"):
            environment_keywords(bad)
    for keywords, message in (
        ({"horizn": 3}, "mean 'horizon'"),
        ({"horizon": -1}, "horizon must be a positive integer"),
        ({"difficulty": "easy"}, "difficulty is set by an option of its own"),
        ({"split": "test"}, "split is set by training"),
    ):
        with pytest.raises(SpaceEnvsError, match=message):
            settle({"env_kwargs": keywords})


def test_a_task_without_differences_gets_its_whole_observation() -> None:
    layout = make_task(ENV_ID, {}).layout
    parameters = default_hyperparameters("Mine/Task-v0", "ppo", layout)
    assert {feature.field for feature in parameters.features} == {field.name for field in layout.fields}
    view = FeatureView(parameters.features, layout, make_task(ENV_ID, {}).mechanics.home)
    assert view.size > layout.size - 2
    strange = ObservationLayout((Field("position_error", 3, 1.0, "m"), Field("mood", 2, 1.0, "none")))
    assert [tuple(feature) for feature in usual_features(strange)] == [
        ("position_error", "plain", 0.5),
        ("mood", "plain", 1.0),
    ]
