"""The one table of ids: which task, with what defaults."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import make

from space_envs.errors import positive, unknown_id, unknown_keyword
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import LARGEST_TOLERANCE
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.dual_arm_spatial import DualArmSpatialTask
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask


@dataclass(frozen=True)
class Entry:
    """One id: its task class and a line that says what it asks."""

    task: type[CaptureTask]
    summary: str


ENTRIES: dict[str, Entry] = {
    "SpaceCapture/SingleArm-v0": Entry(
        SingleArmTask, "a 7-DoF arm on a free-floating 200 kg satellite takes a static grapple pose"
    ),
    "SpaceCapture/SingleArmCluttered-v0": Entry(
        SingleArmClutteredTask, "the same arm takes a static grapple pose, clear of spheres in its way"
    ),
    "SpaceCapture/DualArmPlanar-v0": Entry(
        DualArmPlanarTask, "two planar arms on a 500 kg satellite take a tumbling object, attitude kept"
    ),
    "SpaceCapture/DualArmSpatial-v0": Entry(
        DualArmSpatialTask, "two 7-DoF arms on a 500 kg satellite take a tumbling satellite, attitude kept"
    ),
}

# Keywords of gym.make that set the capture envelope, and the field of CaptureEnvelope each one sets.
ENVELOPE_KEYWORDS = {
    "position_tolerance": "position",
    "orientation_tolerance": "orientation",
    "approach_tolerance": "approach",
    "linear_velocity_tolerance": "linear_velocity",
    "angular_velocity_tolerance": "angular_velocity",
    "hold_time": "hold",
}


def make_task(env_id: str, keywords: Mapping[str, Any]) -> CaptureTask:
    """Build the task of an id from the keywords of `gym.make`.

    Raises:
        UnknownIdError: for an unknown id. UnknownKeywordError: for an unknown keyword.
        ConfigurationError: for a value that is not valid.
    """
    if not isinstance(env_id, str) or env_id not in ENTRIES:
        raise unknown_id(env_id, ENTRIES)
    task = ENTRIES[env_id].task
    names = [f.name for f in fields(task) if f.name != "envelope"]
    asked = {f.name for f in fields(task().envelope)}
    tolerances = [keyword for keyword, name in ENVELOPE_KEYWORDS.items() if name in asked]
    own = {"control_mode", "render_mode", "width", "height", "camera", "threads", "max_episode_steps"}
    for name in keywords:
        if name not in names and name not in tolerances:
            raise unknown_keyword(name, [*names, *tolerances, *sorted(own)])
    for keyword in tolerances:
        if keyword in keywords:
            positive(keyword, keywords[keyword], LARGEST_TOLERANCE)
    envelope = replace(
        task().envelope, **{ENVELOPE_KEYWORDS[k]: v for k, v in keywords.items() if k in tolerances}
    )
    return task(**{k: v for k, v in keywords.items() if k in names}, envelope=envelope)


def asked_of_make(env: gym.Env) -> Any:
    """`max_episode_steps` of the `gym.make` that constructs `env`, argument or spec; None if nothing says it.

    `gym.make` adds a TimeLimit of as many steps and keeps the number to itself. An environment that ends its
    episodes on its own must know it, or there would be two limits; so it is read from the frame of the call.
    That frame is the first outside the constructors of `env`: one further out makes something else, of which
    `env` is only a part.
    """
    frame = inspect.currentframe()
    frame = frame and frame.f_back
    while frame is not None and frame.f_locals.get("self") is env:
        frame = frame.f_back
    if frame is None or frame.f_code is not make.__code__:
        return None
    asked, spec = (frame.f_locals.get(name) for name in ("max_episode_steps", "env_spec"))
    return getattr(spec, "max_episode_steps", None) if asked is None else asked


def register_all() -> None:
    """Make every id known to Gymnasium."""
    for env_id in ENTRIES:
        gym.register(
            id=env_id,
            entry_point="space_envs.envs:CaptureEnv",
            vector_entry_point="space_envs.envs:CaptureVectorEnv",
            kwargs={"env_id": env_id},
        )
