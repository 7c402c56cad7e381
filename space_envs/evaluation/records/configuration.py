"""Configuration of a task, and the hash that records of equal configurations share."""

from collections.abc import Mapping
from dataclasses import asdict, fields
from typing import Any

from space_envs.system.digests import json_digest
from space_envs.tasks.base import CaptureTask


def configuration(env_id: str, control_mode: str, task: CaptureTask) -> dict[str, Any]:
    """Everything that defines a task, apart from its split, as plain values."""
    settings = {field.name: getattr(task, field.name) for field in fields(task)}
    for name in ("split", "robot", "variant"):
        del settings[name]
    if task.perturbation.nominal:
        del settings["perturbation"]
    else:
        settings["perturbation"] = asdict(task.perturbation)
    settings |= {"timestep": task.step_size, "envelope": asdict(task.envelope)}
    robot = {"robot": task.robot.title, "robot_digest": task.robot.digest}
    about = {"env_id": env_id, **robot, "task_version": task.version, "control_mode": control_mode}
    return {**about, **settings}


def configuration_hash(config: Mapping[str, Any]) -> str:
    """Twelve hexadecimal digits that change with anything in a configuration, also after it was written as
    JSON and read again."""
    return json_digest(config, 12)


def config_hash(env_id: str, control_mode: str, task: CaptureTask) -> str:
    """The hash of a task's configuration."""
    return configuration_hash(configuration(env_id, control_mode, task))
