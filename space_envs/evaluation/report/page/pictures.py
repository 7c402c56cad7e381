"""Pictures of captures on the page, shared evenly among its tasks."""

import base64
import io
from collections.abc import Mapping, Sequence

import numpy as np
from PIL import Image

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.replay.stills import Still
from space_envs.evaluation.report.tables.wording import row_name

PICTURE_CHARACTERS = 1_000_000  # of a page of ten million
# How many policies of each task are shown in pictures, and how wide these are, in pixels: the first that fit.
_PICTURED = ((3, 480), (2, 480), (2, 320), (1, 320), (1, 200), (1, 120))
TOO_MANY = "There are no pictures: those of so many tasks would make this page too large."
NOTHING_CAPTURED = "There are no pictures, since no policy captured anything here."
NONE_HERE = "There are no pictures of this task among these results."
NO_PICTURES = (
    "There are no pictures: none came with these results. They need a machine that can draw (OpenGL through "
    "EGL or OSMesa); the figures above do not."
)

Film = tuple[str, list[tuple[str, str]]]  # a policy's name; the time in s and the data URL of each still


def page_pictures(
    tasks: Sequence[tuple[EvaluatedTask, list[Row]]], pictures: Mapping[LeaderboardEntry, Sequence[Still]]
) -> dict[EvaluatedTask, list[Film]]:
    """Pictures of the first policies of each task: of as many and as large as every task has room for.

    Raises:
        ConfigurationError: for pictures that are none.
    """
    for count, width in _PICTURED:
        films = _films(tasks, pictures, count, width)
        if films is not None:
            return films
    return {task: [] for task, _ in tasks}


def _films(
    tasks: Sequence[tuple[EvaluatedTask, list[Row]]],
    pictures: Mapping[LeaderboardEntry, Sequence[Still]],
    count: int,
    width: int,
) -> dict[EvaluatedTask, list[Film]] | None:
    """Pictures of `count` policies of each task, `width` pixels wide; None where the page has no room."""
    room = PICTURE_CHARACTERS
    films: dict[EvaluatedTask, list[Film]] = {task: [] for task, _ in tasks}
    for task, rows in tasks:
        pictured = [(row, stills) for row in rows if (stills := pictures.get(row.entry))]
        for row, stills in pictured[:count]:
            film = [(f"{still.time:.1f}", _jpeg(row.policy, still, width)) for still in stills]
            room -= sum(len(url) for _, url in film)
            if room < 0:
                return None
            films[task].append((display_name(row_name(row, rows)), film))
    return films


def no_pictures_reason(
    rows: Sequence[Row], pictures: Mapping[LeaderboardEntry, Sequence[Still]], note: str
) -> str:
    """Reason why the task of the rows has no pictures; `note` is the reason why no task has any."""
    if not pictures:
        return note or NO_PICTURES
    if any(pictures.get(row.entry) for row in rows):
        return TOO_MANY
    return NONE_HERE if any(row.outcomes["captured"] for row in rows) else NOTHING_CAPTURED


def _jpeg(policy: str, still: Still, width: int) -> str:
    """A picture as a data URL, no wider than `width` pixels."""
    frame = np.asarray(still.frame)
    if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[-1] != 3:
        raise ConfigurationError(
            f"pictures of {policy!r} must be uint8 (height, width, 3), got {frame.dtype} {frame.shape}"
        )
    buffer = io.BytesIO()
    picture = Image.fromarray(frame)
    picture.thumbnail((width, picture.height))
    picture.save(buffer, format="JPEG", quality=85)
    return "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
