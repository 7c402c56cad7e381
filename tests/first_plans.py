"""First actions of planners, each on one goal, as JSON; run as a program it does so in a process of its own.

python first_plans.py '[["SpaceCapture/SingleArm-v0", "ocp"]]'
"""

import json
import sys
import warnings
from typing import Any

import numpy as np

from agents.policies.registry import make_policy
from space_envs.dynamics import NoCompiledCodeWarning
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext


def first_actions(planners: list[tuple[str, str]]) -> dict[str, dict[str, Any]]:
    """Of each (id, policy) the actions (2, n) of the first two control steps on one validation goal, and why
    there is no plan, if there is none."""
    actions = {}
    for env_id, name in planners:
        env = CaptureVectorEnv(env_id, 1)
        policy = make_policy(name, PolicyContext.from_env(env), 0)
        seen, _ = env.reset(options={"split": "validation", "index": np.array([1])})
        first, state = policy.predict(seen)
        seen, *_ = env.step(first)
        second, state = policy.predict(seen, state, np.zeros(1, dtype=bool))
        failure = next(iter(getattr(state, "failures", ())), None)
        failure = None if failure is None else str(failure)
        actions[f"{env_id} {name}"] = {"actions": [first[0].tolist(), second[0].tolist()], "failure": failure}
    return actions


if __name__ == "__main__":
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", NoCompiledCodeWarning)
        found = first_actions([(env_id, name) for env_id, name in json.loads(sys.argv[1])])
    told = [str(one.message) for one in caught if issubclass(one.category, NoCompiledCodeWarning)]
    print(json.dumps({"plans": found, "warnings": told}))
