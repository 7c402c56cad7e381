"""From recorded episodes to the metrics of each."""

import json
from collections.abc import Mapping
from dataclasses import asdict, fields
from hashlib import sha256
from typing import Any

import numpy as np

from space_envs.dynamics.rotations import Array, logarithm
from space_envs.dynamics.trajectories import attitude_cost
from space_envs.evaluation.play.integrals import Totals
from space_envs.evaluation.play.rollout import Rollout
from space_envs.evaluation.records.record import SCHEMA_VERSION, UNTIMED, Entrant, EpisodeRecord, Timing
from space_envs.evaluation.replay.traces import Traces
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.outcome import Outcome

TRACED = 30  # episodes of a policy whose course in time is kept


def config_hash(env_id: str, control_mode: str, task: CaptureTask) -> str:
    """Twelve hexadecimal digits that change with anything that defines the task."""
    return configuration_hash(configuration(env_id, control_mode, task))


def configuration_hash(config: Mapping[str, Any]) -> str:
    """The same of a task's `configuration`, also after it was written as JSON and read again."""
    return sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:12]


def configuration(env_id: str, control_mode: str, task: CaptureTask) -> dict[str, Any]:
    """Everything that defines a task, apart from its split, as plain values."""
    settings = {**asdict(task), "timestep": task.step_size}
    del settings["split"]
    return {"env_id": env_id, "task_version": task.version, "control_mode": control_mode, **settings}


def episode_metrics(rollout: Rollout, task: CaptureTask) -> dict[str, Array]:
    """Metrics (K,) of recorded episodes: what they add up to (`Totals`), how they end, and attitude_cost.

    attitude_cost: eq. 20 times dt, from the base twist after each control period, as in the reward, m^2/s;
        docs/physics.md says how near the time integral that is.
    """
    alive = np.arange(rollout.torque.shape[1]) < rollout.length[:, None]  # (K, T) steps before the end
    twist = rollout.qvel[:, 1:, :6] * alive[..., None]  # rotation of the axes does not change eq. 20
    return {
        **{item.name: getattr(rollout, item.name) for item in fields(Totals)},
        "attitude_cost": attitude_cost(twist, task.control_period, task.c),
        "position_error": rollout.position_error[:, -1],
        "orientation_error": rollout.orientation_error[:, -1],
        "final_attitude": rollout.attitude[:, -1],
    }


def episode_records(
    rollout: Rollout, task: CaptureTask, entrant: Entrant, seed: int, first: int = 0, timing: Timing = UNTIMED
) -> list[EpisodeRecord]:
    """One record an episode, whose numbers within the seed begin with `first`."""
    metrics = episode_metrics(rollout, task)
    config = config_hash(entrant.task.env_id, entrant.control_mode, task)
    records = []
    for row in range(len(rollout.index)):
        captured = rollout.outcome[row] == Outcome.CAPTURED
        values: dict[str, Any] = {name: float(value[row]) for name, value in metrics.items()}
        steps = int(rollout.length[row])
        entered = steps - task.hold_steps
        records.append(
            EpisodeRecord(
                schema=SCHEMA_VERSION,
                env_id=entrant.task.env_id,
                policy=entrant.policy,
                control_mode=entrant.control_mode,
                difficulty=entrant.task.difficulty,
                split=entrant.task.split,
                index=int(rollout.index[row]),
                episode=first + row,
                seed=seed,
                config_hash=config,
                task_version=task.version,
                captured=captured,
                outcome=rollout.outcome[row],
                cause=rollout.cause[row],
                reason=rollout.reason[row],
                time_to_capture=steps * task.control_period if captured else None,
                time_to_envelope=entered * task.control_period if captured else None,
                steps=steps,
                episode_return=float(rollout.episode_return[row]),
                collisions=int(rollout.outcome[row] == "collision"),  # it ends the episode
                clipped_actions=int(rollout.clipped[row]),
                timing=timing,
                **values,
            )
        )
    return records


def episode_traces(rollout: Rollout, task: CaptureTask) -> Traces:
    """The course of the first episodes in time."""
    k = slice(0, TRACED)
    position = rollout.qpos[k, :, :3]
    return Traces(
        time=task.control_period * np.arange(rollout.qpos.shape[1]),
        length=rollout.length[k],
        attitude=rollout.attitude[k],
        base_rotation=np.rad2deg(logarithm(rollout.qpos[k, :, 3:7])),
        base_position=position - position[:, :1],
        position_error=rollout.position_error[k],
        orientation_error=rollout.orientation_error[k],
        joint_position=rollout.qpos[k, :, 7:],
    )
