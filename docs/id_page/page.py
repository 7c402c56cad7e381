"""The page of a registered id, written from its task, its model and the environment's own docstrings."""

import inspect
import sys

import numpy as np

from docs.goals import SPLIT_TEXT, goals
from docs.id_page.episode import capture_section, observations_section, rewards_section
from docs.id_page.options import INFO_TEXT, OPTION_TEXT, info_section, keywords_section, reset_section
from docs.id_page.robot import actions_section, robot_section
from docs.reading import (
    flowed,
)
from space_envs.envs import CaptureVectorEnv
from space_envs.envs.starts import COMMON_OPTIONS
from space_envs.registration import ENTRIES
from space_envs.tasks.common import SPLITS


def environment_page(env_id: str) -> str:
    """The whole page as Markdown.

    Raises:
        RuntimeError: if the code knows a split, an info key or a reset option that is not
            described.
    """
    env = CaptureVectorEnv(env_id=env_id)
    _, begun = env.reset(seed=0)
    *_, info = env.step(np.zeros(env.action_space.shape))
    keys = {key for key in {**begun, **info} if not key.startswith("_")}
    options = {*OPTION_TEXT} & {*COMMON_OPTIONS, *env.task.goal_options}
    for ours, theirs in (
        (SPLIT_TEXT, SPLITS),
        (INFO_TEXT, keys),
        (options, (*COMMON_OPTIONS, *env.task.goal_options)),
    ):
        if set(ours) != set(theirs):
            raise RuntimeError(f"the documentation describes {sorted(ours)}, the code has {sorted(theirs)}")
    parts = [
        f"<!-- Written by `python -m docs.generate` from the code; do not edit. -->\n\n# {env_id}",
        _opening(env),
        robot_section(env),
        actions_section(env),
        observations_section(env),
        rewards_section(env),
        capture_section(env),
        goals(env.task),
        keywords_section(env),
        reset_section(env),
        info_section(),
        _versions(env),
    ]
    return "\n\n".join(parts) + "\n"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _opening(env: CaptureVectorEnv) -> str:
    # The module's first paragraph is its title; the task's summary says the same in a line that stands alone.
    rest = next(text for kind in type(env.task).__mro__ if (text := _rest_of_docstring(kind)))
    example = f"""```python
import gymnasium as gym

import space_envs

env = gym.make("{env.env_id}")
observation, info = env.reset(seed=0)
observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
error = env.unwrapped.task.layout.read(observation, "position_error")

keywords = {{"control_mode": "reactionless", "difficulty": "hard"}}
envs = gym.make_vec("{env.env_id}", num_envs=16, **keywords)
observations, infos = envs.reset(seed=0)
```"""
    vector = (
        "Seed `s` gives row `i` of the vector environment the episode that seed `s + i` gives the single "
        "one, bit for bit. [Physics and symbols](../physics.md) describes the simulation."
    )
    return "\n\n".join([_sentence(ENTRIES[env.env_id].summary), rest, example, vector])


def _rest_of_docstring(kind: type) -> str:
    """Docstring of a class's module without its first paragraph."""
    return flowed(inspect.getdoc(sys.modules[kind.__module__]) or "").partition("\n\n")[2]


def _versions(env: CaptureVectorEnv) -> str:
    version = env.env_id.rpartition("-")[2]
    return (
        f"## Versions\n\n- {version}: the first. Until its release, every change that alters a score raises "
        "the task version in the [records](../records.md), which `evaluate.py compare` refuses to mix. "
        f"The task version is {env.task.version}."
    )
