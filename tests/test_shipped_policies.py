"""Policies that ship: they do what their provenance says, and are what the documented commands give."""

import json
from dataclasses import replace

import numpy as np
import pytest
from training_runs import ENV_ID

from agents.learning.runs.hyperparameters import from_json
from agents.learning.runs.settings import Settings, settle
from agents.learning.validation import Validator
from agents.policies.learned.learned_policy import (
    LearnedPolicy,
    load_shipped,
    shipped_path,
    shipped_policies,
)
from agents.policies.registry import POLICIES, control_mode, make_policy, policies_for
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES

SHIPPED = [(env_id, name) for env_id in ENTRIES for name in shipped_policies(env_id)]


@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
def test_shipped_policies_capture_as_their_provenance_says_and_seldom_collide(env_id: str, name: str) -> None:
    stated = json.loads(shipped_path(env_id, name).with_suffix(".json").read_text())["test"]["captured"]
    n, mode = 64, control_mode(name)
    env = CaptureVectorEnv(env_id, n, autoreset_mode="disabled", control_mode=mode)
    policy = make_policy(name, PolicyContext.from_env(env), 0)
    observation, _ = env.reset(seed=0, options={"split": "test", "index": np.arange(n)})
    outcome, state = np.full(n, "running", dtype=object), None
    while (outcome == "running").any():
        action, state = policy.predict(observation, state)
        observation, _, _, _, info = env.step(action)
        outcome = info["outcome"]
    captured = (outcome == "captured").mean()
    # Three standard deviations of a share among 64 of the goals that the provenance was counted on.
    assert abs(captured - stated) <= 3.0 * np.sqrt(stated * (1.0 - stated) / n) + 1.0 / n
    assert stated >= 0.95 and (outcome == "collision").mean() <= 0.05


def test_policies_that_are_offered_are_those_that_ship() -> None:
    for env_id in ENTRIES:
        learned = {
            name.removesuffix("_alone")  # of the same weights
            for name in policies_for(env_id)
            if POLICIES[name].policy.startswith("agents.policies.learned")
        }
        assert learned == set(shipped_policies(env_id))
    with pytest.raises(ConfigurationError, match="shipped policy"):
        load_shipped(ENV_ID, "dqn")


@pytest.mark.parametrize(("env_id", "name"), [pair for pair in SHIPPED if pair[1].startswith("ppo")])
def test_what_ships_beside_a_clone_captures_as_many_goals_and_sooner(env_id: str, name: str) -> None:
    mode = control_mode(name)
    validator = Validator(env_id, 96, control_mode=mode)
    files = [load_shipped(env_id, each) for each in (name, name.replace(name.split("_")[0], "bc"))]
    weights = [file.network.weights for file in files]
    assert any(not np.array_equal(a, b) for a, b in zip(*weights, strict=False))
    own, clone = (validator(LearnedPolicy(validator.context, 0, file)) for file in files)
    assert own.captured >= clone.captured and own.seconds < clone.seconds


def test_shipped_policies_come_from_documented_commands() -> None:
    for env_id, name in SHIPPED:
        provenance = json.loads(shipped_path(env_id, name).with_suffix(".json").read_text())
        settings = Settings(**provenance["settings"])
        given = {"algo": settings.algorithm, "env": env_id, "control_mode": settings.control_mode}
        given |= {"kind": "reactionless"} if name == "reactionless_network" else {}
        settled = settle(given)
        assert settled.settings == settings
        parameters = from_json(settings.algorithm, provenance["hyperparameters"])
        # Some defaults are younger than the policies, and a resumed run may have other steps.
        younger = [
            each
            for each in ("steps", "validation_interval", "features", "gamma")
            if hasattr(parameters, each)
        ]
        own = {field: getattr(parameters, field) for field in younger}
        assert parameters == replace(settled.parameters, **own), (env_id, name)
    for name, words in (("bc", ["--algo", "bc"]), ("ppo", [])):
        provenance = json.loads(shipped_path(ENV_ID, name).with_suffix(".json").read_text())
        assert provenance["commands"] == [["train.py", *words]]
        assert load_shipped(ENV_ID, name).notes["validation"] == provenance["summary"]["validation"]
        assert provenance["test"]["captured"] >= 0.97 and provenance["summary"]["wall_s"] < 600
