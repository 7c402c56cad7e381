"""Small result folders as `evaluate.py` leaves them, for the tests of what reads them."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from synthetic_results import make_record

from space_envs.evaluation.play.episode_file import save_episodes
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.configuration import configuration_hash
from space_envs.evaluation.records.episode import SCHEMA_VERSION, EpisodeRecord
from space_envs.evaluation.records.storage import write_records
from space_envs.evaluation.results.result import EPISODES, entry_stem
from space_envs.registration import make_task
from space_envs.tasks.base import CaptureTask


def configuration(**changes: Any) -> dict[str, Any]:
    """A task's settings, as `summary.json` has them."""
    usual = {"env_id": "SpaceCapture/SingleArm-v0", "control_mode": "joint_velocity", "difficulty": "medium"}
    return {
        **usual,
        "task_version": CaptureTask.version,
        "horizon": 200,
        "envelope": {"position": 0.05, "hold": 1.0},
        **changes,
    }


def episodes(count: int = 3, config: Mapping[str, Any] | None = None, **changes: Any) -> list[EpisodeRecord]:
    """Records of a task with such settings."""
    config = configuration() if config is None else config
    own = {name: config[name] for name in ("env_id", "control_mode", "difficulty")}
    own["config_hash"] = configuration_hash(config)
    return [
        make_record(**{"episode": number, "index": 10 + number, **own, **changes}) for number in range(count)
    ]


def edit(path: Path, old: str, new: str) -> None:
    """Replace the first of a text in a file that has it."""
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def write_folder(
    path: Path,
    records: Sequence[EpisodeRecord],
    configurations: Sequence[Mapping[str, Any]] = (configuration(),),
    recorded: bool = False,
) -> Path:
    """Records, the summary with checksums and configurations, and made-up episodes if they are wanted."""
    path.mkdir(parents=True)
    write_records(path / "records.jsonl", records)
    written = [path / "records.jsonl"]
    if recorded:
        for entry in dict.fromkeys(record.entry for record in records):
            target = path / EPISODES / f"{entry_stem(entry)}.npz"
            save_episodes(target, made_episodes([record for record in records if record.entry == entry]))
            written.append(target)
    summary = {
        "schema": SCHEMA_VERSION,
        "provenance": {
            "command": f"evaluate.py --output {path.name}",
            "configurations": {configuration_hash(config): config for config in configurations},
        },
        "checksums": {
            each.relative_to(path).as_posix(): hashlib.sha256(each.read_bytes()).hexdigest()
            for each in written
        },
    }
    (path / "summary.json").write_text(json.dumps(summary), encoding="utf-8")
    return path


def made_episodes(records: Sequence[EpisodeRecord], horizon: int = 200) -> EpisodeBatch:
    """Recorded episodes of the records: joints rotate by an angle that says which episode it is."""
    first = records[0]
    task = make_task(first.env_id, {"difficulty": first.difficulty, "split": first.split})
    indices = np.array([record.index for record in records])
    scene = np.zeros((len(records), horizon + 1, task.render_model.nq))
    scene[..., 3] = 1.0
    scene[..., 7:] = np.linspace(0.0, 1.0, horizon + 1)[None, :, None]
    scene[..., 7] += np.array([record.episode for record in records])[:, None]
    flat = np.zeros((len(records), horizon + 1))
    return EpisodeBatch(
        entry=first.entry,
        robot=task.robot,
        period=task.control_period,
        scene=scene,
        base_pose=scene[..., :7],
        attitude=flat,
        position_error=flat,
        orientation_error=flat,
        length=np.array([record.metrics["steps"] for record in records]),
        seed=np.array([record.seed for record in records]),
        episode=np.array([record.episode for record in records]),
        index=indices,
        outcome=np.array([record.outcome for record in records]),
        goal=vars(task.goals(first.split, indices)),
    )
