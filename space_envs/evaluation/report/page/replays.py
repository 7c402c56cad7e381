"""The replays of a page as JSON: the scenes of its tasks, and every policy's motions."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.replay.packing import json_text, replay_values, scene_values, size_of
from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.scenes import ReplayMotion, make_motion, make_scene
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.tables.wording import row_name

REPLAY_CHARACTERS = 3_000_000  # of a page of ten million
_LONGEST_STRIDE = 50  # steps between two frames; what does not fit then is left as it is


def page_replays(
    tasks: Sequence[tuple[EvaluatedTask, list[Row]]],
    replays: Mapping[LeaderboardEntry, Sequence[Replay]],
    looks: Mapping[str, Look],
) -> dict[EvaluatedTask, dict[str, Any] | None]:
    """Replays of each task as the page shows them; None where a task has none.

    `json` has the policies and their motions. `scene` is the number of the task whose element holds the
    scene, and `scene_json` that scene, None where an earlier task has the same. Where there are so many
    replays that they would not fit, only every `stride`-th state is kept.
    """
    owners: dict[str, int] = {}  # by the scene's JSON
    made: dict[EvaluatedTask, dict[str, Any] | None] = {}
    motions: dict[LeaderboardEntry, list[tuple[Replay, ReplayMotion]]] = {}
    for number, (task, rows) in enumerate(tasks):
        shown = [row for row in rows if replays.get(row.entry)]
        if not shown:
            made[task] = None
            continue
        scene = make_scene(replays[shown[0].entry][0].task.render_model)
        text = json_text(scene_values(scene))
        owner = owners.setdefault(text, number)
        made[task] = {
            "scene": owner,
            "scene_json": text if owner == number else None,
            "entries": [row.entry for row in shown],
            "names": [display_name(row_name(row, rows)) for row in shown],
        }
        for row in shown:
            motions[row.entry] = [(replay, make_motion(replay, scene)) for replay in replays[row.entry]]
    stride, values = _fitting(motions)
    for found in filter(None, made.values()):
        policies = [
            {"name": name, "color": looks[entry.policy].color, "episodes": values[entry]}
            for name, entry in zip(found["names"], found["entries"], strict=True)
        ]
        found["json"] = json_text({"policies": policies})
        found["stride"] = stride
    return made


def _fitting(
    motions: Mapping[LeaderboardEntry, Sequence[tuple[Replay, ReplayMotion]]],
) -> tuple[int, dict[LeaderboardEntry, list[dict[str, Any]]]]:
    """Every motion's values, with the least stride between states with which all fit into the page."""
    stride = 1
    while True:
        values = {
            entry: [_shown(replay_values(*pair, stride)) for pair in pairs]
            for entry, pairs in motions.items()
        }
        size = sum(size_of(each) for group in values.values() for each in group)
        if size <= REPLAY_CHARACTERS or stride >= _LONGEST_STRIDE:
            return stride, values
        stride = max(stride + 1, math.floor(stride * size / REPLAY_CHARACTERS))


def _shown(values: dict[str, Any]) -> dict[str, Any]:
    """The values, with what others wrote made harmless for a line of text."""
    reason = values["reason"]
    return values | {"reason": None if reason is None else display_name(reason, 300)}
